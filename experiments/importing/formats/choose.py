"""Which reader a file or folder needs."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from experiments.importing.columns.quaternions import with_tilts
from experiments.importing.columns.row_order import in_order
from experiments.importing.columns.side_by_side import parted
from experiments.importing.columns.split_stamps import whole_stamps
from experiments.importing.columns.turns import unwound
from experiments.importing.formats.bag_folder import is_bag
from experiments.importing.formats.bags import read_bag
from experiments.importing.formats.hdf5_files import read_hdf5
from experiments.importing.formats.json_files import read_json, read_json_lines
from experiments.importing.formats.matlab import read_matlab
from experiments.importing.formats.numpy_files import read_npy, read_npz
from experiments.importing.formats.packed import ENDING, unpacked
from experiments.importing.formats.tables import read_lerobot, read_parquet
from experiments.importing.formats.tdms import read_tdms
from experiments.importing.formats.text_tables.text import read_text
from experiments.importing.formats.workbooks import read_workbook
from experiments.importing.recording import BadFileError, Recording, Stream, joined
from rig.files import printable

# Characters; chosen: a library may name what it met by its bytes, a file of five lists columns.
LONGEST_WORDS = 500

READERS = {
    ".csv": read_text,
    ".txt": read_text,
    ".tsv": read_text,
    ".dat": read_text,
    ".log": read_text,
    ".lvm": read_text,
    ".jsonl": read_json_lines,
    ".ndjson": read_json_lines,
    ".json": read_json,
    ".mat": read_matlab,
    ".h5": read_hdf5,
    ".hdf5": read_hdf5,
    ".npz": read_npz,
    ".npy": read_npy,
    ".tdms": read_tdms,
    ".parquet": read_parquet,
    ".mcap": read_bag,
    ".xlsx": read_workbook,
    ".xlsm": read_workbook,
}


def read_recording(path: Path) -> Recording:
    """Read a file, a LeRobot data set's folder or a ROS 2 bag's folder.

    FileNotFoundError: nothing is there. BadFileError (one line, with the path): not readable.
    """
    if not path.exists():
        raise FileNotFoundError(f"{path} does not exist")
    if odd := _without_an_end(path):
        raise BadFileError(f"{odd} is no file but a pipe or a device, which may have no end")
    if path.is_dir():
        if all((path / name).is_file() for name in ("run.json", "samples.mcap")):
            raise BadFileError(f"{path} is a run of the rig: rig gap and report take it as it is")
        lerobot = (path / "meta" / "info.json").is_file()
        bag = is_bag(path)
        reader = read_lerobot if lerobot else read_bag if bag else None
    elif path.suffix.lower() == ENDING:
        reader = _read_packed if _reader_of(path.with_suffix("")) else None
    else:
        reader = _reader_of(path)
    if reader is None:
        raise BadFileError(
            f"{path}: no kind of recording that is known: {', '.join(READERS)}, the folder "
            "of a LeRobot data set (with meta/info.json) or of a ROS 2 bag, or one of these files "
            f"with {ENDING} behind; save a spreadsheet as .xlsx or .csv, unpack what else is packed"
        )
    try:
        with np.errstate(all="ignore"):  # damaged floats warn where they become doubles
            streams = [part for one in reader(path) for part in parted(whole_stamps(one))]
            return joined([unwound(with_tilts(in_order(one))) for one in streams])
    except BadFileError as error:
        raise BadFileError(f"{path}: {printable(error)[:LONGEST_WORDS]}") from error


def _reader_of(path: Path) -> Callable[[Path], list[Stream]] | None:
    return READERS.get(path.suffix.lower())


def _read_packed(path: Path) -> list[Stream]:
    """The streams of a file that was packed. BadFileError: as of its reader, or damaged."""
    with unpacked(path) as inside:
        reader = _reader_of(inside)
        return reader(inside) if reader else []


def _without_an_end(path: Path) -> Path | None:
    """What is no file there or within: a pipe, a socket or a device, None: nothing is."""
    parts = [path, *(path.rglob("*") if path.is_dir() else ())]
    return next(
        (one for one in parts if one.exists() and not (one.is_file() or one.is_dir())), None
    )
