"""Where the recording shows a ball: its columns settled, with what means `no ball` in them."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from experiments.importing.absent_ball import (
    absent_codes,
    alone_codes,
    condition_of,
    gone,
    held_rows,
    jumps,
    seen_rows,
)
from experiments.importing.draft import Draft
from experiments.importing.names import belongs, is_strange
from experiments.importing.roles import NAMES, columns_of

LIKELY = 0.6  # the cut-off (pcutoff) that DeepLabCut writes into every new project
SURELY = 1.2  # a detector's peak may be a little higher than that of the pictures it was taught
MOST_JUMPS = 0.0025  # chosen: of the steps; one place away, to and back, in 16 s at 50 Hz
MOST_LOST = 0.5  # chosen: of the rows, what a column may say that was lost
FEWER = 5.0  # times fewer jumps are left by a column that tells of them
OTHERWISE = {">": "<=", ">=": "<", "<": ">=", "<=": ">"}
MOST_UNLIKELY = 0.25  # chosen: of the rows; a ball is on the table in more


def settle_ball(draft: Draft, ball: Mapping[str, str]) -> dict[str, np.ndarray]:
    """The ball's coordinates (n,) by axis with NaN where there was none; settles their columns,
    and blanks them in the draft: what follows sees the ball alone."""
    names = [NAMES["ball"].format(axis) for axis in ball]
    columns, flags = _flagged(draft, ball, names)
    if not columns:
        return {}
    held = _held_rows(draft, names, columns)
    columns = _blanked(columns, gone(columns, held=held))
    codes = _codes(draft, names, columns, ball)
    columns = _blanked(columns, gone(columns, [(code,) for code in codes]))
    alone = [_alone(draft, *one) for one in zip(names, ball.values(), columns, strict=True)]
    columns = _blanked(columns, gone(columns, alone=alone))
    _doubt_jumps(draft, names, columns, ball, flags)
    seen = {}
    for i, (axis, column) in enumerate(ball.items()):
        sign = -1 if axis == "y" and draft.hints[column].unit == "px" else 1
        if "calibration" in draft.said.get("", {}):
            sign = 1
        keys = {"absent": codes[i : i + 1], "absent_alone": alone[i], "held_rows": held}
        draft.settle(names[i], column=column, **keys, seen=flags, sign=sign)
        seen[axis] = draft.signals[names[i]]["sign"] * columns[i]
    if all(np.isfinite(values).any() for values in columns):
        kept = dict(zip(ball.values(), columns, strict=True))
        draft.stream = replace(draft.stream, columns={**draft.stream.columns, **kept})
    return seen


def _doubt_jumps(
    draft: Draft,
    names: Sequence[str],
    columns: Sequence[np.ndarray],
    ball: Mapping[str, str],
    flags: Sequence[str],
) -> None:
    """Doubt places (n,) that jump as no ball does, whatever took them for one; the options are what
    another column says by which they would not. flags: the conditions that hold already."""
    share = jumps(columns, draft.seconds)
    asked = any(doubt.key == "seen" for doubt in draft.doubts)
    if asked or not share > MOST_JUMPS:
        return
    telling = []
    for name, values in draft.stream.columns.items():
        low = np.nanmin(values, initial=0.0)
        if name in ball.values() or name == draft.time.get("column") or low < 0:
            continue
        for condition in (f"{name} < 1", name):
            lost = ~seen_rows(draft.stream.columns, [condition])
            if not 0 < np.mean(lost) <= MOST_LOST:
                continue
            if jumps(_blanked(columns, lost), draft.seconds) <= min(MOST_JUMPS, share / FEWER):
                telling.append(",".join((*flags, condition)))
    told = f"the ball's place jumps as none can in {100 * share:.1f} % of its steps"
    why = f"{told}: which column says that it was lost (if none does, take those rows out)"
    draft.doubt(list(names), "seen", why, *telling[:4], "none")
    draft.because("ball", told)


def _blanked(columns: Sequence[np.ndarray], rows: np.ndarray) -> list[np.ndarray]:
    return [np.where(rows, np.nan, values) for values in columns]


def _flagged(
    draft: Draft, ball: Mapping[str, str], names: Sequence[str]
) -> tuple[list[np.ndarray], tuple[str, ...]]:
    """The ball's columns, NaN where another column says that there was none; the conditions under
    which there was one, as of `seen_rows`, by columns that bear a name for it, or as stated."""
    stated = [draft.said[name]["seen"] for name in names if draft.is_said(name, "seen")]
    flags = stated[0] if stated else _conditions(draft, ball, names) if ball else ()
    for flag in flags:
        draft.values(condition_of(flag)[0])
    lost = ~seen_rows(draft.stream.columns, flags)
    if flags and ball:
        which = " or ".join(map(_otherwise, flags))
        draft.because("ball", f"no ball where {which} ({_share(lost)} of the rows)")
    return _blanked([draft.values(column) for column in ball.values()], lost), flags


def _otherwise(condition: str) -> str:
    """What holds where a condition does not."""
    name, sign, limit = condition_of(condition)
    return f"{name} {OTHERWISE[sign]} {limit:g}" if sign else f"{name} is 0"


def _conditions(draft: Draft, ball: Mapping[str, str], names: Sequence[str]) -> tuple[str, ...]:
    """The conditions that names tell; a doubt of those that may be of another thing."""
    open_ = dict(_likely(draft, ball))
    told = [*_told(draft, ball), *open_]
    for condition in told:
        name = condition_of(condition)[0]
        if is_strange(name) and not belongs(name, ball.values()):
            open_[condition] = f"does {name} tell of the ball"
    lost = {one: ~seen_rows(draft.stream.columns, [one]) for one in told}
    told = [one for one in told if lost[one].any() or not open_.get(one)]
    if asked := [why for one, why in open_.items() if why and one in told]:
        sure = ",".join(one for one in told if not open_.get(one)) or "none"
        draft.doubt(list(names), "seen", "; ".join(asked), ",".join(told), sure)
    return tuple(told)


def _told(draft: Draft, ball: Mapping[str, str]) -> Iterator[str]:
    """Yield what flags say, and the size of what was seen where that may be 0."""
    yield from columns_of(draft, "seen")
    yield from (f"{flag} < 1" for flag in columns_of(draft, "unseen"))
    sizes = _of_the_ball(draft, "size", ball)
    yield from (size for size in sizes if np.any(draft.values(size) <= 0))


def _likely(draft: Draft, ball: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    """Yield what a detector's likelihoods say; why it is in doubt where it is no share, or rules
    out many rows, else ""."""
    for column in _of_the_ball(draft, "likelihood", ball):
        values = draft.values(column)
        low, high = np.nanmin(values), np.nanmax(values)
        per_cent = draft.hints[column].unit == "1/100"
        least = LIKELY * (100 if high > SURELY else 1)
        share = low >= 0 and high <= SURELY * (100 if per_cent else 1)
        sure = share and np.mean(~(values >= least)) <= MOST_UNLIKELY
        why = f"{column} runs from {low:g} to {high:g}: from where on is it the ball"
        yield f"{column} >= {least:g}", "" if sure else why


def _of_the_ball(draft: Draft, role: str, ball: Mapping[str, str]) -> list[str]:
    """Columns of a role that speak of the ball: by their names where some bear its own, else those
    that bear no other point's."""
    names = columns_of(draft, role)
    own = [name for name in names if belongs(name, ball.values())]
    others = [n for n, one in draft.hints.items() if one.axis and n not in (*ball.values(), *names)]
    return own or [name for name in names if not belongs(name, others)]


def _held_rows(draft: Draft, names: list[str], columns: list[np.ndarray]) -> int:
    """The rows from which on a place that stays is one that the detector holds; 0: none is."""
    said = [draft.said[name]["held_rows"] for name in names if draft.is_said(name, "held_rows")]
    if said:
        return max(said)
    held, sure = held_rows(columns, draft.seconds)
    what = f"places that stay for {held} rows or more"
    if not sure:
        draft.doubt(names, "held_rows", f"do {what} mean that the ball was lost", str(held), "0")
    elif held:
        share = _share(gone(columns, held=held) & ~gone(columns))
        draft.because("ball", f"{what} are held ones of a lost ball ({share} of the rows)")
    return held


def _codes(
    draft: Draft, names: list[str], columns: list[np.ndarray], ball: Mapping[str, str]
) -> tuple[float, ...]:
    """The value of each coordinate that means `no ball` where all have theirs; () for none."""
    if any(draft.is_said(name, "absent") for name in names):
        each = [draft.said.get(name, {}).get("absent", ()) for name in names]
        codes = tuple(one[0] for one in each if one)
        codes = codes if len(codes) == len(columns) else ()
        if codes and not _have(columns, codes).any():
            raise ValueError(f"absent = {codes}: no row of {', '.join(ball.values())} has it")
        return codes
    codes, sure = absent_codes(columns)
    said = ", ".join(f"{code:g}" for code in codes)
    for name, code in zip(names, codes, strict=False) if not sure else ():
        draft.doubt([name], "absent", f"does ({said}) mean `no ball`", repr(code), "none")
    if codes and sure:
        share = _share(_have(columns, codes))
        draft.because("ball", f"({said}) means no ball ({share} of the rows)")
    return codes


def _alone(draft: Draft, name: str, column: str, values: np.ndarray) -> tuple[float, ...]:
    """The values of a coordinate that mean `no ball` whatever the other one is."""
    if draft.is_said(name, "absent_alone"):
        return draft.said[name]["absent_alone"]
    sure, open_ = alone_codes(values, draft.seconds)
    if open_:
        options = (",".join(map(repr, (*sure, *open_))), ",".join(map(repr, sure)) or "none")
        why = f"does {_some(open_)} in {column} alone mean `no ball`"
        draft.doubt([name], "absent_alone", why, *options)
    if sure:
        share = _share(np.isin(values, sure))
        draft.because("ball", f"{_some(sure)} in {column} means no ball ({share} of the rows)")
    return (*sure, *open_)


def _have(columns: Sequence[np.ndarray], codes: Sequence[float]) -> np.ndarray:
    """Rows (n,) in which every coordinate has its code."""
    return np.all([c == k for c, k in zip(columns, codes, strict=True)], axis=0)


def _some(codes: Sequence[float]) -> str:
    more = f" and {len(codes) - 3} more" if len(codes) > 3 else ""
    return " or ".join(f"{code:g}" for code in codes[:3]) + more


def _share(rows: np.ndarray) -> str:
    return f"{100 * float(np.mean(rows)):.1f} %"
