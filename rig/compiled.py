"""One decorator for every compiled function, and a cache that cannot go stale.

numba stores machine code beside the source and checks only the file in which a function stands: a
changed equation in `shaft.py` would not reach a cached kernel in `simulate.py`. So the cache
folder carries a hash of all sources of this package: any edit starts a fresh one.

No fast-math: the loop calls the functions one by one, the batch kernel inlines them, and both must
give the same bits.
"""

import hashlib
import os
import sys
from functools import partial
from pathlib import Path

import numba
from numba.core.config import reload_config


def _source_hash() -> str:
    """Hash of every source file of this package (hex, 16 characters)."""
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).parent.rglob("*.py")):
        digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def _cache_root() -> Path:
    if sys.platform == "win32":
        base = os.environ.get("LOCALAPPDATA")
    else:
        base = os.environ.get("XDG_CACHE_HOME")
    return Path(base) if base else Path.home() / ".cache"


if "NUMBA_CACHE_DIR" not in os.environ:
    os.environ["NUMBA_CACHE_DIR"] = str(_cache_root() / "balancing-table-rig" / _source_hash())
    reload_config()

_options = {"error_model": "numpy", "nogil": True, "no_cfunc_wrapper": True}
compiled = partial(numba.njit, cache=True, **_options)()
# For what stands inside a kernel's innermost loop: a call there would keep the compiler from
# working on several runs at once. It lives in its callers' cache.
inlined = partial(numba.njit, forceinline=True, **_options)()
