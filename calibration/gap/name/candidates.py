"""The candidates: with which sizes and shapes each effect of the catalogue is tried.

Several starts where the model is not linear in the effect (backlash, friction and delays have no
derivative at zero, a period along the turn has to be found), one where it is.
"""

from collections.abc import Iterable, Mapping
from itertools import product

import numpy as np

from calibration.gap.decision_rule import MIN_PHASE_RAD
from calibration.gap.model.data import Evidence
from calibration.gap.model.parameters import (
    CALIBRATED,
    COAST_KEY,
    FALL_KEY,
    GUESSES,
    HEIGHT_KEY,
    PERIODIC,
    SERVO,
    SETTLING_KEY,
    NominalModel,
)
from rig.effects import Effect

PERIODS = (3.0, 4.5, 6.5, 9.0, 13.0, 18.0, 25.0, 35.0, 50.0, 70.0)
# Each effect is tried from its tolerance up to the end of its range: real faults are 30 to 130
# tolerances, and a fit that starts near zero ends in the next minimum.
SIZES: Mapping[str, tuple[float, ...]] = {
    "friction_V": (0.03, 0.1, 0.3, 1.0), "half_width_V": (0.03, 0.1, 0.3, 1.0),
    "fraction": (0.02, 0.2), "fraction_1": (0.05, 0.3), "offset_V": (0.05, 0.5),
    "delay_s": (0.003, 0.01, 0.03, 0.1),
    "rate_1_s": (0.002,), "drop_1_V": (0.01,), "play_rad": (0.005, 0.012, 0.03, 0.08),
    "coefficient_1_rad": (0.1, 0.5), "coefficient_1_rad2": (0.5, 2.0), "slope_rad": (0.001, 0.01),
    "rate_rad_s": (5e-5,), "stiffness_1_s2": (0.05, 1.0), "deceleration_m_s2": (0.004, 0.015, 0.06),
    "extra_s": (0.006, -0.006, 0.02, 0.05, 0.1, 0.16, 0.25), "angle_rad": (0.02, 0.1),
    "k1_1_m2": (0.5, 3.0), HEIGHT_KEY: (0.01,), "lag_s": (0.01, 0.03, 0.1),
    "half_width_rad": (0.003, 0.01, 0.03),
}  # fmt: skip
START_COASTS_S2_RAD = (0.06, 0.2)  # arms that brake by 17 and by 5 rad/s2; chosen
FALLS = (0.0, 0.5, 1.0)  # of plates in the play of their joints
# Plays that are tried from here to the end of the range, a quarter apart: the valley of C about the
# right one is as wide; chosen.
SMALLEST_PLAY_RAD, PLAYS = 0.005, 14
SETTLING_S = (0.003, 0.01)  # dry friction is tried hard and with these
WIDE_DEAD_ZONE_SHARES = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7)  # of the largest volts
LOW_LIMIT_SHARES = (0.6, 0.4, 0.25, 0.16, 0.1, 0.06, 0.04, 0.025)  # likewise
OWN_SIZES = {"viscous_drag.rate_1_s": (0.05,), "angle_zero.offset_rad": (0.005, 0.05)}
# A lab's own effect: shares of its size's range, and places in the range of its 0 to 3 shapes.
OWN_SIZES_OF_RANGE = (0.05, 0.3)
OWN_SHAPES: tuple[tuple[float, ...], ...] = (
    (),
    (0.05, 0.2, 0.35, 0.5, 0.65, 0.8, 0.95),
    (0.1, 0.3, 0.5, 0.7, 0.9),
    (0.2, 0.5, 0.8),
)
Start = dict[str, float]


def starts(
    effect: Effect, axis: str, nominal: NominalModel, evidence: Evidence
) -> list[list[Start]]:
    """Groups of settings in which an effect is tried on an axis. The settings within a group are
    superposed, each with a size of its own that the linear screen finds."""
    name = effect.name
    if name in PERIODIC:
        size = {"cogging": 0.03, "transmission_ripple": 0.003}[name]
        return [
            [
                {f"{name}.{wave}.{axis}": size, f"{name}.periods_per_turn.{axis}": n}
                for wave in ("sine", "cosine")
            ]
            for n in PERIODS
            if n * reach(evidence, axis) > MIN_PHASE_RAD[name]
        ]
    if nominal.is_own(name):
        return own_starts(effect, axis, nominal)
    first = nominal.of(name, axis)[0]
    if name == "stribeck_friction":
        return [[{first.name: 0.05, f"{name}.speed_rad_s.{axis}": v}] for v in (0.05, 0.12, 0.3)]
    if name == "saturation":
        reached = largest_volts(evidence, axis)
        return [[{first.name: share * reached}] for share in (0.9, 0.6)]
    if name == "rate_limit":
        return [[{first.name: share * fastest(evidence, axis)}] for share in (0.9, 0.6, 0.3)]
    if name == "camera_scale":
        fraction, height = nominal.of(name, axis)
        alone = {fraction.name: fraction.nominal + SIZES["fraction"][0]}
        return [[alone], [alone, {height.name: SIZES[HEIGHT_KEY][0]}]]
    if name == "joint_backlash" and nominal.plate_may_fall:
        falls = f"{name}.{FALL_KEY}.{axis}"
        plays = [first.nominal + size for size in SIZES["play_rad"]]
        return [[{first.name: play, falls: fall}] for play in plays for fall in FALLS]
    if name == "coulomb_friction":
        frictions = [{first.name: first.nominal + size} for size in SIZES["friction_V"]]
        settling = [{f"{name}.{SETTLING_KEY}.{axis}": value} for value in SETTLING_S]
        return [[one | more] for one in frictions for more in ({}, *settling)]
    sizes = OWN_SIZES.get(f"{name}.{first.key}", SIZES.get(first.key, ()))
    return [[{first.name: first.nominal + size}] for size in sizes]


def own_starts(effect: Effect, axis: str, nominal: NominalModel) -> list[list[Start]]:
    """Starts with an effect of a lab's own: each of OWN_SIZES of its range, beside a grid over what
    shapes it. The linear screen finds the sign."""
    first, *shape = nominal.of(effect.name, axis)
    places = OWN_SHAPES[len(shape)]
    grid = product(*[[k.lower + share * (k.upper - k.lower) for share in places] for k in shape])
    reach = max(first.upper - first.nominal, first.nominal - first.lower)
    way = 1.0 if first.upper > first.nominal else -1.0
    return [
        [
            {first.name: first.nominal + way * share * reach}
            | {k.name: value for k, value in zip(shape, values, strict=True)}
        ]
        for values in grid
        for share in OWN_SIZES_OF_RANGE
    ]


def light_arm_backlash_starts(
    axis: str, nominal: NominalModel, plays: Iterable[float]
) -> list[Start]:
    """Starts with gear backlash of each width of `plays` [rad], in whose gap the arm stays where
    the teeth leave it, coasts braked by some friction or, in a model of arms that coast, by none.
    From one of these the fit does not come to another. K, tau and delay are nominal, because those
    fitted beside a model without backlash are biased."""
    servo = {f".{key}.{axis}": getattr(nominal.rig.servo, key) for key in CALIBRATED}
    delay = nominal.of("input_delay", axis)[0]
    shapes = [{f"gear_backlash.{COAST_KEY}.{axis}": x} for x in (0.0, *START_COASTS_S2_RAD)]
    return [
        {f"gear_backlash.play_rad.{axis}": play, delay.name: delay.nominal} | servo | shape
        for play in plays
        for shape in ([*shapes, {}] if nominal.coasts else shapes)
    ]


def play_ladder(nominal: NominalModel, axis: str) -> list[float]:
    """Plays of the gears of an axis that are tried [rad]."""
    most = nominal.of("gear_backlash", axis)[0].range[1]
    return np.geomspace(SMALLEST_PLAY_RAD, most, PLAYS).tolist()


def wide_dead_zone_starts(axis: str, nominal: NominalModel, most_V: float) -> list[Start]:
    """Starts with dead zones as wide as a good part of the largest volts `most_V` (H-bridges have
    them). K and tau are from the grid GUESSES, because those fitted beside a model without it are
    biased."""
    gain, time = (f".{key}.{axis}" for key in CALIBRATED)
    return [
        {
            f"dead_zone.half_width_V.{axis}": share * most_V,
            gain: k * nominal.parameters[gain].nominal,
            time: tau * nominal.parameters[time].nominal,
        }
        for share in WIDE_DEAD_ZONE_SHARES
        for k in GUESSES
        for tau in GUESSES
    ]


def low_saturation_starts(axis: str, nominal: NominalModel, most_V: float) -> list[Start]:
    """Starts with volts that are cut far below the largest `most_V` that were asked for. K and tau
    are nominal, because those fitted beside a model without it are biased."""
    servo = {f".{key}.{axis}": getattr(nominal.rig.servo, key) for key in CALIBRATED}
    return [{f"saturation.limit_V.{axis}": share * most_V} | servo for share in LOW_LIMIT_SHARES]


def resets_servo(start: Iterable[str]) -> bool:
    """Whether a start sets K and tau anew, as those of a light arm's backlash, of a wide dead zone
    and of low saturation do; `start` holds its parameter names."""
    return any(name.startswith(".") for name in start)


def largest_volts(evidence: Evidence, axis: str) -> float:
    """0.995 quantile of the absolute volts of an axis [V] over all runs that drive it; 0 without
    any."""
    a = SERVO.index(f"servo_{axis}")
    volts = [run.volts_V[:, a] for run in evidence.runs if run.has_servo(a)]
    return float(np.quantile(np.abs(np.concatenate(volts)), 0.995)) if volts else 0.0


def share_of_lower_volts(evidence: Evidence, axis: str, limit_V: float) -> float:
    """Share of the volts of an axis that lie below a limit [V], without those below a tenth of it,
    which hardly turn the motor; 1 without any."""
    a = SERVO.index(f"servo_{axis}")
    volts = [np.abs(run.volts_V[:, a]) for run in evidence.runs if run.has_servo(a)]
    used = [each[each > 0.1 * limit_V] for each in volts]
    return float(np.mean(np.concatenate(used) < limit_V)) if any(map(len, used)) else 1.0


def reach(evidence: Evidence, axis: str) -> float:
    """Largest range of angles [rad] that the servo of an axis passes within one run; 0 without
    runs."""
    a = SERVO.index(f"servo_{axis}")
    return max((float(np.ptp(run.theta_rad[:, a])) for run in evidence.runs), default=0.0)


def fastest(evidence: Evidence, axis: str, share: float = 0.99) -> float:
    """Quantile `share` of the absolute servo speed of an axis [rad/s], by differences over 0.04
    s."""
    a, step = (
        SERVO.index(f"servo_{axis}"),
        0.04,
    )  # [s] of the difference quotient: encoder counts are steps
    speeds = [np.zeros(1)]
    for run in evidence.runs:
        m = max(1, round(step / float(np.median(np.diff(run.t_s)))))
        moved = run.theta_rad[m:, a] - run.theta_rad[:-m, a]
        speeds.append(np.abs(moved) / (run.t_s[m:] - run.t_s[:-m]))
    return float(np.quantile(np.concatenate(speeds), share))
