"""How the ball swings: speed over position, angle over torque, and how far from its target.

Drawn as small pictures (SVG) of the last 10 s, twice a second: a ring is a limit cycle, a loop of
the servo what play and friction leave of a straight line.
"""

import time
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.analysis.metrics import run_metrics
from experiments.analysis.samples import held
from experiments.dashboard.view.curves import X_HERE, Y_HERE
from rig.log import INDEX, Log
from rig.parameters import Servo

if TYPE_CHECKING:
    from viser import ClientHandle, ViserServer

WIDTH, HEIGHT, MARGIN = 300, 190, 34  # of a picture [px]
EVERY_S, LAST_S, BINS = 0.5, 10.0, 24  # chosen: calm to look at
WAIT = "Waiting for the first data."
GREY, BARS = "#868e96", "#0c8599"  # of another run; of the distances
KEY = f'<p><b style="color: {X_HERE}">x</b>, <b style="color: {Y_HERE}">y</b></p>'
Curve = tuple[str, np.ndarray, np.ndarray]  # colour, abscissae, ordinates


def _range(values: np.ndarray) -> tuple[float, float]:
    """Limits of an axis that holds all values and 0."""
    low, high = min(0.0, float(values.min())), max(0.0, float(values.max()))
    return (low, high) if high > low else (low - 1.0, high + 1.0)


def phase_picture(title: str, across: str, up: str, curves: list[Curve]) -> str:
    """An SVG of curves in a plane, with a cross at 0; across, up: names of its axes with units."""
    finite = [(c, *(v[np.isfinite(x) & np.isfinite(y)] for v in (x, y))) for c, x, y in curves]
    finite = [one for one in finite if len(one[1]) > 1]
    if not finite:
        return ""
    (left, right), (low, high) = (
        _range(np.concatenate([one[k] for one in finite])) for k in (1, 2)
    )

    def places(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        wide, tall = WIDTH - 2 * MARGIN, HEIGHT - 2 * MARGIN
        return (
            MARGIN + wide * (x - left) / (right - left),
            HEIGHT - MARGIN - tall * (y - low) / (high - low),
        )

    lines = []
    for colour, x, y in finite:
        at = " ".join(f"{a:.0f},{b:.0f}" for a, b in zip(*places(x, y), strict=True))
        lines.append(f'<polyline points="{at}" fill="none" stroke="{colour}" stroke-width="1.3"/>')
    (zero_x,), (zero_y,) = places(np.zeros(1), np.zeros(1))
    cross = (
        f'<path d="M{MARGIN} {zero_y:.0f}H{WIDTH - MARGIN}M{zero_x:.0f} {MARGIN}V{HEIGHT - MARGIN}"'
        ' stroke="currentColor" stroke-opacity="0.35" fill="none"/>'
    )
    ends = (
        f"{_text(MARGIN, HEIGHT - MARGIN + 12, f'{left:.3g}', 'start')}"
        f"{_text(WIDTH - MARGIN, HEIGHT - MARGIN + 12, f'{right:.3g}', 'end')}"
        f"{_text(MARGIN - 3, HEIGHT - MARGIN, f'{low:.3g}', 'end')}"
        f"{_text(MARGIN - 3, MARGIN + 8, f'{high:.3g}', 'end')}"
        f"{_text(WIDTH / 2, HEIGHT - 8, across, 'middle')}{_text(4, MARGIN - 8, up, 'start')}"
    )
    return _picture(title, cross + "".join(lines) + ends)


def histogram_picture(
    title: str, across: str, values: np.ndarray, before: np.ndarray | None = None
) -> str:
    """An SVG of how often values (n,) >= 0 lie where, from 0 to the largest; "" without any.
    before: values of another run, as a grey line in the same axes.
    """
    known = [v[np.isfinite(v)] for v in (values, np.empty(0) if before is None else before)]
    if not len(known[0]):
        return ""
    most = max(float(np.concatenate(known).max()), 1e-9)
    shares = [np.histogram(v, BINS, (0.0, most))[0] / max(len(v), 1) for v in known]
    highest = max(share.max() for share in shares)
    wide, bottom = (WIDTH - 2 * MARGIN) / BINS, HEIGHT - MARGIN
    now, then = ((HEIGHT - 2 * MARGIN) * share / highest for share in shares)
    bars = "".join(
        f'<rect x="{MARGIN + i * wide:.1f}" y="{bottom - h:.1f}" '
        f'width="{wide - 1:.1f}" height="{h:.1f}"/>'
        for i, h in enumerate(now)
    )
    steps = "".join(f"V{bottom - h:.1f}h{wide:.1f}" for h in then)
    line = f'<path d="M{MARGIN} {bottom}{steps}V{bottom}" stroke="{GREY}" stroke-width="2"'
    ends = (
        f"{_text(MARGIN, bottom + 12, '0', 'start')}"
        f"{_text(WIDTH - MARGIN, bottom + 12, f'{most:.3g}', 'end')}"
        f"{_text(MARGIN - 3, MARGIN + 8, f'{100 * highest:.0f} %', 'end')}"
        f"{_text(WIDTH / 2, HEIGHT - 8, across, 'middle')}"
    )
    shadow = f'{line} fill="none"/>' if len(known[1]) else ""
    return _picture(title, f'<g fill="{BARS}" fill-opacity="0.6">{bars}</g>{shadow}{ends}')


def _text(x: float, y: float, words: str, anchor: str) -> str:
    place = f'x="{x:.0f}" y="{y:.0f}" text-anchor="{anchor}"'
    return f'<text {place} font-size="11" fill="currentColor">{words}</text>'


def _picture(title: str, inside: str) -> str:
    return (
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" width="100%" role="img" aria-label="{title}">'
        f"{_text(WIDTH / 2, 14, title, 'middle')}{inside}</svg>"
    )


def _place_m(rows: np.ndarray, axis: str) -> np.ndarray:
    """The ball's coordinate (n,) [m] as it was last seen; NaN before that."""
    return held(rows[:, INDEX[f"ball_{axis}_m"]], np.nan)


def distance_cm(rows: np.ndarray) -> np.ndarray:
    """How far the ball was from its target (n,) [cm], of log rows (n, len(COLUMNS)); NaN before it
    was seen first.
    """
    off = [_place_m(rows, axis) - rows[:, INDEX[f"target_{axis}_m"]] for axis in "xy"]
    return 100 * np.hypot(*off)


def newest(rows: np.ndarray) -> np.ndarray:
    """The last LAST_S of log rows (n, len(COLUMNS)): a release before that would set the scale."""
    return rows[rows[:, 0] > rows[-1, 0] - LAST_S] if len(rows) else rows


def distance_words(rows: np.ndarray) -> str:
    """RMS distance from the target, in HTML, as Results tells it, but of these log rows (n,
    len(COLUMNS)), which are thinned: so with a digit less.
    """
    found = run_metrics(Log(rows))
    if not found.samples:
        return "RMS: <b>not seen</b>"
    if not (found.has_settled or found.target_moves):
        return "RMS after settling: <b>not settled yet</b>"
    part = "after settling" if found.has_settled else "of the last half"
    return f"RMS {part}: <b>{100 * found.settled.error_rms_m:.1f} cm</b>"


def phase_curves(rows: np.ndarray, servo: Servo) -> tuple[str, str, list[Curve], list[Curve]]:
    """Name and unit of what drives the servos; the ball's speed over its position, and the servos'
    angle over what drives them, of log rows (n, len(COLUMNS)), n > 1.
    """
    driven, unit, factor = (
        "estimated_torque_{}_Nm",
        "torque in the shaft, estimated [mN\u00a0m]",
        1e3,
    )
    name = "torque"
    angle = "theta_{}_rad"
    if servo.takes_angle:
        driven, unit, factor = "command_{}_rad", "command [deg]", np.degrees(1)
        name = "command"
        angle = angle if servo.has_angle else "desired_theta_{}_rad"
    swing, loop = [], []
    for axis, colour in (("x", X_HERE), ("y", Y_HERE)):
        place = 100 * _place_m(rows, axis)
        swing.append((colour, place, np.gradient(place, rows[:, 0])))
        turned = np.degrees(rows[:, INDEX[angle.format(axis)]])
        loop.append((colour, factor * rows[:, INDEX[driven.format(axis)]], turned))
    return name, unit, swing, loop


def pictures(rows: np.ndarray, servo: Servo, before: np.ndarray | None = None) -> str:
    """HTML of the pictures of the last 10 s of log rows (n, len(COLUMNS)), and `distance_words`;
    fewer than three rows: a sentence. before: rows of another run, drawn grey in the same axes.
    """
    if len(rows) < 3:
        return WAIT
    told, rows = distance_words(rows), newest(rows)
    name, unit, swing, loop = phase_curves(rows, servo)
    if before is not None:
        _, _, *others = phase_curves(before, servo)
        greys = [[(GREY, x, y) for _, x, y in curves] for curves in others]
        swing, loop = greys[0] + swing, greys[1] + loop
    away = "share of time at each distance from the target", "distance [cm]", distance_cm(rows)
    return (
        f"<p>From the target, {told}</p>"
        + KEY
        + phase_picture("ball: speed over position", "position [cm]", "speed [cm/s]", swing)
        + phase_picture(f"servo: angle over {name}", unit, "angle [deg]", loop)
        + histogram_picture(*away, None if before is None else distance_cm(before))
    )


def run_of(of: str) -> bool:
    """Whether what was recorded (`SessionStatus.of`) is a run."""
    return bool(of) and not of.startswith("balancing")


class Portrait:
    """Builds the pictures in the GUI container of viser that is open."""

    def __init__(self, server: "ViserServer | ClientHandle", servo: Servo) -> None:
        self._servo, self._drawn_s = servo, 0.0
        self._of, self._rows = "", np.empty((0, len(INDEX)))
        self._before: tuple[str, np.ndarray] | None = None  # the last run, and what it was
        self._last = ""  # its pictures
        self._html: Any = server.gui.add_html(_boxed(WAIT))

    @property
    def handles(self) -> list[Any]:
        """The widgets."""
        return [self._html]

    def draw(self, rows: np.ndarray, of: str, beside: tuple[str, np.ndarray] | None = None) -> None:
        """Show rows (n, len(COLUMNS)) of the log, at most every EVERY_S; of: what was recorded. A
        run (`run_of`) stays as a grey shadow under what follows it, and until the next one above it
        as it was; or `beside` is that shadow: what it is, and its rows.
        """
        now_s = time.monotonic()
        if of != self._of:
            if run_of(self._of) and len(self._rows) > 2:
                name, shadow = self._before or ("", None)
                head = f"<p><b>The last run</b>: {escape(self._of)}</p>" + _grey(name)
                self._last = f"{head}{pictures(self._rows, self._servo, shadow)}<hr>"
                self._before = self._of, newest(self._rows)
            self._of = of
        self._rows = rows
        if now_s - self._drawn_s >= EVERY_S:
            self._drawn_s = now_s
            name, shadow = beside or self._before or ("", None)
            head = f"<p>{escape(of)}</p>" + _grey(name)
            last = "" if beside or run_of(of) else self._last
            self._html.content = _boxed(last + head + pictures(rows, self._servo, shadow))


def _grey(name: str) -> str:
    line = f'<b style="border-bottom: 0.2em solid {GREY}">Grey</b>'
    return f"<p>{line}, in every picture: {escape(name)}</p>" if name else ""


def _boxed(inside: str) -> str:
    return f'<div style="padding: 0 0.6em; font-size: 0.85em">{inside}</div>'
