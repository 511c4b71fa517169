"""What the entries share: a case's signals, and answers in the format of the rules.

Of the product it knows the catalogue's tolerances alone: the log is a table, the rig file TOML.
`terms` says what each effect of the catalogue adds to the nominal equations, e = sum of size x
column:

    servo [V]: (tau theta'' + theta')/K - V          ball [m/s2]: x'' - A sin(theta)

Both sides pass the same third-order low-pass, so that derivatives of noise stay small; that is the
integral (weak) form of the regression.
"""

import tomllib
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
from numba import njit
from scipy.signal import butter, lfilter, sosfilt

from rig.effects import BY_NAME

SERVO_HZ, BALL_HZ = 12.0, 1.5  # of the low-pass; chosen: below the noise of encoder and camera
RATE_HZ = 25.0  # of what is regressed
G_M_S2 = 9.81
Key = tuple[str, str, str]  # effect, axis, key


@dataclass
class Equation:
    """One axis of servo or ball: e (n,) [V or m/s2] and the columns (n,) that may explain it.

    free: columns of what a calibration leaves (K, tau), which every model may use.
    """

    channel: str
    e: np.ndarray
    columns: dict[Key, np.ndarray]
    free: np.ndarray
    states: dict[str, np.ndarray] = field(default_factory=dict)


@dataclass
class Case:
    """A log's columns by name, its rig file, and the control rate [Hz]."""

    log: dict[str, np.ndarray]
    rig: dict
    rate_hz: float

    @property
    def voltage(self) -> bool:
        return "voltage_x_V" in self.log

    def ratio(self, axis: str) -> float:
        """d x''/d sin(theta) over g: rolling factor times the linkage's ratio."""
        link = self.rig["linkage"] | self.rig["linkage"].get(axis, {})
        factor = 3 / 5 if self.rig["ball"]["hollow"] else 5 / 7
        if link["kind"] == "three-arms":
            return factor  # the command is the tilt that is asked for, to first order
        return factor * 2 * link["arm_radius_m"] / link["plate_side_m"]

    def angle(self, axis: str) -> np.ndarray:
        """The servo's angle: read, or the command behind the rig file's lag and dead time."""
        if f"theta_{axis}_rad" in self.log:
            return self.log[f"theta_{axis}_rad"]
        servo = self.rig["servo"] | self.rig["servo"].get(axis, {})
        keep = np.exp(-1 / (servo["lag_s"] * self.rate_hz)) if servo["lag_s"] else 0.0
        late = round(servo["dead_time_s"] * self.rate_hz)
        told = self.log[f"command_{axis}_rad"]
        return lfilter([1 - keep], [1, -keep], np.r_[np.zeros(late), told[: len(told) - late]])


def read_case(folder: Path) -> Case:
    table = pq.read_table(folder / "log-1.parquet")
    log = {n: table[n].to_numpy(zero_copy_only=False).astype(float) for n in table.column_names}
    rig = tomllib.loads((folder / "rig.toml").read_text("utf-8"))
    return Case(log, rig, rig["control_rate_hz"])


def positions(case: Case, axis: str) -> np.ndarray:
    """The ball at every tick, between the exposures."""
    seen = np.isfinite(case.log[f"ball_{axis}_m"])
    at = case.log["ball_exposed_s"][seen]
    return np.interp(case.log["t_s"], at, case.log[f"ball_{axis}_m"][seen])


class Filter:
    """s^n F(s) x for n = 0, 1, 2, at RATE_HZ, without the run-in."""

    def __init__(self, cut_hz: float, rate_hz: float) -> None:
        self._sos = butter(3, cut_hz, fs=rate_hz, output="sos")
        self._rate, self._skip = rate_hz, int(2 * rate_hz / cut_hz)
        self._every = max(round(rate_hz / RATE_HZ), 1)

    def __call__(self, x: np.ndarray, derivative: int = 0) -> np.ndarray:
        for _ in range(derivative):
            x = np.gradient(x, 1 / self._rate)
        return sosfilt(self._sos, x)[self._skip :: self._every]


@njit(cache=True)
def relay(theta: np.ndarray, step: float) -> np.ndarray:
    """+1 or -1 by the last motion of more than `step`: the side of a play that touches."""
    side, last, out = 0.0, theta[0], np.zeros(len(theta))
    for k, angle in enumerate(theta):
        if abs(angle - last) > step:
            side, last = np.sign(angle - last), angle
        elif (angle - last) * side > 0:
            last = angle
        out[k] = side
    return out


def counts(name: str, size: float) -> bool:
    """Whether a size is beyond what a well-kept table may have, by the catalogue's tolerance."""
    return abs(size) > BY_NAME[name].tolerance


def answer(verdict: str, effects: list[dict] | None = None, unknown: dict | None = None) -> dict:
    return {"verdict": verdict, "effects": effects or [], "unknown": unknown}


def effect(name: str, probability: float | None, sizes: dict[tuple[str, str], tuple]) -> dict:
    """sizes: (axis, key) -> (value, standard deviation)."""
    parameters: dict[str, dict] = {}
    for (axis, key), (value, sd) in sizes.items():
        low, high = value - 1.96 * sd, value + 1.96 * sd
        parameters.setdefault(axis, {})[key] = {"value": value, "low": low, "high": high}
    return {"name": name, "probability": probability, "twins": [], "parameters": parameters}
