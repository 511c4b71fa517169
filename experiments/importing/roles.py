"""Which columns are the time, the ball, the angles, the drive: by names, units and the clock."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from experiments.importing.clock import coarse, read_clock, written_twice
from experiments.importing.draft import Draft
from experiments.importing.import_map import time_map
from experiments.importing.names import FLAGS, TELLING, Hint, belongs
from experiments.importing.recording import MIN_ROWS, BadFileError
from experiments.importing.units import FACTORS, factor, is_time

STEPS_S = (2e-4, 0.25)  # between rows: faster than any such table is read, slower than one can be
MAX_STRAY = 0.2  # chosen: of the usual step, the median stray of a nameless clock's steps
COARSEST = 1 / 1000  # of rows, those with a new stamp of whole seconds; chosen: at 1 kHz
# Of rows, those with a new stamp: of clocks by name one that most rows move goes before one that
# stands still for up to 50 of them, as of whole seconds at 50 Hz; chosen.
FINE, RENEWED = 0.5, 0.02
MIN_GROWING = 0.95  # share of steps forwards from which a column may be a clock
OPEN = (None, "ball", "target", "other")  # of a column, where somebody said that it is an angle
NO_PLACES = ("other", "target")  # a column of errors, say, follows the ball the other way round
NAMES = {
    "ball": "ball_{}_m",
    "target": "target_{}_m",
    "theta": "theta_{}_rad",
    "command": "command_{}_rad",
    "voltage": "voltage_{}_V",
    "speed": "motor_speed_{}_rad_s",
}


def find_time(draft: Draft) -> None:
    """Settle where the time comes from and in which unit; doubt what is open."""
    said: dict[str, Any] = {"session": draft.stream.session or _session_column(draft)}
    said |= draft.said.get("time", {})
    said["session"] = None if said["session"] == "none" else said["session"]
    if "rate_hz" in said:
        draft.time = dict(said)
        time_map(draft.time)
        draft.because("time", f"rows every {1000 / said['rate_hz']:.4g} ms, as stated")
    else:
        column = said.get("column") or draft.stream.time or _time_column(draft)
        if column is None:
            named = [name for name, hint in draft.hints.items() if hint.role == "time"]
            why = "no column is a clock (or state time.column)"
            if named:
                why = f"{named[0]} is a time by its name, but does not grow (sort the rows)"
            draft.doubt(["time"], "rate_hz", why)
            return
        draft.time = {"column": column, **said}
        if "unit" not in said:
            _time_unit(draft, column)
    if "unit" not in draft.time and "rate_hz" not in draft.time:
        return
    _clock(draft)


def _clock(draft: Draft) -> None:
    """Read the seconds; find out whether the stamps are coarser than the rows."""
    draft.values(draft.time["column"]) if draft.time.get("column") else None
    if "clock" not in draft.time and draft.time.get("column"):
        times = time_map({**draft.time, "clock": "even"})
        raw = draft.values(draft.time["column"]) * (factor(times.unit, "t_s") or 1.0)
        session = read_clock(draft.stream, times).session
        parts = [raw[(session == number) & np.isfinite(raw)] for number in np.unique(session)]
        same = np.diff(raw, prepend=np.nan) == 0
        twice = np.all(written_twice(draft.stream)[same])  # then the stamps are no coarser
        if (
            parts
            and not twice
            and all(coarse(part) for part in parts if len(part) > 20)
            and coarse(parts[0])
        ):
            draft.time["clock"] = "even"
            draft.because("time", "stamps are coarser than the rows: spread evenly")
    clock = read_clock(draft.stream, time_map(draft.time))
    draft.seconds = clock.unrolled
    for note in clock.notes:
        draft.because("time", note)


def _time_column(draft: Draft) -> str | None:
    """The column that is the time: by name (the finest first), by unit, the first that grows like a
    clock, that of a stated rate, or at last one of whole seconds."""
    by_rate = draft.stream.by_rate
    columns = {name: v for name, v in draft.stream.columns.items() if name != by_rate}
    named = [n for n, v in columns.items() if draft.hints[n].role == "time" and _grows(v, COARSEST)]
    growing = [name for name, values in columns.items() if _grows(values)]
    fine = [n for often in (FINE, RENEWED) for n in named if _grows(columns[n], often)]
    if fine:
        return fine[0]
    by_unit = [name for name in growing if is_time(draft.hints[name].unit)]
    by_unit = [name for name in by_unit if _even(draft.stream.columns[name])]
    if by_unit:
        return by_unit[0]
    nameless = [name for name in growing if draft.hints[name].role is None]
    nameless = [
        name
        for name in nameless
        if not _counts(draft.stream.columns[name]) and _even(draft.stream.columns[name])
    ]
    return next(iter(nameless), by_rate or next(iter(named), None))


def _session_column(draft: Draft) -> str | None:
    """The column that numbers the sessions: by its name, and whole numbers that seldom change."""
    for name, values in draft.stream.columns.items():
        numbers = np.all(values % 1 == 0) and np.all(np.diff(values) >= 0)  # a flag comes and goes
        if draft.hints[name].role == "session" and numbers:
            changes = np.flatnonzero(np.diff(values)) + 1
            rows = np.diff(np.concatenate(([0], changes, [len(values)])))
            if len(changes) and np.min(rows) >= MIN_ROWS:
                draft.because("time", f"another {name} is another session")
                return name
    return None


def _grows(values: np.ndarray, often: float = RENEWED) -> bool:
    """Whether a column (n,) grows, in more than a share of its steps."""
    values = values[np.isfinite(values)]
    if len(values) < 3:
        return False
    steps = np.diff(values)
    return bool(np.mean(steps >= 0) >= MIN_GROWING and np.mean(steps > 0) > often)


def _even(values: np.ndarray) -> bool:
    """Whether it grows by steps as even as a clock's: a ball is quicker and slower by turns."""
    steps = np.diff(values[np.isfinite(values)])
    usual = float(np.median(steps))
    return usual > 0 and float(np.median(np.abs(steps - usual))) <= MAX_STRAY * usual


def _counts(values: np.ndarray) -> bool:
    """Whether it is a number of the row, not a time."""
    return bool(np.mean(np.diff(values) == 1) > 0.9)


def _time_unit(draft: Draft, column: str) -> None:
    """The unit by name where the steps allow it, else the one that the steps allow."""
    steps = np.diff(draft.values(column))
    steps = steps[steps >= 0]  # stamps coarser than the rows stand several times
    usual = (
        min(float(np.mean(steps)), float(np.median(steps[steps > 0]))) if any(steps > 0) else 0.0
    )
    units = {u: f for u, f in FACTORS["time"].items() if f is not None and u != "min"}
    fitting = [u for u, f in units.items() if STEPS_S[0] <= usual * f <= STEPS_S[1]]
    named = draft.hints[column].unit or ""
    own = factor(named, "t_s") if is_time(named) else None
    if own and (named == "min" or STEPS_S[0] <= usual * own <= STEPS_S[1]):
        draft.time["unit"] = named
    elif own:
        draft.time["unit"] = named
        draft.doubt(
            ["time"],
            "unit",
            f"{column} says {named}, but its rows are {usual:.4g} apart",
            *fitting,
        )
        draft.time["unit"] = fitting[0] if fitting else named
    elif len(fitting) == 1:
        draft.time["unit"] = fitting[0]
        draft.because("time", f"in {fitting[0]}: rows are {usual:.4g} apart")
    else:
        why = f"the unit of {column} is open (its rows are {usual:.4g} apart)"
        draft.doubt(["time"], "unit", why, *(fitting or units))


def columns_of(draft: Draft, role: str | None) -> list[str]:
    """Columns that names and units give a role (None: none), in the order of the file.

    Constants are none, but for those that say of every row that there was a ball: in another file
    of the same program they may not. Nor is what was stated to be something, nor a flag of 0 and 1
    unless one is asked for, and of seen and unseen nothing else.
    """
    taken = {keys.get("column") for keys in draft.said.values()} | {draft.time.get("column")}
    return [
        name
        for name, one in draft.hints.items()
        if one.role == role
        and name not in taken
        and (_changes(draft, name) or _says_seen(role, draft.values(name)))
        and (role in TELLING if is_flag(draft.values(name)) else role not in FLAGS)
    ]


def is_flag(values: np.ndarray) -> bool:
    """Whether a column (n,) says yes or no: 0 and 1, nothing else."""
    return set(values[np.isfinite(values)]) <= {0.0, 1.0}


def _says_seen(role: str | None, values: np.ndarray) -> bool:
    """Whether a column (n,) that tells of the ball says of every row that there was one."""
    return role in TELLING and bool(np.all((values < 1) if role == "unseen" else (values > 0)))


def _changes(draft: Draft, name: str) -> bool:
    values = draft.stream.columns[name]
    values = values[np.isfinite(values)]
    return len(values) > 2 and bool(np.ptp(values) > 0)


def by_axis(names: Sequence[str], hints: Mapping[str, Hint]) -> tuple[dict[str, str], list[str]]:
    """Axis -> column of at most two columns, by their names or else in their order; and the rest.

    The rest is not empty where there are more than two, or two of one axis.
    """
    axes = [hints[name].axis for name in names]
    if len(names) == 1:
        return {axes[0] or "x": names[0]}, []
    if len(names) == 2:
        if set(axes) == {"x", "y"}:
            return {axis: name for axis, name in zip(axes, names, strict=True) if axis}, []
        if len(set(axes)) == 2 or axes == [None, None]:
            return dict(zip("xy", names, strict=True)), []
    return {}, list(names)


def assign(draft: Draft, role: str, names: Sequence[str]) -> dict[str, str]:
    """Axis -> column of a role, what was stated first; a doubt where several could be meant."""
    pattern = NAMES[role]
    said = {
        axis: draft.said[pattern.format(axis)]["column"]
        for axis in "xy"
        if draft.is_said(pattern.format(axis), "column")
    }
    found, rest = ({}, list(names)) if said else by_axis(names, draft.hints)
    for axis in "xy" if rest else ():
        if axis in said:
            continue
        fits = [name for name in rest if draft.hints[name].axis in (axis, None)] or rest
        if len(fits) == 1:
            found[axis] = fits[0]
        else:
            why = f"{len(fits)} columns could be {pattern.format(axis)}"
            draft.doubt([pattern.format(axis)], "column", why, *fits[:6], "none")
    return {**found, **{axis: column for axis, column in said.items() if column != "none"}}


def find_ball(draft: Draft) -> dict[str, str]:
    """Axis -> column of the ball: as measured rather than filtered."""
    names = columns_of(draft, "ball")
    raw = [name for name in names if not draft.hints[name].derived]
    if raw and len(raw) < len(names):
        draft.because("ball", "filtered or estimated columns are left out")
    names = raw or names
    explicit = [name for name in names if draft.hints[name].explicit]
    if explicit and len(names) > 2:
        names = explicit
    metric = [name for name in names if draft.hints[name].unit not in (None, "px")]
    if len(names) > 2 and metric:
        names = metric
    if names and not raw:
        draft.because("ball", "only filtered positions are there: the filter's delay is in them")
    return assign(draft, "ball", names)


def doubt_what_is_missing(
    draft: Draft, ball: Mapping[str, str], angles: Mapping[str, str], volts: Mapping[str, str]
) -> None:
    """Doubt the columns without which nothing could be compared with anything.

    BadFileError: there are too few columns for that, whatever they are.
    """
    kinds = {name.split()[0] for name in angles}
    drives = volts if "theta" in kinds else {}  # volts say nothing without what they turn
    taken = {draft.time.get("column"), draft.time.get("session"), *drives.values()}
    taken |= {*ball.values(), *angles.values()}
    free = [
        name
        for name, values in draft.stream.columns.items()
        if name not in taken and _changes(draft, name) and not is_flag(values)
    ]
    unknown = [name for name in free if draft.hints[name].role is None]
    said = any(draft.is_said(f"ball_{axis}_m", "column") for axis in "xy")
    servo = bool(drives) or len(kinds) > 1  # that can be compared without a ball
    if not ball and not said and (unknown or not servo):
        if not free:
            still = [name for name in draft.stream.columns if not _changes(draft, name)]
            never = f" ({', '.join(still[:4])} never changes)" if still else ""
            raise BadFileError(
                f"no column can be the ball's place: none is left that changes{never}"
            )
        places = [name for name in free if draft.hints[name].role not in NO_PLACES]
        if not unknown and not places:
            raise BadFileError(
                f"no column can be the ball's place: {', '.join(free[:4])} are none by their "
                "names; a log needs it (--set ball_x_m.column=NAME, if one is)"
            )
        options = [*(unknown or places)[:8], *(["none"] if servo else [])]
        why = "no column is the ball's place by its name"
        draft.doubt(["ball_x_m"], "column", why, *options)
    elif len(ball) == 1 and (able := [n for n in free if belongs(n, ball.values())] + unknown):
        other = "ball_y_m" if "x" in ball else "ball_x_m"
        draft.doubt([other], "column", "the ball's other coordinate is open", *able[:8], "none")
    asked = any(doubt.place.startswith(("theta", "command")) for doubt in draft.doubts)
    if not angles and not asked:
        if not free:
            raise BadFileError(
                "no column can be an angle: none is left that changes; a log needs the servos' "
                "angles, commanded or measured (--set command_x_rad.column=NAME, or theta_x_rad)"
            )
        why = "no column is an angle by its name (commanded: command_x_rad, measured: theta_x_rad)"
        draft.doubt(["command_x_rad"], "column", why, *free[:8])
    elif len(ball) == 2 and [draft.hints[name].role in OPEN for name in angles.values()] == [True]:
        (one,) = angles
        other = NAMES[one[:-2]].format("y" if one.endswith("x") else "x")
        draft.doubt([other], "column", "the other axis' angle is open", *free[:8], "none")
