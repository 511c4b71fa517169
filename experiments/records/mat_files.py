"""Read the variables of a MAT file: version 5 through scipy, version 7.3 (which is HDF5) by h5py.

Columns may be variables of their own, or the fields of one struct that has `t_s`.
"""

import struct
import zlib
from collections.abc import Callable, Iterator
from contextlib import suppress
from io import BytesIO
from math import prod
from pathlib import Path
from typing import Any

import numpy as np

from experiments.records.mat5_sizes import Matrix
from experiments.records.unpacking import LEAST_BYTES, MOST_RATIO
from rig.log import INDEX

DEFLATE, SHUFFLE, FLETCHER32 = 1, 2, 3  # filters, by HDF5's own numbers
MOST_DEFLATED = 1032  # bytes out to bytes in, of what zlib packs (its own documentation)
MOST_BYTES = 800_000_000  # of a file's unpacked variables; chosen: a day of ten signals at 100 Hz


def read_mat(path: Path) -> dict[str, Any]:
    """Variables of a MAT file (version 5 or 7.3), or fields of its one struct with `t_s`, by name.

    ValueError: damaged, no MAT file, it unpacks to more than `MOST_BYTES`, or it holds a MATLAB
    table or object.
    """
    from scipy.io import loadmat

    try:
        check_inflated(path, MOST_BYTES)
        found = loadmat(path, appendmat=False, spmatrix=False)
    except NotImplementedError:  # what scipy raises for version 7.3
        return _read_hdf5(path)
    except Exception as error:  # of damaged bytes scipy raises whatever it meets
        raise ValueError(f"not readable as a MAT file ({error})") from error
    found = {name: value for name, value in found.items() if not name.startswith("__")}
    if "t_s" not in found:
        for value in found.values():
            fields = value.dtype.names or ()
            if "t_s" in fields and value.size == 1:
                return {name: value[name].item() for name in fields}
            _refuse_object({"s0", "arr"} <= set(fields))
    return found


def check_inflated(path: Path, most: int) -> None:
    """Check what the variables of a file of version 5 unpack to, and that they hold what they
    claim, before they are read.

    ValueError: more than `most` bytes, or not. zlib.error: they are damaged.
    """
    data, at = path.read_bytes(), 128
    order = "<" if data[126:128] == b"IM" else ">"
    if 0 in data[:4] or data[124:126] not in (b"\0\1", b"\1\0"):  # version 4, or 7.3
        return
    room = [most]
    while at + 8 <= len(data):
        kind, size = struct.unpack_from(order + "II", data, at)
        if kind == 15:  # miCOMPRESSED
            read = _inflated(data[at + 8 : at + 8 + size], room, most)
        else:
            read = BytesIO(data[at : at + 8 + size]).read
        Matrix(read, order).check()
        while read(1 << 24):
            pass
        at += 8 + size


def _inflated(rest: bytes, room: list[int], most: int) -> Callable[[int], bytes]:
    """What reads unpacked bytes. ValueError: more than `room` [bytes], of `most`."""
    unpack, held = zlib.decompressobj(), bytearray()

    def read(size: int) -> bytes:
        nonlocal rest
        while len(held) < size and rest:
            part = unpack.decompress(rest, 1 << 20)
            rest = unpack.unconsumed_tail
            room[0] -= len(part)
            if room[0] < 0:
                raise ValueError(f"it unpacks to more than {most} bytes: save less")
            held.extend(part)
        data = bytes(held[:size])
        del held[:size]
        return data

    return read


def _refuse_object(is_object: bool) -> None:
    """ValueError where a table or timetable was saved: only MATLAB itself can read those."""
    if is_object:
        raise ValueError(
            "it holds a MATLAB table or object: save a struct, as of table2struct(T, 'ToScalar', 1)"
        )


def _read_hdf5(path: Path) -> dict[str, Any]:
    """Read a file of version 7.3; every array lies there transposed, which a column survives."""
    import h5py

    try:
        with h5py.File(path, "r") as file:
            _refuse_object("#subsystem#" in file and "t_s" not in file)
            return _columns(_with_time(file, h5py.Group))
    except (OSError, RuntimeError, KeyError) as error:
        raise ValueError(f"not readable as a MAT file of version 7.3 ({error})") from error


def _with_time(file: Any, group: type) -> Any:
    """Return the group that has `t_s`: the file itself, or the one struct that does."""
    if "t_s" not in file:
        for _, value in members(file):
            if isinstance(value, group) and "t_s" in value:
                return value
    return file


def _columns(group: Any) -> dict[str, Any]:
    """Name -> array of a group's datasets; of names that nobody asks for only the name."""
    found: dict[str, Any] = {}
    for name, value in members(group):
        if name not in INDEX:
            found[name] = np.empty(0)
        elif not hasattr(value, "dtype"):  # a group: a struct or an object
            raise ValueError(f"{name} is no column of numbers (it is a struct or an object)")
        elif value.attrs.get("MATLAB_empty", 0):  # the sizes are stored in the place of numbers
            found[name] = np.empty(0)
        elif value.attrs.get("MATLAB_class") == b"char":
            found[name] = np.array("text")
        elif value.dtype.kind not in "fiub":  # of texts, many may be one, which is not unpacked
            raise ValueError(f"{name} is no column of numbers (it is {value.dtype})")
        else:
            found[name] = _numbers(value, name)
    return found


def members(group: Any) -> Iterator[tuple[str, Any]]:
    """Yield name and content of what a group of HDF5 holds, less MATLAB's own (#...).

    ValueError: one lies in another file, whichever way it is led to: else a file from a stranger
    would read any file of this machine; or it is led to nothing.
    """
    import h5py

    for name in group:
        if isinstance(group.get(name, getlink=True), h5py.ExternalLink):
            raise ValueError(f"{name} lies in another file: save the numbers themselves")
        if not name.startswith("#"):
            if (value := group.get(name)) is None:
                raise ValueError(f"{name} is a link to nothing: delete it, or save it again")
            yield name, in_file(group.file, name, value)


def in_file(file: Any, name: str, value: Any) -> Any:
    """Return a dataset or group of an HDF5 file. ValueError: it lies in another one, such as behind
    a soft link over an external one, or in external storage.
    """
    elsewhere = value.file.filename != file.filename
    if elsewhere or getattr(value, "external", None) or getattr(value, "is_virtual", False):
        raise ValueError(f"{name} lies in another file: save the numbers themselves")
    return value


def _numbers(dataset: Any, name: str) -> np.ndarray:
    """All numbers of a column. ValueError: they are more than a file of this size can hold."""
    held = max(Path(dataset.file.filename).stat().st_size * MOST_RATIO, LEAST_BYTES)
    if dataset.nbytes > held:
        raise ValueError(f"{name} claims {dataset.nbytes} bytes, more than its file can hold")
    check_chunks(dataset, name)
    return dataset[()]


def check_chunks(dataset: Any, name: str) -> None:
    """Check what the chunks of a dataset of HDF5 become, which are unpacked whole, whatever size
    they claim. ValueError: one holds more than the dataset, or was packed twice.
    """
    if not dataset.chunks:
        return
    size = prod(dataset.chunks) * dataset.dtype.itemsize
    made = dataset.id.get_create_plist()
    filters = [made.get_filter(i)[0] for i in range(made.get_nfilters())]
    packed = [one for one in filters if one not in (SHUFFLE, FLETCHER32)]
    most, chunks = size + LEAST_BYTES, []
    too_much = len(packed) > 1 or size > max(dataset.nbytes, LEAST_BYTES)
    if packed == [DEFLATE] and not too_much:
        dataset.id.chunk_iter(chunks.append)
    for chunk in (one for one in chunks if one.size * MOST_DEFLATED > most):
        packed_bytes = dataset.id.read_direct_chunk(chunk.chunk_offset)[1]
        with suppress(zlib.error):  # damaged, as HDF5 will say, or not packed
            unpacked = zlib.decompressobj().decompress(packed_bytes, most + 1)
            too_much = too_much or len(unpacked) > most
    if too_much:
        raise ValueError(f"{name} unpacks to more than it holds: save the numbers themselves")
