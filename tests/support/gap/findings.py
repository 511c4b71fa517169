"""Findings as the gap workflow might return them, one for each verdict."""

from dataclasses import replace
from math import radians

import numpy as np

from calibration.gap.findings import (
    ClosedLoopRow,
    Findings,
    Gap,
    Interval,
    Leftover,
    Named,
    NextExperiment,
    PlateMap,
    Profile,
    ProofRow,
    RankedEffect,
    Step,
    Untestable,
    Where,
)
from rig.parameters import CHANNELS, Rig

FLOORS = {"servo_x": 4.1e-4, "servo_y": 4.3e-4, "ball_x": 3.2e-4, "ball_y": 3.1e-4}


def around(value: float, width: float = 0.04) -> Interval:
    return Interval(value, value - abs(value) * width, value + abs(value) * width)


def profiles(size: dict[str, float]) -> tuple[Profile, ...]:
    """Gap profiles of all four channels; `size` is how far each rises above the floor."""
    rng = np.random.default_rng(5)
    found = []
    for channel in CHANNELS:
        servo = channel.startswith("servo")
        shapes = [
            ("time", "s", np.linspace(0, 60, 61), lambda u: 0.7 + 0.3 * np.sin(9 * u)),
            ("position", "rad" if servo else "m", np.linspace(-0.12, 0.12, 13), lambda u: u**0),
            ("speed", "rad/s" if servo else "m/s", np.linspace(0, 0.4, 9), lambda u: 1 - u),
            ("direction", "1", np.array([-1.5, 0.0, 1.5]), lambda u: u**0),
            ("after reversal", "s", np.linspace(0, 0.4, 11), lambda u: np.exp(-6 * u)),
        ]
        if servo:
            shapes.append(("voltage", "V", np.linspace(-6, 6, 13), lambda u: u**0))
        for quantity, unit, edges, shape in shapes:
            n = len(edges) - 1
            u = np.linspace(0, 1, n)
            gap = 1 + size.get(channel, 0.0) * shape(u) + rng.normal(0, 0.04, n)
            gap[n // 3] = np.nan if quantity == "speed" else gap[n // 3]
            found.append(Profile(channel, quantity, unit, edges, gap, np.full(n, 50)))
    return tuple(found)


def plate_map(strength: float) -> PlateMap:
    edges = np.linspace(-0.1375, 0.1375, 12)
    x, y = np.meshgrid((edges[1:] + edges[:-1]) / 2, (edges[1:] + edges[:-1]) / 2)
    noise = np.random.default_rng(2).normal(0, 0.15, (11, 11, 2))
    mean = noise + strength * np.stack([np.sin(30 * x), np.sin(30 * y)], axis=-1)
    count = np.where(x**2 + y**2 < 0.11**2, 20, 0)
    return PlateMap(edges, edges, mean, count)


UNTESTABLE = (
    Untestable("saturation", "the volts stay below 3.1 V", {"limit_V": 3.1}),
    Untestable("supply_sag", "both motors never draw current at once", {"drop_1_V": 0.012}),
    Untestable("lens_distortion", "the ball stays near the centre", {"k1_1_m2": 1.4}),
    Untestable("camera_yaw", "hidden by cross coupling", {"angle_rad": radians(0.8)}),
    Untestable("stribeck_friction", "few slow sweeps", {"extra_V": 0.02, "speed_rad_s": 0.1}),
)
CALIBRATED = {
    "gain_x_rad_s_V": around(1.61, 0.004),
    "gain_y_rad_s_V": around(1.55, 0.004),
    "time_constant_x_s": around(0.0253, 0.02),
    "time_constant_y_s": around(0.0262, 0.02),
}
RANKING = (
    RankedEffect("joint_backlash", 812.0, 0.985),
    RankedEffect("linkage_cubic", 240.0, 0.009),
    RankedEffect("camera_delay", 130.0, 0.004, ("encoder_to_plate_delay",)),
    RankedEffect("level_offset", 90.0, 0.002, ("encoder_zero", "asymmetric_play")),
    RankedEffect("rolling_resistance", 41.0, 0.0),
    RankedEffect("viscous_drag", 12.0, 0.0),
)

CLOSED_LOOP = (
    ClosedLoopRow("limit cycle amplitude x", "mm", 8.1, 0.4, 7.9),
    ClosedLoopRow("limit cycle period x", "s", 1.82, float("nan"), 1.79),
    ClosedLoopRow("settling time", "s", 5.2, 3.1, 5.0),
    ClosedLoopRow("spread", "mm", 6.3, 1.2, 6.0),
)


def named() -> Findings:
    """Play in both joints, found, added and proven."""
    before = {"servo_x": 1.03, "servo_y": 1.01, "ball_x": 7.9, "ball_y": 4.2}
    middle = before | {"ball_x": 1.05, "ball_y": 4.1}
    after = {"servo_x": 1.02, "servo_y": 1.01, "ball_x": 1.04, "ball_y": 1.06}
    play = {"x": {"play_rad": around(0.035)}, "y": {"play_rad": around(0.02)}}
    rig = Rig()
    effects = {"joint_backlash": {"x": {"play_rad": 0.035012345}, "y": {"play_rad": 0.02}}}
    return Findings(
        verdict="named",
        sentence="There is play between encoder and plate: 2.01 degrees on x, 1.15 degrees on y. "
        "The model without it is wrong in ball x, within 80 ms after the x servo reverses, by "
        "7.9 times the noise.",
        where=(
            Where("ball_x", "within 80 ms after the x servo reverses", 7.9),
            Where("ball_y", "within 80 ms after the y servo reverses", 4.2),
        ),
        effects=(Named("joint_backlash", 0.985, (), play),),
        untestable=UNTESTABLE,
        calibrated=CALIBRATED,
        gap=Gap(before, after, "fullest model", True, FLOORS,
                {"before": 6.1, "after": 2.4, "floor": 2.2}),
        ranking=RANKING,
        profiles=profiles({"ball_x": 7, "ball_y": 3.2}),
        maps=(plate_map(0.2),),
        steps=(Step("", before), Step("joint_backlash x", middle), Step("joint_backlash y", after)),
        proof=(
            ProofRow("nothing added", before, 6.1),
            ProofRow("best rival: linkage_cubic", before | {"ball_x": 6.2}, 5.3),
            ProofRow("unnamed term", before | {"ball_x": 2.1, "ball_y": 1.9}, 3.1),
            ProofRow("named: joint_backlash", after, 2.4),
        ),
        closed_loop=CLOSED_LOOP,
        notes=("log.csv: left out row 18 and 3 more of 6000, where a voltage is blank",),
        noise={"servo_process": 0.2, "ball_measured": 3.1e-4, "ball_memory_s": 0.0},
        rig_before=rig,
        rig_after=replace(rig, effects=effects),
    )  # fmt: skip


def nothing() -> Findings:
    """A rig that is what its model says."""
    gap = {"servo_x": 1.01, "servo_y": 0.99, "ball_x": 1.0, "ball_y": 1.02}
    return Findings(
        verdict="nothing-missing",
        sentence="Nothing is missing from the model beyond the declared tolerances.",
        untestable=UNTESTABLE[:2],
        calibrated={key: around(v.value / 1.05, 0.004) for key, v in CALIBRATED.items()},
        gap=Gap(
            gap, gap, "repeated runs", True, FLOORS, {"before": 2.2, "after": 2.2, "floor": 2.2}
        ),
        ranking=tuple(replace(c, score=c.score / 300, probability=0.01) for c in RANKING),
        profiles=profiles({}),
        maps=(plate_map(0.0),),
        rig_before=Rig(),
    )


def unknown() -> Findings:
    """A force over the plate that no entry describes; data-driven term added."""
    before = {"servo_x": 1.0, "servo_y": 1.0, "ball_x": 34.0, "ball_y": 21.0}
    after = before | {"ball_x": 1.2, "ball_y": 1.1}
    rig = Rig()
    term = replace(rig.unknown, ball_rhythm_x=(0.02, -0.01), ball_rhythm_hz=1.3)
    return Findings(
        verdict="unknown-effect",
        sentence="Something pushes the ball with a rhythm of 1.3 Hz; no effect of the catalogue "
        "explains it.",
        where=(Where("ball_x", "everywhere on the plate, all the time", 34.0),),
        unknown=Leftover("ball_x", "a rhythm of 1.3 Hz, 0.022 m/s2", "0.022 sin(2 pi 1.3 t + 0.5)"),
        untestable=UNTESTABLE[:1],
        calibrated=CALIBRATED,
        gap=Gap(before, after, "fullest model", True, FLOORS, {"before": 41.0, "after": 3.0}),
        ranking=RANKING[1:],
        profiles=profiles({"ball_x": 33, "ball_y": 20}),
        maps=(plate_map(4.0), plate_map(2.0)),
        steps=(Step("", before), Step("unnamed term", after)),
        proof=(ProofRow("nothing added", before, 41.0), ProofRow("unnamed term", after, 3.0)),
        rig_before=rig,
        rig_after=replace(rig, unknown=term),
    )  # fmt: skip


def no_motion() -> Findings:
    """A log in which nothing moves."""
    return Findings(
        verdict="undecided",
        sentence="Not enough excitation: nothing moves in these logs, so nothing can be said.",
        untestable=tuple(Untestable(u.name, "no motion", {}) for u in UNTESTABLE),
        notes=("still.csv: theta_x_rad never changes: it says nothing",),
        rig_before=Rig(),
    )


def rivals() -> Findings:
    """Two names that the logs do not tell apart, and the experiment that would."""
    found = named()
    other = Named("linkage_cubic", 0.41, (), {"x": {"coefficient_1_rad2": around(0.8)}, "y": {}})
    twin = ("a pure delay from encoder to plate",)
    late = Named("camera_delay", 0.57, twin, {"xy": {"extra_s": around(0.0075)}})
    return replace(
        found,
        verdict="undecided",
        sentence="It is camera_delay or linkage_cubic.",
        effects=(late, other),
        ranking=(
            RankedEffect("camera_delay", 44.0, 0.57, twin),
            RankedEffect("linkage_cubic", 43.5, 0.41),
        ),
        next_experiment=NextExperiment("steps", ("camera_delay", "linkage_cubic"), 30.0, 27.0),
        rig_after=None, steps=(), proof=(), closed_loop=(),
    )  # fmt: skip


ALL = {f.__name__: f for f in (named, nothing, unknown, no_motion, rivals)}
