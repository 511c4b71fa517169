"""Streams with clocks of their own: which column is the time, and when each begins."""

import json
from pathlib import Path

import numpy as np
from mcap.writer import Writer

from experiments.importing.formats.bags import read_bag

T = np.arange(50) * 0.02


def test_the_time_of_a_bag_is_its_log_time_whatever_its_messages_call_time(tmp_path: Path):
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel("/b", "json", writer.register_schema("b", "", b""))
        for t in T:
            row = {"x": t, "time": t + 0.4, "own_time": 7}
            writer.add_message(channel, int(1e9 * t), json.dumps(row).encode(), 0)
        writer.finish()
    (stream,) = read_bag(path)
    assert (stream.time, len(stream.columns)) == ("b.time", 4)
    np.testing.assert_allclose(stream.columns["b.time"], T, atol=1e-6)
    np.testing.assert_allclose(stream.columns["b.own_own_time"], T + 0.4)
    assert set(stream.columns["b.own_time"]) == {7.0}
