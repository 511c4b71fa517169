"""The layout for Foxglove names topics and fields that a recording has, and places every panel."""

import json
import re
from importlib.resources import files

import numpy as np
from mcap.reader import make_reader

from experiments.records.recording import write_run
from rig.log import NAMES, Log

LAYOUT = json.loads(
    (files("experiments") / "records/foxglove-layout.json").read_text(encoding="utf-8")
)


def panels(place) -> list[str]:
    if isinstance(place, str):
        return [place]
    return panels(place["first"]) + panels(place["second"])


def test_every_path_is_of_a_recording_and_every_panel_has_its_place(tmp_path):
    log = Log.from_columns({"t_s": np.arange(5) / 500, "ball_x_m": np.zeros(5)})
    start = {"source": "simulated", "arm": "with"}
    write_run(tmp_path / "run", start, log, [{"t_s": 0.0, "text": "released"}])
    with (tmp_path / "run/samples.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    topics = {channel.topic for channel in summary.channels.values()}
    told = re.findall(r'"(samples|events)(?:\.(\w+))?"', json.dumps(LAYOUT))
    assert {topic for topic, _ in told} == topics
    fields = {field for _, field in told if field}
    assert fields <= set(NAMES)
    assert {"ball_x_m", "theta_y_rad", "voltage_x_V", "estimated_torque_y_Nm"} <= fields
    assert sorted(panels(LAYOUT["layout"])) == sorted(LAYOUT["configById"])
