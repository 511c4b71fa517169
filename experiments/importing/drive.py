"""Volts, shares, currents, speeds and targets: settled after the angles and the ball."""

from collections.abc import Mapping

import numpy as np

from experiments.importing.draft import Draft
from experiments.importing.relations import Response, responses
from experiments.importing.roles import NAMES, assign, columns_of
from experiments.importing.scales import OFF_MIDDLE, ROUND, settle_scale
from experiments.importing.signs import filled, motion
from experiments.importing.units import FACTORS, factor, quantity

MAX_VOLTS = 60.0  # extra-low voltage; no motor of such a table takes more
FULL_SCALES = (1.0, 100.0, 255.0, 1000.0, 1023.0, 4095.0, 32767.0)
NEAR_FULL = 0.02
SUPPLY_SHARE = 0.5  # chosen: a supply sags by less, and no drive stays above half of its most
_VOLTAGES = {axis: NAMES["voltage"].format(axis) for axis in "xy"}
SPEED_TOLERANCE = 0.15  # of a slope that must be 1
FOLLOWS = 0.8  # chosen: of an angle's motion; a ball's target has less than half in it
GIVE = 0.1  # chosen: of all that an angle went the one way, what it may go back
OFF_ZERO = 0.5  # chosen: of the farthest volts from rest; an amplifier's offset is smaller


def find_volts(draft: Draft) -> dict[str, str]:
    """Axis -> column of the motors' volts, or of what stands for them."""
    for role in ("voltage", "share", "current"):
        names = [n for n in columns_of(draft, role) if not _is_supply(draft, role, n)]
        if names or role == "voltage":
            found = assign(draft, "voltage", names)
            if found:
                return found
    return {}


def _is_supply(draft: Draft, role: str, column: str) -> bool:
    """Whether volts are those of a supply: of one sign, and never near 0, where a motor rests."""
    values = draft.values(column)
    values = values * np.sign(np.nanmean(values))
    if role != "voltage" or not np.nanmin(values) > SUPPLY_SHARE * np.nanmax(values):
        return False
    draft.because("drive", f"{column} is left out: volts of a supply, which never come near 0")
    return True


def settle_volts(draft: Draft, volts: Mapping[str, str], theta: Mapping[str, str]) -> None:
    """Settle pairing, sign and unit of the volts by the angles that follow them."""
    good = np.isfinite(draft.seconds)
    columns = list(volts.values())
    causes = [filled(draft.values(column))[good] for column in columns]
    for axis, own in list(volts.items()):
        name = NAMES["voltage"].format(axis)
        if axis not in theta:
            draft.because("drive", f"{own} is left out: no angle on axis {axis} to hold it against")
            continue
        angle = NAMES["theta"].format(axis)
        turned = draft.signals[angle]["sign"] * motion(draft, theta[axis])[good]
        each = responses(draft.seconds[good], turned, causes, order=1)
        others = _said_columns(draft, axis)
        known = {
            column: response
            for column, response in zip(columns, each, strict=True)
            if response is not None and response.sure and column not in others
        }
        own = next((one for one in (own, *columns) if one not in others), own)
        column = max(known, key=lambda c: known[c].share) if known else own
        if draft.is_said(name, "column") or len(volts) > len(theta):
            column = own
        if column != own:
            draft.because("drive", f"{column} drives {axis}, whatever its name: the angle follows")
        draft.settle(name, column=column, offset=0.0)
        column = str(draft.signals[name]["column"])  # what was said wins
        response = known.get(column)
        if response is None:
            why = f"{theta[axis]} does not tell the sign of {column}"
            draft.doubt([name], "sign", why, "1", "-1")
            draft.settle(name, sign=1)
        else:
            draft.settle(name, sign=1 if response.gain > 0 else -1)
        _settle_rest(draft, name, column, response, turned)
    names = [NAMES["voltage"].format(axis) for axis in volts if axis in theta]
    columns = [draft.signals[name]["column"] for name in names]
    if len(set(columns)) < len(columns):  # asked of one axis: the other's is then the other one
        why = "one column of volts would drive both axes"
        unsaid = [name for name in names if not draft.is_said(name, "column")]
        draft.doubt(unsaid[:1], "column", why, *volts.values())
    unit = _unit(draft, names)
    settle_scale(draft, names, unit)
    if quantity(unit) == "current":
        for key in ("resistance_ohm", "back_emf_V_s_rad"):
            why = f"volts follow from {' and '.join(columns)} only by the motor's {key}"
            draft.doubt(names, key, why)


def _said_columns(draft: Draft, axis: str) -> set[str]:
    """Columns of volts that somebody said to be of another axis."""
    names = [name for key, name in _VOLTAGES.items() if key != axis]
    return {str(draft.said[n]["column"]) for n in names if draft.is_said(n, "column")}


def _settle_rest(
    draft: Draft, name: str, column: str, response: Response | None, turned: np.ndarray
) -> None:
    """Settle at which number nothing drives: 0, the middle of an unsigned code, or in doubt.

    turned (n,): the angle; what is driven one way alone, as by a step of volts, has a direction.
    """
    values = draft.values(column)
    if draft.is_said(name, "offset"):
        return
    zero = response.zero if response is not None else 0.0
    if abs(zero) <= OFF_ZERO * float(np.nanmax(np.abs(values - zero))):
        one_sign = np.nanmin(values) >= 0 or np.nanmax(values) <= 0
        if one_sign and _both_ways(turned[np.isfinite(turned)]):
            why = f"{column} has one sign, though the servo turns both ways: the direction lacks"
            draft.doubt([name], "column", why, "none", column)
        return
    best = min((0.0, *ROUND), key=lambda one: abs(one - zero))
    draft.settle(name, offset=best)
    if abs(zero - best) > OFF_MIDDLE * best:
        why = f"{column} is {zero:.4g} where nothing drives"
        draft.doubt([name], "offset", why, f"{zero:.4g}", "0")
    else:
        draft.because("drive", f"{column} is {zero:.4g} at rest: {best:g} is taken off")


def _both_ways(angle: np.ndarray) -> bool:
    """Whether an angle (n,) goes back by more than a load's or a gear's give."""
    back = np.max(np.maximum.accumulate(angle) - angle, initial=0.0)
    forth = np.max(angle - np.minimum.accumulate(angle), initial=0.0)
    return bool(min(back, forth) > GIVE * max(back, forth))


def _unit(draft: Draft, names: list[str]) -> str:
    """The unit of the volts of these names, settled; in doubt where it is in no column's name and
    not in the range."""
    unit = next((draft.said[n]["unit"] for n in names if draft.is_said(n, "unit")), None)
    unit = unit or _likely_unit(draft, names)
    for name in names:
        draft.settle(name, unit=unit)
    return unit


def _likely_unit(draft: Draft, names: list[str]) -> str:
    """The unit by name and range; a doubt where they do not tell."""
    columns = {draft.signals[name]["column"]: draft.signals[name]["offset"] for name in names}
    hints = [draft.hints[column] for column in columns]
    most = max(float(np.nanmax(np.abs(draft.values(c) - zero))) for c, zero in columns.items())
    named = next((one.unit for one in hints if one.unit), None)
    role = hints[0].role
    kind = quantity(named or "")
    if named and kind == "voltage" and most * (factor(named, names[0]) or 1) <= MAX_VOLTS:
        return named
    if named and role == kind == "current":
        return named
    if any(columns.values()):  # full is as far from its rest as the code goes, whatever that is
        return "counts"
    parts = [f"1/{full:.0f}" if full > 1 else "1" for full in FULL_SCALES if most <= 1.001 * full]
    if named in ("1/100", "counts") or (named or "").startswith("1/"):
        return named or "counts"
    at_full = any(abs(most / full - 1) < NEAR_FULL for full in FULL_SCALES)
    if role == "voltage" and named is None and most <= MAX_VOLTS and not at_full and most > 1:
        return "V"
    options = ["A", "mA"] if role == "current" else ["V", "mV", *parts[:3]]
    if role == "share":
        options = parts[:3] or ["counts"]
    draft.doubt(names, "unit", f"{' and '.join(columns)} reach {most:.4g}: of what", *options)
    return options[0]


def settle_speeds(draft: Draft, theta: Mapping[str, str]) -> None:
    """Take speeds that are the angle's derivative; their sign and unit follow from that."""
    good = np.isfinite(draft.seconds)
    names = columns_of(draft, "speed")
    for axis, column in assign(draft, "speed", names).items() if len(names) <= 2 else ():
        angle = NAMES["theta"].format(axis)
        if axis not in theta or draft.hints[theta[axis]].role == "speed":
            continue
        key = draft.signals[angle]
        turned = key["sign"] * filled(draft.values(theta[axis]))[good]
        one = responses(draft.seconds[good], turned, [filled(draft.values(column))[good]], order=1)[
            0
        ]
        slope = abs(one.gain) * (factor(key["unit"], angle) or 0) if one else 0.0
        unit = next(
            (u for u, f in FACTORS["speed"].items() if f and abs(slope / f - 1) < SPEED_TOLERANCE),
            None,
        )
        if one is None or not one.sure or unit is None:
            draft.because("drive", f"{column} is left out: it is not the slope of {theta[axis]}")
            continue
        sign = 1 if one.gain > 0 else -1
        draft.settle(NAMES["speed"].format(axis), column=column, unit=unit, sign=sign, offset=0.0)


def _follower(draft: Draft, axis: str, column: str) -> str | None:
    """The measured angle of an axis that does little else than follow a column; None: it does not,
    or there is none."""
    angle = draft.signals.get(NAMES["theta"].format(axis), {}).get("column")
    if angle is None:
        return None
    good = np.isfinite(draft.seconds)
    cause = [filled(draft.values(column))[good]]
    one = responses(draft.seconds[good], motion(draft, str(angle))[good], cause, order=0)[0]
    return str(angle) if one is not None and one.share > FOLLOWS else None


def settle_targets(draft: Draft, ball: Mapping[str, str]) -> None:
    """Take targets in the ball's own unit; they are treated as the ball is."""
    names = columns_of(draft, "target")
    if len(names) > 2:
        named = [name for name in names if draft.hints[name].axis]
        names = named if len(named) == 2 else []
    for axis, column in assign(draft, "target", names).items():
        source = draft.signals.get(NAMES["ball"].format(axis))
        if axis not in ball or source is None:
            continue
        name = NAMES["target"].format(axis)
        if not draft.is_said(name, "column") and (angle := _follower(draft, axis, column)):
            why = f"{angle} follows {column}: a command ({NAMES['command'].format(axis)}.column)?"
            draft.doubt([name], "column", why, "none", column)
        unit = draft.hints[column].unit
        values, own = draft.values(column), draft.values(ball[axis])
        span = float(np.nanmax(own) - np.nanmin(own))
        reach = float(np.nanmax(np.abs(values - np.nanmedian(own))))
        if (unit is not None and unit != source.get("unit")) or reach > 1.5 * span:
            draft.because("rest", f"{column} is left out: not in the unit of {ball[axis]}")
            continue
        both = np.isfinite(values) & np.isfinite(own)
        if np.ptp(values[both]) > 0 and np.corrcoef(values[both], own[both])[0, 1] < 0:
            draft.because("rest", f"{column} is left out: the ball goes the other way")
            continue
        taken = {key: source[key] for key in ("unit", "sign", "offset", "scale") if key in source}
        draft.settle(name, column=column, **taken)
