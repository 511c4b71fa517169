"""A recording whose exposures are of no clock at all is reported without a word on the way."""

import warnings
from pathlib import Path

import numpy as np
import pytest

from experiments.records.recording import write_run
from experiments.reports.report_runs import report_runs
from rig.log import COLUMNS, INDEX, Log


@pytest.mark.parametrize("ahead_s", [5.0, 1e9, 1e308, np.inf])
def test_light_that_hit_the_sensor_in_the_future(tmp_path: Path, ahead_s: float):
    rows = np.random.default_rng(0).normal(0.0, 0.01, (500, len(COLUMNS)))
    rows[:, 0] = 0.002 * np.arange(500)
    rows[:, INDEX["phase"]] = 2
    rows[:, INDEX["ball_exposed_s"]] = rows[:, 0] + ahead_s
    start = {"source": "simulated", "protocol": "hold", "arm": "with", "seed": 1}
    write_run(tmp_path / "run", start, Log.from_rows(rows), outcome="completed")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert report_runs([tmp_path / "run"], tmp_path).is_file()
