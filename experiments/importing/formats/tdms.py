"""Read LabVIEW's TDMS files: one stream a group, its clock from the channels' waveform settings.

A waveform begins `wf_start_offset` after `wf_start_time`; times count from the first start.
npTDMS's time_track wants both properties of every channel, and counts from its own start.
"""

import logging
import struct
from pathlib import Path

import numpy as np

from experiments.importing.formats.extra import library
from experiments.importing.recording import BadFileError, Stream, check_size

MOST_SCALES = 100  # of a channel, in a row; chosen: ten times what LabVIEW's own programs make
SECOND = np.timedelta64(1, "s")
NOT_SET = np.datetime64("1904-01-01")  # zero, in LabVIEW's count of seconds
# A segment's first bytes: tag, contents, version, bytes behind these, of which so many its names.
LEAD_IN = 28
HAS_NAMES, HIGH_FIRST = 1 << 1, 1 << 6  # bits of the contents
CUT_OFF = "the file was cut off: read as far as it goes"


def read_tdms(path: Path) -> list[Stream]:
    """Read every channel of numbers. BadFileError: damaged, too large, or npTDMS is missing."""
    nptdms = library("nptdms", "TDMS")
    logging.disable(logging.WARNING)  # of a damaged file it prints the bytes
    try:
        with nptdms.TdmsFile.open(path) as file:
            cut = file.file_status.incomplete_final_segment or not _is_whole(path)
            notes = (CUT_OFF,) if cut else ()
            waves = [one for group in file.groups() for one in group.channels() if _step_s(one) > 0]
            starts = [_start(one) for one in waves]
            first = min((start for start in starts if start != NOT_SET), default=NOT_SET)
            if first != NOT_SET and NOT_SET in starts:
                notes += ("waveforms without a start are taken to begin with the first one",)
            groups = file.groups()
            return [one for group in groups for one in _streams(file, group, first, notes)]
    except BadFileError:
        raise
    except Exception as error:  # of damaged bytes npTDMS raises whatever it meets
        raise BadFileError(f"not readable as TDMS ({error})") from error
    finally:
        logging.disable(logging.NOTSET)


def _is_whole(path: Path) -> bool:
    """Whether each segment ends where it says, the last one at the file's end, with its names.

    npTDMS says so of a segment that lacks numbers, not of one whose names were cut off.
    """
    size, at = path.stat().st_size, 0
    with path.open("rb") as file:
        while at < size:
            file.seek(at)
            head = file.read(LEAD_IN)
            if len(head) < LEAD_IN:
                return False
            (contents,) = struct.unpack_from("<I", head, 4)
            order = ">" if contents & HIGH_FIRST else "<"
            length, names = struct.unpack_from(f"{order}QQ", head, 12)
            if not (bool(contents & HAS_NAMES) <= names <= length <= size - at - LEAD_IN):
                return False
            at += LEAD_IN + length
    return True


def _step_s(channel) -> float:
    """Seconds between a waveform's samples, 0: it is none."""
    return float(channel.properties.get("wf_increment", 0.0))


def _start(channel) -> np.datetime64:
    """The date at which a waveform was started, NOT_SET: unknown."""
    start = channel.properties.get("wf_start_time", NOT_SET)
    return start if isinstance(start, np.datetime64) and not np.isnat(start) else NOT_SET


def _begin_s(channel, first: np.datetime64) -> float:
    """Seconds from the file's first start to a waveform's first sample."""
    start, offset_s = _start(channel), float(channel.properties.get("wf_start_offset", 0.0))
    return offset_s if start == NOT_SET else offset_s + float((start - first) / SECOND)


def _streams(file, group, first: np.datetime64, notes: tuple[str, ...]) -> list[Stream]:
    """Streams of a group: channels of one length and one waveform clock share one.

    first: the earliest start of any waveform of the file.
    """
    found: dict[tuple[int, float, float], dict[str, np.ndarray]] = {}
    units: dict[str, str] = {}
    for channel in group.channels():
        check_size(len(channel), len(group.channels()))
        for known in (channel.properties, group.properties, file.properties):
            if (scales := known.get("NI_Number_Of_Scales", 0)) > MOST_SCALES:
                raise BadFileError(f"{channel.name} has {scales} scales (limit: {MOST_SCALES})")
        if len(channel) == 0 or channel.dtype.kind not in "fiubM":
            continue
        name = f"{group.name}/{channel.name}"
        step_s = _step_s(channel)
        begin_s = _begin_s(channel, first) if step_s > 0 else 0.0
        values = np.asarray(channel[:])
        if values.dtype.kind == "M":
            values = values.astype("datetime64[us]").astype(np.int64) / 1e6
            units[name] = "s"
        found.setdefault((len(channel), step_s, begin_s), {})[name] = values.astype(np.float64)
        unit = channel.properties.get("unit_string")
        if isinstance(unit, str) and unit:
            units[name] = unit
    streams = []
    for i, ((rows, step_s, begin_s), columns) in enumerate(found.items()):
        time = None
        if step_s > 0:
            time = f"{group.name}/time{i + 1 if i else ''}"
            columns = {time: begin_s + np.arange(rows) * step_s, **columns}
            units[time] = "s"
        own = {name: unit for name, unit in units.items() if name in columns}
        streams.append(Stream(columns, own, time, notes=notes))
    return streams
