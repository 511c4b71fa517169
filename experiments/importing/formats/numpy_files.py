"""Read NumPy's files: arrays by name (.npz), or one array of rows (.npy)."""

from pathlib import Path
from zipfile import ZipFile

import numpy as np

from experiments.importing.formats.matlab import streams_of
from experiments.importing.recording import MAX_CELLS, BadFileError, Stream, check_size
from rig.foreign_call import in_words


def read_npz(path: Path) -> list[Stream]:
    """Read every array of numbers of an .npz file; one without numbers is left out.

    BadFileError: damaged, too large, or it holds no rows of numbers.
    """
    try:
        with ZipFile(path) as packed:
            check_size(sum(part.file_size for part in packed.infolist()) // 8, 1)
        with np.load(path, allow_pickle=False) as file:
            tree = {name: value for name in file.files if (value := _numbers(file, name)).size}
    except BadFileError:
        raise
    except Exception as error:  # of damaged or packed members zipfile, zlib and NumPy raise many
        raise BadFileError(f"not readable as an .npz file ({in_words(error)})") from error
    return _some(tree)


def read_npy(path: Path) -> list[Stream]:
    """Read the rows of an .npy file, one column of numbers after the other.

    BadFileError: damaged, too large, Python's own objects, or no rows of numbers.
    """
    try:
        found = np.load(path, mmap_mode="r", allow_pickle=False)
    except Exception as error:  # a header is Python's own text: its parser raises what it likes
        raise BadFileError(f"not readable as an .npy file ({in_words(error)})") from error
    check_size(found.size, 1)
    if not found.size or not found.ndim:
        return _some({})
    if found.dtype.names:
        return _some({name: np.array(found[name]) for name in found.dtype.names})
    columns = found.reshape(len(found), -1)
    check_size(*columns.shape)
    names = [f"column {i + 1}" for i in range(columns.shape[1])]
    return _some({name: np.array(columns[:, i]) for i, name in enumerate(names)})


def _numbers(file: np.lib.npyio.NpzFile, name: str) -> np.ndarray:
    """The array `name`; an empty one where it holds Python's own objects, or is none."""
    try:
        found = file[name]
    except ValueError:  # an object would have to be unpickled, which runs its code
        return np.empty(0)
    return found if isinstance(found, np.ndarray) else np.empty(0)


def _some(tree: dict[str, np.ndarray]) -> list[Stream]:
    kept = {name: value for name, value in tree.items() if value.dtype.kind in "fiub"}
    streams = [stream for stream in streams_of(kept) if len(stream)]
    if not streams:
        raise BadFileError(f"it holds no rows of numbers (limit: {MAX_CELLS} cells)")
    return streams
