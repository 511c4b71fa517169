"""Plausibility of a log: units, signs, swapped axes, encoder, rate, length.

What is certainly wrong is refused (ValueError); what is only suspicious, or makes a channel
useless, is a note. Where a range does not decide, physics does: a wrong unit gives an absurd gain.
"""

from collections.abc import Callable
from math import degrees, log10

import numpy as np

from experiments.gap.physics import Response, ball_response, servo_response
from experiments.records.row_checks import MAX_POSITION_M, check_clock
from rig.log import COMMANDS, INDEX, Log
from rig.parameters import Rig
from rig.plant.plant_record import pack
from rig.prediction.commanded import answers
from rig.prediction.innovations import after_holes, signals

MIN_ROWS, MIN_SECONDS, MIN_OBSERVATIONS = 20, 1.0, 10
MAX_VOLTS_V = 100.0  # no motor of such a table takes more: counts of a converter, or millivolts
MAX_VALUE = 1e6  # of a single cell, in its SI unit: beyond, it is a fault of the recording; chosen
BEYOND_RATIO = 1.3  # of half a plate, or of the end of travel: beyond, it is more than a slip
ABSURD_GAIN_RATIO = 15.0  # of a gain to its nominal: beyond, it is a wrong unit, not another table
MAX_EXPOSURE_LAG_S = 2.0  # an exposure is at most so long before its row
TIMES = ("t_s", "ball_exposed_s")  # may count from 1970
OTHER_RATE = 1.25  # chosen: of frames to the rig file's: no slip of a clock, another camera
HOLE_S, MISSING = 0.25, 4.0  # between two frames, or times the usual step: some are missing; chosen
MOST_EARLY = 0.1  # share of frames; chosen: above what a slow program lets wait now and then
MIN_LEVELS = 12  # different encoder readings from which their step is found
DECIMAL = 1e-6  # chosen: of the decade, so far is the step of written decimals from a power of ten


class TooShortError(ValueError):
    """A log that is usable but too short; among several logs it may be left out."""


def check(log: Log, rig: Rig) -> list[str]:
    """Notes on what is suspicious in a log of the rig.

    TooShortError (a ValueError): fewer than MIN_ROWS rows or MIN_SECONDS. ValueError: the log
    cannot be used: no axis has both ends of a channel, a wrong unit, axes swapped, a sign reversed,
    or a row rate out of range.
    """
    read_back = rig.servo.takes_angle and (log.has("theta_x_rad") or log.has("theta_y_rad"))
    log = _with_answers(log, rig)
    _check_channels(log, ["command_{}_rad"] if read_back else [])
    _check_cells(log)
    _check_time(log)
    notes = [*_still(log), *_holes(log), *_frames(log, rig), *_volts(log, rig), *_told(log, rig)]
    servo = {axis: servo_response(log, axis, axis) for axis in "xy"}
    ball = {axis: ball_response(log, axis, axis, rig.camera.delay_s) for axis in "xy"}
    notes += _units(log, rig, ball, servo)
    _check_signs(servo, "voltage_{}_V", "theta_{}_rad", lambda a, b: servo_response(log, a, b))
    _check_signs(
        ball,
        "theta_{}_rad",
        "ball_{}_m",
        lambda a, b: ball_response(log, a, b, rig.camera.delay_s),
    )
    return notes


def _with_answers(log: Log, rig: Rig) -> Log:
    """The log with the answer of the rig's servos to what they were told, where nobody measured it.

    ValueError: angles were told, but the rig's servos take volts.
    """
    if log.told() is None or log.has("theta_x_rad") or log.has("theta_y_rad"):
        return log
    given = [name for name in COMMANDS if log.has(name)]
    if not rig.servo.takes_angle:
        raise ValueError(
            f"{' and '.join(given)}, and no theta: these servos take an angle; say so in "
            'a rig file, [servo] kind = "position", and give it with --rig'
        )
    known = signals(log, camera_delay_s=rig.camera.delay_s)
    if known.told_rad is None or not np.all(np.diff(known.t_s) > 0):
        return log
    t_s, angles = answers(pack(rig), known.t_s, known.told_rad)
    rows = np.array(log.rows)
    theta = INDEX["theta_x_rad"]
    rows[:, theta : theta + 2] = angles[np.searchsorted(t_s, known.t_s - 1e-9)]
    for name in COMMANDS:
        if name not in given:
            rows[:, INDEX[name.replace("command", "theta")]] = np.nan
    return Log.from_rows(rows, notes=log.notes)


def _check_channels(log: Log, told: list[str]) -> None:
    """ValueError where no axis has both ends of a channel, or the log is too short; told: what a
    measured angle may be compared with beside volts and ball."""
    if len(log) < MIN_ROWS:
        raise TooShortError(
            f"too short: {len(log)} row{'s' if len(log) > 1 else ''} (limit: {MIN_ROWS}); "
            "record longer"
        )
    ends = [*told, "voltage_{}_V", "ball_{}_m"]
    for axis in "xy":
        if log.has(f"theta_{axis}_rad") and any(log.has(end.format(axis)) for end in ends):
            return
    there = [name for name in log.columns if name != "t_s" and log.has(name)]
    first = ends[0].replace("_{}", "")
    raise ValueError(
        f"nothing to compare: one axis needs its theta_rad and either its {first} or its ball_m "
        f"(there are {', '.join(there) or 'no values'})"
    )


def _check_cells(log: Log) -> None:
    """ValueError where a single value is beyond what any signal of a table can be."""
    for name in log.columns:
        size = np.abs(log[name])
        if name not in TIMES and np.any(size > MAX_VALUE):
            row = int(np.argmax(size > MAX_VALUE))
            raise ValueError(
                f"{name} is {log[name][row]:.3g} in row {row + 1} (limit: {MAX_VALUE:g}): leave "
                "that cell blank"
            )


def _check_time(log: Log) -> None:
    """ValueError: time in other units or with a jump, another clock for exposures, too short."""
    t_s = log["t_s"]
    check_clock(t_s)
    tick, length = float(np.median(np.diff(t_s))), float(t_s[-1] - t_s[0])
    if length < MIN_SECONDS:
        raise TooShortError(f"too short: {length:.3g} s (limit: {MIN_SECONDS:g} s); record longer")
    late = (t_s - log["ball_exposed_s"])[~np.isnan(log["ball_exposed_s"])]
    if len(late) and not -tick <= float(np.median(late)) <= MAX_EXPOSURE_LAG_S:
        raise ValueError(
            f"ball_exposed_s lies {float(np.median(late)):.3g} s before its row's t_s (limit: 0 to "
            f"{MAX_EXPOSURE_LAG_S:g} s): give it on the clock of t_s, or leave the column out"
        )


def _still(log: Log) -> list[str]:
    """Notes on signals that never change, and on a ball that was hardly ever seen."""
    notes = []
    for name in ("voltage_{}_V", "theta_{}_rad", "ball_{}_m"):
        for axis in "xy":
            values = log[name.format(axis)]
            values = values[~np.isnan(values)]
            if len(values) and np.ptp(values) == 0:
                notes.append(f"{name.format(axis)} never changes: it says nothing")
    if log.has("ball_x_m") or log.has("ball_y_m"):
        seen = len(log.ball()[0])
        if seen < MIN_OBSERVATIONS:
            notes.append(f"the ball was seen only {seen} times")
    return notes


def _holes(log: Log) -> list[str]:
    """A note on missing rows, behind which the servos are predicted anew."""
    t_s = log["t_s"]
    rows = np.flatnonzero(after_holes(t_s))
    if not len(rows):
        return []
    spans = t_s[rows] - t_s[rows - 1]
    longest = int(np.argmax(spans))
    several = f"{len(rows)} holes, the longest" if len(rows) > 1 else "a hole"
    return [
        f"rows are missing: {several} {spans[longest]:.3g} s after {t_s[rows[longest] - 1]:.6g} s; "
        "servos are predicted anew behind each"
    ]


def _frames(log: Log, rig: Rig) -> list[str]:
    """A note on frames that come in bursts, or at another rate than the rig file's camera has."""
    exposed_s = log.ball()[0]
    if len(exposed_s) < MIN_OBSERVATIONS:
        return []
    steps_s, camera_Hz = np.diff(exposed_s), rig.camera.rate_hz
    # The mean: rows that date the frames of a slower camera round each step to whole rows. The
    # median: frames are lost. Either may be the file's.
    usual = steps_s <= max(HOLE_S, MISSING * float(np.median(steps_s)))
    periods_s = [float(np.mean(steps_s[usual])), float(np.median(steps_s))]
    periods_s = [period_s for period_s in periods_s if period_s > 0.0]
    if not periods_s:
        return []
    period_s = min(periods_s, key=lambda period_s: abs(np.log(period_s * camera_Hz)))
    early = float(np.mean(steps_s < 0.5 * period_s))
    if early > MOST_EARLY:
        return [
            f"{100 * early:.0f} % of the frames come less than half a frame after the one before, "
            "as over a link that sends several at once: their times are not those of exposure, and "
            "places are off by speed times what they are late, which no verdict knows of"
        ]
    if 1 / OTHER_RATE < period_s * camera_Hz < OTHER_RATE:
        return []
    return [
        f"the ball is seen {1 / period_s:.3g} times a second, the rig file says camera.rate_hz = "
        f"{camera_Hz:g}: its camera.delay_s may be of another camera, too"
    ]


def _told(log: Log, rig: Rig) -> list[str]:
    """Notes on angles that were told beyond what the rig file's servos are told at most."""
    most_rad = {name: _most(log[name]) for name in COMMANDS if log.has(name)}
    limit_rad = rig.servo.angle_limit_rad
    return [
        f"{name} reaches {most:.3g} rad, beyond the rig file's servo.angle_limit_rad = "
        f"{limit_rad:.3g}: the extended model would be held back where this table was not"
        for name, most in most_rad.items()
        if most > 1.02 * limit_rad
    ]


def _volts(log: Log, rig: Rig) -> list[str]:
    """Notes on volts beyond the rig's limit. ValueError: they are no volts."""
    notes = []
    for axis in "xy":
        name = f"voltage_{axis}_V"
        most = _most(log[name])
        if most > MAX_VOLTS_V:
            raise ValueError(
                f"{name} reaches {most:.4g} (limit: {MAX_VOLTS_V:g} V): these look like a "
                "converter's counts or millivolts; give the volts at the motor's terminals"
            )
        if most > 1.02 * rig.servo.voltage_limit_V:
            notes.append(
                f"{name} reaches {most:.3g} V, above the rig's voltage_limit_V = "
                f"{rig.servo.voltage_limit_V:g}: volts before limits or gain, or counts?"
            )
    return notes


def _units(
    log: Log, rig: Rig, ball: dict[str, Response | None], servo: dict[str, Response | None]
) -> list[str]:
    """Notes on angles and positions that may be in other units. ValueError: they surely are."""
    notes = []
    for axis in "xy":
        notes += _position_unit(log, rig, axis, ball[axis])
    for axis in "xy":
        notes += _angle_unit(log, rig, axis, ball[axis], servo[axis])
    return notes


def _position_unit(log: Log, rig: Rig, axis: str, ball: Response | None) -> list[str]:
    name, half = f"ball_{axis}_m", rig.linkage.side_m / 2
    most = _most(log[name])
    if most <= BEYOND_RATIO * half:
        return []
    times = abs(ball.gain) / rig.ball_gain_m_s2 if ball is not None and ball.clear else 0.0
    if most > MAX_POSITION_M or times > ABSURD_GAIN_RATIO:
        unit, factor = "millimetres, centimetres or pixels", ""
        if times > ABSURD_GAIN_RATIO:  # the ball is that much faster than a table can make it
            millimetres = times > 300
            unit = "millimetres" if millimetres else "centimetres"
            factor = f" (times {0.001 if millimetres else 0.01:g})"
        raise ValueError(
            f"{name} reaches {most:.4g}, but half the plate is {half:.4g} m: this looks like "
            f"{unit}; give metres{factor}"
        )
    return [
        f"{name} reaches {most:.3g} m, beyond half the plate ({half:.4g} m): another unit, or "
        "linkage.plate_side_m of another table"
    ]


def _angle_unit(
    log: Log, rig: Rig, axis: str, ball: Response | None, servo: Response | None
) -> list[str]:
    """Degrees make every angle 57 times too large: the range, the encoder and the gains show it."""
    name = f"theta_{axis}_rad"
    most, step = _most(log[name]), step_of(log[name])
    beyond = most > rig.servo.stop_rad * BEYOND_RATIO
    ratio = step / rig.servo.encoder_step_rad if step else 1.0
    signs = [
        abs(ratio / degrees(1) - 1) < 0.03,
        ball is not None and ball.clear and abs(ball.gain) < rig.ball_gain_m_s2 / ABSURD_GAIN_RATIO,
        servo is not None and servo.clear and abs(servo.gain) > 25 * rig.servo.gain_rad_s_V,
    ]
    if sum(signs) + beyond >= 2:
        raise ValueError(
            f"{name} reaches {most:.4g}: this looks like degrees (the servo's stop is at "
            f"{rig.servo.stop_rad:.3g} rad); give radians (times 0.01745)"
        )
    notes = []
    if beyond:
        notes.append(
            f"{name} reaches {most:.3g} rad, beyond the rig's stop ({rig.servo.stop_rad:.3g} rad): "
            "degrees, the servo of another table, or a bare motor, which has none"
        )
    if step and abs(ratio - 1) > 0.02:
        notes.append(
            f"{name} moves in steps of {step:.3g} rad ({2 * np.pi / step:.0f} a turn), the rig "
            f"file says encoder_counts_per_rev = {rig.servo.encoder_counts_per_rev}"
        )
    return notes


def _check_signs(
    own: dict[str, Response | None],
    cause: str,
    result: str,
    across: Callable[[str, str], Response | None],
) -> None:
    """ValueError where an axis surely answers the other one, or the wrong way round."""
    crossed = [across("x", "y"), across("y", "x")]
    both = [one.rank for one in crossed if one is not None and one.clear]
    mine = [one.rank for one in own.values() if one is not None]
    if len(both) == 2 == len(mine):
        stronger = min(map(abs, both)) > max(map(abs, mine)) + 0.3
        if stronger or (min(both) > 0 and max(mine) < 0):
            raise ValueError(
                f"{result.format('x')} follows {cause.format('y')} and {result.format('y')} "
                f"follows {cause.format('x')} (correlations {both[1]:+.2f}, {both[0]:+.2f}): "
                "swap the axes of one of them"
            )
    for axis, one in own.items():
        if one is not None and one.clear and one.rank < 0:
            raise ValueError(
                f"{result.format(axis)} answers {cause.format(axis)} the wrong way round "
                f"(correlation {one.rank:+.2f}): reverse the sign of one of them, so that "
                "+voltage raises theta and +theta accelerates the ball towards +"
            )


def _most(values: np.ndarray) -> float:
    """Largest magnitude, outliers aside; 0 without values."""
    values = np.abs(values[~np.isnan(values)])
    return float(np.quantile(values, 0.999)) if len(values) else 0.0


def step_of(theta_rad: np.ndarray) -> float | None:
    """Step [rad] in which an encoder's angle theta_rad (n,) moves; None where no step is found.

    Steps of a power of ten are taken for the rounding of the written numbers and give None.
    """
    values = np.unique(theta_rad[~np.isnan(theta_rad)])
    gaps = np.diff(values)
    gaps = gaps[gaps > 1e-9]
    if len(gaps) < MIN_LEVELS or len(theta_rad) < 3 * len(gaps):
        return None
    count = np.round(gaps / gaps.min())
    step = float(gaps.sum() / count.sum())
    whole = np.abs(gaps / step - np.round(gaps / step)) < 0.15
    if whole.mean() < 0.98 or abs(log10(step) - round(log10(step))) < DECIMAL:
        return None
    return step
