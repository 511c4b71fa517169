"""Turn a recording into logs by a map: one log a session. Pure: nothing is guessed here."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from experiments.importing.absent_ball import condition_of, gone, seen_rows
from experiments.importing.clock import read_clock
from experiments.importing.import_map import ImportMap, SignalMap
from experiments.importing.recording import (
    MIN_ROWS,
    BadFileError,
    Stream,
    Unreadable,
    numbers_only,
)
from experiments.importing.units import factor, family, part_of, quantity
from rig.log import Log

HELD = ("command", "voltage", "target", "push")  # a value holds until the next one
MOST_UNREADABLE = 0.01  # of a column's cells; chosen
BRIDGED_S = 0.1  # chosen: between two samples of an angle no further apart, a straight line


def convert(stream: Stream, made: ImportMap) -> list[Log]:
    """Logs of the sessions of a recording, in order; notes on what was left out are the logs'.

    BadFileError: a column is missing, more than 1 % of a column's cells are no numbers, no session
    has 20 rows, or no value is left.
    """
    for name, signal in made.signals.items():
        for column in (signal.column, *(condition_of(flag)[0] for flag in signal.seen)):
            if column not in stream.columns:
                there = ", ".join(list(stream.columns)[:12])
                raise BadFileError(f"no column {column!r} for {name}; there are {there}")
    unread = _unreadable(stream, made)
    stream = numbers_only(stream)
    clock = read_clock(stream, made.time)
    whole = _columns(stream, made)
    logs, short = [], 0
    for number in np.unique(clock.session):
        rows = np.flatnonzero((clock.session == number) & np.isfinite(clock.t_s))
        if len(rows) < MIN_ROWS:
            short += 1
            continue
        t_s = clock.t_s[rows]
        columns = {name: values[rows] for name, values in whole.items()}
        columns = _in_time(t_s, columns, made)
        notes = [*clock.notes, *unread, *([f"{short} short sessions left out"] if short else [])]
        if "ball_exposed_s" in columns:
            start = _start(stream, made, rows[0])
            columns["ball_exposed_s"] = columns["ball_exposed_s"] - start
        logs.append(Log.from_columns({"t_s": t_s - t_s[0], **columns}, notes=tuple(notes)))
    if not logs:
        raise BadFileError(f"no session has {MIN_ROWS} rows with a time")
    empty = [name for name in made.signals if not any(log.has(name) for log in logs)]
    if empty:
        raise BadFileError(f"no value is left of {', '.join(empty)}")
    return logs


def _unreadable(stream: Stream, made: ImportMap) -> list[str]:
    """Notes on cells of the mapped columns that are neither blank nor a number. BadFileError: more
    than MOST_UNREADABLE of a column are.

    Words in the ball's columns say that it was not seen.
    """
    notes = []
    for name, signal in made.signals.items():
        cells = stream.unreadable.get(signal.column, Unreadable())
        count = cells.digits if family(name) == "ball" else cells.count
        if not count:
            continue
        told = f"{count} of {len(stream)} cells of column '{signal.column}' are no numbers"
        if count > MOST_UNREADABLE * len(stream):
            raise BadFileError(f"{told} (the first: '{cells.first[:20]}'): mend or empty them")
        notes.append(f"{told}: taken as blank")
    return notes


def _start(stream: Stream, made: ImportMap, row: int) -> float:
    """Time [s] of a row on the recording's own clock, on which an exposure is stamped."""
    if made.time.column is None:
        raise BadFileError("ball_exposed_s needs a time column, on whose clock it is")
    return float(stream.columns[made.time.column][row]) * (factor(made.time.unit, "t_s") or 1.0)


def _columns(stream: Stream, made: ImportMap) -> dict[str, np.ndarray]:
    """Every mapped column (n,) in SI as far as no time is needed: speeds and currents come later.

    The ball is blank in every coordinate where it is blank in one.
    """
    raw = {name: stream.columns[one.column] for name, one in made.signals.items()}
    lost = _absent(raw, stream, made)
    if made.calibration is not None and "ball_x_m" in raw:
        balls = _by_camera(raw, made, lost)
    else:
        balls = {}
    out = {}
    for name, signal in made.signals.items():
        values = balls[name] if name in balls else _si(name, raw[name], signal)
        out[name] = np.where(lost, np.nan, values) if family(name) == "ball" else values
    return out


def _absent(raw: Mapping[str, np.ndarray], stream: Stream, made: ImportMap) -> np.ndarray:
    """Rows (n,) without a ball: as of `gone`, or a column says so."""
    balls = {name: one for name, one in made.signals.items() if family(name) == "ball"}
    if not balls:
        return np.zeros(len(stream), bool)
    signals = balls.values()
    out = gone(
        [raw[name] for name in balls],
        [one.absent for one in signals],
        [one.absent_alone for one in signals],
        max(one.held_rows for one in signals),
    )
    return out | ~seen_rows(stream.columns, {flag for one in signals for flag in one.seen})


def _si(name: str, values: np.ndarray, signal: SignalMap) -> np.ndarray:
    """sign * (value - offset) * scale * factor (n,); of px with a calibration nothing is done."""
    if name == "push":
        return signal.sign * (values - signal.offset)
    own = factor(signal.unit, name)
    times = (part_of(signal.unit) if own is None else own) * (signal.scale or 1.0)
    return signal.sign * (values - signal.offset) * times


def _by_camera(
    raw: Mapping[str, np.ndarray], made: ImportMap, lost: np.ndarray
) -> dict[str, np.ndarray]:
    """The ball's centre [m] on the level plate by the camera's calibration.

    BadFileError: one coordinate is missing, or the map changes pixels before they are looked up;
    ValueError, OSError: the calibration cannot be read.
    """
    from calibration.bundle import load

    both = ("ball_x_m", "ball_y_m")
    if any(name not in raw for name in both):
        raise BadFileError("a calibration needs both pixels: ball_x_m.column and ball_y_m.column")
    for name in both:
        one = made.signals[name]
        if one.unit != "px" or one.offset != 0 or one.scale is not None or one.sign != 1:
            raise BadFileError(
                f"{name}: with a calibration its unit is px, without scale, offset or sign"
            )
    path = Path(made.calibration or "")
    if not path.is_file():
        raise FileNotFoundError(f"calibration {path} does not exist")
    bundle = load(path)
    pixels = np.column_stack([raw[name] for name in both])
    xy = np.full(pixels.shape, np.nan)
    for row in np.flatnonzero(~lost):
        try:
            xy[row] = bundle.view.ball_from_silhouette(pixels[row], bundle.ball_radius_m)[0]
        except ValueError as error:
            raise BadFileError(f"row {row + 1}, pixel {pixels[row].tolist()}: {error}") from error
    return dict(zip(both, xy.T, strict=True))


def _in_time(
    t_s: np.ndarray, columns: Mapping[str, np.ndarray], made: ImportMap
) -> dict[str, np.ndarray]:
    """One session's columns: held or bridged over blanks, speeds integrated, currents to volts."""
    out: dict[str, np.ndarray] = {}
    for name, values in columns.items():
        kind, unit = family(name), made.signals[name].unit
        if kind in HELD:
            values = _held(values)
        elif kind in ("theta", "motor_speed"):
            values = _bridged(t_s, values)
        if kind in ("theta", "command") and quantity(unit) == "speed":
            values = _integral(t_s, values)
        out[name] = values
    for name in columns:
        signal = made.signals[name]
        if quantity(signal.unit) == "current":
            theta = out.get(name.replace("voltage", "theta").replace("_V", "_rad"))
            if theta is None:
                raise BadFileError(f"{name} from a current needs the angle of the same axis")
            speed = np.gradient(theta, t_s)
            ohm, emf = signal.resistance_ohm or 0.0, signal.back_emf_V_s_rad or 0.0
            out[name] = ohm * out[name] + emf * speed
    return out


def _held(values: np.ndarray) -> np.ndarray:
    """The last value before every blank; blanks before the first stay."""
    at = np.maximum.accumulate(np.where(np.isfinite(values), np.arange(len(values)), -1))
    return np.where(at >= 0, values[at], np.nan)


def _bridged(t_s: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Straight lines over holes of at most 0.1 s; longer ones stay blank."""
    known = np.flatnonzero(np.isfinite(values))
    if len(known) < 2 or len(known) == len(values):
        return values
    line = np.interp(t_s, t_s[known], values[known], left=np.nan, right=np.nan)
    after = np.clip(np.searchsorted(known, np.arange(len(values))), 1, len(known) - 1)
    short = t_s[known[after]] - t_s[known[after - 1]] <= BRIDGED_S
    return np.where(np.isfinite(values), values, np.where(short, line, np.nan))


def _integral(t_s: np.ndarray, speed: np.ndarray) -> np.ndarray:
    """Angle (n,) of a speed by the trapezoidal rule, 0 at the start; blanks count as still."""
    rate = np.nan_to_num(speed)
    return np.concatenate(([0.0], np.cumsum(np.diff(t_s) * (rate[1:] + rate[:-1]) / 2)))
