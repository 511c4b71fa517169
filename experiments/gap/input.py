"""What `rig gap LOG...` takes: several logs of one table, the nominal rig, what is known of them.

Nothing here opens truth.json: the answer is the same without it.
"""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from experiments.gap.checks import TooShortError, check, step_of
from experiments.records.importing import read_log, read_logs, refuse_same_rows
from experiments.records.run_folder import read_meta, refuse_twice
from experiments.runs.assemble import load_rig
from rig.log import INDEX, Log, Phase, exposures
from rig.parameters import Rig
from rig.rigfile import from_dict, own_names

SAME_RIG = ("servo", "linkage", "ball", "camera", "drive", "walls")
STEP_TOLERANCE = 0.02  # encoder steps of one rig's logs differ by less


@dataclass(frozen=True, eq=False)
class GapInput:
    """Logs of one table, in the order given; every tuple but `notes` has one entry for each log.

    rig: the nominal rig (from --rig, else of the run folders, else the default table); rigs: the
    nominal rig with the gains and control rate of each run; names: short and all different;
    sources: "run folder" or "file"; arms, protocols (as stored in run.json) and seeds: None where
    not known; notes: what was odd, as sentences.
    """

    logs: tuple[Log, ...]
    rig: Rig
    rigs: tuple[Rig, ...]
    names: tuple[str, ...]
    sources: tuple[str, ...]
    arms: tuple[str | None, ...]
    protocols: tuple[dict[str, Any] | None, ...]
    seeds: tuple[int | None, ...]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class _One:
    """One log as read: the file or folder, and of a run folder what run.json says."""

    path: Path
    log: Log
    meta: dict[str, Any] | None = None
    rig: Rig | None = None

    @property
    def own(self) -> dict[str, str]:
        """Effects of a lab's own in the run's rig, name -> file; a recording's are not executed."""
        return own_names((self.meta or {}).get("rig") or {})


def read_evidence(
    paths: Sequence[Path], rig_file: Path | None = None, from_s: float = 0.0
) -> GapInput:
    """Read and check every log and the rig that `rig gap` works on.

    paths: run folders (or their samples.mcap), .csv, .parquet or .mat files; rig_file: the nominal
    model; from_s: of every file, what comes before this time since its first row is left out (a
    hand at the ball, say). Rejected runs and logs that are too short are left out with a note.
    FileNotFoundError, ValueError (one line): a file is missing or not readable, no log is left, or
    a log is named twice, of another rig, in other units, with axes or signs swapped, or too short.
    """
    if not paths:
        raise ValueError("no log given: name run folders, .csv, .parquet or .mat files")
    given = load_rig(rig_file) if rig_file is not None else None
    read, notes = _kept([one for path in paths for one in _read(Path(path))])
    read = [_later(one, from_s) for one in read] if from_s else read
    names = _names([one.path for one in read])
    rig, more = _nominal(read, names, given)
    notes += [*more, *_left_out(read, names, rig)]
    logs, odd = _checked(read, names, rig)
    notes += odd
    read = [one for one, log in zip(read, logs, strict=True) if log is not None]
    names = [name for name, log in zip(names, logs, strict=True) if log is not None]
    whole = tuple(log for log in logs if log is not None)
    _check_alike(whole, names)
    metas = [one.meta or {} for one in read]
    return GapInput(
        logs=whole,
        rig=rig,
        rigs=tuple(_of_run(rig, one.rig) for one in read),
        names=tuple(names),
        sources=tuple("file" if one.meta is None else "run folder" for one in read),
        arms=tuple(meta.get("arm") for meta in metas),
        protocols=tuple(_dictionary(meta.get("protocol")) for meta in metas),
        seeds=tuple(meta.get("seed") for meta in metas),
        notes=tuple(notes),
    )


def _read(path: Path) -> list[_One]:
    """Read the logs of a path, several where a file holds several runs. FileNotFoundError,
    ValueError: it cannot be."""
    folder = path.parent if path.name == "samples.mcap" else path
    if not folder.is_dir():
        logs = read_logs(path)
        if len(logs) == 1:
            return [_One(path, logs[0])]
        parts = [path.with_name(f"{path.name} run {i + 1}") for i in range(len(logs))]
        return [_One(part, log) for part, log in zip(parts, logs, strict=True)]
    if not (folder / "run.json").is_file():
        runs = sorted(file.parent.name for file in folder.glob("*/run.json"))
        within = f"; name the {len(runs)} inside it ({runs[0]} ...)" if runs else ""
        raise FileNotFoundError(f"{folder} is no run folder: it has no run.json{within}")
    log = read_log(folder)
    meta = read_meta(folder)
    try:
        rig = from_dict(meta["rig"]) if meta.get("rig") else None
    except ValueError as error:
        raise ValueError(f"{folder}: the rig of run.json cannot be used: {error}") from error
    return [_One(folder, log, meta, rig)]


def _later(one: _One, from_s: float) -> _One:
    """A file without what comes before from_s [s]. ValueError: it is a run folder, or shorter."""
    if one.meta is not None:
        raise ValueError(
            f"{one.path}: --from is for files of other programs; a run folder tells by itself when "
            "the ball was let go, and its closed loop is repeated as a whole"
        )
    t_s = one.log["t_s"]
    rows = one.log.rows[t_s >= t_s[0] + from_s]
    if not len(rows):
        raise ValueError(
            f"{one.path}: --from {from_s:g} is beyond its end, {t_s[-1] - t_s[0]:.3g} s"
        )
    words = f"its first {from_s:g} s are left out, as was asked for"
    return replace(one, log=Log.from_rows(rows, notes=(*one.log.notes, words)))


def _checked(
    read: Sequence[_One], names: Sequence[str], rig: Rig
) -> tuple[list[Log | None], list[str]]:
    """Return the logs without what a person did, None for one too short, and what is odd in them.

    ValueError: a log cannot be used, or every one is too short.
    """
    logs: list[Log | None] = []
    notes: list[str] = []
    for one, name in zip(read, names, strict=True):
        log = released(one.log, rig.camera.delay_s)
        try:
            odd = check(log, rig)
        except TooShortError as error:
            if name == names[-1] and all(log is None for log in logs):
                raise TooShortError(f"{one.path}: {error}") from error
            logs.append(None)
            notes.append(f"{name} is left out: {error}")
        except ValueError as error:
            raise ValueError(f"{one.path}: {error}") from error
        else:
            logs.append(log)
            notes += [f"{name}: {text}" for text in (*log.notes, *odd)]
    return logs, notes


def _kept(read: list[_One]) -> tuple[list[_One], list[str]]:
    """Return the logs that nobody rejected, and what to say. ValueError: none is left."""
    notes = [
        f"{one.path.name} was rejected ({one.meta['rejected']}) and is left out"
        for one in read
        if one.meta and one.meta.get("rejected")
    ]
    kept = [one for one in read if not (one.meta and one.meta.get("rejected"))]
    if not kept:
        raise ValueError(f"no log left to work on: {'; '.join(notes)}")
    return kept, notes


def _names(paths: Sequence[Path]) -> list[str]:
    """Short names that differ. ValueError: a log is named twice."""
    refuse_twice(paths)
    resolved = [path.resolve() for path in paths]
    short = [path.name for path in resolved]
    if len(set(short)) == len(short):
        return short
    return [f"{path.parent.name}/{path.name}" for path in resolved]


def _nominal(
    read: Sequence[_One], names: Sequence[str], given: Rig | None
) -> tuple[Rig, list[str]]:
    """Return the nominal rig, and notes. ValueError: run folders of different rigs."""
    known = [(name, one.rig) for name, one in zip(names, read, strict=True) if one.rig is not None]
    if given is not None:
        notes = []
        for name, rig in known:
            other = list(rig_differences(given, rig))
            if other:
                notes.append(f"{name} was recorded with another rig file ({other[0]})")
        return given, notes
    if not known:
        return Rig(), ["no rig file given: the default table is assumed (--rig names another)"]
    first_name, first = known[0]
    for name, rig in known[1:]:
        other = list(rig_differences(first, rig))
        if other:
            raise ValueError(
                f"{first_name} and {name} are of different rigs ({'; '.join(other[:3])}): "
                "give the logs of one table, or say with --rig what it is"
            )
    files = [name for name, one in zip(names, read, strict=True) if one.rig is None]
    notes = [f"{', '.join(files)}: taken to be of the rig of {first_name}"] if files else []
    return replace(first, effects={}), notes


def _left_out(read: Sequence[_One], names: Sequence[str], rig: Rig) -> Iterator[str]:
    """Yield a note for each run whose rig names an effect that this analysis does not know."""
    for name, one in zip(names, read, strict=True):
        missing = [f"{effect} ({file})" for effect, file in one.own.items()]
        if missing and not set(one.own) <= set(rig.catalogue):
            yield (
                f"{name} was made with a rig file of its own effects: {', '.join(missing)}; they "
                "are left out, since a recording runs no code: name the rig file with --rig"
            )


def rig_differences(a: Rig, b: Rig) -> Iterator[str]:
    """Yield where two rigs differ as tables; gains and control rate may differ between runs."""
    for section in SAME_RIG:
        one, other = asdict(getattr(a, section)), asdict(getattr(b, section))
        for key, value in one.items():
            if key != "colour" and other[key] != value:
                yield f"{section}.{key} = {_short(value)} and {_short(other[key])}"


def _short(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _of_run(rig: Rig, run: Rig | None) -> Rig:
    """Return the nominal rig with the controller's settings of a run."""
    if run is None:
        return rig
    try:
        return replace(rig, gains=run.gains, control_rate_hz=run.control_rate_hz)
    except ValueError:  # the given camera is faster than the run's loop
        return replace(rig, gains=run.gains)


def _dictionary(value: Any) -> dict[str, Any] | None:
    return value if isinstance(value, dict) else None


def released(log: Log, delay_s: float) -> Log:
    """The log with the ball blanked (NaN) where a person held it.

    That is outside the run phase, and where the light hit the sensor before the release
    (`exposures` at the camera's delay delay_s). A log without phases is returned as it is.
    """
    if not log.has("phase"):
        return log
    free = log["phase"] == Phase.RUN
    if free.any():
        seen = exposures(log["t_s"], log["ball_exposed_s"], delay_s)
        free &= seen >= log["t_s"][free][0]
    rows = np.array(log.rows)
    rows[~free, INDEX["ball_x_m"]] = rows[~free, INDEX["ball_y_m"]] = np.nan
    return Log.from_rows(rows, notes=log.notes)


def _check_alike(logs: Sequence[Log], names: Sequence[str]) -> None:
    """ValueError: two logs with the same rows, or with encoders of different steps."""
    refuse_same_rows(logs, names)
    for axis in "xy":
        steps = [step_of(log[f"theta_{axis}_rad"]) for log in logs]
        known = [(step, name) for step, name in zip(steps, names, strict=True) if step]
        for step, name in known[1:]:
            if abs(step / known[0][0] - 1) > STEP_TOLERANCE:
                raise ValueError(
                    f"{known[0][1]} and {name} are of different rigs: theta_{axis}_rad moves in "
                    f"steps of {known[0][0]:.3g} and {step:.3g} rad; give the logs of one table"
                )
