"""How are kernels compiled, and how does their cache stay valid?

numba stores machine code beside the source and checks only the file in which a function stands: a
change in `ellipse.py` would not reach a cached kernel in `tracing.py` that calls it. So the cache
folder carries a hash of all sources of the two packages with such kernels: any edit starts anew.
"""

import atexit
import hashlib
import os
import shutil
import sys
import tempfile
from collections.abc import Callable
from contextlib import suppress
from functools import partial, wraps
from pathlib import Path
from typing import Any

import numba
from numba.core.caching import Cache
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


def _why_not(folder: Path) -> str:
    """Why compiled functions are not kept in a folder, with the cure; "": they are. What lies there
    is executed, so nobody else may have put it there.
    """
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            about = folder.stat()
    except OSError:
        return "let XDG_CACHE_HOME name a folder that you can write to"
    if sys.platform != "win32" and (about.st_uid != os.geteuid() or about.st_mode & 0o022):
        return (
            "others can write to it, and its files are executed: remove it, or make it yours alone"
        )
    return ""


def _choose_cache() -> str:
    """Name the cache's folder to numba; return why it is not the usual one, "" where it is.

    A folder that cannot be used gives way to one of this program and its children, which is removed
    in the end. Beside the sources, where numba would go next, nothing tells it that what a function
    calls has changed.
    """
    given = os.environ.get("NUMBA_CACHE_DIR")
    folder = Path(given) if given else _cache_root() / "balancing-table-rig" / _source_hash()
    note = ""
    if why := _why_not(folder):
        note = f"compiled functions are not kept in {folder}, but compiled for every program: {why}"
        folder = Path(tempfile.mkdtemp(prefix="balancing-table-rig-"))
        atexit.register(shutil.rmtree, folder, ignore_errors=True)
    os.environ["NUMBA_CACHE_DIR"] = str(folder)
    reload_config()
    return note


def is_compiled(package: str) -> bool:
    """Whether kernels of the package of this name ("detection") were kept: else their first calls
    take a minute."""
    return any(Path(os.environ["NUMBA_CACHE_DIR"]).glob(f"{package}_*/*.nbi"))


def _mended(load: Callable[..., Any]) -> Callable[..., Any]:
    """Numba's `load`, for which what cannot be loaded is not there: it is compiled anew. A power
    cut leaves files that are empty, or end too early."""

    @wraps(load)
    def load_or_forget(cache: Cache, *args: Any) -> Any:
        try:
            return load(cache, *args)
        except Exception:  # whatever pickle, numba or LLVM say of such bytes
            with suppress(OSError):
                cache.flush()
            return None

    return load_or_forget


def _with_room(save: Callable[..., None]) -> Callable[..., None]:
    """Numba's `save`, for which a full disk keeps nothing: what was compiled works all the same."""

    @wraps(save)
    def save_or_not(*args: Any) -> None:
        with suppress(OSError):
            save(*args)

    return save_or_not


CACHE_NOTE = _choose_cache()
Cache.load_overload = _mended(Cache.load_overload)
Cache.save_overload = _with_room(Cache.save_overload)

# Division by zero gives inf or NaN, for which every caller tests.
kernel = partial(numba.njit, cache=True, error_model="numpy")()
# Where sums over pixels may be taken in any order.
fast_kernel = partial(numba.njit, cache=True, error_model="numpy", fastmath=True)()
