"""The keys of the page, which are the entries of its command palette (Ctrl + K), too."""

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

from experiments.dashboard.server.controls import Controls
from experiments.dashboard.tabs.replay import ReplayTab
from experiments.dashboard.tabs.run import RunTab

if TYPE_CHECKING:
    from viser import ViserServer


def add_keys(
    server: "ViserServer",
    controls: Controls,
    stop: Callable[[str], None],
    run_tab: RunTab,
    replay: ReplayTab,
) -> None:
    """Stop, start, go on, balance, play and push by key; stop: called with who stops."""
    add, button = server.gui.add_command, controls.button
    controls.stop_button(add("Stop", hotkey="escape"), "stop", stop)
    button(add("Start the run", hotkey="R"), "start", run_tab.start)
    button(add("Next run", hotkey="N"), "next run", lambda page: run_tab.go_on())
    button(add("Balance again", hotkey="B"), "balance", run_tab.balance)
    replay.key(add("Play or pause", hotkey="space"), "play", replay.toggle)
    for frames, key in ((1, "arrowright"), (-1, "arrowleft")):
        way = "on" if frames > 0 else "back"
        step = add(f"A frame {way}", hotkey=key)  # pyright: ignore[reportArgumentType]
        replay.key(step, "frame", partial(replay.step, frames=frames))
    keys = (
        ("left", "left", 180),
        ("right", "right", 0),
        ("up", "away", 90),
        ("down", "near", 270),
    )
    for key, way, angle in keys:
        push = add(f"Push {way}", hotkey=f"arrow{key}", modifier="shift")  # pyright: ignore[reportArgumentType]
        button(push, "push", lambda page, a=float(angle): run_tab.push(a))
