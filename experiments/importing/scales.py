"""Units and zeros: from names where physics does not object, from physics where names are silent.

What decides: a ball that rolls on a tilted plate accelerates by k g sin(tilt), k = 3/5 to 5/7, and
a linkage makes the tilt 0.04 to 1 times the servo's angle. So one metre per second squared and
radian lies within GAIN, and a wrong unit (10, 57.3, 100, 1000 times) mostly falls out of it.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from experiments.importing.draft import Draft
from experiments.importing.relations import Response
from experiments.importing.roles import NAMES
from experiments.importing.signs import Answer
from experiments.importing.units import SCALED, factor, quantity

# k g 2 arm/side, k = 5/7 and 3/5, by the keys of the section [linkage] of the rig file.
EXPECTED = "by a rig file about 14.0 arm_radius_m / plate_side_m, 11.8 with a hollow ball"
GAIN = (0.2, 8.5)  # m/s2/rad; the upper end: the plate's own tilt, 5/7 g, and a fifth
LINKAGE_GAIN = 3.6  # of a servo's arm on a plate at most half as long; beyond, it is no such angle
TILT_GAINS = (5 / 7 * 9.81, 3 / 5 * 9.81)  # of the plate's own tilt, of a solid and a hollow ball
TILT_TOLERANCE = 0.05  # chosen: twice what noise and drag make of them
TILT_SPAN_M = 0.3  # chosen: a ball keeps to less on a plate's own tilt, of a share it is 1 or 2
BALL_SPAN_M = (0.004, 1.5)
LENGTHS = ("m", "cm", "mm")
ANGLE_SPAN_RAD = 0.004  # at least
USUAL_GAIN = (0.4, 8.5)
USUAL_SPAN_RAD = 3.2  # a servo turns half a turn
PLATE_TILT = "on two rods, linkage.arm_radius_m of rig.toml is then half of plate_side_m"
# Where the plate is level a servo's command says its unit: unit -> that middle, and its ends.
MIDDLES = {"deg": (90.0, 0.0, 180.0), "us": (1500.0, 500.0, 2500.0)}
USUAL_PULSE_RAD = np.pi / 2 / 1000  # of a microsecond of a hobby servo's pulse
OFF_MIDDLE = 0.08  # of the middle; chosen: trims of servos are smaller
LEVEL_RAD = 0.12  # a zero nearer to 0 than this is a level error, which is for `rig gap` to find
ROUND = (90.0, 180.0, 1500.0, 2048.0, 512.0, 127.5, 128.0, 135.0, 2047.0, 0.5, 307.0, 375.0)


def settle_units(
    draft: Draft,
    ball: Mapping[str, str],
    kind: str,
    angles: Mapping[str, str],
    answers: Mapping[str, Answer | None],
    followed: Mapping[str, Mapping[str, Response]],
) -> None:
    """Settle the units of the ball (axis -> column) and of one kind of angle, or doubt them.

    followed: how measured angles follow these (of `signs.followed`).
    """
    ball_names = {axis: NAMES["ball"].format(axis) for axis in ball}
    angle_names = {axis: NAMES[kind].format(axis) for axis in angles}
    b_said = _named(draft, ball_names, ball)
    a_said = (
        _named(draft, angle_names, angles)
        or _followers_unit(draft, angles, followed)
        or _middles_unit(draft, answers)
    )
    fitting = [
        (b, a)
        for b in ([b_said] if b_said else LENGTHS)
        for a in ([a_said] if a_said else ["rad", "deg"])
        if _plausible(
            draft,
            (b, ball_names, ball),
            (a, angle_names, angles),
            answers,
            named=a_said is not None,
        )
    ]
    told = any(answer is not None for answer in answers.values())
    pick_b = b_said or (fitting[0][0] if fitting else "m")
    pick_a = a_said or (fitting[0][1] if fitting else "rad")
    for names, unit in ((ball_names, pick_b), (angle_names, pick_a)):
        for name in names.values():
            draft.settle(name, unit=unit)
    gain = _gain_text(draft, answers, pick_b, pick_a, ball_names, angle_names)
    if not fitting and told and b_said and a_said:
        told_units = (b_said, ball_names, ball), (a_said, angle_names, angles)
        _doubt_named(draft, gain, *told_units, answers)
    if ball and not b_said and not _sure_ball(draft, fitting, answers, ball_names, angle_names):
        usual = ("m", "cm", "mm", "px", *(["1"] if _may_be_shares(draft, ball) else []))
        _doubt_unnamed(draft, ball_names, ball, *(b for b, _ in fitting), *usual)
    clear = all(draft.hints[column].clear for column in angles.values())
    if angles and not a_said and not (told and clear and len({a for _, a in fitting}) == 1):
        usual = ("rad", "deg", "turn/4096", "us", "counts")
        _doubt_unnamed(draft, angle_names, angles, *(a for _, a in fitting), *usual)
    for names, unit in ((ball_names, pick_b), (angle_names, pick_a)):
        settle_scale(draft, list(names.values()), unit)
    if told and gain:
        gains = _gains(draft, answers, (pick_b, ball_names), (pick_a, angle_names))
        each = " for each radian of it" if gains else ""
        draft.because("angle", f"the ball accelerates{each} by {gain}")
        if any(abs(one) > LINKAGE_GAIN for one in gains):
            draft.because("angle", f"so this is the plate's own tilt: {PLATE_TILT}")
        elif gains:
            draft.because("angle", EXPECTED)


def _doubt_unnamed(
    draft: Draft, names: Mapping[str, str], columns: Mapping[str, str], *options: str
) -> None:
    """Ask for a unit that no name says; options: the likeliest first."""
    why = f"the unit of {', '.join(columns.values())} is not in the name"
    draft.doubt(list(names.values()), "unit", why, *dict.fromkeys(options))


def _may_be_shares(draft: Draft, ball: Mapping[str, str]) -> bool:
    """Whether the ball's places (axis -> column) may be shares, up to 1, of a picture."""
    most = [float(np.nanmax(np.abs(draft.values(column)))) for column in ball.values()]
    return all(TILT_SPAN_M < one <= 1.0 for one in most)


def _followers_unit(
    draft: Draft, commands: Mapping[str, str], followed: Mapping[str, Mapping[str, Response]]
) -> str | None:
    """Unit of the measured angles where it must be the commands', too: names without a unit that
    only angles have, and gains nearer to 1 than to the degrees of a radian."""
    gains = [abs(followed[a][c].gain) for a, c in commands.items() if c in followed.get(a, {})]
    clear = all(draft.hints[c].clear and draft.hints[c].unit is None for c in commands.values())
    if not gains or not clear or any(abs(np.log(gain)) > np.log(180 / np.pi) / 2 for gain in gains):
        return None
    axis = next(a for a, c in commands.items() if c in followed.get(a, {}))
    unit = draft.signals[NAMES["theta"].format(axis)]["unit"]
    return unit if unit in ("deg", "rad") else None


def _middles_unit(draft: Draft, answers: Mapping[str, Answer | None]) -> str | None:
    """The unit whose middle of a servo's range every axis is level at, and whose range it keeps."""
    for unit, (middle, low, high) in MIDDLES.items():
        if answers and all(
            answer is not None
            and abs(answer.response.zero - middle) <= OFF_MIDDLE * middle
            and low <= np.nanmin(draft.values(answer.column))
            and np.nanmax(draft.values(answer.column)) <= high
            for answer in answers.values()
        ):
            draft.because("angle", f"level near {middle:g}, as a servo's {unit}")
            return unit
    return None


def _doubt_named(
    draft: Draft,
    gain: str,
    ball: tuple[str, Mapping[str, str], Mapping[str, str]],
    angle: tuple[str, Mapping[str, str], Mapping[str, str]],
    answers: Mapping[str, Answer | None],
) -> None:
    """Ask for units that the names say wrongly: those first that would fit with the other's as it
    is named, and of ball or angle alone where only its own can be wrong.

    ball, angle: unit as named, axis -> name in the log, axis -> column.
    """
    asked = {doubt.place for doubt in draft.doubts if doubt.key == "unit"}
    both = {*ball[1].values(), *angle[1].values()}
    if asked & both or all(draft.is_said(name, "unit") for name in both):
        return

    def fit(b: str, a: str) -> bool:
        return _plausible(draft, (b, *ball[1:]), (a, *angle[1:]), answers, named=True)

    balls = [b for b in LENGTHS if b != ball[0] and fit(b, angle[0])]
    angles = [a for a in ("rad", "deg") if a != angle[0] and fit(ball[0], a)]
    told = [f"the ball in {b}" for b in balls] + [f"the angle in {a}" for a in angles]
    why = f"the ball would answer to a radian with {gain}, "
    why += f"which no linkage does in {ball[0]} and {angle[0]}"
    why += f"; it would with {' or '.join(told)}" if told else ""
    if balls or not told:
        options = dict.fromkeys([*balls, *LENGTHS, "px"])
        draft.doubt(list(ball[1].values()), "unit", why, *options)
    if angles or not told:
        options = dict.fromkeys([*angles, "rad", "deg", "turn/4096", "us"])
        draft.doubt(list(angle[1].values()), "unit", why, *options)


def settle_scale(draft: Draft, names: Sequence[str], unit: str) -> None:
    """Doubt the scale of a unit that has no SI factor; of px a camera's calibration has it."""
    for name in names:
        if factor(unit, name) is None and not draft.is_said(name, "scale"):
            if unit == "px" and "calibration" in draft.said.get("", {}):
                continue
            whole = "whole" if unit == "1" else unit
            what = f"{'m' if name[:4] in ('ball', 'targ') else 'rad'} in one {whole}"
            if name.startswith("voltage"):
                what = "volts of the supply" if "1" in unit else "volts in one count"
            hint = {
                "us": " (90 degrees in 1000 us are 0.00157)",
                "px": " (or state --calibration)",
            }.get(unit, "")
            draft.doubt([*names], "scale", f"nothing says the {what}{hint}")
            return


def _named(draft: Draft, names: Mapping[str, str], columns: Mapping[str, str]) -> str | None:
    """The unit of a pair of columns: stated, or in a name; a brother's counts for both."""
    said = [draft.said[n]["unit"] for n in names.values() if draft.is_said(n, "unit")]
    if said:
        for axis, name in names.items():
            factor(said[0], name)
            own = draft.hints[columns[axis]].unit
            if own not in (None, *said):
                draft.doubt([name], "unit", f"{columns[axis]} says {own}", own, *said)
        return str(said[0])
    found = dict.fromkeys(draft.hints[column].unit for column in columns.values())
    fits = []
    for unit in found:
        if unit is None or (quantity(unit) is None and unit != "us" and "/" not in unit):
            if unit in SCALED:
                fits.append(unit)
            continue
        try:
            factor(unit, next(iter(names.values())))
        except ValueError:
            continue
        fits.append(unit)
    if len(fits) > 1:
        why = f"{' and '.join(columns.values())} are in different units"
        for axis, name in names.items():
            own = draft.hints[columns[axis]].unit
            draft.doubt([name], "unit", why, *sorted(fits, key=lambda unit: unit != own))
    return fits[0] if fits else None


def _si(draft: Draft, name: str, unit: str) -> float | None:
    """SI in one `unit`, or in the one that was stated: by its factor, or by a stated scale; None
    where neither is known."""
    unit = draft.said.get(name, {}).get("unit", unit)
    own = factor(unit, name)
    return own if own is not None else draft.said.get(name, {}).get("scale")


def _plausible(
    draft: Draft,
    ball: tuple[str, Mapping[str, str], Mapping[str, str]],
    angle: tuple[str, Mapping[str, str], Mapping[str, str]],
    answers: Mapping[str, Answer | None],
    *,
    named: bool,
) -> bool:
    """Whether spans and gains are those of a table, if ball and angle are in these units.

    An angle whose name says no unit must be a usual one: counts and pulse widths look like degrees
    of an unusual servo.
    """
    largest, (lowest, highest) = (7.0, GAIN) if named else (USUAL_SPAN_RAD, USUAL_GAIN)
    spans = (BALL_SPAN_M, (ANGLE_SPAN_RAD, largest))
    for (unit, names, columns), (low, high) in zip((ball, angle), spans, strict=True):
        for axis, column in columns.items():
            si = _si(draft, names[axis], unit)
            if si is not None and draft.hints[column].role != "speed":
                span = si * _span(draft.values(column))
                if not low <= span <= high:
                    return False
                most = float(np.nanmax(np.abs(draft.values(column))))
                if columns is angle[2] and not named and most * si > 2 * np.pi:
                    return False
    for axis, answer in answers.items():
        if answer is None or axis not in ball[1] or axis not in angle[1]:
            continue
        b, a = _si(draft, ball[1][axis], ball[0]), _si(draft, angle[1][axis], angle[0])
        if b is not None and a is not None:
            ends = sorted(abs(end) * b / a for end in (answer.response.low, answer.response.high))
            if ends[1] < lowest or ends[0] > highest:
                return False
    return True


def _span(values: np.ndarray) -> float:
    """Width of the middle 98 % of the values."""
    low, high = np.nanquantile(values, (0.01, 0.99))
    return float(high - low)


def _sure_ball(
    draft: Draft,
    fitting: Sequence[tuple[str, str]],
    answers: Mapping[str, Answer | None],
    ball_names: Mapping[str, str],
    angle_names: Mapping[str, str],
) -> bool:
    """Whether a ball without a named unit surely is in metres.

    Millimetres and centimetres could as well be pixels, and a share of the plate could be metres
    if the gain were more than a linkage's, but is not that of a plate's own tilt within
    TILT_SPAN_M.
    """
    columns = {axis: draft.signals[name]["column"] for axis, name in ball_names.items()}
    if {b for b, _ in fitting} != {"m"} or len(fitting) != 1 or _may_be_shares(draft, columns):
        return False
    for axis, answer in answers.items():
        if answer is None or axis not in ball_names:
            return False
        a = _si(draft, angle_names[axis], fitting[0][1])
        if a is None:
            return False
        gain = abs(answer.response.gain) / a
        own_tilt = any(abs(gain / tilt - 1) <= TILT_TOLERANCE for tilt in TILT_GAINS)
        own_tilt &= _span(draft.values(columns[axis])) <= TILT_SPAN_M
        if gain > LINKAGE_GAIN and not own_tilt:
            return False
    return bool(answers)


def _gains(
    draft: Draft,
    answers: Mapping[str, Answer | None],
    ball: tuple[str, Mapping[str, str]],
    angle: tuple[str, Mapping[str, str]],
) -> list[float]:
    """Gains [m/s2/rad] where both units (unit, axis -> name) have SI values."""
    found = []
    for axis, answer in answers.items():
        if answer is not None and axis in ball[1]:
            b, a = _si(draft, ball[1][axis], ball[0]), _si(draft, angle[1][axis], angle[0])
            if b is not None and a is not None:
                found.append(answer.response.gain * b / a)
    return found


def _gain_text(
    draft: Draft,
    answers: Mapping[str, Answer | None],
    ball_unit: str,
    angle_unit: str,
    ball_names: Mapping[str, str],
    angle_names: Mapping[str, str],
) -> str:
    """The gains, per unit of the angle, in words with 99.9 % intervals; in file units where the SI
    ones are not known."""
    parts = []
    for axis, answer in answers.items():
        if answer is None or axis not in ball_names:
            continue
        b, a = _si(draft, ball_names[axis], ball_unit), _si(draft, angle_names[axis], angle_unit)
        one = answer.response
        times = b / a if b is not None and a is not None else 1.0
        ends = sorted(abs(end) * times for end in (one.low, one.high))
        unit = "m/s2" if b is not None and a is not None else "file units"
        level = "" if parts else "99.9 %: "
        parts.append(
            f"{abs(one.gain) * times:.3g} {unit} on {axis} "
            f"({level}{ends[0]:.3g} to {ends[1]:.3g}), {one.delay_s:.2f} s later"
        )
    return " and ".join(parts)


def settle_angle_zero(draft: Draft, kind: str, answers: Mapping[str, Answer | None]) -> None:
    """Settle the angle at which the plate is level: 0, a round number, or in doubt."""
    for axis, answer in answers.items():
        name = NAMES[kind].format(axis)
        column, unit = draft.signals[name]["column"], draft.signals[name]["unit"]
        if draft.hints[column].role == "speed":
            draft.settle(name, offset=0.0)
            draft.because("angle", f"{name} is the integral of a speed: it drifts, level unknown")
            continue
        if draft.is_said(name, "offset"):
            draft.settle(name, offset=draft.said[name]["offset"])
            continue
        values = draft.values(column)
        si = _si(draft, name, unit)
        about = USUAL_PULSE_RAD if si is None and unit == "us" else si  # enough to tell a trim
        near = LEVEL_RAD / about if about is not None else 0.15 * _span(values)
        middle = float(np.nanmedian(values))
        if answer is None:
            draft.settle(name, offset=0.0)
            if abs(middle) > max(near, 1.5 * _span(values)):
                draft.doubt([name], "offset", f"{column} is about {middle:.4g}: level is open")
            continue
        zero, error = answer.response.zero, answer.response.zero_error
        best = min((0.0, *ROUND, *(-one for one in ROUND)), key=lambda one: abs(one - zero))
        if abs(zero) <= near and (si is not None or abs(zero) < 0.02 * max(ROUND)):
            best = 0.0
        draft.settle(name, offset=best)
        if abs(zero - best) > near or error > near:
            why = f"the plate is level where {column} is {zero:.4g} +- {2 * error:.2g}"
            draft.doubt([name], "offset", why, f"{zero:.4g}", "0")
        elif best:
            draft.because("angle", f"{column} is {zero:.4g} where level: {best:g} is taken off")


def settle_ball_zero(draft: Draft, ball: Mapping[str, str], seen: Mapping[str, np.ndarray]) -> None:
    """Settle the plate's centre: 0 where the ball was on both sides of it, else in doubt."""
    for axis, column in ball.items():
        name = NAMES["ball"].format(axis)
        if draft.is_said(name, "offset"):
            draft.settle(name, offset=draft.said[name]["offset"])
            continue
        draft.settle(name, offset=0.0)
        if draft.signals[name].get("unit") == "px" and "calibration" in draft.said.get("", {}):
            continue
        values = draft.values(column)[np.isfinite(seen[axis])]
        low, high = np.quantile(values, (0.02, 0.98)) if len(values) else (0.0, 0.0)
        if not low < 0 < high:
            why = f"{column} runs from {low:.4g} to {high:.4g}: where is the plate's centre"
            draft.doubt([name], "offset", why)
