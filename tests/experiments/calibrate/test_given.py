"""A calibration from recorded runs: they have to be of the table that is calibrated."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from experiments.calibrate.given import read_given
from experiments.records.recording import write_run
from experiments.records.run_folder import plain
from experiments.runs.assemble import load_rig
from rig.log import Log
from rig.parameters import Rig
from rig.rigfile import to_record

RIG = load_rig(Path("bus-servos"))


def recorded(folder: Path, rig: Rig) -> Path:
    start = {"source": "measured", "arm": "with", "seed": None, "protocol": {"name": "hold"}}
    log = Log.from_columns({"t_s": np.arange(5) / 200, "theta_x_rad": np.zeros(5)})
    write_run(folder, {**start, "rig": plain(to_record(rig))}, log, [], outcome="completed")
    return folder


def test_a_run_of_another_table_is_refused_with_what_differs(tmp_path: Path):
    run = recorded(tmp_path / "run", load_rig(Path("three-arms")))
    with pytest.raises(ValueError, match=r"another table than the rig file's, in .*linkage.kind"):
        read_given(run, RIG)


def test_a_table_that_was_calibrated_since_is_the_same(tmp_path: Path):
    since = replace(RIG, servo=replace(RIG.servo, lag_s=0.06, dead_band_rad=0.01))
    assert read_given(recorded(tmp_path / "run", RIG), since).source == "measured"
