"""`rig calibrate play`: the virtual table's backlash, by every combination of its sensors."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from math import degrees
from pathlib import Path

import numpy as np
import typer

from calibration.camera.sheet import CalibrationError
from calibration.motion.backlash import (
    BacklashEstimate,
    gear_by_strikes,
    gear_by_tachometer,
    joint_by_ball,
    offset_V,
    whole_by_motor,
)
from calibration.motion.manoeuvres import Trace, perform, strikes, sweeps
from calibration.motion.rolling import fit_rolling, rolling
from calibration.records import BacklashRecord
from experiments.calibrate.folder import CalibrationFolder
from experiments.calibrate.given import led_about, led_in_steps
from experiments.progress import ProgressCall, silent
from experiments.runs.assemble import load_rig
from rig.log import Log
from rig.parameters import KnownBacklash, Rig
from rig.simulation.simulator import SimulatedTable

SWEEPS, STRIKES, LED_S = 16, 28, 60.0  # chosen: half a minute to a minute of motion each
STAGES, LEADS = 6, "leading the ball about, for the joints"  # of `measure`
WORDS = {
    "gear": "gear (tachometer against encoder)",
    "gear without tachometer": "gear (encoder and volts)",
    "joint": "joint (servo's angle against camera)",
    "whole": "gear and joint together (motor side alone)",
}


@dataclass(frozen=True, eq=False)
class MeasuredBacklash:
    """Backlash estimates of a table.

    plays: by what they were measured from (keys of WORDS), then by axis; not_seen: why there is no
    estimate, by the same keys.
    """

    plays: dict[str, dict[str, BacklashEstimate]]
    not_seen: dict[str, str]


def measure(
    rig: Rig,
    believed: Rig,
    seed: int,
    *,
    motor_only: bool = False,
    progress: ProgressCall = silent,
) -> MeasuredBacklash:
    """Measure the backlash of the virtual table `rig` with every combination of its sensors.

    believed: the rig as the laboratory knows it; seed: of the sensors' noise; motor_only: volts and
    tachometer alone. CalibrationError: the ball was lost while it was led about.
    """
    plays: dict[str, dict[str, BacklashEstimate]] = {}
    missing: dict[str, str] = {}

    def each(what: str, of_axis: Callable[[int], BacklashEstimate]) -> None:
        try:
            plays[what] = {name: of_axis(a) for a, name in enumerate("xy")}
        except (CalibrationError, ValueError) as error:
            missing[what] = str(error)

    def joints(led: Callable[..., Log], done: int, of: int) -> MeasuredBacklash:
        progress(LEADS, done, of)
        log = led(rig, LED_S, np.random.default_rng([seed, 15]))

        def joint(a: int) -> BacklashEstimate:
            progress(f"the joint of {'xy'[a]}, by how the ball answered", done + 1 + a, of)
            return _joint(log, a, believed)

        each("joint", joint)
        return MeasuredBacklash(plays, missing)

    if rig.servo.takes_angle:
        return joints(led_about if rig.servo.has_angle else led_in_steps, 0, 3)
    progress("sweeping the motors to and fro, without the encoder", 0, STAGES)
    if rig.servo.tachometer:
        blind = _swept(rig, seed, encoder=False)
        each("whole", lambda a: whole_by_motor(blind, a, believed))
    else:
        missing["whole"] = "no tachometer: the motor side alone shows nothing"
    if motor_only:
        return MeasuredBacklash(plays, missing)
    progress("sweeping them again, with the encoder", 1, STAGES)
    swept = _swept(rig, seed, encoder=True)
    if rig.servo.tachometer:
        each("gear", lambda a: gear_by_tachometer(swept, a, believed))
    bias = [offset_V(swept, a) for a in range(2)]
    progress("striking the gears' teeth", 2, STAGES)
    struck = _struck(rig, seed, bias)
    each("gear without tachometer", lambda a: gear_by_strikes(struck, a, believed, bias[a]))
    return joints(led_about, 3, STAGES)


def _joint(log: Log, axis: int, believed: Rig) -> BacklashEstimate:
    run = rolling(log, axis, believed.camera.delay_s, believed)
    return joint_by_ball(fit_rolling([run], believed, late=False), believed)


def _swept(rig: Rig, seed: int, *, encoder: bool) -> Trace:
    rng = np.random.default_rng([seed, 12 + encoder])
    with SimulatedTable(rig, rng, held=True) as table:
        one, other = (sweeps(table.period_s, SWEEPS) for _ in range(2))
        return perform(table, (one, other), encoder=encoder)


def _struck(rig: Rig, seed: int, bias: list[float]) -> Trace:
    with SimulatedTable(rig, np.random.default_rng([seed, 14]), held=True) as table:
        one, other = (strikes(table.period_s, bias[a], STRIKES) for a in range(2))
        return perform(table, (one, other))


def calibrate_backlash(
    rig_file: Path | None,
    out: Path,
    *,
    seed: int,
    motor_only: bool = False,
    progress: ProgressCall = silent,
) -> None:
    """Measure the virtual table's backlash, print it, and keep it in `out`.

    Kept in the calibration and, as what the controllers know, in rig.toml (not with motor_only,
    which uses volts and tachometer alone). seed: of the sensors' noise. CalibrationError: nothing
    could be measured. ValueError, OSError: rig file or folder cannot be used.
    """
    rig = load_rig(rig_file)
    folder = CalibrationFolder(out, "simulated", rig)
    believed = folder.believed(rig_file)
    measured = measure(rig, believed, seed, motor_only=motor_only, progress=progress)
    if not measured.plays:
        raise CalibrationError("; ".join(measured.not_seen.values()))
    plays = {
        what: {axis: estimate.record() for axis, estimate in by_axis.items()}
        for what, by_axis in measured.plays.items()
    }
    record = BacklashRecord.model_validate({"plays": plays, "not_seen": measured.not_seen})
    folder.keep("play", warnings=list(measured.not_seen.values()), play=record)
    for what, by_axis in measured.plays.items():
        for axis, estimate in by_axis.items():
            typer.echo(f"play {axis}, {WORDS[what]}: {sentence(estimate)}")
    if not motor_only:
        folder.believe(rig_file, partial(with_known_backlash, measured=measured))


def sentence(estimate: BacklashEstimate) -> str:
    """Width, 95 % interval and symmetry of an estimate in words [degrees]."""
    low, high = estimate.interval_rad
    said = f"{degrees(estimate.width_rad):.2f} degrees ({degrees(low):.2f} to {degrees(high):.2f})"
    if estimate.symmetric is None:
        return said + ", its middle cannot be told from a level error or a rest position"
    if estimate.symmetric:
        return said + ", symmetric about where it rested"
    return said + f", one-sided: its middle lies {degrees(estimate.middle_rad):+.2f} degrees off"


def with_known_backlash(believed: Rig, measured: MeasuredBacklash) -> Rig:
    """The rig with the measured widths [rad] as the controllers' known play (`[play]`).

    An axis without estimate gets no width; negative widths become 0.
    """
    gear = measured.plays.get("gear") or measured.plays.get("gear without tachometer") or {}
    joint = measured.plays.get("joint") or {}
    widths = {f"gear_{axis}_rad": max(one.width_rad, 0.0) for axis, one in gear.items()}
    widths |= {f"joint_{axis}_rad": max(one.width_rad, 0.0) for axis, one in joint.items()}
    return replace(believed, play=KnownBacklash(**widths))
