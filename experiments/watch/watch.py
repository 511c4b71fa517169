"""`rig watch`: judge every new run of a table against the accepted model and the runs before it."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calibration.gap.model.parameters import Parameter
from calibration.watch.change_detection import (
    ONE_IN,
    Change,
    alarm_threshold,
    alarms,
    smallest_seen,
    strongest,
)
from calibration.watch.run_estimates import Accepted, accept, estimate
from experiments.progress import ProgressCall, silent
from experiments.runs.assemble import load_rig
from experiments.watch.runs import (
    RunFolder,
    accepted_of,
    log_of,
    other_protocol,
    other_table,
    rig_of,
    runs_of,
)
from rig.parameters import Rig

ACCEPTED, UNCHANGED, CHANGED, SKIPPED = "accepted", "unchanged", "changed", "skipped"


@dataclass(frozen=True)
class JudgedRun:
    """One run: its state (ACCEPTED, UNCHANGED, CHANGED or SKIPPED), why it was skipped, the row of
    its estimates in `Watch.values`, and the changes that the runs up to it show."""

    run: RunFolder
    state: str
    why: str = ""
    row: int | None = None
    strongest: Change | None = None
    changes: tuple[Change, ...] = ()


@dataclass(frozen=True, eq=False)
class Watch:
    """A table's runs, judged.

    values, stds (n, p): estimates of the n runs that count (`counted`), the accepted ones first,
    and their standard deviations, in the units of the p `parameters`; threshold: of the statistic;
    smallest (p,): the change that five further runs would show with even chances.
    """

    folder: Path
    runs: tuple[JudgedRun, ...]
    model: Accepted
    values: np.ndarray
    stds: np.ndarray
    threshold: float
    smallest: np.ndarray
    counted: tuple[RunFolder, ...]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The watched parameters, in the order of the columns of `values`."""
        return self.model.parameters

    @property
    def changes(self) -> tuple[Change, ...]:
        """What has changed by the newest run that counts, the strongest first."""
        judged = [one for one in self.runs if one.state in (UNCHANGED, CHANGED)]
        return judged[-1].changes if judged else ()

    @property
    def verdict(self) -> str:
        """ "changed", "nothing-changed", or "no-new-run" where none was judged."""
        if self.changes:
            return "changed"
        judged = any(one.state in (UNCHANGED, CHANGED) for one in self.runs)
        return "nothing-changed" if judged else "no-new-run"


def watch(
    folder: Path,
    rig_file: Path | None = None,
    *,
    accepted: Sequence[str] = (),
    progress: ProgressCall = silent,
) -> Watch:
    """Judge the runs of a folder (module docstrings of `calibration.watch`).

    rig_file: the table as it is believed, effects included; without it that of the accepted run.
    accepted: names of the accepted runs, without them the first that counts; runs before the last
    of them are not judged. FileNotFoundError, ValueError (one line): no such folder, run or rig
    file, or no run to begin with.
    """
    runs = runs_of(folder)
    chosen = accepted_of(runs, accepted, folder)
    rig = load_rig(rig_file) if rig_file is not None else rig_of(chosen[0])
    progress("accepted model", 0, 1)
    logs = []
    for one in chosen:
        try:
            logs.append(log_of(one, rig))
        except (ValueError, OSError) as error:
            cure = "accept another run (--accept RUN)"
            raise ValueError(f"{one.name} cannot be accepted: {error}; {cure}") from error
    model = accept(logs, rig)
    progress("accepted model", 1, 1)
    begin = [estimate(model, log) for log in logs]
    return _judged(folder, runs, chosen, model, begin, progress)


def _judged(folder, runs, chosen, model, begin, progress) -> Watch:
    rows, counted, lines = list(begin), list(chosen), []
    limit = alarm_threshold(len(model.parameters))
    last = max(runs.index(one) for one in chosen)
    for i, run in enumerate(runs):
        progress("runs", i, len(runs))
        if run in chosen:
            lines.append(JudgedRun(run, ACCEPTED, row=chosen.index(run)))
            continue
        why = run.why or _not_compared(run, chosen[0], model.rig, before=i < last)
        if not why:
            try:
                rows.append(estimate(model, log_of(run, model.rig)))
            except (ValueError, OSError, np.linalg.LinAlgError) as error:
                why = f"cannot be used: {error}"
        if why:
            lines.append(JudgedRun(run, SKIPPED, why))
            continue
        counted.append(run)
        found = strongest(*_arrays(rows), len(chosen))
        over = tuple(alarms(found, limit))
        told = [one for one in found if one is not None]
        most = max(told, key=lambda one: abs(one.z), default=None)
        state = CHANGED if over else UNCHANGED
        lines.append(JudgedRun(run, state, "", len(rows) - 1, most, over))
    progress("runs", len(runs), len(runs))
    values, stds = _arrays(rows)
    healthy = len(rows)
    if lines and any(one.changes for one in lines):
        healthy = max(len(chosen), min(c.since for one in lines for c in one.changes))
    smallest = smallest_seen(values[:healthy], stds[:healthy], limit)
    return Watch(folder, tuple(lines), model, values, stds, limit, smallest, tuple(counted))


def _arrays(rows) -> tuple[np.ndarray, np.ndarray]:
    return np.array([r.values for r in rows]), np.array([r.stds for r in rows])


def _not_compared(run: RunFolder, accepted: RunFolder, rig: Rig, *, before: bool) -> str:
    """Why a whole run is not judged, "" if it is."""
    if before:
        return "lies before the accepted run"
    if run.kind != accepted.kind:
        return (
            f"is of {' '.join(run.kind)}, the accepted run of {' '.join(accepted.kind)}: runs of "
            "one protocol and controller are compared"
        )
    if edited := other_protocol(run, accepted):
        return f"is of another protocol of that name, in {edited}"
    other = other_table(run, rig)
    return f"was recorded with another rig file ({other})" if other else ""


def rate_words() -> str:
    """The false-alarm rate that the threshold is for."""
    return f"at most one false alarm in {ONE_IN} healthy runs"
