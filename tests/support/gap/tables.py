"""Logs of a table that shares no code with the model, as evidence, for the gap workflow's tests."""

import numpy as np

from calibration.gap.investigation import levels_of, usable_runs
from calibration.gap.model.data import Evidence, gather
from calibration.gap.model.fit import evaluate
from calibration.gap.model.parameters import NominalModel
from calibration.gap.model.state import Key, State
from experiments.benchmark.engines.foreign import table as foreign_table
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
    nominal = NominalModel(rig, load_friction=False, coasts=False)  # as that plant has it
    start = evaluate(evidence, nominal, {}, evidence.outputs)
    return State(evidence, nominal, start, named)


def without_columns(log: Log, *starts: str) -> Log:
    """The log with every column that begins like one of `starts` blank."""
    rows = np.array(log.rows)
    for i, name in enumerate(log.columns):
        if name.startswith(starts):
            rows[:, i] = np.nan
    return Log.from_rows(rows)
