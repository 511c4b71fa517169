"""The tab Run: choose a protocol, start, pause, stop; gains, play, target and pushes."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from math import cos, degrees, radians, sin
from typing import TYPE_CHECKING, Any

from experiments.assemble import with_play
from experiments.dashboard.clamps import (
    KD,
    KI,
    KP,
    PLAY_DEG,
    PUSH_M_S,
    REPETITIONS,
    Range,
    choice,
    on_plate,
)
from experiments.dashboard.controls import Controls
from experiments.dashboard.plan import Plan, Status
from experiments.dashboard.pose import plays
from experiments.dashboard.progress import IDLE, Progress
from experiments.dashboard.session import Session
from experiments.protocol import read_protocol, shipped
from rig.commands import Push, SetGains, Target

if TYPE_CHECKING:
    from viser import ViserServer

ARMS = {"both": ("without", "with"), "with the model": ("with",), "without": ("without",)}
WHAT = "Choose a protocol and press **Start**; or play with the balancing table."
WHAT_REAL = (
    "**A real table.** Homed with `rig home`? Choose a protocol, clear the plate, a hand at the "
    "switch, tick **Arm**, press **Start**; every run is armed anew."
)
SPEEDS = ("1 x", "2 x", "4 x")
PUSH_S = 0.08
ARROWS = {"left": 180.0, "right": 0.0, "away": 90.0, "near": 270.0}
KEYS = (
    "Keys: **R** start, **N** next run, **B** balance, **Esc** stop, **Shift + arrows** push, "
    "**Ctrl + K** all of them."
)


class RunTab:
    """The widgets of the tab in the container that is open when it is made; `look` turns every
    page to the live table when a run begins."""

    def __init__(
        self, server: "ViserServer", controls: Controls, session: Session,
        look: Callable[[], None],
    ) -> None:  # fmt: skip
        self._server, self._controls, self._session = server, controls, session
        self._look = look
        self._handles: dict[int, Any] = {}
        self._progress = Progress()
        gui, virtual = server.gui, not session.table.real
        gui.add_markdown(WHAT if virtual else WHAT_REAL)
        self._protocol = controls.value(
            gui.add_dropdown("Protocol", shipped(), initial_value="free-release"),
            "protocol",
            partial(choice, options=shipped()),
        )
        self._arm = controls.value(
            gui.add_dropdown("Backlash model", tuple(ARMS), initial_value="both"),
            "arm",
            partial(choice, options=tuple(ARMS)),
        )
        self._repetitions = controls.value(
            gui.add_number("Repetitions", 1, min=1, max=100, step=1),
            "repetitions",
            lambda v: int(REPETITIONS.clamp(v)),
        )
        self._speed = controls.value(
            gui.add_dropdown(
                "Virtual time", SPEEDS, hint="How fast its time runs", visible=virtual
            ),
            "virtual time",
            partial(choice, options=SPEEDS),
        )
        self._pause = controls.value(gui.add_checkbox("Pause between runs", False), "pause", bool)
        self._hand = controls.value(
            gui.add_checkbox(
                "I place and let go", False, hint="You are the operator's hand", visible=virtual
            ),
            "hand",
            bool,
        )
        self._arm_box: Any = gui.add_checkbox(
            "Arm: the plate is clear, a hand is at the switch", False, visible=not virtual
        )
        self._armed = controls.value(self._arm_box, "arm the table", bool)
        self._start = gui.add_button("Start", color="green", icon=None)
        controls.button(self._start, "start", lambda page: self.start())
        self._next = gui.add_button("Next run", color="green", visible=False)
        controls.button(self._next, "next run", lambda page: self.go_on())
        self._asked = gui.add_markdown("", visible=False)
        self._done = gui.add_button("Done", color="orange", visible=False)
        controls.button(self._done, "confirm", lambda page: session.confirm())
        self._balance = gui.add_button("Balance again", color="green", visible=False)
        controls.button(self._balance, "balance", lambda page: self.balance())
        self._bar: Any = gui.add_progress_bar(0.0)
        self._words: Any = gui.add_markdown(IDLE)
        with gui.add_folder("Controller's gains", expand_by_default=False):
            self._gains = self._add_gains()
        with gui.add_folder("Ball: target and pushes", expand_by_default=True):
            self._add_ball()
        with gui.add_folder("Virtual table's play", expand_by_default=False, visible=virtual):
            self._play = self._add_play()
        gui.add_markdown(KEYS)
        self._events: Any = gui.add_markdown("")
        self._shown: dict[Any, Any] = {}

    def start(self) -> None:
        """Put the plan together from the checked values and start it."""
        protocol, real = read_protocol(self._protocol.now), self._session.table.real
        self._take_arming()
        self._session.start(
            Plan(
                protocol,
                ARMS[self._arm.now],
                self._repetitions.now,
                protocol.seed,
                pause=self._pause.now or real,  # who armed it for a run armed it for that one
                by_hand=self._hand.now,
                speed=float(self._speed.now.split()[0]),
            )
        )
        self._look()

    def balance(self) -> None:
        """The virtual table balances again, for all to see."""
        self._session.balance()
        self._look()

    def go_on(self) -> None:
        """The next run of the plan."""
        if self._session.status.state == "pause":
            self._take_arming()
        self._session.go_on()

    def _take_arming(self) -> None:
        """A real table's arming counts once. ValueError: it was not armed."""
        if not self._session.table.real:
            return
        if not self._armed.now:
            raise ValueError("nothing moves yet: clear the plate, hand at the switch, tick Arm")
        self._armed.now = self._arm_box.value = False

    def _slider(
        self, label: str, limits: Range, value: float, apply: Callable[[float], None], hint: str,
        *, visible: bool = True,
    ):  # fmt: skip
        handle = self._server.gui.add_slider(
            label, limits.low, limits.high, limits.step, value, hint=hint, visible=visible
        )
        kept = self._controls.value(handle, label, limits.clamp, apply)
        self._handles[id(kept)] = handle
        return kept

    def _add_back(self, rows: list, values: list[float], apply: Callable[[], None]) -> None:
        """A button that puts sliders back to where they began."""

        def back(page: int | None) -> None:
            for kept, value in zip(rows, values, strict=True):
                kept.now = self._handles[id(kept)].value = value
            apply()

        button = self._server.gui.add_button("Back to the rig file's", color="gray")
        self._controls.button(button, "back", back)

    def _add_gains(self) -> list:
        gains = self._session.rig.gains
        start = gains.proportional_rad_m, gains.integral_rad_m_s, gains.derivative_rad_s_m
        rows = (("P [rad/m]", KP), ("I [rad/(m s)]", KI), ("D [rad s/m]", KD))
        hint = "applies at once, and to the runs that are started from now on"
        kept = [
            self._slider(label, limits, value, partial(self._set_gain, i), hint)
            for i, ((label, limits), value) in enumerate(zip(rows, start, strict=True))
        ]
        self._add_back(kept, list(start), lambda: self._set_gains(list(start)))
        return kept

    def _set_gain(self, which: int, value: float) -> None:
        wanted = [kept.now for kept in self._gains]
        wanted[which] = value
        self._set_gains(wanted)

    def _set_gains(self, wanted: list[float]) -> None:
        names = "proportional_rad_m", "integral_rad_m_s", "derivative_rad_s_m"
        rig = self._session.rig
        gains = replace(rig.gains, **dict(zip(names, wanted, strict=True)))
        self._session.set_gains(replace(rig, gains=gains), SetGains(*wanted))

    def _add_ball(self) -> None:
        gui, controls = self._server.gui, self._controls
        virtual = not self._session.table.real
        gui.add_markdown("Shift + click on the plate sends the ball there.")
        back = gui.add_button("Target back to the protocol's", color="gray")
        controls.button(back, "target", lambda page: self._session.put(Target(None)))
        self._push = self._slider(
            "Push [m/s]", PUSH_M_S, 0.15, lambda value: None, "speed that a push gives",
            visible=virtual,
        )  # fmt: skip
        arrows = gui.add_button_group("Push", tuple(ARROWS), visible=virtual)
        controls.pick(arrows, "push", lambda label: self.push(ARROWS[choice(label, tuple(ARROWS))]))

    def push(self, angle_deg: float) -> None:
        """Push the virtual ball towards an angle on the plate."""
        if self._session.table.real:
            raise ValueError("push a real ball with a stick")
        strength = self._push.now / PUSH_S
        angle = radians(angle_deg)
        self._session.put(Push((strength * cos(angle), strength * sin(angle)), PUSH_S))

    def aim(self, xy_m: tuple[float, float]) -> None:
        """Send the ball to a point of the plate, as far as it may."""
        side = self._session.rig.linkage.plate_side_m
        self._session.put(Target(on_plate(xy_m, side, self._session.rig.ball.radius_m)))

    def _add_play(self) -> list:
        gear, joint = plays(self._session.rig)
        rows = (("Gear play [deg]", gear), ("Joint play [deg]", joint))
        start = [round(degrees(float(play.mean())), 1) for _, play in rows]
        kept = [
            self._slider(label, PLAY_DEG, value, partial(self._set_play, i),
                         "a new virtual table starts")
            for i, ((label, _), value) in enumerate(zip(rows, start, strict=True))
        ]  # fmt: skip
        self._add_back(kept, start, lambda: self._set_plays(start))
        return kept

    def _set_play(self, which: int, value: float) -> None:
        wanted = [kept.now for kept in self._play]
        wanted[which] = value
        self._set_plays(wanted)

    def _set_plays(self, wanted: list[float]) -> None:
        words = "a new virtual table: gear play {:.1f}, joint play {:.1f} degrees"
        self._session.note(words.format(*wanted))
        gear, joint = map(radians, wanted)
        self._session.again(with_play(self._session.rig, gear_rad=gear, joint_rad=joint))

    def draw(self, status: Status, events: list[str]) -> None:
        """Show what happens; only what changed is sent."""
        on = status.state in ("running", "pause")
        real = self._session.table.real
        then = "the table sees that you have" if real else "then press Done"
        asked = f"**Please {status.asked}**, {then}." if status.asked else ""
        self._set(self._start, "visible", not on)
        self._set(self._next, "visible", status.state == "pause")
        self._set(self._balance, "visible", status.state == "stopped" and not real)
        self._set(self._asked, "visible", bool(asked))
        self._set(self._done, "visible", bool(asked) and not real)
        if asked:
            self._set(self._asked, "content", asked)
        self._set(self._bar, "value", round(100 * status.share, 1))
        self._set(self._words, "content", self._progress.words(status))
        self._set(self._events, "content", "  \n".join(["*Events*", *events[::-1]]))

    def _set(self, handle: Any, name: str, value: Any) -> None:
        if self._shown.get((id(handle), name)) != value:
            self._shown[id(handle), name] = value
            setattr(handle, name, value)
