"""What no name explains: its shape on a fixed basis, found in what is left of the innovations.

Families (see `rig.unknown`): a map (force over the plate, volts over the servo's angle), a
dependence on speed, one rhythm, one segment of time. Each is linear in its coefficients; where a
frequency or a window has to be found, the periodogram and a matched filter propose it. The score
is the gain in log-likelihood beyond what the coefficients and the places looked at cost.
"""

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace

import numpy as np

from calibration.gap.attitude import attitude
from calibration.gap.evidence import Evidence
from calibration.gap.fit import Fit, bounded_step, differences, normal_equations, weights
from calibration.gap.knobs import BALL, SERVO
from calibration.gap.screen import PER_KNOB
from calibration.gap.state import State
from rig.unknown import Unknown, pack, unknown_acceleration, unknown_volts

WINDOWS_S = (0.3, 0.6, 1.2, 2.5, 5.0, 10.0)
SEARCHED = 7.0  # log-likelihood that the choice of a frequency or a window costs
ORDERS = (1, 2, 3)
# RMS [m/s2, V] below which it is no effect: the tolerances of rolling, of friction and dead zone.
SMOOTHED = 15
LEAST_FELT = {"ball": 0.0015, "servo": 0.025}
UNIT = {"ball": 0.02, "servo": 0.02}  # m/s2 and V: size of the trial coefficients


@dataclass(frozen=True, eq=False)
class Shape:
    """An unnamed term: its part, its kind (map, speed, rhythm, segment, turning), score and
    coefficients. The model has no room for a turning one: it is told, not added."""

    part: str
    kind: str
    score: float
    unknown: Unknown
    state: State

    @property
    def channel(self) -> str:
        """The channel that it moves most."""
        if self.part != BALL:
            return self.part
        size = [
            sum(float(np.sum(np.square(value))) for name, value in vars(self.unknown).items()
                if name.startswith("ball") and name.endswith(axis) and isinstance(value, tuple))
            + (self.unknown.ball_segment["xy".index(axis)] ** 2)
            for axis in "xy"
        ]  # fmt: skip
        return "ball_x" if size[0] >= size[1] else "ball_y"


def shapes(state: State) -> list[Shape]:
    """Every family on every part, best first."""
    found = [shape for part in state.evidence.parts for shape in _of_part(state, part)]
    return sorted(found, key=lambda shape: -shape.score)


def _of_part(state: State, part: str) -> Iterator[Shape]:
    side = "ball" if part == BALL else "servo"
    axes = "xy" if part == BALL else part[-1]
    nuisance = _nuisance(state, part)
    for order in ORDERS if side == "ball" else (4,):
        places = [i * 4 + j for i in range(4) for j in range(4) if i + j <= order]
        places = places if side == "ball" else list(range(4))
        units = [_unit(f"{side}_map_{a}", i) for a in axes for i in places]
        yield _fitted(state, part, "map", units, nuisance, {})
    # On a servo what grows with speed is K and tau: that term is left out.
    units = [
        _unit(f"{side}_speed_{a}", i) for a in axes for i in range(4) if part == BALL or i != 1
    ]
    yield _fitted(state, part, "speed", units, nuisance, {})
    units = [_unit(f"{side}_rhythm_{a}", i) for a in axes for i in range(2)]
    for hz in _peaks(state, part):
        yield _fitted(state, part, "rhythm", units, nuisance, {f"{side}_rhythm_hz": hz}, SEARCHED)
    if part == BALL and all(state.evidence.ball_axes):
        yield turning(state, nuisance)
    units = [_unit(f"{side}_segment", "xy".index(a)) for a in axes]
    for window in _windows(state, part, side):
        fixed = {f"{side}_segment_s": window}
        yield _fitted(state, part, "segment", units, nuisance, fixed, SEARCHED)


Unit = tuple[str, int]


def _unit(name: str, i: int) -> Unit:
    return name, i


def _term(units: list[Unit], sizes: np.ndarray, fixed: dict, base: Unknown) -> Unknown:
    """The unnamed term with the units at these sizes, on top of `base`."""
    values = {f.name: getattr(base, f.name) for f in fields(Unknown)} | fixed
    for (name, i), size in zip(units, sizes, strict=True):
        row = list(values[name])
        row[i] += float(size)
        values[name] = tuple(row)
    return Unknown(**values)


def _nuisance(state: State, part: str) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Columns (n, k) of the free knobs of a part, their lower and upper room, their steps."""
    bounds = state.bounds((part,))
    knobs = [state.believed.knobs[name] for name in bounds]
    only = Fit(state.fit.setting, {part: state.fit.rolls[part]}, {}, state.fit.columns)
    columns = differences(state.evidence, state.believed, only, knobs, bounds)[part]
    value = np.array([state.fit.setting.get(k.name, k.believed) for k in knobs])
    low, high = (np.array([bounds[k.name][i] for k in knobs]) for i in (0, 1))
    return columns, low - value, high - value, np.array([k.step for k in knobs])


def _fitted(state: State, part: str, kind: str, units: list[Unit], nuisance: tuple,
            fixed: dict, searched: float = 0.0) -> Shape:  # fmt: skip
    """Fit a family linearly beside the free knobs, then score it by its real roll-out."""
    unit = UNIT["ball" if part == BALL else "servo"]
    base, believed = state.fit.rolls[part], state.believed
    have = believed.rig.unknown
    eye = np.eye(len(units)) * unit
    models = [
        believed.with_unknown(_term(units, row, fixed, have)).model(state.fit.setting)
        for row in eye
    ]
    rolls = state.evidence.rolls([(model, part) for model in models])
    columns = np.column_stack([nuisance[0], *[r.slope(base, unit) for r in rolls]])
    k = len(units)
    only = Fit(state.fit.setting, {part: base}, {})
    a, b = normal_equations(state.evidence, only, {part: columns})
    low = np.append(nuisance[1], np.full(k, -np.inf))
    high = np.append(nuisance[2], np.full(k, np.inf))
    step = bounded_step(a, b, low, high, np.append(nuisance[3], np.full(k, unit)))
    gain = -float(0.5 * step @ a @ step + b @ step)
    alone = bounded_step(a[:-k, :-k], b[:-k], nuisance[1], nuisance[2], nuisance[3])
    gain += float(0.5 * alone @ a[:-k, :-k] @ alone + b[:-k] @ alone)
    unknown = _term(units, step[-k:], fixed, have)
    felt = float(np.sqrt(np.mean(np.square(_felt(state, part, unknown)))))
    least = LEAST_FELT["ball" if part == BALL else "servo"]
    if felt < least + (state.believed.friction_slack_V if part != BALL else 0.0):
        gain = 0.0
    new = replace(state, believed=believed.with_unknown(unknown))
    return Shape(part, kind, gain - PER_KNOB * k - searched, unknown, new)


def _felt(state: State, part: str, unknown: Unknown) -> np.ndarray:
    """The unnamed term along the recorded motion [V or m/s2], (n,)."""
    rig = state.believed.rig
    u, half = pack(unknown, rig.servo.angle_limit_rad), rig.linkage.plate_side_m / 2
    values: list[float] = []
    for run in state.evidence.runs:
        if part == BALL and len(run.exposed_s) > 2:
            v = np.gradient(run.ball_m, run.exposed_s, axis=0)
            for i in range(0, len(v), 5):
                x, y = run.ball_m[i] / half
                values += [unknown_acceleration(u, a, x, y, v[i, a], run.exposed_s[i])
                           for a in range(2)]  # fmt: skip
        elif part != BALL:
            a = SERVO.index(part)
            omega = np.gradient(run.theta_rad[:, a], run.t_s)
            omega = np.convolve(omega, np.ones(SMOOTHED) / SMOOTHED, "same")  # counts are steps
            values += [unknown_volts(u, a, run.theta_rad[i, a], omega[i], run.t_s[i])
                       for i in range(0, len(run.t_s), 20)]  # fmt: skip
    return np.array(values)


def _peaks(state: State, part: str) -> list[float]:
    """The two frequencies [Hz] at which the residuals swing most, beyond their neighbours."""
    z = state.fit.z(part) * state.evidence.masks[part]
    t, run = state.evidence.times(part)
    chosen = run == np.bincount(run).argmax()
    t, z = t[chosen], z[chosen]
    columns = [z[0::2], z[1::2]] if part == BALL else [z]
    t = t[0::2] if part == BALL else t
    step = float(np.median(np.diff(t)))
    even = np.arange(t[0], t[-1], max(step, 0.005))
    swings = [np.fft.rfft(np.interp(even, t, c), 4 * len(even)) for c in columns]
    power = np.sum(np.abs(swings) ** 2, axis=0)
    hz = np.fft.rfftfreq(4 * len(even), max(step, 0.005))
    band = (hz > 2.0 / (t[-1] - t[0])) & (hz < min(25.0, 0.45 / step))
    if not band.any():
        return []
    hz, power = hz[band], power[band]
    width = max(len(hz) // 12, 5)
    floor = np.convolve(np.pad(power, width, mode="reflect"), np.ones(2 * width + 1), "valid")
    ratio = power / floor
    first = int(ratio.argmax())
    far = np.abs(hz - hz[first]) > 0.3
    second = [float(hz[far][ratio[far].argmax()])] if far.any() else []
    return [float(hz[first]), *second]


def _windows(state: State, part: str, side: str) -> list[tuple[float, float]]:
    """The two windows of time in which a constant force explains most (matched filter)."""
    t, run = state.evidence.times(part)
    z = state.fit.z(part) * np.sqrt(weights(state.fit.z(part), state.evidence.masks[part]))
    stride = 2 if part == BALL else 1
    t, run, z = t[::stride], run[::stride], z.reshape(-1, stride)
    found: list[tuple[float, float, float]] = []
    for length in WINDOWS_S:
        kernel = _response(state.evidence, state, part, side, length, stride)
        if kernel is None or len(kernel) >= len(t):
            continue
        match = np.array([np.correlate(z[:, c], kernel, "valid") for c in range(stride)])
        score = np.sum(match**2, axis=0) / max(float(kernel @ kernel), 1e-30)
        i = int(np.argmax(score))
        begin = float(t[i])
        found.append((0.5 * float(score[i]), begin, begin + length))
    found.sort(reverse=True)
    return [(begin, end) for _, begin, end in found[:2]]


def _response(evidence: Evidence, state: State, part: str, side: str, length: float,
              stride: int) -> np.ndarray | None:  # fmt: skip
    """What a unit force of `length` seconds does to the residuals, from its start on."""
    t, run = evidence.times(part)
    t, first = t[::stride], run[::stride] == 0
    t = t[first]
    if t[-1] - t[0] < length + 3.0:
        return None
    begin = float(t[0]) + 1.0
    fixed = {f"{side}_segment_s": (begin, begin + length)}
    axis = 0 if part == BALL else SERVO.index(part)
    unknown = _term([(f"{side}_segment", axis)], np.array([UNIT[side]]), fixed, Unknown())
    model = state.believed.with_unknown(unknown).model(state.fit.setting)
    z = evidence.roll(model, part).z - state.fit.z(part)
    z = z.reshape(-1, stride)[: len(t), 0]
    i = int(np.searchsorted(t, begin))
    keep = int(np.searchsorted(t, begin + length + 1.0)) - i
    return z[i : i + keep]


def turning(state: State, nuisance: tuple) -> Shape:
    """A force that turns with the ball: a heavy side, of which each run has its own direction.

    The ball rolls, so its attitude follows from its path: dR = [(-dy, dx, 0)/r]x R. The force is
    c (R e)_xy, linear in e; its effect on the innovations is the filter's answer to a short push.
    """
    kernel = _response(state.evidence, state, BALL, "ball", 0.05, 2)
    found: list[np.ndarray] = []
    total = sum(len(run.exposed_s) for run in state.evidence.runs)
    begin = 0
    for run in state.evidence.runs:
        n = len(run.exposed_s)
        turned = attitude(run.ball_m, state.believed.rig.ball.radius_m)
        for j in range(3):
            column = np.zeros((total, 2))
            for a in range(2):
                answer = np.convolve(turned[:, a, j], kernel if kernel is not None else [0.0])
                column[begin : begin + n, a] = answer[:n] / (3 * UNIT["ball"])
            found.append(column.ravel())
        begin += n
    k = len(found)
    columns = np.column_stack([nuisance[0], *found])
    only = Fit(state.fit.setting, {BALL: state.fit.rolls[BALL]}, {})
    a, b = normal_equations(state.evidence, only, {BALL: columns})
    low, high = (
        np.append(side, np.full(k, s * np.inf))
        for side, s in zip(nuisance[1:3], (-1, 1), strict=True)
    )
    step = bounded_step(a, b, low, high, np.append(nuisance[3], np.full(k, UNIT["ball"])))
    gain = -float(0.5 * step @ a @ step + b @ step)
    if np.linalg.norm(step[-k:]) / k**0.5 < LEAST_FELT["ball"]:
        gain = 0.0
    return Shape(BALL, "turning", gain - PER_KNOB * k, state.believed.rig.unknown, state)
