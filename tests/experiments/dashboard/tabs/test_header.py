"""Who watches takes the controls over, by the button or by the palette."""

import threading
from types import SimpleNamespace

import pytest

from experiments.dashboard.server.controls import ControlLock, Controls
from experiments.dashboard.server.pages import Pages
from experiments.dashboard.session.plan import SessionStatus
from experiments.dashboard.tabs.header import Header


class Handle:
    """A button or a command: what is registered with it."""

    def __init__(self) -> None:
        self.press = lambda event: None

    def on_click(self, act) -> None:
        self.press = act


class Command(Handle):
    def on_trigger(self, act) -> None:
        self.press = act


def test_a_message_is_titled_with_what_happened():
    pages, shown = Pages(), []
    for page in (1, 2):
        buffer = SimpleNamespace(message_from_id={})
        client = SimpleNamespace(
            client_id=page,
            add_notification=lambda *w, **k: shown.append(w),
            _websock_connection=SimpleNamespace(get_message_buffer=lambda b=buffer: b),
        )
        pages.joined(client)  # pyright: ignore[reportArgumentType]
    pages.not_done(2, "play", "choose a run and press Show first")
    assert shown == [("Not done: play", "choose a run and press Show first")]


def test_a_page_with_a_film_does_not_show_the_state_of_the_live_table():
    told = {}
    pages = SimpleNamespace(
        clients={1: None, 2: None},
        tell=lambda page, handle, visible: told.update({(page, handle.text): visible}),
        show_usable=lambda checks: None,
    )
    gui = SimpleNamespace(
        add_markdown=lambda text="", **k: SimpleNamespace(text=text, content=text),
        add_button=lambda label, **k: SimpleNamespace(text=label, visible=False),
        add_command=lambda label: SimpleNamespace(),
    )
    controls = SimpleNamespace(
        button=lambda *what, **k: None, checks={}, lock=ControlLock().joined(1)
    )
    session = SimpleNamespace(table=SimpleNamespace(real=False))
    header = Header(SimpleNamespace(gui=gui), controls, pages, session, "virtual", print)  # pyright: ignore[reportArgumentType]
    header._own[2] = SimpleNamespace(content="")
    header.show_film(2, True)
    assert "A replay is shown" in header._own[2].content
    assert "live table goes on" not in header._own[2].content  # it may have been stopped
    header.draw(SimpleNamespace(), SessionStatus("stopped"), 500.0)  # pyright: ignore[reportArgumentType]
    assert (told[1, ""], told[2, ""]) == (True, False)
    header.show_film(2, False)
    header.draw(SimpleNamespace(), SessionStatus("stopped"), 500.0)  # pyright: ignore[reportArgumentType]
    assert told[2, ""]


@pytest.mark.parametrize("way", ["button", "palette"])
def test_a_page_that_watches_takes_over_and_the_other_is_told(way: str):
    buttons, commands, noted = {}, {}, []
    gui = SimpleNamespace(
        add_markdown=lambda *a, **k: SimpleNamespace(),
        add_button=lambda label, **k: buttons.setdefault(label, Handle()),
        add_command=lambda label: commands.setdefault(label, Command()),
    )
    controls = Controls(lambda *what: None, print)
    session = SimpleNamespace(note=noted.append)
    Header(SimpleNamespace(gui=gui), controls, Pages(), session, "virtual", lambda page: None)  # pyright: ignore[reportArgumentType]
    controls.lock = ControlLock().joined(1).joined(2)
    handle = {"button": buttons, "palette": commands}[way]["Take over the controls"]
    handle.press(SimpleNamespace(client_id=2))  # pyright: ignore[reportArgumentType]
    done = threading.Event()
    controls.queue.put("then", done.set)
    assert done.wait(5.0)
    assert controls.lock.holder == 2
    assert noted == ["another page took over the controls"]
    controls.queue.close()
