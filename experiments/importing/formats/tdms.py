"""Read LabVIEW's TDMS files: one stream a group, its clock from the channels' waveform settings."""

import logging
from pathlib import Path

import numpy as np

from experiments.importing.formats.extra import library
from experiments.importing.recording import BadFileError, Stream, check_size

MOST_SCALES = 100  # of a channel, in a row; chosen: ten times what LabVIEW's own programs make


def read_tdms(path: Path) -> list[Stream]:
    """Read every channel of numbers. BadFileError: damaged, too large, or npTDMS is missing."""
    nptdms = library("nptdms", "TDMS")
    logging.disable(logging.WARNING)  # of a damaged file it prints the bytes
    try:
        with nptdms.TdmsFile.open(path) as file:
            cut = file.file_status.incomplete_final_segment
            notes = ("the file was cut off: read as far as it goes",) if cut else ()
            return [stream for group in file.groups() for stream in _streams(file, group, notes)]
    except BadFileError:
        raise
    except Exception as error:  # of damaged bytes npTDMS raises whatever it meets
        raise BadFileError(f"not readable as TDMS ({error})") from error
    finally:
        logging.disable(logging.NOTSET)


def _streams(file, group, notes: tuple[str, ...]) -> list[Stream]:
    """Streams of a group: channels of one length and one waveform clock share one."""
    found: dict[tuple[int, float], dict[str, np.ndarray]] = {}
    units: dict[str, str] = {}
    for channel in group.channels():
        check_size(len(channel), len(group.channels()))
        for known in (channel.properties, group.properties, file.properties):
            if (scales := known.get("NI_Number_Of_Scales", 0)) > MOST_SCALES:
                raise BadFileError(f"{channel.name} has {scales} scales (limit: {MOST_SCALES})")
        if len(channel) == 0 or channel.dtype.kind not in "fiubM":
            continue
        name = f"{group.name}/{channel.name}"
        step_s = float(channel.properties.get("wf_increment", 0.0))
        values = np.asarray(channel[:])
        if values.dtype.kind == "M":
            values = values.astype("datetime64[us]").astype(np.int64) / 1e6
            units[name] = "s"
        found.setdefault((len(channel), step_s), {})[name] = values.astype(np.float64)
        unit = channel.properties.get("unit_string")
        if isinstance(unit, str) and unit:
            units[name] = unit
    streams = []
    for i, ((rows, step_s), columns) in enumerate(found.items()):
        time = None
        if step_s > 0:
            time = f"{group.name}/time{i + 1 if i else ''}"
            columns = {time: np.arange(rows) * step_s, **columns}
            units[time] = "s"
        own = {name: unit for name, unit in units.items() if name in columns}
        streams.append(Stream(columns, own, time, notes=notes))
    return streams
