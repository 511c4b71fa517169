"""The live stream for Foxglove, as a client of its protocol reads it."""

import json
import struct
import sys
import time
from collections.abc import Iterator

import numpy as np
import pytest
from mcap.records import Schema
from mcap_protobuf.decoder import DecoderFactory
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from experiments.dashboard.session.foxglove_stream import HERE, FoxgloveStream
from experiments.records.samples_file import SCHEMA_NAME, sample_schema
from rig.log import COLUMNS, NAMES
from tests.support.parts import needs

pytestmark = [needs("foxglove"), pytest.mark.realtime]


@pytest.fixture
def stream() -> Iterator[FoxgloveStream]:
    one = FoxgloveStream(0)
    yield one
    one.close()


def listener(stream: FoxgloveStream) -> tuple[ClientConnection, dict[int, str]]:
    """A client that is subscribed to all topics, and the topic of each of its subscriptions."""
    client = connect(stream.link, subprotocols=[Subprotocol("foxglove.sdk.v1")], open_timeout=5)
    offered: dict[str, dict] = {}
    while len(offered) < 2:
        told = json.loads(client.recv(timeout=5))
        if told["op"] == "advertise":
            offered |= {one["topic"]: one for one in told["channels"]}
    assert offered["samples"]["encoding"] == "protobuf"
    assert offered["samples"]["schemaName"] == SCHEMA_NAME["samples"]
    wanted = [{"id": i, "channelId": one["id"]} for i, one in enumerate(offered.values())]
    client.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
    time.sleep(0.3)  # nothing tells when a subscription holds
    return client, dict(enumerate(offered))


def heard(client: ClientConnection, topics: dict[int, str]) -> tuple[str, int, bytes]:
    """Topic, time [ns] and content of the next message."""
    while isinstance(data := client.recv(timeout=5), str):
        pass
    _, subscription, time_ns = struct.unpack_from("<BIQ", data)
    return topics[subscription], time_ns, data[13:]


def test_rows_and_events_are_those_of_a_recording_at_the_wall_clock(stream):
    rows = np.random.default_rng(1).normal(size=(3, len(COLUMNS)))
    rows[:, 0] = 5.0, 5.5, 0.25  # the last one is of another run
    rows[1, 5:7] = np.nan
    client, topics = listener(stream)
    begin_ns = time.time_ns()
    nowhen = np.full(len(COLUMNS), np.nan)
    stream.send([*rows[:2], nowhen, rows[2]])
    stream.event(0.25, "released")
    schema = Schema(id=1, name=SCHEMA_NAME["samples"], encoding="protobuf", data=sample_schema())
    decode = DecoderFactory().decoder_for("protobuf", schema)
    times = []
    for row in rows:
        topic, time_ns, content = heard(client, topics)
        assert topic == "samples"
        found = decode(content)
        assert np.array([getattr(found, name) for name in NAMES]).tobytes() == row.tobytes()
        times.append(1e-9 * (time_ns - begin_ns))
    assert times[1] - times[0] == pytest.approx(0.5)
    assert 0.0 <= times[0] < 2.0
    assert 0.0 <= times[2] < 2.0
    topic, _, content = heard(client, topics)
    assert (topic, json.loads(content)) == ("events", {"t_s": 0.25, "text": "released"})
    client.close()


def test_it_listens_to_this_machine_alone_and_takes_nothing(stream):
    assert stream.link.startswith(f"ws://{HERE}:")
    client = connect(stream.link, subprotocols=[Subprotocol("foxglove.sdk.v1")], open_timeout=5)
    told = json.loads(client.recv(timeout=5))
    assert told["op"] == "serverInfo"
    assert told["capabilities"] == []
    client.close()


def test_a_taken_port_and_a_missing_library_are_one_line(stream, monkeypatch):
    port = int(stream.link.rpartition(":")[2])
    with pytest.raises(ValueError, match=f"port {port} cannot be used"):
        FoxgloveStream(port)
    monkeypatch.setitem(sys.modules, "foxglove", None)
    with pytest.raises(ValueError, match="uv sync --extra foxglove"):
        FoxgloveStream(0)
