"""A table as a model that other programs simulate: MuJoCo's XML or a Functional Mock-up Unit."""

from pathlib import Path

from experiments.export.intervals import read_intervals
from rig.files import printable, write_whole
from rig.parameters import Rig

MJCF, FMU = "mjcf", "fmu"
KINDS = {MJCF: ".xml", FMU: ".fmu"}


def export_model(
    rig: Rig, name: str, kind: str, out: Path, *, intervals: Path | None = None
) -> list[str]:
    """Write the model of a rig, effects included, to `out`; returns what it does not carry.

    name: what the model is called; kind: "mjcf" or "fmu"; intervals: an answer of `rig gap` (JSON),
    whose intervals become least and greatest values of the FMU's parameters. Each returned line
    also stands in the file. ValueError (one line): an unknown kind, a wrong ending, intervals for
    MJCF, no C compiler. OSError: a file cannot be read or written. RuntimeError: the C compiler
    failed.
    """
    name = printable(name)
    if kind not in KINDS:
        raise ValueError(f"--as {kind}: must be {' or '.join(KINDS)}")
    if out.suffix != KINDS[kind]:
        raise ValueError(f"--out {out}: must end in {KINDS[kind]} for --as {kind}")
    if not out.absolute().parent.is_dir():
        raise ValueError(f"--out {out}: no such folder {out.parent}; make it first")
    if kind == MJCF:
        if intervals is not None:
            raise ValueError("--intervals: MuJoCo's XML has no place for intervals; use --as fmu")
        from experiments.export.mjcf.model import mjcf

        text, told = mjcf(rig, name)
        write_whole(out, text.encode())
        return told
    from experiments.export.fmu.archive import write_fmu

    found, told = ({}, []) if intervals is None else read_intervals(intervals, rig)
    return write_fmu(rig, name, out, found, told)
