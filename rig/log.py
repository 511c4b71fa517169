"""A log in memory: one row a control tick, one column a signal; the names are the CSV contract.

`COLUMNS` is the one ordered list of names, units and meanings: the loop fills rows in its order,
recordings derive their schema from it, exports and imports use its names. New columns go to the
end (a recording's field numbers follow the order).
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np


class Column(NamedTuple):
    """One column of a log: `name` (with its unit), `unit` ("1": a number) and what it means."""

    name: str
    unit: str
    meaning: str


OTHER_CLOCK_S = 60.0  # chosen: no camera is as late


class Phase(IntEnum):
    """What the run was doing in a row, as stored in the column `phase`."""

    PLACE = 0
    HOLD = 1
    RUN = 2


def _by_axis(name: str, unit: str, meaning: str) -> Iterator[Column]:
    """Yield the x and the y column of a signal; `{a}` in name and meaning is the axis."""
    for axis in "xy":
        yield Column(name.format(a=axis), unit, meaning.format(a=axis))


COLUMNS: tuple[Column, ...] = (
    Column("t_s", "s", "time of the tick, when theta is read; seconds from the run's start"),
    *_by_axis("voltage_{a}_V", "V", "applied at motor {a} from this row to the next, after limits"),
    *_by_axis("theta_{a}_rad", "rad", "servo angle {a} at t_s, zero = plate level after homing"),
    *_by_axis("ball_{a}_m", "m", "ball centre, plate frame, {a}; blank without a new observation"),
    *_by_axis("motor_speed_{a}_rad_s", "rad/s", "speed of motor {a} by its tachometer"),
    *_by_axis("target_{a}_m", "m", "where the ball should be, {a}"),
    Column("push", "1", "not 0 while the ball is pushed"),
    Column("ball_exposed_s", "s", "when the light of this row's observation hit the sensor"),
    *_by_axis("wanted_voltage_{a}_V", "V", "what the controller asked of motor {a}, before limits"),
    *_by_axis("desired_theta_{a}_rad", "rad", "servo angle {a} that the outer loop asks for"),
    *_by_axis("estimated_gear_play_{a}_rad", "rad", "estimated full play motor to encoder, {a}"),
    *_by_axis("estimated_gear_play_std_{a}_rad", "rad", "standard deviation of that play, {a}"),
    *_by_axis("estimated_joint_play_{a}_rad", "rad", "estimated full play encoder to plate, {a}"),
    *_by_axis("estimated_joint_play_std_{a}_rad", "rad", "standard deviation of that play, {a}"),
    *_by_axis("estimated_torque_{a}_Nm", "N m", "estimated shaft torque, {a}"),
    Column("ball_cov_xx_m2", "m2", "variance of this row's observation in x"),
    Column("ball_cov_xy_m2", "m2", "covariance of this row's observation"),
    Column("ball_cov_yy_m2", "m2", "variance of this row's observation in y"),
    Column("phase", "1", "0 place, 1 hold, 2 run"),
    *_by_axis("command_{a}_rad", "rad", "angle told to position servo {a}, from here to next row"),
)
NAMES: tuple[str, ...] = tuple(column.name for column in COLUMNS)
INDEX: dict[str, int] = {name: i for i, name in enumerate(NAMES)}
COMMANDS: tuple[str, ...] = ("command_x_rad", "command_y_rad")
"""What a table with position servos is told, beside or in place of volts."""
CONTRACT: tuple[str, ...] = (*NAMES[: INDEX["ball_exposed_s"] + 1], *COMMANDS)
"""The columns of the CSV contract; the others are what our own runs record besides."""


@dataclass(frozen=True, eq=False)
class Log:
    """One row a control tick; every column of `COLUMNS` is there, NaN where blank or missing.

    `rows` (n, len(COLUMNS)) float64, read-only; `notes`: what an import left out or found odd.
    """

    rows: np.ndarray
    notes: tuple[str, ...] = ()

    @classmethod
    def from_rows(cls, rows: np.ndarray, *, notes: tuple[str, ...] = ()) -> "Log":
        """Return a log with a copy of `rows` (n, len(COLUMNS)), in the order of `COLUMNS`; notes:
        see `Log`. ValueError: another shape.
        """
        rows = np.array(rows, dtype=np.float64, order="F")  # columns contiguous
        if rows.ndim != 2 or rows.shape[1] != len(COLUMNS):
            raise ValueError(
                f"rows of a log have shape (n, {len(COLUMNS)}), these have {rows.shape}: "
                "order them as rig.log.COLUMNS"
            )
        rows.flags.writeable = False
        return cls(rows, notes)

    @classmethod
    def from_columns(
        cls, columns: Mapping[str, np.ndarray], *, notes: tuple[str, ...] = ()
    ) -> "Log":
        """Return a log of `columns` (name -> (n,)); missing ones are NaN. notes: see `Log`.

        ValueError: an unknown name, no column at all, or lengths that differ.
        """
        unknown = [name for name in columns if name not in INDEX]
        if unknown:
            raise ValueError(f"unknown columns {', '.join(unknown)}; known: {', '.join(NAMES)}")
        lengths = {name: np.asarray(values).shape for name, values in columns.items()}
        if len(set(lengths.values())) != 1 or len(next(iter(lengths.values()))) != 1:
            raise ValueError(f"columns of a log have one length (n,), these have {lengths}")
        rows = np.full((next(iter(lengths.values()))[0], len(COLUMNS)), np.nan, order="F")
        for name, values in columns.items():
            rows[:, INDEX[name]] = values
        rows.flags.writeable = False
        return cls(rows, notes)

    @property
    def columns(self) -> dict[str, np.ndarray]:
        """Every column by name: (n,) float64 views of `rows`, NaN where blank."""
        return {name: self.rows[:, i] for i, name in enumerate(NAMES)}

    def __getitem__(self, name: str) -> np.ndarray:
        """Return the column `name` (n,). KeyError: not in `COLUMNS`."""
        if name not in INDEX:
            raise KeyError(f"no column {name!r} in a log; known: {', '.join(NAMES)}")
        return self.rows[:, INDEX[name]]

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.rows)

    def has(self, *names: str) -> bool:
        """Tell whether each of the columns `names` holds at least one number.

        KeyError: a name that is not in `COLUMNS`.
        """
        return all(not np.isnan(self[name]).all() for name in names)

    def where(self, chosen: np.ndarray | slice) -> "Log":
        """Return the rows of `chosen` (mask (n,), indices or slice) as a log; notes are kept."""
        return Log.from_rows(self.rows[chosen], notes=self.notes)

    def told(self) -> np.ndarray | None:
        """Return the angles told to position servos (n, 2) [rad], each held to the next one.

        0 before the first one, and on an axis that was told none, as a beam has; None where no axis
        was told any.
        """
        if not any(self.has(name) for name in COMMANDS):
            return None
        return np.column_stack([_held(self[name]) for name in COMMANDS])

    def ball(self, delay_s: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
        """Return the times (k,) [s] and positions (k, 2) [m] of the new observations alone.

        The times are `exposures` at the camera's delay `delay_s` [s]. A row that repeats the
        position of the row before it is a held value, no new observation, unless its
        `ball_exposed_s` differs. The position is NaN on an axis that the log lacks.
        """
        xy = self.rows[:, [INDEX["ball_x_m"], INDEX["ball_y_m"]]]
        exposed = self["ball_exposed_s"]
        seen = ~np.isnan(xy).all(axis=1)
        same = (xy[1:] == xy[:-1]) | (np.isnan(xy[1:]) & np.isnan(xy[:-1]))
        held = same.all(axis=1) & (np.isnan(exposed[1:]) | (exposed[1:] == exposed[:-1]))
        new = seen & ~np.concatenate(([False], held))[: len(self)]
        return exposures(self["t_s"], exposed, delay_s)[new], xy[new]


def exposures(t_s: np.ndarray, exposed_s: np.ndarray, delay_s: float) -> np.ndarray:
    """When the light of each row's observation hit the sensor (n,) [s]: `exposed_s`; where that is
    no number, or OTHER_CLOCK_S from `t_s` and so of another clock, `t_s` of the tick in which the
    observation became usable minus the camera's delay `delay_s` [s] (0 keeps the tick's time).
    """
    return np.where(np.abs(exposed_s - t_s) < OTHER_CLOCK_S, exposed_s, t_s - delay_s)


def _held(column: np.ndarray) -> np.ndarray:
    """A column (n,) with each blank the value before it, 0 at the start."""
    last = np.maximum.accumulate(np.where(np.isnan(column), -1, np.arange(len(column))))
    return np.where(last >= 0, column[np.maximum(last, 0)], 0.0)


def shown_angles(rows: np.ndarray) -> np.ndarray:
    """Return the servos' angles (..., 2) of rows (..., len(COLUMNS)) for a person to look at [rad].

    The measured ones, or where nobody measures them those that the servos were told.
    """
    theta, told = INDEX["theta_x_rad"], INDEX["command_x_rad"]
    measured, commanded = rows[..., theta : theta + 2], rows[..., told : told + 2]
    return np.where(np.isnan(measured), commanded, measured)


def blank_row() -> np.ndarray:
    """Return a row (len(COLUMNS),) of blanks, to fill in by `INDEX`."""
    return np.full(len(COLUMNS), np.nan)
