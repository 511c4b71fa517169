"""The one place where a run is put together: rig, plant, camera, hand."""

from collections.abc import Callable
from dataclasses import replace
from importlib.resources import files
from math import radians
from pathlib import Path

import numpy as np

from experiments.runs.protocol import Protocol
from rig.course import Course
from rig.files import why_no_file
from rig.linkage import THREE_ARMS, Linkage
from rig.operator import Operator
from rig.parameters import Rig
from rig.rigfile import read_rig
from rig.simulation.operator import PushingOperator, SimulatedOperator
from rig.simulation.simulator import CameraModel, SimulatedTable

# How real units of one kind differ from each other (source D of rig.parameters), half ranges.
SPREAD_GAIN, SPREAD_TAU = 0.032, 0.043
SPREAD_FRICTION = 0.3
SPREAD_LEVEL_RAD = radians(0.15)
SPREAD_TACHOMETER = 0.02
# The plate's largest tilt for the camera's search region: ratio x sine of the servo's end stop
# (0.61 rad) of the default table, 6 degrees.
MAX_TILT_RAD = 0.105


def load_rig(path: Path | None) -> Rig:
    """The rig of a rig file (TOML) or, by its name alone, a shipped one; None: the default table.

    FileNotFoundError, ValueError (one line): the file is missing, or a key or value is wrong.
    """
    folder = Path(str(files("experiments") / "rigs"))
    if path is None:
        return read_rig(folder / "default.toml")
    if path.is_file():
        return read_rig(path)
    shipped = sorted(file.stem for file in folder.glob("*.toml"))
    if str(path) in shipped:
        return read_rig(folder / f"{path}.toml")
    known = ", ".join(shipped)
    raise FileNotFoundError(f"rig file {path} {why_no_file(path)}; shipped: {known}")


def known(rig: Rig) -> Rig:
    """The rig as controllers and estimators may know it (`Rig.known`)."""
    return rig.known


def another_unit(rig: Rig, seed: int) -> Rig:
    """Another unit of the same kind, drawn from `seed`.

    Uniformly drawn are: servo gain and time constant (the lag of servos that take an angle),
    friction of arm and joint, Coulomb friction and voltage offset (where the rig has these
    effects), level offset and the tachometer's scale.
    The controllers of the unit still know the kind (`rig`), not the unit: see
    `runner.RunRequest.kind`.
    """
    rng = np.random.default_rng([seed, 2])
    one = rng.uniform
    servo = replace(
        rig.servo,
        gain_rad_s_V=rig.servo.gain_rad_s_V * (1 + SPREAD_GAIN * one(-1, 1)),
        time_constant_s=rig.servo.time_constant_s * (1 + SPREAD_TAU * one(-1, 1)),
        tachometer_scale=SPREAD_TACHOMETER * one(-1, 1),
    )
    if servo.takes_angle:
        late = servo.time_constant_s / rig.servo.time_constant_s
        lags = {a: {"lag_s": late * rig.servo.on(a).lag_s} for a in ("x", "y")}
        servo = replace(
            servo, lag_s=late * servo.lag_s, x=servo.x | lags["x"], y=servo.y | lags["y"]
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


def play_rad(rig: Rig, at_servo_deg: float) -> float:
    """Play of the rig's table [rad] that stands for at_servo_deg [degrees] at a servo of two rods.

    The angle of three arms is the plate's own tilt: theirs is the tilt that such a play leaves to
    the plate of the default linkage.
    """
    return radians(at_servo_deg) * (Linkage().ratio if rig.linkage.kind == THREE_ARMS else 1.0)


def with_play(rig: Rig, *, gear_rad: float, joint_rad: float) -> Rig:
    """The rig with these plays (full widths [rad]) on both axes in place of its own.

    Servos that take an angle close their loop around their gears: no gear play is left of them.
    """
    effects = dict(rig.effects)
    if not rig.servo.takes_angle:
        effects["gear_backlash"] = {axis: {"play_rad": gear_rad} for axis in ("x", "y")}
    effects["joint_backlash"] = {axis: {"play_rad": joint_rad} for axis in ("x", "y")}
    return replace(rig, effects=effects)


def simulated_table(rig: Rig, course: Course, seed: int, eye: CameraModel | None) -> SimulatedTable:
    """Simulated table of a course, its random numbers drawn from the seed alone.

    Every arm of a seed therefore gets the same random numbers. eye: camera model, None for the
    statistical one. The ball is held at first where the course has a hold time.
    """
    return SimulatedTable(
        rig,
        np.random.default_rng([seed, 3]),
        start_m=course.start_m,
        held=course.hold_s > 0,
        eye=eye,
    )


def simulated_operator(
    table: SimulatedTable, protocol: Protocol, course: Course, seed: int
) -> Operator:
    """Operator of a simulated table.

    Releases the ball after the course's hold time and, with pushes "at-centre", pushes the ball
    whenever it rests there, in directions drawn from the seed.
    """
    if protocol.pushes.kind != "at-centre":
        return SimulatedOperator(table, course.hold_s)
    return PushingOperator(
        table,
        course.hold_s,
        speed_m_s=protocol.pushes.speed_m_s,
        seconds=protocol.pushes.seconds,
        rng=np.random.default_rng([seed, 4]),
    )


def rendered_eye(rig: Rig, bundle_path: Path, seed: int):
    """The `RenderedCamera` over the simulated table, which renders frames and detects the ball in
    them.

    The frames are rendered with the virtual camera's true geometry; positions are computed from
    them with the calibration bundle at `bundle_path` alone. seed: of the image noise. BundleError,
    a ValueError: the bundle cannot be used.
    """
    from calibration.bundle import load
    from rig.simulation.rendered_camera import RenderedCamera

    bundle = load(bundle_path)
    renderer = virtual_renderer(rig, np.random.default_rng([seed, 5]))
    camera = ball_camera(rig, bundle)
    return RenderedCamera(renderer, camera, rig.linkage.ratio)


def ball_camera(rig: Rig, bundle, late_s: float = 0.0):
    """The `BallCamera` for the rig's ball and plate, through the view of `bundle`, a
    `calibration.bundle.Bundle`; late_s: how long after its light a frame is stamped.

    ValueError: the rig names an unknown colour, or the plate is not in view.
    """
    from vision.ball_camera import BallCamera
    from vision.detection.appearance import Appearance

    return BallCamera.over_plate(
        bundle.view,
        bundle.layout,
        bundle.ball_radius_m,
        rig.linkage.side_m,
        MAX_TILT_RAD,
        appearance=Appearance.of_colour(rig.ball.colour),
        late_s=late_s,
    )


def camera_lookout(eye, bundle_path: Path | None) -> Callable[[float], str | None] | None:
    """Function that tells from the last frame whether the camera was moved.

    Called with the run's time [s], that function returns a sentence for the user once, None at
    other times. `eye` must keep its last frame as `image`. None without an eye or a bundle.
    BundleError, a ValueError: the bundle cannot be used.
    """
    if eye is None or bundle_path is None:
        return None
    from calibration.bundle import load
    from calibration.camera.camera_shift import ShiftMonitor

    monitor = ShiftMonitor(load(bundle_path).fixed)

    def look(t_s: float) -> str | None:
        if eye.image is None:
            return None
        return monitor.check(eye.image, t_s, eye.ball_camera.drift_m)

    return look


def virtual_scene(rig: Rig):
    """The `Scene` of the virtual camera: the rig's plate and ball, with the default markers.
    ValueError: the plate is too small for them.
    """
    from vision.plate.markers import default_layout
    from vision.synthetic.synthetic import Scene

    side = rig.linkage.side_m
    return Scene(plate_side_m=side, layout=default_layout(side), ball_radius_m=rig.ball.radius_m)


def virtual_renderer(rig: Rig, rng: np.random.Generator):
    """The `Renderer` of the virtual camera, which sees the whole plate of the rig; rng: of its
    textures and noise. ValueError: as of `virtual_scene`.
    """
    from vision.synthetic.synthetic import Renderer, virtual_view

    view = virtual_view(plate_side_m=rig.linkage.side_m)
    return Renderer(virtual_scene(rig), view, rng)
