"""The runs of one table's folder, in the order in which they were recorded."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from filecmp import cmp
from math import inf
from pathlib import Path
from typing import Any

from experiments.analysis.alike import difference_words
from experiments.gap.checks import check
from experiments.gap.input import released, rig_differences
from experiments.records.made_with import entries
from experiments.records.recording import being_recorded, read_run
from experiments.records.run_folder import nanoseconds, read_meta
from rig.files import printable
from rig.log import Log
from rig.parameters import Rig
from rig.rigfile import from_dict

WHOLE = ("completed", "done")


@dataclass(frozen=True)
class RunFolder:
    """A run folder as its run.json tells it; meta is None, and `why` a reason, where that cannot be
    read or the run does not count."""

    path: Path
    meta: dict[str, Any] | None
    why: str = ""

    @property
    def name(self) -> str:
        """The folder's name, as one line of printable characters."""
        return printable(self.path.name)

    @property
    def kind(self) -> tuple[str, str]:
        """Protocol and arm: runs of one kind excite the table alike and may be compared."""
        meta = self.meta or {}
        protocol = meta.get("protocol")
        name = protocol.get("name") or protocol.get("title") if isinstance(protocol, dict) else None
        return str(name or protocol or "-"), str(meta.get("arm") or "-")


def runs_of(folder: Path) -> list[RunFolder]:
    """The run folders in `folder`, by the time of their recording, then by name; last those of
    which no such time is known. A copy of a run, or a link to it, does not count again.

    FileNotFoundError: no such folder, or it holds no run folder.
    """
    if not folder.is_dir():
        raise FileNotFoundError(
            f"{folder}: no such folder; name the one that holds the run folders"
        )
    found = [path for path in sorted(folder.iterdir()) if _is_run(path)]
    if not found:
        inside = " (name the folder that holds it)" if _is_run(folder) else ""
        raise FileNotFoundError(f"{folder} holds no run folder{inside}")
    runs = [_as_recorded(path) for path in found]
    known: dict[str, list[RunFolder]] = {}
    found = []
    for one in sorted(runs, key=lambda one: (_recorded_ns(one), one.name)):
        meta = one.meta or {}
        alike = known.setdefault(repr((meta.get("created"), meta.get("seed"))), [])
        same = None if one.why else next((other for other in alike if _equal(one, other)), None)
        found.append(replace(one, why=f"is the same run as {same.name}") if same else one)
        if not one.why or meta.get("rejected"):
            alike.append(one)
    return found


def accepted_of(runs: Sequence[RunFolder], names: Sequence[str], folder: Path) -> list[RunFolder]:
    """The accepted runs: those named (folder names or paths), else the first that counts.

    ValueError: a name that is no run of the folder, a run that does not count, runs of several
    protocols or arms, or none that counts.
    """
    if not names:
        first = next((one for one in runs if not one.why), None)
        if first is None:
            raise ValueError(f"{folder}: no run to begin with: {runs[0].name} {runs[0].why}")
        return [first]
    by_name = {name: one for one in runs for name in (one.name, one.path.name)}
    chosen = []
    for name in names:
        one = by_name.get(Path(name).name)
        if one is None:
            raise ValueError(f"--accept {name}: no such run in {folder}")
        if one.why:
            raise ValueError(f"--accept {name}: {one.why}; accept another run")
        chosen.append(one)
    if len({one.kind for one in chosen}) > 1 or any(other_protocol(chosen[0], o) for o in chosen):
        raise ValueError("--accept: the runs are of several protocols or arms; accept those of one")
    return [one for one in runs if one in chosen]


def log_of(run: RunFolder, rig: Rig) -> Log:
    """The run's log without what a person did. ValueError, FileNotFoundError: it cannot be used."""
    recorded = read_run(run.path)
    if recorded.meta["truncated"]:
        raise ValueError("its samples end before their time")
    log = released(recorded.log, rig.camera.delay_s)
    check(log, rig)
    return log


def rig_of(run: RunFolder) -> Rig:
    """The rig file that the run's controller knew. ValueError: run.json has none that is valid."""
    record = (run.meta or {}).get("rig")
    if not record:
        raise ValueError(
            f"{run.name}: run.json holds no rig file: say with --rig what the table is"
        )
    return from_dict(record)


def other_protocol(run: RunFolder, accepted: RunFolder) -> str:
    """In what the protocols of two runs of one kind differ, "" where they are the same: another
    excitation moves the estimates, too."""
    one, other = (
        entries(Path(), {"protocol": (of.meta or {}).get("protocol")}) for of in (run, accepted)
    )
    return difference_words(one, other)


def other_table(run: RunFolder, rig: Rig) -> str:
    """Why the run is of another table than `rig`, "" if it is not."""
    try:
        known = rig_of(run)
    except ValueError:
        return ""
    return next(iter(rig_differences(rig, known)), "")


def _recorded_ns(run: RunFolder) -> float:
    try:
        return nanoseconds((run.meta or {})["created"])
    except (KeyError, TypeError, ValueError):
        return inf


def _equal(one: RunFolder, other: RunFolder) -> bool:
    """Whether the samples of two runs are equal, byte for byte."""
    with suppress(OSError):
        return cmp(one.path / "samples.mcap", other.path / "samples.mcap", shallow=False)
    return False


def _is_run(path: Path) -> bool:
    """Whether a folder holds a run, or may: one of somebody else that nobody may look into."""
    try:
        return path.is_dir() and any((path / f).is_file() for f in ("run.json", "samples.mcap"))
    except OSError:
        return True


def _as_recorded(path: Path) -> RunFolder:
    try:
        if not (path / "run.json").is_file():
            return RunFolder(path, None, "is damaged: it has no run.json")
        meta = read_meta(path)
        return RunFolder(path, meta, _why_not(path, meta))
    except ValueError as error:
        return RunFolder(path, None, f"is damaged: {error}")
    except OSError as error:
        return RunFolder(path, None, f"cannot be read ({error.strerror})")


def _why_not(path: Path, meta: dict[str, Any]) -> str:
    if meta.get("rejected"):
        return f"was rejected ({meta['rejected']})"
    if meta.get("outcome") is None:
        return "is being recorded" if being_recorded(path) else "was cut off: rig recover mends it"
    if meta["outcome"] not in WHOLE:
        return f"failed (outcome {meta['outcome']})"
    if not (path / "samples.mcap").is_file():
        return "is damaged: it has no samples.mcap"
    return ""
