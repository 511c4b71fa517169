"""Which angle tilts which axis, with which sign, and where it is level: by how the ball answers."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from experiments.importing.draft import Draft
from experiments.importing.relations import DELAYS_S, MIN_LEAD, Response, responses
from experiments.importing.roles import NAMES

LATE_S = 0.04  # chosen: two steps of DELAYS_S by which a measured angle comes after the ball
OTHER_SHARE = 1 / 3  # of the best cause's share; an axis that explains more might be the right one


@dataclass(frozen=True, eq=False)
class Answer:
    """How a ball's axis answers an angle's column."""

    axis: str
    column: str
    response: Response


def filled(values: np.ndarray) -> np.ndarray:
    """The last known value (n,) in place of blanks; NaN before the first."""
    at = np.maximum.accumulate(np.where(np.isfinite(values), np.arange(len(values)), 0))
    return values[at]


def motion(draft: Draft, column: str) -> np.ndarray:
    """What a column does as an angle: its values, or their integral where it is a speed."""
    values = filled(draft.values(column))
    if draft.hints[column].role != "speed":
        return values
    steps = np.diff(draft.seconds, prepend=draft.seconds[:1])
    return np.nancumsum(np.where(steps < 5.0, np.nan_to_num(values * steps), 0.0))


def answers(
    draft: Draft, ball: Mapping[str, np.ndarray], columns: Mapping[str, str]
) -> dict[str, dict[str, Response]]:
    """Response of every axis of the ball to every angle: axis -> column -> response."""
    good = np.isfinite(draft.seconds)
    causes = [motion(draft, column)[good] for column in columns.values()]
    found: dict[str, dict[str, Response]] = {}
    for axis, values in ball.items():
        known = draft.seconds[good], values[good]
        each = responses(*known, causes, order=2)
        *held, place = responses(*known, [*causes, values[good]], order=2)
        found[axis] = {
            column: _either(one, beside, place)
            for column, one, beside in zip(columns.values(), each, held, strict=True)
            if one is not None
        }
    return found


def _either(one: Response, held: Response | None, place: Response | None) -> Response:
    """A response, of either sign where the ball's place explains more than the angle beside it and
    held fixed turns its sign: a bowl draws the ball back by more than slow circles need, and the
    plate tilts against them."""
    if held is None or place is None or held.gain * one.gain > 0.0 or place.share <= held.share:
        return one
    return replace(one, low=min(one.low, -one.high), high=max(one.high, -one.low))


def followed(
    draft: Draft, theta: Mapping[str, str], columns: Mapping[str, str]
) -> dict[str, dict[str, Response]]:
    """Response of every measured angle (axis -> column, settled, with its sign) to every command:
    axis -> column -> response, where it is sure."""
    good = np.isfinite(draft.seconds)
    causes = [motion(draft, column)[good] for column in columns.values()]
    found: dict[str, dict[str, Response]] = {}
    for axis, measured in theta.items():
        turned = draft.signals[NAMES["theta"].format(axis)]["sign"] * motion(draft, measured)[good]
        each = responses(draft.seconds[good], turned, causes, order=0)
        named = zip(columns.values(), each, strict=True)
        found[axis] = {column: one for column, one in named if one is not None and one.sure}
    return found


def doubt_late_angles(
    draft: Draft, ball: Mapping[str, np.ndarray], columns: Mapping[str, str]
) -> None:
    """Doubt measured angles (axis -> column) that are told after the ball has answered them, as by
    a slow filter: what is judged by them comes out wrong."""
    good = np.isfinite(draft.seconds)
    both_s = np.concatenate((-DELAYS_S[:0:-1], DELAYS_S))
    for axis, column in columns.items():
        if axis not in ball:
            continue
        known = draft.seconds[good], ball[axis][good], [motion(draft, column)[good]]
        now, any_ = (responses(*known, order=2, delays_s=d)[0] for d in (DELAYS_S, both_s))
        if now is None or any_ is None or not any_.sure:
            continue
        if any_.delay_s <= -LATE_S and any_.share - now.share >= MIN_LEAD:
            why = f"the ball moves {-any_.delay_s:.2f} s before {column} tells it: leave that out"
            draft.doubt([NAMES["theta"].format(axis)], "column", why, "none", column)


def pair(
    draft: Draft,
    kind: str,
    columns: Mapping[str, str],
    found: Mapping[str, Mapping[str, Response]],
    angles: Mapping[str, Mapping[str, Response]],
) -> dict[str, Answer | None]:
    """Settle which of `columns` (axis by name -> column) is which axis of `kind`, and its sign.

    kind: theta or command; found: how the ball answers; angles: how measured angles follow
    commands (of `followed`). The angle that follows a command decides, then the ball, where they
    are sure; where neither is, pairing and signs are in doubt. Returns axis -> the ball's answer,
    None where it says nothing.
    """
    pattern = NAMES[kind]
    sure = {axis: clear_answer(each) for axis, each in found.items()}
    sure |= {axis: column for axis, each in angles.items() if (column := clear_answer(each))}
    chosen: dict[str, str] = dict(columns)
    for axis, column in sure.items():
        if column is None or draft.is_said(pattern.format(axis), "column"):
            continue
        other = "y" if axis == "x" else "x"
        if chosen.get(axis) != column and sure.get(other) != column:
            chosen = {axis: column}
            rest = [name for name in columns.values() if name != column]
            if rest:
                chosen[other] = rest[0]
            what = "measured angle" if angles.get(axis) else "ball"
            draft.because(
                "angle", f"{column} tilts {axis}, whatever its name: the {what} follows it"
            )
    said = any(draft.is_said(pattern.format(axis), "column") for axis in chosen)
    if len(chosen) == 2 and found and not said and not any(sure.values()):
        _open_pairing(draft, kind, chosen, found)
    out: dict[str, Answer | None] = {}
    for axis, column in chosen.items():
        name = pattern.format(axis)
        draft.settle(name, column=column)
        one, told = found.get(axis, {}).get(column), angles.get(axis, {}).get(column)
        seen = one is not None and one.sure and sure.get(axis) in (None, column)
        out[axis] = Answer(axis, column, one) if one is not None and seen else None
        decides = told or (one if seen else None)
        if decides is None:
            _open_sign(draft, name, axis, column, found)
            continue
        sign = 1 if decides.gain > 0 else -1
        draft.settle(name, sign=sign)
        if draft.signals[name]["sign"] != sign:
            draft.because("angle", f"sign of {column} as stated, against what follows it")
    return out


def _open_pairing(
    draft: Draft,
    kind: str,
    chosen: Mapping[str, str],
    found: Mapping[str, Mapping[str, Response]],
) -> None:
    """Nothing follows either angle clearly: which of them tilts an axis is asked of one axis with a
    ball. Names do not tell: a servo's, a motor's and an axis of rotation's may be either."""
    axis = next(iter(found))
    share = {c: each.share for c, each in found[axis].items()}
    told = " and ".join(f"{c} explains {100 * share.get(c, 0.0):.0f} %" for c in chosen.values())
    both = (chosen[axis], *(c for other, c in chosen.items() if other != axis))
    why = f"which angle moves the ball along {axis} ({told})"
    draft.doubt([NAMES[kind].format(axis)], "column", why, *both)


def _open_sign(
    draft: Draft, name: str, axis: str, column: str, found: Mapping[str, Mapping[str, Response]]
) -> None:
    """Nothing tells the sign of a column. Without a ball on its axis it can only be agreed; as long
    as some axis has a ball, it is asked for."""
    draft.settle(name, sign=1)
    if axis in found:
        one = found[axis].get(column)
        why = f"the ball does not tell the sign of {column} on axis {axis}{_weak(one)}"
        draft.doubt([name], "sign", why, "1", "-1")
    elif found:
        why = f"there is no ball on axis {axis} to tell the sign of {column}"
        draft.doubt([name], "sign", why, "1", "-1")


def clear_answer(each: Mapping[str, Response]) -> str | None:
    """The angle that this axis of the ball surely follows, and no other as much; None: open."""
    ranked = sorted(each, key=lambda column: -each[column].share)
    if not ranked or not each[ranked[0]].sure:
        return None
    best = each[ranked[0]].share
    return ranked[0] if all(each[c].share < OTHER_SHARE * best for c in ranked[1:]) else None


def _weak(one: Response | None) -> str:
    if one is None:
        return " (too little motion)"
    return f" (explains {100 * one.share:.0f} %, {one.windows:.0f} independent windows)"
