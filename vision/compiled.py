"""How are kernels compiled, and how does their cache stay valid?

numba stores machine code beside the source and checks only the file in which a function stands: a
change in `ellipse.py` would not reach a cached kernel in `tracing.py` that calls it. So the cache
folder carries a hash of all sources of the two packages with such kernels: any edit starts anew.
"""

import hashlib
import os
import sys
from functools import partial
from pathlib import Path

import numba
from numba.core.config import reload_config


def _source_hash() -> str:
    """Hash of every source file of `vision` and `rig` (hex, 16 characters)."""
    digest = hashlib.sha256()
    top = Path(__file__).parents[1]
    for path in sorted(p for name in ("vision", "rig") for p in (top / name).rglob("*.py")):
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

# Division by zero gives inf or NaN, for which every caller tests.
kernel = partial(numba.njit, cache=True, error_model="numpy")()
# Where sums over pixels may be taken in any order.
fast_kernel = partial(numba.njit, cache=True, error_model="numpy", fastmath=True)()
