"""The one place where a run is put together: rig, plant, camera, hand."""

from collections.abc import Callable
from dataclasses import replace
from importlib.resources import files
from math import radians
from pathlib import Path

import numpy as np

from experiments.protocol import Protocol
from rig.hands import Hand, PushingHand, SimulatedHand
from rig.parameters import Rig
from rig.rigfile import read_rig
from rig.simulate import Course
from rig.simulator import Eye, SimulatedTable
from rig.unknown import Unknown

# How real units of one kind differ from each other (source D of rig.parameters), half ranges.
SPREAD_GAIN, SPREAD_TAU = 0.032, 0.043
SPREAD_FRICTION = 0.3
SPREAD_LEVEL_RAD = radians(0.15)
SPREAD_TACHOMETER = 0.02


def load_rig(path: Path | None) -> Rig:
    """The rig of a file, or the shipped default table. ValueError, FileNotFoundError: one line."""
    if path is not None and not path.is_file():
        raise FileNotFoundError(f"rig file {path} not found")
    return read_rig(path or Path(str(files("experiments") / "rigs" / "default.toml")))


def known(rig: Rig) -> Rig:
    """What controllers and estimators may see of a rig: all but its effects and unnamed term."""
    servo = replace(rig.servo, tachometer_scale=0.0)
    return replace(rig, servo=servo, effects={}, unknown=Unknown())


def another_unit(rig: Rig, seed: int) -> Rig:
    """Another unit of the same kind: gain, lag, friction, offset, level and tachometer drawn.

    Its controllers still know the kind (`rig`), not the unit: see `runner.Order.kind`.
    """
    rng = np.random.default_rng([seed, 2])
    one = rng.uniform
    servo = replace(
        rig.servo,
        gain_rad_s_V=rig.servo.gain_rad_s_V * (1 + SPREAD_GAIN * one(-1, 1)),
        time_constant_s=rig.servo.time_constant_s * (1 + SPREAD_TAU * one(-1, 1)),
        tachometer_scale=SPREAD_TACHOMETER * one(-1, 1),
    )
    loose = 1 + SPREAD_FRICTION * one(-1, 1)
    drive = replace(
        rig.drive,
        arm_friction_nm=rig.drive.arm_friction_nm * loose,
        joint_friction_nm=rig.drive.joint_friction_nm * loose,
    )
    effects = {name: {a: dict(v) for a, v in by.items()} for name, by in rig.effects.items()}
    for name, key in (("coulomb_friction", "friction_V"), ("voltage_offset", "offset_V")):
        for values in effects.get(name, {}).values():
            if key in values:
                values[key] *= 1 + SPREAD_FRICTION * one(-1, 1)
    level = effects.setdefault("level_offset", {})
    for axis in ("x", "y"):
        slope = level.get(axis, {}).get("slope_rad", 0.0)
        level[axis] = {"slope_rad": slope + SPREAD_LEVEL_RAD * one(-1, 1)}
    return replace(rig, servo=servo, drive=drive, effects=effects)


def with_play(rig: Rig, *, gear_rad: float, joint_rad: float) -> Rig:
    """The rig with this play (full width) on both axes instead of its own."""
    effects = dict(rig.effects)
    effects["gear_backlash"] = {axis: {"play_rad": gear_rad} for axis in ("x", "y")}
    effects["joint_backlash"] = {axis: {"play_rad": joint_rad} for axis in ("x", "y")}
    return replace(rig, effects=effects)


def simulated_table(rig: Rig, course: Course, seed: int, eye: Eye | None) -> SimulatedTable:
    """The plant with its own random numbers: the same for every arm of a seed."""
    return SimulatedTable(
        rig,
        np.random.default_rng([seed, 3]),
        start_m=course.start_m,
        held=course.hold_s > 0,
        eye=eye,
    )


def simulated_hand(table: SimulatedTable, protocol: Protocol, course: Course, seed: int) -> Hand:
    """The operator of a simulated table: lets go on time and pushes as the protocol says."""
    if protocol.pushes.kind != "at-centre":
        return SimulatedHand(table, course.hold_s)
    return PushingHand(
        table,
        course.hold_s,
        speed_m_s=protocol.pushes.speed_m_s,
        seconds=protocol.pushes.seconds,
        rng=np.random.default_rng([seed, 4]),
    )


def rendered_eye(rig: Rig, bundle_path: Path, seed: int):
    """A camera over the simulated table that renders frames; calibrated by the bundle alone.

    The renderer's own geometry is the virtual camera's; what interprets its pixels is the bundle.
    """
    from calibration.bundle import load
    from rig.rendered_eye import RenderedEye
    from vision.synthetic import Renderer, virtual_view

    bundle = load(bundle_path)
    scene = virtual_scene(rig)
    renderer = Renderer(scene, virtual_view(), np.random.default_rng([seed, 5]))
    camera = ball_camera(rig, bundle)
    return RenderedEye(renderer, camera, rig.linkage.ratio)


def ball_camera(rig: Rig, bundle):
    """What sees the rig's ball through a calibrated camera."""
    from vision.appearance import Appearance
    from vision.ball_camera import BallCamera

    return BallCamera.over_plate(
        bundle.view,
        bundle.layout,
        bundle.ball_radius_m,
        rig.linkage.plate_side_m,
        appearance=Appearance.of_colour(rig.ball.colour),
    )


def camera_lookout(eye, bundle_path: Path | None) -> Callable[[float], str | None] | None:
    """What tells whether the camera was knocked: called with the run's time, it gives the sentence
    for the user once; None where no frames are seen. Works for any eye that keeps its last frame.
    """
    if eye is None or bundle_path is None:
        return None
    from calibration.bundle import load
    from calibration.knock import KnockWatch

    watch = KnockWatch(load(bundle_path).fixed)

    def look(t_s: float) -> str | None:
        if eye.image is None:
            return None
        return watch.look(eye.image, t_s, eye.ball_camera.drift_m)

    return look


def virtual_scene(rig: Rig):
    """The scene of the virtual camera: the rig's plate, markers and ball."""
    from vision.markers import default_layout
    from vision.synthetic import Scene

    side = rig.linkage.plate_side_m
    return Scene(plate_side_m=side, layout=default_layout(side), ball_radius_m=rig.ball.radius_m)
