"""An unnamed term in plain words, and as a formula."""

from collections.abc import Callable
from math import degrees

import numpy as np

from calibration.gap.model.parameters import BALL
from calibration.gap.unnamed.term import UnnamedTerm
from rig.discrepancy import Discrepancy

MOST_TOLD = 4  # of the windows of pushes
# Of what a term is made, in words, its unit there and how many of them an SI unit is.
QUANTITIES = {
    "a": ("a force", "m/s2", 1.0),
    "V": ("a voltage", "V", 1.0),
    "d": ("an angle beside the command", "degrees", degrees(1.0)),
}


def _quantity(term: UnnamedTerm) -> str:
    """The letter of a term in a formula: acceleration, volts or an angle."""
    if term.output == BALL:
        return "a"
    return "d" if term.state.nominal.rig.servo.takes_angle else "V"


def describe(term: UnnamedTerm) -> str:
    """The term's kind and size in plain words, for the report."""
    u, side = term.unknown, "ball" if term.output == BALL else "servo"
    word, unit, scale = QUANTITIES[_quantity(term)]
    words: dict[str, Callable[[], str]] = {
        "map": lambda: _map_words(term),
        "speed": lambda: f"{word} that depends on speed",
        "rhythm": lambda: (
            f"a rhythm of {getattr(u, f'{side}_rhythm_hz'):.2f} Hz, "
            f"{scale * _largest(u, side, 'rhythm'):.2g} {unit}"
        ),
        "swaying": lambda: "rhythms of {:.2f} Hz along x and {:.2f} Hz along y".format(
            *term.rhythms_hz
        ),
        "turning": lambda: "a force that turns with the ball, as of one that is heavier on a side",
        "pushes": lambda: f"pushes {when(term.windows_s)}",
        "slipping": lambda: "a force as of a ball that slips where the plate is steep",
        "swinging": lambda: (
            "a force as of a plate that swings behind its servos, at about "
            + " and ".join(
                f"{hz:.1f} Hz along {axis}"
                for axis, hz in zip("xy", term.rhythms_hz, strict=True)
                if hz
            )
        ),
        "segment": lambda: (
            f"from {getattr(u, f'{side}_segment_s')[0]:.1f} to "
            f"{getattr(u, f'{side}_segment_s')[1]:.1f} s only, "
            f"{scale * max(abs(v) for v in getattr(u, f'{side}_segment')):.2g} {unit}"
        ),
    }
    return words[term.kind]()


def when(windows_s: tuple[tuple[float, float], ...]) -> str:
    """When, in words: the first few windows."""
    told = ", ".join(f"{begin:.1f} to {end:.1f}" for begin, end in windows_s[:MOST_TOLD])
    more = f" s and {len(windows_s) - MOST_TOLD} more" if len(windows_s) > MOST_TOLD else " s"
    return f"from {told}{more}"


def _largest(u: Discrepancy, side: str, kind: str) -> float:
    return max(float(np.hypot(*getattr(u, f"{side}_{kind}_{a}"))) for a in "xy")


def _map_words(term: UnnamedTerm) -> str:
    quantity, axis = _quantity(term), term.output[-1]
    if quantity == "a":
        return "a force that depends on the place on the plate"
    if quantity == "d":
        return f"an angle beside the command of {axis} that depends on the servo's angle"
    return f"volts on {axis} that depend on the servo's angle"


SPARSE = 0.15  # of the largest coefficient: smaller ones are left out of a formula
SPEEDS = {
    "ball": ("tanh(v/0.01)", "v", "v|v|", "|v|"),
    "servo": ("tanh(w/0.05)", "w", "w|w|", "|w|"),
}


def formula(term: UnnamedTerm) -> str | None:
    """The largest coefficients of the unnamed term as a formula, axis by axis; None where all are
    0.

    Ball, a [m/s2]: x, y over half the plate's side, v its speed [m/s]. Servo, V [V], or where it
    takes an angle, d [rad]: q its angle over the servo's limit, w its speed [rad/s]. T2, T3 ...:
    Chebyshev polynomials; t: the run's time [s].
    """
    side = "ball" if term.output == BALL else "servo"
    axes = "xy" if term.output == BALL else term.output[-1]
    told = []
    for axis in axes:
        terms = [(c, w) for c, w in _terms(term.unknown, side, axis) if c != 0.0]
        largest = max((abs(c) for c, _ in terms), default=0.0)
        kept = [f"{c:+.2g} {w}".strip() for c, w in terms if abs(c) >= SPARSE * largest]
        if kept:
            told.append(f"{_quantity(term)}_{axis} = {' '.join(kept)}")
    return "; ".join(told) or None


def _terms(u: Discrepancy, side: str, axis: str) -> list[tuple[float, str]]:
    """Every coefficient of an axis with its function in words."""
    coefficients = getattr(u, f"{side}_map_{axis}")
    if side == "ball":
        places = [(_power("x", i), _power("y", j)) for i in range(4) for j in range(4)]
        found = [
            (c, " ".join(p for p in pair if p))
            for c, pair in zip(coefficients, places, strict=True)
        ]
    else:
        found = [(c, _power("q", i + 1)) for i, c in enumerate(coefficients)]
    found += list(zip(getattr(u, f"{side}_speed_{axis}"), SPEEDS[side], strict=True))
    hz = getattr(u, f"{side}_rhythm_hz")
    waves = (f"sin(2 pi {hz:.3g} t)", f"cos(2 pi {hz:.3g} t)")
    found += list(zip(getattr(u, f"{side}_rhythm_{axis}"), waves, strict=True))
    begin, end = getattr(u, f"{side}_segment_s")
    constant = getattr(u, f"{side}_segment")["xy".index(axis)]
    return [*found, (constant, f"for {begin:.1f} < t < {end:.1f}")]


def _power(name: str, order: int) -> str:
    return "" if order == 0 else name if order == 1 else f"T{order}({name})"
