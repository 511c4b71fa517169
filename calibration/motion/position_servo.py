"""Servos that take an angle: lag, dead time, limits, dead band, scale, from commands and angles.

The angle seen is the servo's answer to its commands by the simulator's own equations
(`rig.plant.position_servo`; their words and symbols hold here),

    theta(t) = answer(u; T, t_d, Omega, A, w, s, z),

fitted by nonlinear least squares. Standard deviations come from clusters of a second
(`calibration.statistics`), as neighbouring residuals are correlated. A limit counts as seen where
the answer without it is worse by more than chance brings. Three arms have three servos for two
tilts: they are taken as alike, and fitted to both. Of servos that take a command once a period
longer than a tick (hobby servos on pulses) a real log does not tell when a period begins: that is
fitted, too (`Followed.in_phase`).
"""

from dataclasses import dataclass
from itertools import product
from math import exp, log, sqrt

import numpy as np
from scipy.optimize import least_squares

from calibration.camera.sheet import CalibrationError
from calibration.motion.commanded_moves import Followed
from calibration.records import PositionServoAxis, PositionServoRecord, Value
from calibration.statistics import clustered_covariance, student_quantile
from rig.linkage import THREE_ARMS
from rig.parameters import Rig
from rig.plant.plant_record import pack
from rig.prediction.commanded import answers

CLUSTER_S = 1.0
MIN_CLUSTERS = 12  # chosen: twice the numbers that are fitted
WORSE = 12.0  # chi-square of one number with 3.5 standard deviations; chosen
FREE_RATE_RAD_S, FREE_ACCELERATION_RAD_S2 = 1e3, 1e6  # no limit at all
MOST_LEFT = 0.2  # share of the motion; chosen: what leaves more is no such servo
# What a servo of another kind than the equations' leaves, measured on motors with a controller and
# a dead band in MuJoCo (tests/engines/test_position_calibration.py): their inertia is a second lag
# of 2 to 3 ms, which goes to the dead time. The limits are shares.
_MODEL = {
    "lag_s": 0.0035,
    "dead_time_s": 0.0035,
    "rate_limit_rad_s": 0.02,
    "acceleration_limit_rad_s2": 0.05,
    "dead_band_rad": 0.0002,
    "scale": 0.002,
    "zero_rad": 0.0003,
}


@dataclass(frozen=True)
class _Number:
    """One number of the fit: field of the plant's record, start, bounds, typical size; limits are
    fitted as logarithms."""

    field: str
    starts: tuple[float, ...]
    low: float
    high: float
    size: float
    logarithm: bool = False


NUMBERS = {
    "lag_s": _Number("lag_s", (0.003, 0.02, 0.06, 0.15), 0.0, 1.0, 0.02),
    "dead_time_s": _Number("dead_time_s", (0.002, 0.02, 0.06), 0.0, 0.5, 0.01),
    "rate_limit_rad_s": _Number("rate_limit_rad_s", (5.0,), 0.05, 200.0, 0.2, True),
    "acceleration_limit_rad_s2": _Number(
        "acceleration_limit_rad_s2", (50.0, 1000.0), 1.0, 1e5, 0.5, True
    ),
    "dead_band_rad": _Number("dead_band_rad", (0.004,), 0.0, 0.2, 0.004),
    "scale": _Number("angle_scale_fraction", (0.0,), -0.8, 4.0, 0.05),
    "zero_rad": _Number("angle_zero_offset_rad", (0.0,), -0.5, 0.5, 0.01),
}
PERIOD_BEGIN = "period_begin_s"  # in the log's time, less a whole number of periods
BEGIN_STARTS = tuple(k / 8 for k in range(8))  # of a period; chosen
VALLEYS = ("acceleration_limit_rad_s2", PERIOD_BEGIN)
SHARES = (-0.1, -0.03, 0.0, 0.03, 0.1)  # by which other scales are tried; chosen
ALIKE = (
    "dead band and scale error look alike under commands of one size; record slow-triangle or "
    "sine-sweep"
)
LIMITS = {
    "acceleration_limit_rad_s2": FREE_ACCELERATION_RAD_S2,
    "rate_limit_rad_s": FREE_RATE_RAD_S,
}


def _kinds(followed: Followed, rig: Rig, axes: tuple[int, ...]) -> dict[str, _Number]:
    """NUMBERS, and when a period begins where that is not known and it is longer than a tick."""
    period_s = max(rig.servo.pair("period_s")[a] for a in axes)
    if followed.in_phase or period_s <= 1.5 * float(np.median(np.diff(followed.t_s))):
        return NUMBERS
    starts = tuple(share * period_s for share in BEGIN_STARTS)
    begin = _Number("", starts, -period_s, 2.0 * period_s, 0.25 * period_s)
    return {**NUMBERS, PERIOD_BEGIN: begin}


class _Fit:
    """The numbers `names` of the servos of `axes`, fitted to what followed; limits that are not
    among them are set free, and the dead band is held at `dead_band_rad`."""

    def __init__(
        self,
        followed: Followed,
        rig: Rig,
        axes: tuple[int, ...],
        names: list[str],
        dead_band_rad: float = 0.0,
    ) -> None:
        self._followed, self._axes, self.names = followed, axes, names
        self._p, self._kinds = pack(rig), _kinds(followed, rig, axes)
        for name, free in {**LIMITS, "dead_band_rad": dead_band_rad}.items():
            for a in axes:
                self._p[NUMBERS[name].field][a] = free
        seen = followed.seen_rad[:, list(axes)]
        self._used = np.isfinite(seen)
        self.seen = seen[self._used]
        clusters = np.floor((followed.seen_s - followed.seen_s[0]) / CLUSTER_S)
        both = clusters[:, None] + np.zeros(len(axes))
        self.clusters = both[self._used]
        self.x, self.cost = np.zeros(len(names)), np.inf

    def numbers(self, x: np.ndarray) -> dict[str, float]:
        """The fit's variables as what they stand for."""
        return {
            name: exp(value) if self._kinds[name].logarithm else float(value)
            for name, value in zip(self.names, x, strict=True)
        }

    def answer(self, x: np.ndarray) -> np.ndarray:
        """Angles (m, axes) [rad] at the times seen."""
        numbers = self.numbers(x)
        begin = numbers.pop(PERIOD_BEGIN, 0.0)
        for name, value in numbers.items():
            for a in self._axes:
                self._p[self._kinds[name].field][a] = value
        times, angles = answers(self._p, self._followed.t_s - begin, self._followed.told_rad)
        return np.column_stack(
            [np.interp(self._followed.seen_s - begin, times, angles[:, a]) for a in self._axes]
        )

    def residual(self, x: np.ndarray) -> np.ndarray:
        """Seen less answered (k,) [rad]."""
        return self.seen - self.answer(x)[self._used]

    def jacobian(self, x: np.ndarray) -> np.ndarray:
        """Derivatives (k, n) of the residual, by forward differences of 2 % of a typical size."""
        r, columns = self.residual(x), []
        for k, name in enumerate(self.names):
            step = 0.02 * self._kinds[name].size
            more = x.copy()
            more[k] += step
            columns.append((self.residual(more) - r) / step)
        return np.column_stack(columns)

    def starts(self) -> list[dict[str, float]]:
        """Every combination of the numbers' starts."""
        kinds = self._kinds
        return [
            dict(zip(kinds, values, strict=True))
            for values in product(*(kind.starts for kind in kinds.values()))
        ]

    def run(self, starts: list[dict[str, float]]) -> "_Fit":
        """Fit from the best start of each valley of the sum of squares, and keep the best: a lag
        and an acceleration limit are two, and so is every beginning of a period."""
        kinds = [self._kinds[name] for name in self.names]
        low = np.array([log(k.low) if k.logarithm else k.low for k in kinds])
        high = np.array([log(k.high) if k.logarithm else k.high for k in kinds])
        firsts: dict[tuple[float, ...], tuple[float, np.ndarray]] = {}
        for start in starts:
            numbers = zip(kinds, (start[name] for name in self.names), strict=True)
            x = np.array([log(value) if kind.logarithm else value for kind, value in numbers])
            valley, cost = tuple(start.get(name, 0.0) for name in VALLEYS), self._squares(x)
            if valley not in firsts or cost < firsts[valley][0]:
                firsts[valley] = cost, x
        for _, x in firsts.values():
            fit = least_squares(
                lambda x: 1e3 * self.residual(x),
                np.clip(x, low, high),
                jac=lambda x: 1e3 * self.jacobian(x),  # pyright: ignore[reportArgumentType]
                bounds=(low, high),
                x_scale=[k.size for k in kinds],
                ftol=1e-5,
                xtol=1e-5,
            )
            if fit.cost < self.cost:
                self.x, self.cost = fit.x, float(fit.cost)
        return self

    def _squares(self, x: np.ndarray) -> float:
        return float(np.sum(self.residual(x) ** 2))

    def deviations(self) -> np.ndarray:
        """Standard deviations of the variables, from the scatter between clusters."""
        r = self.residual(self.x)
        covariance = clustered_covariance(self.jacobian(self.x), r, self.clusters)
        return np.sqrt(np.maximum(np.diag(covariance), 0.0))


@dataclass(frozen=True)
class PositionServoFit:
    """The record of both servos, and when a period of each begins in the log's time [s]: a moment
    of the log, 0 where that is known.
    """

    record: PositionServoRecord
    begins_s: tuple[float, float]


def fit_position_servos(followed: Followed, rig: Rig) -> PositionServoFit:
    """Fit the servos of both axes to what followed their commands, with 95 % intervals.

    rig: period and quantum of the servos, the linkage, and where the numbers may lie.
    `CalibrationError`: an axis has too little to go by, or does not follow as a servo does.
    """
    if rig.linkage.kind == THREE_ARMS:
        x, begin_x_s = y, begin_y_s = _fitted(followed, rig, (0, 1), "the arms' servos")
    else:
        x, begin_x_s = _fitted(followed, rig, (0,), "servo x")
        y, begin_y_s = _fitted(followed, rig, (1,), "servo y")
    record = PositionServoRecord(x=x, y=y, source="angle")
    return PositionServoFit(record, (begin_x_s, begin_y_s))


def _fitted(
    followed: Followed, rig: Rig, axes: tuple[int, ...], who: str
) -> tuple[PositionServoAxis, float]:
    followed = followed.while_told(axes)
    first = _Fit(followed, rig, axes, list(_kinds(followed, rig, axes)))
    count = len(np.unique(first.clusters))
    if count < MIN_CLUSTERS:
        raise CalibrationError(
            f"{who}: its angle was seen in {count} seconds, {MIN_CLUSTERS} are needed"
        )
    best, gone = first.run(first.starts()), {}
    for limit in LIMITS:
        fewer = _Fit(followed, rig, axes, [n for n in best.names if n != limit])
        fewer.run([best.numbers(best.x)])
        if count * (fewer.cost / best.cost - 1.0) < WORSE:
            best, gone[limit] = fewer, "the servo did not reach it"
    left = float(np.sqrt(np.mean(best.residual(best.x) ** 2)))
    moved = float(np.std(best.answer(best.x)))
    rounded = _rounded(best, rig.servo.encoder_step_rad, moved)
    if left > MOST_LEFT * moved:
        raise CalibrationError(
            f"{who}: {left:.4f} rad of its angle is left of {moved:.4f}: it does not follow its "
            "commands as a servo does; are the axes swapped, is something in its way?"
        )
    if _look_alike(followed, rig, axes, best, count, rounded):
        gone |= dict.fromkeys(("dead_band_rad", "scale"), ALIKE)
    begin_s = best.numbers(best.x).get(PERIOD_BEGIN, 0.0)
    return _record(best, gone, left, count, rounded), begin_s


def _rounded(fit: _Fit, step_rad: float, moved_rad: float) -> dict[str, float]:
    """Half widths (95 %) by which rounded readings may move the numbers that angles at rest tell:
    twice step / sqrt(12 n) of n readings that err apart, 1 / sum of the squared shares of each."""
    counts = np.unique(np.round(fit.seen / step_rad), return_counts=True)[1]
    shares = counts / counts.sum()
    wide = 2.0 * step_rad * float(np.sqrt(np.sum(shares**2) / 12.0))
    return {"dead_band_rad": wide, "zero_rad": wide, "scale": wide / moved_rad}


def _look_alike(
    followed: Followed,
    rig: Rig,
    axes: tuple[int, ...],
    best: _Fit,
    count: int,
    rounded: dict[str, float],
) -> bool:
    """Whether another dead band fits as well, none where there is one and else a usual one, with a
    scale farther off than its interval tells: a second valley. Commands of one size move the servo
    by (1 + scale) of it, less the dead band; where it rests at few places, what the readings are
    rounded by says nothing of which it is."""
    numbers = best.numbers(best.x)
    deviations = dict(zip(best.names, best.deviations(), strict=True))
    usual = NUMBERS["dead_band_rad"].starts[0]
    other = 0.0 if numbers["dead_band_rad"] > 0.5 * usual else usual
    names = [name for name in best.names if name != "dead_band_rad"]
    fewer = _Fit(followed, rig, axes, names, other)
    fewer.run([{**numbers, "scale": numbers["scale"] + share} for share in SHARES])
    noise = 0.5e6 * len(best.clusters) * rig.servo.encoder_step_rad**2 / 12.0  # as a cost
    far = abs(fewer.numbers(fewer.x)["scale"] - numbers["scale"])
    told = sqrt(WORSE) * deviations["scale"] + _MODEL["scale"] + rounded["scale"]
    return far > told and count * (fewer.cost - best.cost) / (best.cost + noise) < WORSE


def _record(
    fit: _Fit, gone: dict[str, str], left: float, count: int, rounded: dict[str, float]
) -> PositionServoAxis:
    quantile = student_quantile(count - len(fit.names))
    values: dict[str, Value] = {}
    for name, x, std in zip(fit.names, fit.x, fit.deviations(), strict=True):
        if name == PERIOD_BEGIN or name in gone:
            continue
        half = quantile * float(std) + _MODEL[name] + rounded.get(name, 0.0)
        if NUMBERS[name].logarithm:
            values[name] = Value(value=exp(x), low=exp(x - half), high=exp(x + half))
        else:
            values[name] = Value.within(float(x), half, at_least=NUMBERS[name].low)
    return PositionServoAxis(**values, together_off_s=None, not_seen=gone, rms_rad=left)


def expected_angles(followed: Followed, fit: PositionServoFit, rig: Rig) -> np.ndarray:
    """Angles (m, 2) [rad] that the fitted servos give at the times seen."""
    p = pack(rig)
    for a, axis in enumerate((fit.record.x, fit.record.y)):
        for name, number in NUMBERS.items():
            value = getattr(axis, name)
            p[number.field][a] = value.value if value is not None else LIMITS.get(name, 0.0)
    columns = []
    for a, begin_s in enumerate(fit.begins_s):
        times, angles = answers(p, followed.t_s - begin_s, followed.told_rad)
        columns.append(np.interp(followed.seen_s - begin_s, times, angles[:, a]))
    return np.column_stack(columns)
