"""What `rig calibrate play` does: plans and runs the motion, says how much play and where."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import degrees
from pathlib import Path

import numpy as np
import typer

from calibration.play import (
    Play,
    gear_by_strikes,
    gear_by_tachometer,
    joint_by_ball,
    offset_V,
    whole_by_motor,
)
from calibration.play_moves import Motion, perform, strikes, sweeps
from calibration.records import PlayRecord
from calibration.rolling import fit_rolling, rolling
from calibration.sheet import CalibrationError
from experiments.assemble import known, load_rig
from experiments.calibrate_folder import CalibrationFolder
from experiments.calibrate_motion import LEVEL_HZ, LEVEL_M
from rig.controllers import WITHOUT
from rig.known_play import KnownPlay
from rig.log import Log
from rig.parameters import Rig
from rig.simulate import Course, draw, simulate
from rig.simulator import SimulatedTable

SWEEPS, STRIKES, LED_S = 16, 28, 60.0
WORDS = {
    "gear": "gear (tachometer against encoder)",
    "gear without tachometer": "gear (encoder and volts)",
    "joint": "joint (encoder against camera)",
    "whole": "gear and joint together (motor side alone)",
}


@dataclass(frozen=True, eq=False)
class Measured:
    """Plays by what they were measured from and axis, and what could not be measured and why."""

    plays: dict[str, dict[str, Play]]
    not_seen: dict[str, str]


def measure(rig: Rig, believed: Rig, seed: int, *, motor_only: bool = False) -> Measured:
    """Measure a virtual table's play with every combination of sensors it has."""
    plays: dict[str, dict[str, Play]] = {}
    missing: dict[str, str] = {}

    def each(what: str, of_axis: Callable[[int], Play]) -> None:
        try:
            plays[what] = {name: of_axis(a) for a, name in enumerate("xy")}
        except (CalibrationError, ValueError) as error:
            missing[what] = str(error)

    if rig.servo.tachometer:
        blind = _swept(rig, seed, encoder=False)
        each("whole", lambda a: whole_by_motor(blind, a, believed))
    else:
        missing["whole"] = "no tachometer: the motor side alone shows nothing"
    if motor_only:
        return Measured(plays, missing)
    swept = _swept(rig, seed, encoder=True)
    if rig.servo.tachometer:
        each("gear", lambda a: gear_by_tachometer(swept, a, believed))
    bias = [offset_V(swept, a) for a in range(2)]
    struck = _struck(rig, seed, bias)
    each("gear without tachometer", lambda a: gear_by_strikes(struck, a, believed, bias[a]))
    log = _led_about(rig, seed)
    each("joint", lambda a: joint_by_ball(
        fit_rolling([rolling(log, a, believed.camera.delay_s)], believed, late=False), believed
    ))  # fmt: skip
    return Measured(plays, missing)


def _swept(rig: Rig, seed: int, *, encoder: bool) -> Motion:
    rng = np.random.default_rng([seed, 12 + encoder])
    with SimulatedTable(rig, rng, held=True) as table:
        one, other = (sweeps(table.period_s, SWEEPS) for _ in range(2))
        return perform(table, (one, other), encoder=encoder)


def _led_about(rig: Rig, seed: int) -> Log:
    """A run in which the ball follows a sine on each axis, in compiled code."""
    t = np.arange(round(LED_S * rig.control_rate_hz)) / rig.control_rate_hz
    targets = LEVEL_M * np.column_stack([np.sin(2 * np.pi * f * t) for f in LEVEL_HZ])
    way = Course(targets, np.zeros_like(targets))
    draws = draw(np.random.default_rng([seed, 15]), rig, way)
    run = simulate(rig, known(rig), WITHOUT, way, draws)
    if run.outcome != "completed":
        raise CalibrationError(f"the run in which the ball is led about ended early: {run.outcome}")
    return run.log


def _struck(rig: Rig, seed: int, bias: list[float]) -> Motion:
    with SimulatedTable(rig, np.random.default_rng([seed, 14]), held=True) as table:
        one, other = (strikes(table.period_s, bias[a], STRIKES) for a in range(2))
        return perform(table, (one, other))


def play(rig_file: Path | None, out: Path, *, seed: int, motor_only: bool = False) -> None:
    """Measure, say it, and keep it: in the calibration, and in rig.toml for the controllers."""
    rig = load_rig(rig_file)
    folder = CalibrationFolder(out, "simulated")
    believed = folder.believed(rig_file)
    found = measure(rig, believed, seed, motor_only=motor_only)
    if not found.plays:
        raise CalibrationError("; ".join(found.not_seen.values()))
    plays = {
        what: {axis: one.record() for axis, one in by_axis.items()}
        for what, by_axis in found.plays.items()
    }
    record = PlayRecord.model_validate({"plays": plays, "not_seen": found.not_seen})
    folder.keep("play", warnings=list(found.not_seen.values()), play=record)
    for what, by_axis in found.plays.items():
        for axis, one in by_axis.items():
            typer.echo(f"play {axis}, {WORDS[what]}: {sentence(one)}")
    if not motor_only:
        folder.believe(with_known(believed, found))


def sentence(one: Play) -> str:
    """Width, interval and symmetry in plain words."""
    low, high = one.interval_rad
    said = f"{degrees(one.width_rad):.2f} degrees ({degrees(low):.2f} to {degrees(high):.2f})"
    if one.symmetric is None:
        return said + ", its middle cannot be told from a level error or a rest position"
    if one.symmetric:
        return said + ", symmetric about where it rested"
    return said + f", one-sided: its middle lies {degrees(one.middle_rad):+.2f} degrees off"


def with_known(believed: Rig, found: Measured) -> Rig:
    """The rig file with what was measured, so that the controllers start with it."""
    gear = found.plays.get("gear") or found.plays.get("gear without tachometer") or {}
    joint = found.plays.get("joint") or {}
    widths = {f"gear_{axis}_rad": max(one.width_rad, 0.0) for axis, one in gear.items()}
    widths |= {f"joint_{axis}_rad": max(one.width_rad, 0.0) for axis, one in joint.items()}
    return replace(believed, play=KnownPlay(**widths))
