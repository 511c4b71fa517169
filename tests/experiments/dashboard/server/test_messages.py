"""What pages may send, tried with real websockets against a real viser server."""

import gc
import logging
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgspec
import pytest
import viser
import zstandard
from viser import _messages as messages
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin, Subprotocol

from experiments.dashboard.server.controls import ControlLock, Controls
from experiments.dashboard.server.input_limits import KP, choice, flag
from experiments.dashboard.server.messages import LONGEST, admit_values
from experiments.dashboard.server.pages import MOST_UNREAD, Pages
from experiments.dashboard.server.server import open_server
from tests.support.waiting import wait_for

TOKEN = "a-token-of-some-length-for-tests"
CAMERA = messages.ViewerCameraMessage(
    wxyz=(1, 0, 0, 0),
    position=(0, 0, 1),
    fov=1.0,
    near=0.1,
    far=10.0,
    image_height=9,
    image_width=9,
    look_at=(0, 0, 0),
    up_direction=(0, 0, 1),
)


class Panel:
    """A slider, a list, a box that everybody may tick, arrows and a stop, behind the filter."""

    def __init__(self):
        self.server, self.gate = open_server("127.0.0.1", 0, TOKEN)
        self.told: list[Any] = []
        self.applied: list[Any] = []
        self.arrows: list[str] = []
        self.stopped = threading.Event()
        self.controls = c = Controls(lambda *what: self.told.append(what), print)
        admit_values(self.server, c)
        gui = self.server.gui
        self.slider: Any = gui.add_slider("P", KP.low, KP.high, KP.step, 3.0)
        self.gain = c.value(self.slider, "gain", KP.clamp, self.applied.append)
        self.list: Any = gui.add_dropdown("method", ("a", "b"))
        self.method = c.value(self.list, "method", lambda v: choice(v, ("a", "b")))
        self.box: Any = gui.add_checkbox("camera", False)
        self.camera = c.value(self.box, "camera", flag, everybody=True)
        self.group: Any = gui.add_button_group("push", ("left", "right"))
        c.pick(self.group, ("left", "right"), self.arrows.append)
        self.own: Any = gui.add_slider("time", KP.low, KP.high, KP.step, 1.0)
        self.times: list[Any] = []
        c.own_value(self.own, "time", KP.clamp, lambda *what: self.times.append(what))
        self.unknown: Any = gui.add_checkbox("nobody's", False)
        self.stop: Any = gui.add_button("STOP")
        c.stop_button(self.stop, "stop", lambda page: self.stopped.set())

    def page(self) -> ClientConnection:
        """A page that is connected and has told its view."""
        before = len(self.server.get_clients())
        there = connect(
            f"ws://127.0.0.1:{self.gate.port}{self.gate.path}",
            origin=Origin(f"http://127.0.0.1:{self.gate.port}"),
            additional_headers={"Cookie": f"{self.gate.cookie}={self.gate.key}"},
            subprotocols=[Subprotocol(f"viser-v{viser.__version__}")],
            compression=None,
        )
        self.say(there, CAMERA)
        wait_for("the page", lambda: len(self.server.get_clients()) > before, 10.0)
        self.controls.lock = self.controls.lock.joined(before)
        return there

    def say(self, there: ClientConnection, message: Any) -> None:
        there.send(msgspec.msgpack.encode(message.as_serializable_dict()))

    def set(self, there: ClientConnection, handle: Any, **updates: Any) -> None:
        self.say(there, messages.GuiUpdateMessage(handle._impl.uuid, updates))

    def heard(self, there: ClientConnection, page: int) -> None:
        """Wait until everything that the page sent before has been served."""
        self.set(there, self.box, value="x")
        wait_for("the notice", lambda: (page, "camera") in [t[:2] for t in self.told], 10.0)
        done = threading.Event()
        self.controls.queue.put("last", done.set)
        assert done.wait(10.0)


def said(there: ClientConnection) -> list[dict]:
    """The messages of the next packet from the server."""
    packet = there.recv(timeout=5.0)
    assert isinstance(packet, bytes)
    length = int.from_bytes(packet[8:16], "little")  # of the compressed part
    return msgspec.msgpack.decode(zstandard.decompress(packet[16 : 16 + length]))["messages"]


@contextmanager
def opened() -> Iterator[Panel]:
    one = Panel()
    try:
        yield one
    finally:
        one.server.stop()


contexts = {"panel": opened}  # for mutants of the filter


@pytest.fixture
def panel() -> Iterator[Panel]:
    with opened() as one:
        yield one


def test_a_page_sees_greyed_what_it_cannot_use_with_the_reason_and_stop_never(panel: Panel):
    holder, watcher, pages = panel.page(), panel.page(), Pages()
    for client in panel.server.get_clients().values():
        pages.joined(client)
    film = {0: "a film"}

    def need_film(page: int) -> None:
        if page not in film:
            raise ValueError("press Show first")

    panel.controls.needs(need_film, panel.own, panel.slider)
    handles = {one._impl.uuid: one for one in (panel.slider, panel.group, panel.own)}

    def seen(page: ClientConnection, many: int) -> list[tuple[Any, bool, str | None]]:
        pages.show_usable(list(panel.controls.checks.values()))
        told: list[Any] = []
        while len(told) < many:
            told += [m for m in said(page) if m["type"] == "GuiUpdateMessage"]
        assert panel.stop._impl.uuid not in {one["uuid"] for one in told}
        updates = [(handles.get(one["uuid"]), one["updates"]) for one in told]
        return [(one, told["disabled"], told["hint"]) for one, told in updates if one]

    watching = "you are watching: press 'Take over the controls' first"
    usable = [(panel.slider, False, None), (panel.group, False, None), (panel.own, False, None)]
    assert seen(holder, 4) == usable
    assert seen(watcher, 4) == [
        (panel.slider, True, watching),
        (panel.group, True, watching),
        (panel.own, True, "press Show first"),
    ]
    del film[0]
    assert seen(holder, 2) == [(one, True, "press Show first") for one in (panel.slider, panel.own)]
    film[0] = "another"
    assert seen(holder, 2) == [usable[0], usable[2]]


def test_no_page_changes_anything_of_an_input_but_its_value(panel: Panel):
    panel.page()
    watcher = panel.page()
    for name, value in (("removed", True), ("update_cb", []), ("is_button", False), ("x", 1)):
        panel.set(watcher, panel.stop, **{name: value})
        panel.set(watcher, panel.stop, **{"value": True, name: value})
    panel.heard(watcher, 1)
    assert not panel.stopped.is_set()
    panel.set(watcher, panel.stop, value=True)
    assert panel.stopped.wait(5.0)


def test_a_value_of_a_pages_own_is_clamped_and_no_other_page_is_shown_it(panel: Panel):
    holder, watcher = panel.page(), panel.page()
    panel.set(watcher, panel.own, value=1e9)
    panel.set(watcher, panel.own, value="soon")
    panel.set(holder, panel.own, value=2.0)
    panel.heard(watcher, 1)
    panel.heard(holder, 0)
    assert sorted(panel.times) == [(0, 2.0), (1, KP.high)]
    assert panel.own.value == 1.0  # what a page that comes is shown
    assert any(told[:2] == (1, "time") and "no number" in told[2] for told in panel.told)
    assert panel.applied == []


def test_only_the_holder_sets_values_and_the_one_that_was_sent_is_applied(panel: Panel):
    holder, watcher = panel.page(), panel.page()
    for i in range(100):
        panel.set(watcher, panel.slider, value=0.05)
        panel.set(holder, panel.slider, value=4.0 + 0.01 * i)
    panel.set(holder, panel.slider, value=1e9)
    panel.heard(watcher, 1)
    panel.heard(holder, 0)
    assert panel.applied == pytest.approx([*(4.0 + 0.01 * i for i in range(100)), KP.high])
    assert panel.slider.value == panel.gain.now == KP.high
    assert (1, "gain") in [told[:2] for told in panel.told]
    assert panel.controls.lock == ControlLock((0, 1), 0)


@pytest.mark.parametrize("value", [None, "5", True, [1, 2], {"a": 1}, float("nan"), float("inf")])
def test_a_value_of_another_type_is_not_stored(panel: Panel, value):
    holder = panel.page()
    for handle in (panel.slider, panel.list, panel.group):
        panel.set(holder, handle, value=value)
    panel.set(holder, panel.unknown, value=True)
    panel.heard(holder, 0)
    assert (panel.slider.value, panel.list.value, panel.unknown.value) == (3.0, "a", False)
    assert panel.applied == panel.arrows == []


def test_a_page_that_was_refused_shows_what_holds(panel: Panel):
    holder, watcher = panel.page(), panel.page()
    panel.set(watcher, panel.slider, value=5.0)
    panel.set(watcher, panel.box, value=True)  # everybody may
    panel.set(holder, panel.group, value="right")
    panel.heard(watcher, 1)
    panel.heard(holder, 0)
    assert panel.camera.now is True
    assert panel.arrows == ["right"]
    echoes = []
    while not echoes:
        for message in said(watcher):
            if message.get("uuid") == panel.slider._impl.uuid and "updates" in message:
                echoes.append(message["updates"])
    assert echoes == [{"value": 3.0}]


def test_messages_that_are_not_what_their_kind_says_are_passed_over(
    panel: Panel, monkeypatch: pytest.MonkeyPatch
):
    """Each was told of in a traceback of twenty lines, 500 a second."""
    told: list[Any] = []
    monkeypatch.setattr(logging.getLogger("asyncio"), "error", lambda *what, **_: told.append(what))
    panel.server.scene.on_click()(print)
    odd: Any = {"uuid": panel.slider._impl.uuid, "updates": None}
    click: Any = {"event_type": "click", "ray_origin": None, "ray_direction": 1, "screen_pos": []}
    watcher = panel.page()
    panel.say(watcher, messages.GuiUpdateMessage(**odd))
    panel.say(watcher, messages.CommandTriggerMessage([]))  # pyright: ignore[reportArgumentType]
    panel.say(watcher, messages.ScenePointerMessage(**click, modifier=None))
    panel.heard(watcher, 0)
    gc.collect()  # asyncio tells of what nobody waits for as it goes
    assert not told
    panel.set(watcher, panel.stop, value=True)
    assert panel.stopped.wait(5.0)


def test_uploads_and_long_messages_are_not_kept(panel: Panel):
    assert LONGEST == 65536
    holder = panel.page()
    upload = messages.FileTransferStartUpload(
        source_component_uuid=panel.stop._impl.uuid,
        transfer_uuid="t",
        filename="f",
        mime_type="",
        part_count=9,
        size_bytes=9,
    )
    panel.say(holder, upload)
    panel.heard(holder, 0)
    assert panel.server.gui._current_file_upload_states == {}
    holder.send(bytes(LONGEST + 1))
    with pytest.raises(ConnectionClosed):
        sum(len(said) for said in holder)


def test_a_page_that_reads_nothing_is_not_told_without_end(panel: Panel):
    panel.page()
    (client,) = panel.server.get_clients().values()
    unread = client._websock_connection.get_message_buffer().message_from_id
    pages = Pages()
    pages.joined(client)
    with panel.server.atomic(), client.atomic():  # nothing leaves
        for k in range(MOST_UNREAD + 500):
            pages.not_done(client.client_id, "push", f"you are watching, {k}")
        assert MOST_UNREAD // 2 < len(unread) <= MOST_UNREAD + 10


def test_a_page_that_reads_nothing_is_not_sent_file_after_file(panel: Panel, tmp_path: Path):
    """Whoever watches may press Download, and each is another copy in the program's memory."""
    panel.page()
    (client,) = panel.server.get_clients().values()
    unread = client._websock_connection.get_message_buffer().message_from_id
    pages, file = Pages(), tmp_path / "report.html"
    pages.joined(client)
    file.write_bytes(bytes(3 << 20))
    with client.atomic():  # nothing leaves
        for _ in range(20):
            pages.send(client.client_id, file)
        parts = [one for one in unread.values() if isinstance(one, messages.FileTransferPart)]
    assert len(parts) == 3
