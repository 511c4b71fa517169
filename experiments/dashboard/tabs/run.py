"""The tab Run: protocol, start and pause; gains, the table's backlash, target and pushes."""

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from math import cos, radians, sin
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments.dashboard.server.controls import Controls
from experiments.dashboard.server.input_limits import (
    KD,
    KI,
    KP,
    PUSH_M_S,
    REPETITIONS,
    choice,
    flag,
    on_plate,
)
from experiments.dashboard.server.untrusted_text import plain
from experiments.dashboard.session.plan import (
    BOTH,
    METHODS,
    STUDY,
    WHOLE,
    SessionStatus,
    shipped_plan,
)
from experiments.dashboard.session.presets import KeptPresets
from experiments.dashboard.session.seeds import with_new_seeds
from experiments.dashboard.session.session import Session
from experiments.dashboard.tabs.header import live, with_mouse
from experiments.dashboard.tabs.play_sliders import play_sliders
from experiments.dashboard.tabs.sliders import SliderGroup
from experiments.dashboard.view.elapsed import minutes
from experiments.runs.protocol import shipped
from rig.loop.commands import Push, SetGains, Target

if TYPE_CHECKING:
    from viser import ViserServer

WHAT_REAL = (
    "**A real table.** Homed with `rig home`? Choose a protocol, clear the plate, a hand at the "
    "switch, tick **Arm**, press **Start**; every run is armed anew."
)
ARMED_S = 60.0  # so long an arming waits for Start; chosen: what one has just seen is still so
SPEEDS = ("1 x", "2 x", "4 x")
# Gains as multiples of the rig file's P, I, D: what each is good for shows at once.
PRESETS = {
    "as in the rig file": (1.0, 1.0, 1.0),
    "half as stiff": (0.5, 1.0, 1.0),
    "half the damping": (1.0, 1.0, 0.5),
    "twice the damping": (1.0, 1.0, 2.0),
    "no integral": (1.0, 0.0, 1.0),
}
PUSH_S = 0.08  # duration of a push; chosen: a tap
SEEDS = (
    "each has a seed of its own, which no recorded run of the protocol had; same seed, same noise: "
    "both controllers get the same conditions"
)
ARROWS = {"left": 180.0, "right": 0.0, "away": 90.0, "near": 270.0}
KEYS = (
    "Keys: **R** start, **N** next run, **B** balance, **Esc** stop, **Shift + arrows** push, "
    "**Ctrl + K** all of them."
)
IDLE = "No run is on."
BALANCES = " The virtual table balances its ball, without play compensation."
MARKED = (
    "pushes, targets and gains during a recorded run: they are marked in it, and it is not counted"
)
DISTURB = "tick 'Disturb the recorded run' first: what you do will be marked in it"


def progress_words(status: SessionStatus) -> str:
    """A line (Markdown) on the present run: which one, its time, time left of the plan."""
    planned = status.run
    last = f"**{plain(status.last)}** " if status.last else ""
    if planned is None:
        return last + IDLE + (BALANCES if status.state == "balancing" else "")
    of = f"run {planned.number} of {planned.of}"
    left = f"{minutes(status.remaining_s)} left"
    if status.state == "pause":
        return f"{last}**Pause**: {plain(status.words)}, {left}"
    if status.waited_s is not None:
        clock = f"{minutes(status.waited_s)} of {minutes(status.patience_s)}"
        return f"{of}: {plain(status.words)}, **waiting for you** ({clock})"
    return f"{of}: {plain(status.words)}, {status.t_s:.1f} of {status.duration_s:.1f} s, {left}"


def events_by_run(events: Sequence[tuple[str, str]]) -> str:
    """Events (what was on, a line) as Markdown, the newest first, below what was on then."""
    lines, above = ["*Events*"], None
    for of, line in reversed(events):
        if of != above:
            lines.append(f"**{plain(of)}**")
            above = of
        lines.append(plain(line))
    return "  \n".join(lines)


class RunTab:
    """Builds the tab Run in the GUI container of viser that is open: protocol, start, gains,
    target, pushes and the virtual table's backlash.

    session: what the buttons act on; out: folder of the recorded runs and of the gains that are
    kept; show_live: called with the page that begins a run or balancing, to end its film.
    """

    def __init__(
        self,
        server: "ViserServer",
        controls: Controls,
        session: Session,
        out: Path,
        show_live: Callable[[int | None], None],
    ) -> None:
        self._kept_gains, self._runs = KeptPresets(out / "gains.json", 3), out / "runs"
        self._server, self._controls, self._session = server, controls, session
        self._show_live = show_live
        self._shown: dict[Any, Any] = {}
        gui, virtual = server.gui, not session.table.real
        if not virtual:
            gui.add_markdown(WHAT_REAL)
        self._add_choices(virtual)
        self._add_buttons()
        self._bar: Any = gui.add_progress_bar(0.0)
        self._words: Any = gui.add_markdown(IDLE)
        with gui.add_folder("Controller's gains", expand_by_default=False):
            self._add_gains()
        with gui.add_folder("Ball: target and pushes", expand_by_default=True):
            self._add_ball()
        with gui.add_folder("Virtual table's play", expand_by_default=False, visible=virtual):
            play_sliders(server, controls, session)
        gui.add_markdown(with_mouse(KEYS))
        self._events: Any = gui.add_markdown("")

    def _add_choices(self, virtual: bool) -> None:
        """Protocol, methods, repetitions and how the runs are made."""
        gui, value = self._server.gui, self._controls.value
        names = (WHOLE, *shipped())
        protocols = gui.add_dropdown("Protocol", names, initial_value="free-release")
        self._protocol = value(
            protocols, "protocol", partial(choice, options=names), self._describe
        )
        self._about: Any = gui.add_markdown("")
        self._describe(self._protocol.now)
        methods = gui.add_dropdown("Controller", tuple(METHODS))
        self._methods = value(methods, "method", partial(choice, options=tuple(METHODS)))
        self._repetitions = value(
            gui.add_number("Repetitions", 1, min=1, max=100, step=1, hint=SEEDS),
            "repetitions",
            lambda v: int(REPETITIONS.clamp(v)),
        )
        speeds = gui.add_dropdown(
            "Speed of the simulation", SPEEDS, hint="how fast its time runs", visible=virtual
        )
        self._speed = value(speeds, "speed of the simulation", partial(choice, options=SPEEDS))
        self._pause = value(gui.add_checkbox("Pause between runs", False), "pause", flag)
        by_hand = gui.add_checkbox(
            "I put the ball down myself",
            False,
            hint="you are asked before each run, and have two minutes",
            visible=virtual,
        )
        self._by_hand = value(by_hand, "hand", flag)
        self._arm_box: Any = gui.add_checkbox(
            "Arm: the plate is clear, a hand is at the switch", False, visible=not virtual
        )
        self._armed = value(self._arm_box, "arm the table", flag)
        self._armed_since_s: float | None = None
        self._controls.withdraw.append(self._disarm)

    def _describe(self, name: str) -> None:
        """Write below the list what the chosen protocol is, and how long a run of it takes."""
        if name == WHOLE:
            plans = [shipped_plan(one, BOTH, 1) for one in STUDY]
            all_s = minutes(sum(plan.run_s * len(plan.methods) for plan in plans))
            count = sum(len(plan.methods) for plan in plans)
            single = ", ".join(plan.protocol.name for plan in plans if len(plan.methods) == 1)
            self._about.content = (
                f"{', '.join(STUDY)}, one after the other: {count} runs, {all_s} with both "
                f"controllers, at speed 1; of {single}, where the controller plays no part, one."
            )
            return
        plan = shipped_plan(name, BOTH, 1)
        once = "" if len(plan.methods) > 1 else ", recorded once: the controller plays no part"
        self._about.content = f"{plain(plan.protocol.title)}: {plan.run_s:.0f} s a run{once}."

    def _add_buttons(self) -> None:
        """Start, next run, what the operator is asked to do."""
        gui, button = self._server.gui, self._controls.button
        self._start = gui.add_button("▶ Start", color="green")
        button(self._start, "start", self.start)
        self._next = gui.add_button("Next run", color="green", visible=False)
        button(self._next, "next run", lambda page: self.go_on())
        self._repeat = gui.add_button("Repeat the last run", visible=False)
        button(self._repeat, "repeat", self.repeat)
        self._controls.needs(
            lambda page: self._check_armed(), self._start, self._next, self._repeat
        )
        self._step = gui.add_markdown("", visible=False)
        self._done = gui.add_button("Done", color="orange", visible=False)
        button(self._done, "confirm", lambda page: self._session.confirm())

    def start(self, page: int | None) -> None:
        """Start the plan that the inputs describe, and show it on `page`. ValueError, OSError: a
        real table is not armed, or the session refuses the plan (`Session.start`).
        """
        name = self._protocol.now
        how = {
            # who armed a real table for a run armed it for that one
            "pause": self._pause.now or self._session.table.real,
            "by_hand": self._by_hand.now,
            "speed": float(self._speed.now.split()[0]),
        }
        self._take_arming()
        plans = [
            replace(shipped_plan(one, self._methods.now, self._repetitions.now), **how)
            for one in (STUDY if name == WHOLE else (name,))
        ]
        rig = self._session.rig
        self._session.start(*(with_new_seeds(plan, rig, self._runs) for plan in plans))
        self._show_live(page)

    def balance(self, page: int | None) -> None:
        """Balance the virtual table again and show it on `page`. ValueError: a real table."""
        self._session.balance()
        self._show_live(page)

    def go_on(self) -> None:
        """Begin the run of the plan that waits; nothing where none does. ValueError: a real table
        that is not armed for it.
        """
        if self._session.status.state == "pause":
            self._take_arming()
            self._session.go_on()

    def repeat(self, page: int | None) -> None:
        """Make the last run again, which was not completed. ValueError: there is none, or a real
        table is not armed for it.
        """
        self._take_arming()
        self._session.repeat()
        self._show_live(page)

    def _check_disturb(self) -> None:
        """Raise ValueError where a run is being recorded and nobody said that it may be marked."""
        if self._session.status.state == "running" and not self._disturb.now:
            raise ValueError(f"a run is being recorded: {DISTURB}")

    def _take_arming(self) -> None:
        """A real table's arming counts once. ValueError: it was not armed."""
        self._check_armed()
        if self._session.table.real:
            self._disarm()

    def _check_armed(self) -> None:
        """ValueError: a real table that is not armed."""
        if self._session.table.real and not self._armed.now:
            raise ValueError("nothing moves yet: clear the plate, hand at the switch, tick Arm")

    def _disarm(self) -> None:
        """Take the arming back: it was used, or whoever ticked it no longer answers for it."""
        self._armed.now = False
        if self._arm_box.value:
            self._arm_box.value = False

    def _age_arming(self) -> None:
        """Take back an arming that nobody has used for ARMED_S."""
        now_s = time.monotonic()
        if not self._armed.now:
            self._armed_since_s = None
        elif self._armed_since_s is None:
            self._armed_since_s = now_s
        elif now_s - self._armed_since_s > ARMED_S:
            self._armed_since_s = None
            self._disarm()

    def _add_gains(self) -> SliderGroup:
        gains = self._session.rig.gains
        start = gains.proportional_rad_m, gains.integral_rad_m_s, gains.derivative_rad_s_m
        rows = zip(("P [rad/m]", "I [rad/(m s)]", "D [rad s/m]"), (KP, KI, KD), start, strict=True)
        presets = {
            name: [factor * value for factor, value in zip(factors, start, strict=True)]
            for name, factors in PRESETS.items()
        }
        hint = "applies at once, and to the runs that are started from now on"
        return SliderGroup(
            self._server,
            self._controls,
            list(rows),
            self._set_gains,
            hint=hint,
            presets=presets,
            kept=self._kept_gains,
            check=lambda page: self._check_disturb(),
        )

    def _set_gains(self, wanted: list[float]) -> None:
        self._check_disturb()
        names = "proportional_rad_m", "integral_rad_m_s", "derivative_rad_s_m"
        rig = self._session.rig
        gains = replace(rig.gains, **dict(zip(names, wanted, strict=True)))
        self._session.set_gains(replace(rig, gains=gains), SetGains(*wanted))

    def _add_ball(self) -> None:
        gui, controls = self._server.gui, self._controls
        virtual = not self._session.table.real
        gui.add_markdown(with_mouse("Shift + click on the plate sends the ball there."))
        self._disturb_box: Any = gui.add_checkbox(
            "Disturb the recorded run", False, hint=MARKED, visible=False
        )
        self._disturb = controls.value(self._disturb_box, "disturb", flag)
        back = gui.add_button("Send the ball back to the middle")
        controls.button(back, "target", lambda page: self._send(Target(None)))
        low, high, step = PUSH_M_S.low, PUSH_M_S.high, PUSH_M_S.step
        hint = "speed that a push gives"
        push = gui.add_slider("Push [m/s]", low, high, step, 0.15, hint=hint, visible=virtual)
        self._push = controls.value(push, "Push [m/s]", PUSH_M_S.clamp)
        arrows = gui.add_button_group("Push", tuple(ARROWS), visible=virtual)
        controls.pick(arrows, tuple(ARROWS), lambda label: self.push(ARROWS[label]))
        controls.needs(lambda page: self._check_moves(), back, arrows)

    def push(self, angle_deg: float) -> None:
        """Push the virtual ball in the direction `angle_deg`, from +x towards +y, as hard as the
        slider says. ValueError: a real table, or nothing moves.
        """
        if self._session.table.real:
            raise ValueError("push a real ball with a stick")
        strength = self._push.now / PUSH_S
        angle = radians(angle_deg)
        self._send(Push((strength * cos(angle), strength * sin(angle)), PUSH_S))

    def _check_moves(self) -> None:
        """Raise ValueError where no push or target would be taken."""
        self._check_disturb()
        self._session.check_moves()

    def _send(self, command: Push | Target) -> None:
        self._check_disturb()
        self._session.put(command)

    def aim(self, xy_m: tuple[float, float]) -> None:
        """Send the ball to `xy_m` on the plate, clamped to where the ball fits. ValueError: nothing
        moves, or a coordinate is not finite.
        """
        side = self._session.rig.linkage.side_m
        self._send(Target(on_plate(xy_m, side, self._session.rig.ball.radius_m)))

    def draw(self, status: SessionStatus, events: Sequence[tuple[str, str]]) -> None:
        """Show the status and the newest events; only what changed is sent to the pages."""
        on = status.run is not None
        real = self._session.table.real
        then = "the table sees that you have" if real else "then press Done"
        operator_step = (
            f"**Please {plain(status.operator_step)}**, {then}." if status.operator_step else ""
        )
        self._age_arming()
        self._set(self._start, "visible", not on)
        self._set(self._next, "visible", status.state == "pause")
        self._set(self._repeat, "visible", self._session.may_repeat)
        self._set(self._disturb_box, "visible", on)
        if not on and self._disturb.now:  # asked for anew in every plan
            self._disturb.now = self._disturb_box.value = False
        self._set(self._step, "visible", bool(operator_step))
        self._set(self._done, "visible", bool(operator_step) and not real)
        if operator_step:
            self._set(self._step, "content", live(operator_step))
        self._set(self._bar, "value", round(100 * status.share, 1))
        self._set(self._words, "content", live(progress_words(status)))
        self._set(self._events, "content", events_by_run(events))

    def _set(self, handle: Any, name: str, value: Any) -> None:
        if self._shown.get((id(handle), name)) != value:
            self._shown[id(handle), name] = value
            setattr(handle, name, value)
