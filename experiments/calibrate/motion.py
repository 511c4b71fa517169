"""`rig calibrate time`, `level` and `servo`: numbers from tables that move."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np
import typer

from calibration.motion.commanded_moves import tell, waves
from calibration.motion.level import level_record, timing_from_ball
from calibration.motion.manoeuvres import Trace, perform, wiggle
from calibration.motion.rolling import Rolling, rolling
from calibration.motion.servo import calibrate_servos
from calibration.motion.timing import Wiggle, camera_delay
from experiments.calibrate.filmed import files_of, filmed_motion, virtual_film
from experiments.calibrate.folder import (
    CalibrationFolder,
    with_level,
    with_servo,
    with_timing,
)
from experiments.calibrate.given import (
    led_about,
    led_in_steps,
    read_all,
    read_given,
    source_of,
    write_csv,
)
from experiments.calibrate.pictures import level_figure, servo_figure, time_figure
from experiments.calibrate.position import calibrate_position_servo
from experiments.progress import ProgressCall, silent
from experiments.runs.assemble import load_rig
from rig.log import Log
from rig.parameters import Rig
from rig.simulation.simulator import SimulatedTable

WIGGLE_HZ = (0.7, 2.3)
WIGGLE_SHARE = 0.6  # of the angle limit; chosen


def calibrate_servo(
    runs: Sequence[Path],
    rig_file: Path | None,
    out: Path,
    *,
    seed: int,
    video: str | None = None,
    progress: ProgressCall = silent,
) -> None:
    """Measure both servos, of the virtual table where there are no `runs`; keep them in `out`, with
    their traces as CSV.

    runs: run folders or logs of servos that take an angle; video: the frames of one, which show the
    plate's markers. seed: of the sensors' noise. CalibrationError: the motion is refused.
    ValueError, OSError: rig file, run, video or folder cannot be used.
    """
    rig = load_rig(rig_file)
    if rig.servo.takes_angle:
        return calibrate_position_servo(
            runs, rig_file, out, seed=seed, video=video, progress=progress
        )
    folder = CalibrationFolder(out, "simulated", rig)
    if runs or video is not None:
        raise ValueError(
            "servos that take volts are measured by ramps and pulses, not from runs: leave the "
            "runs out; rig gap finds gain and time constant in recorded runs"
        )
    with SimulatedTable(rig, np.random.default_rng([seed, 9]), held=True) as table:
        record, ramped, pulsed = calibrate_servos(table)
    data = [
        _write(ramped, folder.path / "servo_ramps.csv"),
        _write(pulsed, folder.path / "servo_pulses.csv"),
    ]
    picture = servo_figure(ramped, pulsed, record, folder.path / "servo.png", "simulated")
    folder.keep("servo", data=data, pictures=[picture], servo=record)
    for name, axis in (("x", record.x), ("y", record.y)):
        down, up = axis.breakaway_negative_V, axis.breakaway_positive_V
        gain, lag = axis.gain_rad_s_V, axis.time_constant_s
        typer.echo(
            f"servo {name}: breaks away at {down.value:+.3f} and {up.value:+.3f} V, K "
            f"{gain.value:.3f} ({gain.low:.3f} to {gain.high:.3f}) rad/s/V, tau "
            f"{1e3 * lag.value:.1f} ({1e3 * lag.low:.1f} to {1e3 * lag.high:.1f}) ms, signs right"
        )
    folder.believed(rig_file)  # says where it goes on
    folder.believe(rig_file, partial(with_servo, record=record))


def _write(trace: Trace, path: Path) -> Path:
    columns = np.column_stack((trace.t_s, trace.volts, trace.theta_rad))
    write_csv(path, "t_s,voltage_x_V,voltage_y_V,theta_x_rad,theta_y_rad", columns)
    return path


def calibrate_level(
    runs: Sequence[Path], rig_file: Path | None, out: Path, *, seconds: float, seed: int
) -> None:
    """Measure the plate's slope at servo angle 0 on both axes, and keep it in `out`.

    runs: run folders or logs in which the ball is led about; none: a run of `seconds` on the
    virtual table, its noise drawn from `seed`. CalibrationError: the runs are refused. ValueError,
    OSError: a file or folder that cannot be used.
    """
    rig = load_rig(rig_file)
    given = read_all(runs, rig)
    folder = CalibrationFolder(out, source_of(given), rig)
    believed = folder.believed(rig_file)
    logs = [one.log for one in given]
    if not logs:
        led = led_about if rig.servo.has_angle else led_in_steps
        logs = [led(rig, seconds, np.random.default_rng([seed, 10]))]
    delay_s = believed.camera.delay_s
    axes = [[rolling(log, a, delay_s, believed) for log in logs] for a in range(2)]
    record = level_record(axes[0], axes[1], believed)
    first: list[Rolling] = [axes[0][0], axes[1][0]]
    picture = level_figure(first, record, folder.path / "level.png", folder.draft.source)
    folder.keep("level", data=runs, pictures=[picture], level=record)
    for name in ("x", "y"):
        slope, gain = record.slope_rad[name], record.gain_m_s2[name]
        typer.echo(
            f"level {name}: {np.degrees(slope.value):+.4f} degrees at servo angle 0 "
            f"({np.degrees(slope.low):+.4f} to {np.degrees(slope.high):+.4f}); ball gain "
            f"{gain.value:.3f} m/s2/rad, sign right; joint play about "
            f"{np.degrees(record.play_rad[name]):.1f} degrees"
        )
    folder.believe(rig_file, partial(with_level, record=record))


def calibrate_time(
    run: Path | None,
    video: str | None,
    rig_file: Path | None,
    out: Path,
    *,
    seconds: float,
    seed: int,
) -> None:
    """Measure the camera's delay and keep it in `out`.

    From a run with its video, from a run's ball alone (`video` None), or from a motion of `seconds`
    of the virtual table through rendered frames, drawn from `seed` (`run` None). CalibrationError:
    the motion is refused. ValueError: a video without its run, a run without servo angles, or a
    folder without lens and plate where frames are used. OSError: a file or folder that cannot be
    used.
    """
    rig = load_rig(rig_file)
    if not rig.servo.has_angle:
        raise ValueError(
            "servo.angle_measured = false: without measured angles the camera's delay and the "
            "servos' dead time are one; rig calibrate servo finds them together, camera.delay_s "
            "stays that of its data sheet"
        )
    if video is not None and run is None:
        raise ValueError("--video: name the run, too, whose encoders belong to it")
    given = None if run is None else read_given(run, rig)
    folder = CalibrationFolder(out, source_of([given] if given else []), rig)
    believed = folder.believed(rig_file)
    if given is not None and video is None:
        known_s = believed.camera.delay_s if given.delay_s is None else given.delay_s
        axes = [[rolling(given.log, a, known_s)] for a in range(2)]
        record = timing_from_ball(axes, believed, known_s)
        folder.keep("timing", data=[] if run is None else [run], timing=record)
    else:
        if given is None:
            wiggled = _virtual_wiggle(rig, folder, seconds, seed)
        else:
            wiggled = _filmed(given.log, str(video), folder)
        record = camera_delay(wiggled, believed)
        data = [run, *files_of(video)] if run else [_write_wiggle(wiggled, folder.path)]
        picture = time_figure(
            wiggled, record, believed, folder.path / "time.png", folder.draft.source
        )
        folder.keep("timing", data=data, pictures=[picture], timing=record)
    delay = record.delay_s
    typer.echo(
        f"time: frames are stamped {1e3 * delay.value:.2f} ms after their light (95 % "
        f"{1e3 * delay.low:.2f} to {1e3 * delay.high:.2f} ms), from {record.frames} frames by the "
        f"{record.source}"
    )
    if record.readout_s is not None:
        rows = record.readout_s
        typer.echo(
            f"readout: {1e3 * rows.value:.2f} ms from the first row to the last (95 % "
            f"{1e3 * rows.low:.2f} to {1e3 * rows.high:.2f} ms)"
        )
    folder.believe(rig_file, partial(with_timing, record=record))


def _virtual_wiggle(rig: Rig, folder: CalibrationFolder, seconds: float, seed: int) -> Wiggle:
    """Wiggle the virtual table before the virtual camera, calibrated as the folder says."""
    with virtual_film(rig, folder, seed=seed) as (table, tilt):
        if table.takes_angle:
            limit = rig.servo.angle_limit_rad
            rows = waves(table.period_s, seconds, WIGGLE_HZ, WIGGLE_SHARE * limit)
            trace = tell(table, rows, limit)
            return tilt.wiggle(trace.t_s, trace.seen_rad)
        axis = [wiggle(table.period_s, seconds, WIGGLE_HZ) for _ in range(2)]
        trace = perform(table, (axis[0], axis[1]))
        return tilt.wiggle(trace.t_s, trace.theta_rad)


def _filmed(log: Log, video: str, folder: CalibrationFolder) -> Wiggle:
    """A recorded run's encoders and its frames, stamped on the run's clock."""
    if not log.has("theta_x_rad", "theta_y_rad"):
        raise ValueError("the run lacks servo angles: both are needed for the camera's delay")
    theta = np.column_stack((log["theta_x_rad"], log["theta_y_rad"]))
    return filmed_motion(video, folder, log["t_s"], theta)


def _write_wiggle(wiggled: Wiggle, folder: Path) -> Path:
    """plate.csv: what the markers said; encoders.csv: the encoders; in a folder of their own."""
    path = folder / "time"
    path.mkdir(exist_ok=True)
    encoders = np.column_stack((wiggled.t_s, wiggled.theta_rad))
    write_csv(path / "encoders.csv", "t_s,theta_x_rad,theta_y_rad", encoders)
    plate = np.column_stack((wiggled.stamp_s, wiggled.sines))
    write_csv(path / "plate.csv", "stamp_s,sine_x,sine_y", plate)
    return path
