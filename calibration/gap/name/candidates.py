"""What each effect is tried with: the sizes at which the search for it starts.

Several where it matters (play, friction and delays have no derivative at zero, and a period along
the turn has to be found), one where the model is linear in it.
"""

from collections.abc import Iterable, Mapping

import numpy as np

from calibration.gap.evidence import Evidence
from calibration.gap.knobs import CALIBRATED, COAST, HEIGHT, PERIODIC, SERVO, Believed, Knob
from rig.effects import Effect

PERIODS = (3.0, 4.5, 6.5, 9.0, 13.0, 18.0, 25.0, 35.0, 50.0, 70.0)
# Of a period that must fit into the motion: less is a curve, as of a cable that pulls.
LEAST_PHASE_RAD = {"cogging": 5.0, "transmission_ripple": 2.0}
SIZES: Mapping[str, tuple[float, ...]] = {
    "friction_V": (0.03, 0.1), "half_width_V": (0.03, 0.1), "fraction": (0.02,),
    "offset_V": (0.05,), "delay_s": (0.003, 0.01), "rate_1_s": (0.002,), "drop_1_V": (0.01,),
    "play_rad": (0.005, 0.012, 0.03), "coefficient_1_rad": (0.1,), "coefficient_1_rad2": (0.5,),
    "slope_rad": (0.001,), "rate_rad_s": (5e-5,), "stiffness_1_s2": (0.05,),
    "deceleration_m_s2": (0.004, 0.015), "extra_s": (0.006, -0.006, 0.02), "angle_rad": (0.02,),
    "k1_1_m2": (0.5,), HEIGHT: (0.01,),
}  # fmt: skip
COAST_S2_RAD = 0.06
GUESSES = (0.2, 0.5, 1.0, 2.0, 5.0)  # of the nominal K and tau
SWALLOWED = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7)  # of the largest volts
OWN_SIZES = {"viscous_drag.rate_1_s": (0.05,)}
Start = dict[str, float]


def starts(effect: Effect, axis: str, believed: Believed, evidence: Evidence) -> list[list[Start]]:
    """Groups of settings of the effect's knobs; those of a group are tried as one (they add)."""
    name = effect.name
    if name in PERIODIC:
        size = {"cogging": 0.03, "transmission_ripple": 0.003}[name]
        return [
            [{f"{name}.{part}.{axis}": size, f"{name}.periods_per_turn.{axis}": n}
             for part in ("sine", "cosine")]
            for n in PERIODS
            if n * reach(evidence, axis) > LEAST_PHASE_RAD[name]
        ]  # fmt: skip
    first = believed.of(name, axis)[0]
    if name == "stribeck_friction":
        return [[{first.name: 0.05, f"{name}.speed_rad_s.{axis}": v}] for v in (0.05, 0.12, 0.3)]
    if name == "saturation":
        reached = largest_volts(evidence, axis)
        return [[{first.name: share * reached}] for share in (0.9, 0.6)]
    if name == "camera_scale":
        fraction, height = believed.of(name, axis)
        alone = {fraction.name: fraction.believed + SIZES["fraction"][0]}
        return [[alone], [alone, {height.name: SIZES[HEIGHT][0]}]]
    sizes = OWN_SIZES.get(f"{name}.{first.key}", SIZES.get(first.key, ()))
    return [[{first.name: first.believed + size}] for size in sizes]


def coasting_starts(axis: str, believed: Believed, plays: Iterable[float]) -> list[Start]:
    """Plays of gears through whose gap the arm coasts, with the motor as the rig file has it: what
    a model without them made of its K, tau and delay says nothing about it."""
    nominal = {f".{key}.{axis}": getattr(believed.rig.servo, key) for key in CALIBRATED}
    delay = believed.of("input_delay", axis)[0]
    return [
        {
            f"gear_backlash.play_rad.{axis}": play,
            f"gear_backlash.{COAST}.{axis}": COAST_S2_RAD,
            delay.name: delay.believed,
        }
        | nominal
        for play in plays
    ]


def swallowing_starts(axis: str, believed: Believed, most_V: float) -> list[Start]:
    """Drives that swallow a good part of the volts (H-bridges do), with any K and tau: what a model
    without it made of them says nothing."""
    gain, time = (f".{key}.{axis}" for key in CALIBRATED)
    return [
        {
            f"dead_zone.half_width_V.{axis}": share * most_V,
            gain: k * believed.knobs[gain].believed,
            time: tau * believed.knobs[time].believed,
        }
        for share in SWALLOWED
        for k in GUESSES
        for tau in GUESSES
    ]


def afresh(start: Iterable[str]) -> bool:
    """Is it a start that forgets what was made of K and tau (of the two kinds above)?"""
    return any(name.startswith(".") for name in start)


def swallows(start: Iterable[str]) -> bool:
    """Is it one of `swallowing_starts`? Then only noise that was estimated beside it tells."""
    return afresh(start) and not any(f".{COAST}." in name for name in start)


def largest_volts(evidence: Evidence, axis: str) -> float:
    """Volts that a log reached, but for a two-hundredth of it."""
    a = SERVO.index(f"servo_{axis}")
    volts = np.concatenate([run.volts_V[:, a] for run in evidence.runs if run.has_servo(a)])
    return float(np.quantile(np.abs(volts), 0.995))


def reach(evidence: Evidence, axis: str) -> float:
    """How much of the turn the servo uses [rad]."""
    a = SERVO.index(f"servo_{axis}")
    return max((float(np.ptp(run.theta_rad[:, a])) for run in evidence.runs), default=0.0)


def fastest(evidence: Evidence, axis: str, share: float = 0.99) -> float:
    """Speed of the servo below which it stays for this share of the log [rad/s]."""
    a, step = SERVO.index(f"servo_{axis}"), 0.04  # counts are steps: over so many seconds
    speeds = [np.zeros(1)]
    for run in evidence.runs:
        m = max(1, round(step / float(np.median(np.diff(run.t_s)))))
        moved = run.theta_rad[m:, a] - run.theta_rad[:-m, a]
        speeds.append(np.abs(moved) / (run.t_s[m:] - run.t_s[:-m]))
    return float(np.quantile(np.concatenate(speeds), share))


def released(
    effect: Effect, axis: str, believed: Believed, setting: Mapping[str, float]
) -> list[Knob]:
    """The knobs that are free when the effect is tried, its inner shape among them."""
    knobs = believed.of(effect.name, axis)
    if effect.name in (*PERIODIC, "stribeck_friction"):
        return knobs
    if effect.name == "gear_backlash" and setting.get(f"gear_backlash.{COAST}.{axis}"):
        return [k for k in knobs if k.key in ("play_rad", COAST)]
    if effect.name == "camera_scale" and setting.get(f"camera_scale.{HEIGHT}.{axis}"):
        return knobs
    return knobs[:1]
