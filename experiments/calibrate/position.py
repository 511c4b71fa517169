"""`rig calibrate servo` of servos that take an angle.

By the angle read back; else by the plate's markers in frames; else by the ball.
"""

import shlex
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import degrees
from pathlib import Path

import numpy as np
import typer

from calibration.camera.sheet import CalibrationError
from calibration.motion.commanded_moves import Followed, check_directions, moves_in_turn, tell
from calibration.motion.position_servo import expected_angles, fit_position_servos
from calibration.motion.position_servo_by_ball import record_by_ball
from calibration.motion.position_servo_by_plate import followed_by_plate, seen_by_plate
from calibration.motion.rolling import DRAG_1_S, rolling
from calibration.motion.timing import Wiggle
from calibration.records import PositionServoAxis, PositionServoRecord, Value
from experiments.calibrate.answer_picture import answer_figure
from experiments.calibrate.filmed import files_of, filmed_motion, has_plate, virtual_film
from experiments.calibrate.folder import RIG_FILE, CalibrationFolder, with_position_servo
from experiments.calibrate.given import Given, led_in_steps, read_all, source_of, write_csv
from experiments.calibrate.pictures import angle_figure
from experiments.progress import ProgressCall, silent
from experiments.runs.assemble import load_rig
from rig.log import COMMANDS, Log
from rig.parameters import CameraTiming, Rig, Servo
from rig.simulation.simulator import SimulatedTable

LED_S = 60.0
FITS = "fitting when the ball answers the commands"
FILMED_CYCLES = 1  # of `moves_in_turn`: half a minute, of which every frame is rendered; chosen
ANGLES = ("theta_x_rad", "theta_y_rad")


@dataclass(frozen=True, eq=False)
class _Measured:
    """What was found, the file that holds its data (None: the runs), and its picture."""

    record: PositionServoRecord
    data: Sequence[Path]
    picture: Path


def calibrate_position_servo(
    runs: Sequence[Path],
    rig_file: Path | None,
    out: Path,
    *,
    seed: int,
    video: str | None = None,
    progress: ProgressCall = silent,
) -> None:
    """Measure both servos from `runs`, run folders or logs, else on the virtual table; keep them in
    `out`.

    The frames `video` of a run are used where they are given, else angles that were read back,
    else the ball; on the virtual table, before the ball, frames of it where `out` holds lens and
    plate. seed: of the virtual table. CalibrationError: the motion is refused. ValueError, OSError:
    rig file, run, video or folder cannot be used.
    """
    rig = load_rig(rig_file)
    given = read_all(runs, rig)
    folder = CalibrationFolder(out, source_of(given), rig)
    believed = folder.believed(rig_file)
    logs = [one.log for one in given]
    for path, log in zip(runs, logs, strict=True):
        if not log.has(*COMMANDS):
            absent = ", ".join(name for name in COMMANDS if not log.has(name))
            raise ValueError(f"{path}: holds no {absent}: what both servos were told is needed")
    by_angle = any(log.has(*ANGLES) for log in logs) if logs else rig.servo.has_angle
    if video is not None:
        if len(logs) != 1:
            raise ValueError(f"--video: name the one run whose frames these are, not {len(logs)}")
        shown = filmed_motion(video, folder, logs[0]["t_s"], _told(logs[0]))
        followed = replace(followed_by_plate(shown, believed), in_phase=_in_phase(given))
        found = _by_plate(followed, believed, [*runs, *files_of(video)], folder)
    elif by_angle:
        found = _by_angle(rig, believed, given, runs, folder, seed)
    elif not logs and has_plate(folder):
        shown = _virtual_moves(rig, folder, seed)
        found = _by_plate(followed_by_plate(shown, believed), believed, [], folder)
    else:
        if not logs:
            logs = [led_in_steps(rig, LED_S, np.random.default_rng([seed, 16]))]
        found = _by_ball(believed, logs, runs, folder, progress)
    folder.keep(
        "position_servo",
        data=found.data,
        pictures=[found.picture],
        warnings=_not_seen(found.record, believed),
        position_servo=found.record,
    )
    _tell(found.record, believed)
    folder.believe(rig_file, partial(with_position_servo, record=found.record))
    if runs:
        logs, file = shlex.join(map(str, runs)), shlex.quote(str(folder.path / RIG_FILE))
        typer.echo(f"next: rig gap {logs} --rig {file}")


def _tell(record: PositionServoRecord, believed: Rig) -> None:
    """Print what was found, and what a ball tells it beside."""
    for name in "xy":
        typer.echo(f"servo {name}, by its {record.source}: {sentence(record, name, believed)}")
    if record.source == "ball":
        typer.echo(
            f"all beside the camera's delay, taken to be {1e3 * believed.camera.delay_s:g} ms "
            f"(camera.delay_s; a rig file without it has {1e3 * CameraTiming().delay_s:g} ms)"
        )


def _by_angle(
    rig: Rig,
    believed: Rig,
    given: Sequence[Given],
    runs: Sequence[Path],
    folder: CalibrationFolder,
    seed: int,
) -> _Measured:
    if len(given) > 1:
        raise ValueError(f"{len(given)} runs: servos are measured by their angles from one run")
    data: Sequence[Path] = runs
    if given:
        followed = replace(_followed(given[0].log), in_phase=_in_phase(given))
    else:
        limit = rig.servo.angle_limit_rad
        with SimulatedTable(rig, np.random.default_rng([seed, 9]), held=True) as table:
            followed = tell(table, moves_in_turn(table.period_s, limit), limit)
        data = [folder.path / "servo_commands.csv"]
        columns = np.column_stack((followed.t_s, followed.told_rad, followed.seen_rad))
        write_csv(data[0], ",".join(("t_s", *COMMANDS, *ANGLES)), columns)
    return _from_angles(followed, believed, data, folder)


def _in_phase(given: Sequence[Given]) -> bool:
    return all(one.source == "simulated" for one in given)


def _followed(log: Log) -> Followed:
    """Commands and measured angles of a log. CalibrationError: a command is missing."""
    seen = np.column_stack([log[name] for name in ANGLES])
    return Followed(np.array(log["t_s"]), _told(log), np.array(log["t_s"]), seen)


def _told(log: Log) -> np.ndarray:
    """Angles told (n, 2) [rad]. CalibrationError: a row has none."""
    told = np.column_stack([log[name] for name in COMMANDS])
    if not np.isfinite(told).all():
        raise CalibrationError("some rows lack a command: export the run with all its rows")
    return told


def _virtual_moves(rig: Rig, folder: CalibrationFolder, seed: int) -> Wiggle:
    """What the virtual table was told, and its plate before the virtual camera."""
    limit = rig.servo.angle_limit_rad
    with virtual_film(rig, folder, seed=seed) as (table, tilt):
        told = tell(table, moves_in_turn(table.period_s, limit, FILMED_CYCLES), limit)
        return tilt.wiggle(told.t_s, told.told_rad)


def _by_plate(
    followed: Followed, believed: Rig, data: Sequence[Path], folder: CalibrationFolder
) -> _Measured:
    if not data:
        told = np.column_stack((followed.t_s, followed.told_rad))
        seen = np.column_stack((followed.seen_s, followed.seen_rad))
        data = [folder.path / "servo_commands.csv", folder.path / "servo_angles.csv"]
        write_csv(data[0], ",".join(("t_s", *COMMANDS)), told)
        write_csv(data[1], ",".join(("t_s", *ANGLES)), seen)
    found = _from_angles(followed, believed, data, folder)
    return replace(found, record=seen_by_plate(found.record))


def _from_angles(
    followed: Followed, believed: Rig, data: Sequence[Path], folder: CalibrationFolder
) -> _Measured:
    check_directions(followed)
    fit = fit_position_servos(followed, believed)
    shown = angle_figure(
        followed,
        expected_angles(followed, fit, believed),
        folder.path / "servo.png",
        folder.draft.source,
    )
    return _Measured(fit.record, data, shown)


def _by_ball(
    believed: Rig,
    logs: Sequence[Log],
    runs: Sequence[Path],
    folder: CalibrationFolder,
    progress: ProgressCall,
) -> _Measured:
    delay_s = believed.camera.delay_s
    axes = [[rolling(log, a, delay_s, believed) for log in logs] for a in range(2)]
    record = record_by_ball(axes[0], axes[1], believed, partial(progress, FITS))
    first = [axes[0][0], axes[1][0]]
    path = folder.path / "servo.png"
    picture = answer_figure(logs[0], first, record, path, folder.draft.source)
    return _Measured(record, runs, picture)


def sentence(record: PositionServoRecord, name: str, believed: Rig) -> str:
    """What was found of the servo `name` ("x", "y"), with 95 % intervals, in one line; a lag that
    was not seen is the one that is `believed`."""
    axis: PositionServoAxis = getattr(record, name)
    assumed = ""
    if "lag_s" in axis.not_seen:
        lag_s = believed.servo.pair("lag_s")["xy".index(name)]
        assumed = f"lag {1e3 * lag_s:.3g} ms (assumed) + "
    parts, of = [], "95 %: "
    for label, value, scale, unit in (
        ("lag", axis.lag_s, 1e3, "ms"),
        (f"{assumed}dead time", axis.dead_time_s, 1e3, "ms"),
        ("lag and dead time together", axis.together_s, 1e3, "ms"),
        ("at most", axis.rate_limit_rad_s, 1.0, "rad/s"),
        ("at most", axis.acceleration_limit_rad_s2, 1.0, "rad/s2"),
        ("dead band", axis.dead_band_rad, degrees(1), "degrees"),
        ("zero", _if_sure(axis.zero_rad), degrees(1), "degrees"),
        ("scale error", _if_sure(axis.scale), 100.0, "%"),
    ):
        if value is not None:
            low, high = scale * value.low, scale * value.high
            parts.append(f"{label} {scale * value.value:.3g} ({of}{low:.3g} to {high:.3g}) {unit}")
            of = ""
    if axis.together_off_s:
        parts.append(
            f"off by another {1e3 * axis.together_off_s:.2g} ms where the ball loses "
            f"{100 * DRAG_1_S:g} % of its speed in a second, or where the plate's pivot lies a "
            "ball's radius from where the rig file has it"
        )
    return "; ".join(parts)


def _not_seen(record: PositionServoRecord, believed: Rig) -> list[str]:
    """What was not seen, what it is taken to be and why, a warning each; that of both axes once."""
    lines: dict[str, list[str]] = {}
    for name in "xy":
        for key, why in getattr(record, name).not_seen.items():
            lines.setdefault(f"{_as_believed(believed, key, name)}: {why}", []).append(name)
    return [f"servo {' and '.join(names)}: {line}" for line, names in lines.items()]


def _as_believed(rig: Rig, key: str, axis: str) -> str:
    """What a value that was not seen is taken to be: the rig file's, or the default that a file
    without it has."""
    scale, unit = UNITS.get(key, (1.0, ""))
    if not unit:
        return f"{WORDS[key]} kept at that of the rig file"
    value = rig.servo.pair(key)["xy".index(axis)]
    if key == "acceleration_limit_rad_s2" and value >= Servo().acceleration_limit_rad_s2:
        return f"no {WORDS[key]} assumed"
    return f"{WORDS[key]} kept at {scale * value:.3g} {unit} (rig file or its default)"


def _if_sure(value: Value | None) -> Value | None:
    """The value where its interval leaves zero out."""
    return value if value is not None and value.low * value.high > 0 else None


WORDS = {
    "lag_s": "lag",
    "rate_limit_rad_s": "rate limit",
    "acceleration_limit_rad_s2": "acceleration limit",
    "dead_band_rad": "dead band",
    "scale": "scale",
}
UNITS = {
    "lag_s": (1e3, "ms"),
    "rate_limit_rad_s": (1.0, "rad/s"),
    "acceleration_limit_rad_s2": (1.0, "rad/s2"),
    "dead_band_rad": (degrees(1), "degrees"),
}
