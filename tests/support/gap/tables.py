"""Logs of a table that shares no code with the model, as evidence, for the gap workflow's tests."""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "engines"))
import foreign_table  # pyright: ignore[reportMissingImports]

from calibration.gap.evidence import Evidence, gather
from calibration.gap.fit import evaluate
from calibration.gap.knobs import Believed
from calibration.gap.state import Key, State
from calibration.gap.workflow import levels_of, usable_runs
from rig.log import Log
from rig.parameters import Rig

RIG = Rig()


def foreign(protocol: str, **hidden) -> Log:
    """A log of the foreign table; `hidden` as `make_log` takes it."""
    return Log.from_columns(foreign_table.make_log(protocol, **hidden))


def evidence_of(*logs: Log, rig: Rig = RIG) -> Evidence:
    return gather(usable_runs(logs, rig), levels_of(rig))


def released(evidence: Evidence, *named: Key, rig: Rig = RIG) -> State:
    """The believed model with these effects released, not yet fitted."""
    believed = Believed(rig, load_friction=False)
    start = evaluate(evidence, believed, {}, evidence.parts)
    return State(evidence, believed, start, named)


def without_columns(log: Log, *starts: str) -> Log:
    """The log with every column that begins like one of `starts` blank."""
    rows = np.array(log.rows)
    for i, name in enumerate(log.columns):
        if name.startswith(starts):
            rows[:, i] = np.nan
    return Log.from_rows(rows)
