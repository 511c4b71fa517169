"""The logs of a foreign table that `rig gap` is given, and the JSON that it answers with."""

import json
from functools import cache
from pathlib import Path

import numpy as np

from experiments.records.exporting import export_log
from rig.log import Log
from rig.parameters import Rig
from tests.support.foreign.table import make_log

RIG = Rig()
OFFSET = {"voltage_offset": {"y": {"offset_V": 0.1}}}
DRAG = {"viscous_drag": {"xy": {"rate_1_s": 0.1}}}
KEYS = {
    *("verdict", "sentence", "where", "effects", "unknown", "untestable", "calibrated", "gap"),
    "next_experiment",
}
MORE = {"ranking", "notes"}  # what the contract does not name
SERVO_ONLY, BALL_ONLY = ("ball", "target"), ("voltage",)


@cache
def foreign(seconds: float = 8.0, seed: int = 3, rate_hz: float = 500.0, hidden: str = "",
            protocol: str = "steps") -> Log:  # fmt: skip
    effects = {"": {}, "offset": OFFSET, "drag": DRAG}[hidden]
    columns = make_log(protocol, seed=seed, effects=effects, duration_s=seconds, rate_hz=rate_hz)
    return Log.from_columns(columns)


def written(folder: Path, log: Log, *blank: str, name: str = "log.csv") -> Path:
    """The log as a CSV file, the columns that begin like one of `blank` left out."""
    kept = {n: v for n, v in log.columns.items() if not n.startswith(blank or ("-",))}
    kept = {n: v for n, v in kept.items() if not np.isnan(v).all()}
    return export_log(Log.from_columns(kept), folder / name)


def answer(folder: Path) -> dict:
    return json.loads((folder / "results.json").read_text())


def assert_contract(found: dict) -> None:
    """The keys of the documented JSON, at every depth."""
    assert set(found) - MORE == KEYS
    assert found["verdict"] in ("named", "nothing-missing", "unknown-effect", "undecided")
    for where in found["where"]:
        assert set(where) == {"channel", "region", "gap"}
    for effect in found["effects"]:
        assert set(effect) == {"name", "probability", "twins", "parameters"}
        assert set(effect["parameters"]) in ({"x", "y"}, {"xy"})
        for pairs in effect["parameters"].values():
            for interval in pairs.values():
                assert set(interval) == {"value", "low", "high"}
                assert interval["low"] <= interval["value"] <= interval["high"]
    for one in found["untestable"]:
        assert set(one) == {"name", "why", "smallest"}
    for interval in found["calibrated"].values():
        assert set(interval) == {"value", "low", "high"}
    assert {"before", "after", "held_out", "floor", "ahead_1s_mm"} <= set(found["gap"])
    if found["unknown"]:
        assert {"channel", "shape"} <= set(found["unknown"])
    if found["next_experiment"]:
        assert {"protocol", "separates", "seconds"} <= set(found["next_experiment"])
