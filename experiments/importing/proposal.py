"""Propose a map for a recording: a pure function of its columns and of what was stated."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from experiments.importing.absent_ball import condition_of
from experiments.importing.ball import settle_ball
from experiments.importing.draft import Doubt, Draft, Proposal
from experiments.importing.drive import find_volts, settle_speeds, settle_targets, settle_volts
from experiments.importing.import_map import KINDS, SIGNALS, Stated
from experiments.importing.lone_servo import read_lone_servo
from experiments.importing.names import hints
from experiments.importing.plate_angle import doubt_plate_angle, refuse_turned, without_arms
from experiments.importing.recording import MIN_ROWS, BadFileError, Stream, numbers_only
from experiments.importing.roles import (
    NAMES,
    assign,
    columns_of,
    doubt_what_is_missing,
    find_ball,
    find_time,
)
from experiments.importing.scales import (
    MIDDLES,
    OFF_MIDDLE,
    settle_angle_zero,
    settle_ball_zero,
    settle_units,
)
from experiments.importing.signs import answers, clear_answer, doubt_late_angles, followed, pair
from experiments.importing.units import FACTORS, QUANTITIES, family
from rig.log import CONTRACT
from rig.log import NAMES as RECORDED

ASKED = ("kind", "column", "seen")  # before all else, as what else is open depends on them
ANGLES = ("angle", "theta", "command")  # places of doubts about them
JUMP_RAD_S = 25.0  # no servo turns faster: what jumps like that was commanded
LATE_S = 0.06  # chosen: a servo's lag and dead time are longer, a camera's delay mostly shorter
MOST_NAMELESS = 8  # chosen: more are a program's inner values, of which one may look like any other
LEAD_S = 0.02  # by which the ball must answer a command later than the angle itself


def propose(stream: Stream, said: Stated | None = None) -> Proposal:
    """Propose a map for the columns of `stream`; `said` (as of `import_map.stated`) is certain.

    BadFileError: nothing in it can be compared with anything. ValueError: what was stated does
    not fit the file, or no column is one axis' angle.
    """
    if len(stream) < MIN_ROWS:
        rows = f"{len(stream)} row{'s' if len(stream) > 1 else ''}"
        raise BadFileError(f"it has {rows} of numbers (limit: at least {MIN_ROWS}): record longer")
    stream = numbers_only(stream)
    said, stream = _by_own_names(stream, said or {})
    draft = Draft(stream, hints(stream.columns, stream.units), said)
    for keys in said.values():
        if keys.get("column") not in (None, "none"):
            draft.values(keys["column"])
    find_time(draft)
    if len(draft.seconds) == 0:
        return _proposal(draft)
    read_lone_servo(draft)
    ball = find_ball(draft)
    volts = find_volts(draft)
    seen = settle_ball(draft, ball)
    kinds = _angles(draft, bool(volts), seen)
    angles = {f"{kind} {axis}": name for kind, each in kinds.items() for axis, name in each.items()}
    doubt_what_is_missing(draft, ball, angles, volts)
    for kind, columns in kinds.items():
        found = answers(draft, seen, columns)
        refuse_turned(draft, found, columns)
        angles = followed(draft, kinds["theta"], columns) if kind != "theta" in kinds else {}
        answered = pair(draft, kind, columns, found, angles)
        paired = {axis: draft.signals[NAMES[kind].format(axis)]["column"] for axis in answered}
        if kind == "theta":
            doubt_late_angles(draft, seen, paired)
        settle_units(draft, ball, kind, paired, answered, angles)
        settle_angle_zero(draft, kind, answered)
        doubt_plate_angle(draft, angles, kinds.get("theta", {}), paired)
        kinds[kind] = paired
    if not kinds and not any(doubt.place.startswith(ANGLES) for doubt in draft.doubts):
        settle_units(draft, ball, "command", {}, {}, {})
    settle_ball_zero(draft, ball, seen)
    theta = kinds.get("theta", {})
    if volts and theta:
        settle_volts(draft, volts, theta)
    if theta:
        settle_speeds(draft, theta)
    settle_targets(draft, ball)
    return _proposal(draft)


def _by_own_names(stream: Stream, said: Stated) -> tuple[Stated, Stream]:
    """What the log's own names say, where one of them is the clock: which columns are the log's.

    Units and signs are still asked of the data. What our runs record besides is left out, unless
    it was stated.
    """
    if "t_s" not in stream.columns:
        return said, stream
    beside = {*RECORDED} - {*CONTRACT} - {keys.get("column") for keys in said.values()}
    kept = {key: values for key, values in stream.columns.items() if key not in beside}
    own = {k for k in SIGNALS if k in kept and np.isfinite(kept[k]).any()}
    named = {k: {"column": k, **said.get(k, {})} for k in SIGNALS if k in own}
    return {**said, **named}, replace(stream, columns=kept)


def _rank(doubt: Doubt) -> tuple[bool, bool, int]:
    """Which doubts are asked first: the keys ASKED, of the ball before what it tells."""
    first = doubt.key in ASKED
    return not first, first and family(doubt.place) != "ball", [*ASKED, doubt.key].index(doubt.key)


def _proposal(draft: Draft) -> Proposal:
    """What was found; signals that were stated in full are taken as they are."""
    for name, keys in draft.said.items():
        if (
            name in SIGNALS
            and name not in draft.signals
            and keys.get("column") not in (None, "none")
        ):
            unit = {"push": "1", "ball_exposed_s": "s"}.get(name)
            draft.signals[name] = {**({"unit": unit} if unit else {}), **keys}
            if unit is None:
                usual = (u for q in QUANTITIES[family(name)] for u in FACTORS[q])
                why = f"the unit of {keys['column']} is not told by anything beside it"
                draft.doubt([name], "unit", why, *usual)
    used = {keys["column"] for keys in draft.signals.values()}
    each = (flag for keys in draft.signals.values() for flag in keys.get("seen", ()))
    used |= {condition_of(flag)[0] for flag in each}
    used |= {draft.time.get("column"), draft.time.get("session")}
    data = {
        "time": {key: value for key, value in draft.time.items() if value is not None},
        "signals": {name: draft.signals[name] for name in SIGNALS if name in draft.signals},
        "calibration": draft.said.get("", {}).get("calibration"),
    }
    return Proposal(
        data,
        tuple(sorted(draft.doubts, key=_rank)),
        {line: tuple(texts) for line, texts in draft.reasons.items()},
        tuple(name for name in draft.stream.columns if name not in used),
    )


def _angles(
    draft: Draft, driven: bool, ball: Mapping[str, np.ndarray]
) -> dict[str, dict[str, str]]:
    """Columns of the angles by kind (theta, command) and axis; doubts where the kind is open."""
    named = {role: columns_of(draft, role) for role in ("theta", "command", "angle")}
    named = without_arms(draft, named)
    theta, command = (_with_partner(draft, role, named) for role in ("theta", "command"))
    has_theta, has_command = bool(theta or named["theta"]), bool(command or named["command"])
    free = [c for c in named["angle"] if c not in (*theta.values(), *command.values())]
    beside = has_theta + has_command
    if free and (beside == 2 or (beside == 1 and len(free) > 2)):
        draft.because("rest", f"{', '.join(free)}: an angle beside the named ones, left out")
    elif free and driven and not has_theta:
        theta = assign(draft, "theta", free)  # what a motor's volts turn was measured
    elif free and (theta or command):
        # beside a command stands what was reached, which the ball answers sooner; and vice versa
        role, known = ("command", theta) if theta else ("theta", command)
        other = next(iter(known.values()))
        pair_of = (other, free[0]) if role == "command" else (free[0], other)
        if not _earlier(draft, ball, *pair_of):
            name = NAMES[role].format("x")
            what = "commanded" if role == "command" else "measured"
            draft.doubt([name], "column", f"is {free[0]} the {what} angle", free[0], "none")
        if role == "theta":
            theta = assign(draft, "theta", free)
        elif not driven:
            command = assign(draft, "command", free)
    elif free and not beside:
        theta, command = _of_open_kind(draft, free, ball)
    if not free and not beside:
        theta = assign(draft, "theta", columns_of(draft, "speed")) or _stated_speeds(draft)
        if not theta and not driven and (free := _followed_by(draft, ball)):
            theta, command = _of_open_kind(draft, free, ball)
    if driven and command and theta:
        draft.because("rest", f"{', '.join(command.values())}: asked of an inner loop, left out")
        command = {}
    return {kind: c for kind, c in (("theta", theta), ("command", command)) if c}


def _stated_speeds(draft: Draft) -> dict[str, str]:
    """Axis -> column of the speeds that were stated, whose integrals are the only angles."""
    found = {}
    for axis in "xy":
        keys = draft.said.get(NAMES["speed"].format(axis), {})
        column = str(keys.get("column"))
        if column in draft.stream.columns:
            known = draft.hints[column].unit
            unit = keys.get("unit") or (known if known in FACTORS["speed"] else "rad/s")
            one = replace(draft.hints[column], role="speed", unit=unit)
            found[axis], draft.hints = column, {**draft.hints, column: one}
    return found


def _with_partner(draft: Draft, role: str, named: Mapping[str, list[str]]) -> dict[str, str]:
    """Axis -> column of a role; one stated column of open kind takes the other axis' with it."""
    found = assign(draft, role, named[role])
    if [draft.hints[column].role for column in found.values()] != ["angle"]:
        return found
    axis = draft.hints[next(iter(found.values()))].axis
    others = [c for c in named["angle"] if axis is None or draft.hints[c].axis != axis]
    return assign(draft, role, others)


def _followed_by(draft: Draft, ball: Mapping[str, np.ndarray]) -> list[str]:
    """Columns that no name explains and that the ball follows, one an axis: its angles."""
    nameless = columns_of(draft, None)
    if not ball or not len(ball) <= len(nameless) <= MOST_NAMELESS:
        return []
    found = answers(draft, ball, {column: column for column in nameless})
    best = [clear_answer(each) for each in found.values()]
    if None in best or len(set(best)) < len(best):
        return []
    draft.because("angle", f"{' and '.join(map(str, best))}: the ball follows them")
    return [column for column in nameless if column in best]


def _of_open_kind(
    draft: Draft, free: list[str], ball: Mapping[str, np.ndarray]
) -> tuple[dict[str, str], dict[str, str]]:
    """Measured and commanded angles (axis -> column) of columns that are all there is."""
    kind = draft.said.get("angle", {}).get("kind") or _lone_kind(draft, free, ball)
    if kind is None:
        why = f"the names do not say if {' and '.join(free)} were commanded or measured"
        draft.doubts.append(Doubt("angle", "kind", why, KINDS))
    if kind == "measured":
        return assign(draft, "theta", free), {}
    return {}, assign(draft, "command", free)


def _earlier(draft: Draft, ball: Mapping[str, np.ndarray], sooner: str, later: str) -> bool:
    """Whether the ball surely answers one angle sooner than the other: then it is the servo's."""
    first, last = (_delay_s(draft, ball, column) for column in (sooner, later))
    return first is not None and last is not None and last - first >= LEAD_S


def _delay_s(draft: Draft, ball: Mapping[str, np.ndarray], column: str) -> float | None:
    """How much later the ball answers an angle; None where it surely does not."""
    each = [one[column] for one in answers(draft, ball, {"x": column}).values() if one]
    best = max(each, key=lambda one: one.share, default=None)
    return best.delay_s if best is not None and best.sure else None


def _lone_kind(draft: Draft, free: list[str], ball: Mapping[str, np.ndarray]) -> str | None:
    """Commanded, if an angle that is named in degrees or radians jumps as no servo can, or if all
    are a hobby servo's whole degrees that the ball answers late."""
    delays = [_delay_s(draft, ball, column) for column in free if _hobby_servos(draft, column)]
    if len(delays) == len(free) and all(one is not None and one >= LATE_S for one in delays):
        return "commanded"
    for column in free:
        si = FACTORS["angle"].get(draft.hints[column].unit or "")
        if si is None:
            return None
        good = np.isfinite(draft.seconds) & np.isfinite(draft.values(column))
        speed = np.abs(np.diff(draft.values(column)[good])) / np.diff(draft.seconds[good])
        if float(np.quantile(speed, 0.999)) * si > JUMP_RAD_S:
            return "commanded"
    return None


def _hobby_servos(draft: Draft, column: str) -> bool:
    """Whether a column is in whole degrees about 90, as hobby servos' programs tell them."""
    values = draft.values(column)
    values = values[np.isfinite(values)]
    middle, low, high = MIDDLES["deg"]
    near = abs(float(np.median(values)) - middle) <= OFF_MIDDLE * middle
    inside = low <= values.min() and values.max() <= high
    unit = draft.hints[column].unit in ("deg", None)
    return bool(unit and near and inside and np.all(values % 1 == 0))
