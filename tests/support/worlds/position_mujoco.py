"""Tables in MuJoCo whose servos take an angle, each with one hidden effect or none.

RC servos and bus servos on two rods, three arms. MuJoCo does the mechanics: rods by constraints, a
ball that rolls by contact, play as a horn between two stops, a level error as gravity that leans.
What a servo does with its command stands here (`turned`): pulses, dead time, quantum, dead band,
lag and rate; the angle that comes of it is told to MuJoCo's actuators, which are 2 ms late.
"""

import math
import zlib
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from tests.support.worlds.angle_servos import Frame, level_arm_rad, solve
from tests.support.worlds.logs import DEG, World, coloured, rig_toml, steps, truth

G_m_s2 = 9.81
STEP_s, LOOK_s = 2e-4, 1e-3  # of MuJoCo; between two looks at the ball
ACTUATOR_s = 2.2e-3  # lag of MuJoCo's actuators and their one step of waiting
ROLLING = 5.0 / 7.0  # share of a force that moves a solid ball which rolls
CREEP_m_s = 1e-4  # below this speed rolling resistance fades, so that the ball may rest
PIVOT_Nm = 0.004  # dry friction of a plate on two rods in its pivot, felt at the servo
RADIUS_m, MASS_kg = 0.015, 0.05


class Table(NamedTuple):
    """What a rig file says of a table, and how far its targets lie."""

    servo: dict[str, float]
    frame: Frame
    side_m: float
    rows_hz: float
    delay_s: float
    read_back: bool
    limit_rad: float
    target_m: float


RODS = Frame(False, 0.025, np.array([0.16, 0.13]), 0.08, 0.0, 0.0, 0.0)
WIDE_RODS = Frame(False, 0.03, np.array([0.15, 0.15]), 0.09, 0.0, 0.0, 0.0)
ARMS = Frame(True, 0.045, np.ones(2), 0.09, 0.055, 0.08, 0.105)
KEYS: tuple[str, ...] = (
    "lag_s",
    "dead_time_s",
    "rate_limit_rad_s",
    "dead_band_rad",
    "quantum_rad",
    "period_s",
)
RC: dict[str, float] = dict(zip(KEYS, (0.055, 0.008, 6.0, 0.003, 0.0016, 0.02), strict=True))
BUS: dict[str, float] = dict(zip(KEYS, (0.035, 0.015, 4.7, 0.0046, 0.001534, 0.0), strict=True))
LEGS: dict[str, float] = dict(zip(KEYS, (0.03, 0.006, 5.0, 0.002, 0.0018, 0.02), strict=True))
TABLES = {
    "rc": Table(RC, RODS, 0.26, 50.0, 0.02, False, 0.5, 0.05),
    "bus": Table(BUS, WIDE_RODS, 0.3, 100.0, 0.015, True, 0.5, 0.05),
    "arms": Table(LEGS, ARMS, 0.24, 50.0, 0.02, False, 0.2, 0.035),
}


class Hidden(NamedTuple):
    """What the rig file does not know; pairs are by axis, entries of servos by servo."""

    lag_s: np.ndarray
    dead_time_s: np.ndarray
    rate_rad_s: np.ndarray  # the lower one of this and the file's
    band_rad: np.ndarray
    scale: np.ndarray
    zero_rad: np.ndarray
    play_rad: np.ndarray  # (2,), full width, of two rods
    level_rad: np.ndarray  # (2,)
    late_s: float
    camera: float  # seen = (1 + camera) true, turned by yaw
    yaw_rad: float
    rolling_m_s2: float
    drag_1_s: float


def drawn(rng: np.random.Generator, table: Table, changes: dict[str, Any]) -> Hidden:
    """Small faults inside half of the default tolerances, and `changes` beside them."""
    n = 3 if table.frame.three else 2
    found: dict[str, Any] = {
        "lag_s": rng.uniform(-0.0025, 0.0025, n),
        "dead_time_s": rng.uniform(0.0, 0.0015, n),
        "rate_rad_s": np.full(n, np.inf),
        "band_rad": rng.uniform(0.0, 0.05 * DEG, n),
        "scale": rng.uniform(-0.005, 0.005, n),
        "zero_rad": rng.uniform(-0.05 * DEG, 0.05 * DEG, n),
        "play_rad": rng.uniform(0.01 * DEG, 0.04 * DEG, 2),
        "level_rad": rng.uniform(-0.01 * DEG, 0.01 * DEG, 2),
        "late_s": rng.uniform(-0.001, 0.001),
        "camera": rng.uniform(-0.0015, 0.0015),
        "yaw_rad": rng.uniform(-0.075 * DEG, 0.075 * DEG),
        "rolling_m_s2": rng.uniform(0.0, 0.0007),
        "drag_1_s": 0.0,
    }
    for key, change in changes.items():
        more = np.asarray(change, float) if np.ndim(found[key]) else change
        found[key] = np.minimum(found[key], more) if key == "rate_rad_s" else found[key] + more
    return Hidden(**found)


@njit(cache=True)
def turned(angle, goals, row, rows_hz, period_s, late_s, lag_s, rate_rad_s, band_rad, out):
    """Angles of a servo after each step of row `row`, into `out`; the last one is returned.

    goals (rows,): where it is to go by the command of each row. It hears the command that stood
    `late_s` ago, or at the last pulse before that; nothing moves within `band_rad` of the goal, and
    beyond that it goes there with a lag, at most so fast.
    """
    share = 1.0 - math.exp(-STEP_s / lag_s)
    for k in range(len(out)):
        heard_s = row / rows_hz + k * STEP_s - late_s
        if period_s > 0.0:
            heard_s = math.floor(heard_s / period_s + 1e-6) * period_s
        at = math.floor(heard_s * rows_hz + 1e-6)
        goal = goals[min(at, row)] if at >= 0 else 0.0
        off = goal - angle
        if abs(off) > band_rad:
            way = share * (abs(off) - band_rad)
            angle += math.copysign(min(way, rate_rad_s * STEP_s), off)
        out[k] = angle
    return angle


class Servos:
    """The servos of a table: commands by axis in, angles of the arms from level out."""

    def __init__(self, table: Table, hidden: Hidden, rows: int) -> None:
        self._table, self._hidden = table, hidden
        self._level = level_arm_rad(table.frame) if table.frame.three else 0.0
        self._pose = np.zeros(9)
        self._pose[5], self._pose[6:] = table.frame.height_m, self._level
        self.angles = np.zeros(len(hidden.lag_s))
        self._goals = np.zeros((len(self.angles), rows))
        self._steps = np.zeros((len(self.angles), round(1.0 / table.rows_hz / STEP_s)))

    def answer(self, row: int, command: np.ndarray) -> np.ndarray:
        """Tell them `command` (2,) at the start of a row; angles (steps, servos) in the row."""
        file, h, told = self._table.servo, self._hidden, command
        if self._table.frame.three:  # arms that hold the plate so, at its height
            solve(self._pose, command, self._table.frame)
            told = self._pose[6:] - self._level
        told = np.round(told / file["quantum_rad"]) * file["quantum_rad"]
        self._goals[:, row] = (1.0 + h.scale) * told + h.zero_rad
        for i in range(len(self.angles)):
            self.angles[i] = turned(
                self.angles[i],
                self._goals[i],
                row,
                self._table.rows_hz,
                file["period_s"],
                file["dead_time_s"] - ACTUATOR_s + h.dead_time_s[i],
                file["lag_s"] + h.lag_s[i],
                min(file["rate_limit_rad_s"], h.rate_rad_s[i]),
                file["dead_band_rad"] + h.band_rad[i],
                self._steps[i],
            )
        return self._steps.T


class Pilot:
    """A PD (and slow I) for the ball by what the camera says, slow enough for the whole delay."""

    def __init__(self, table: Table) -> None:
        file, frame = table.servo, table.frame
        late = table.delay_s + file["lag_s"] + file["dead_time_s"] + 0.5 * file["period_s"]
        w = min(3.0, 0.28 / (late + 0.5 / table.rows_hz))
        lever = 1.0 if frame.three else frame.arm_m / frame.lever_m.mean()
        self._p, self._d = (gain / (ROLLING * G_m_s2 * lever) for gain in (w * w, 1.6 * w))
        self._i, self._row_s, self._most = 0.1 * w * self._p, 1.0 / table.rows_hz, table.limit_rad
        self._seen, self._speed, self._sum = None, np.zeros(2), np.zeros(2)

    def command(self, seen: np.ndarray, target: np.ndarray) -> np.ndarray:
        if self._seen is not None:
            share = self._row_s / (0.1 + self._row_s)
            self._speed += share * ((seen - self._seen) / self._row_s - self._speed)
        self._seen = seen
        step = self._i * self._row_s * (target - seen)
        self._sum = np.clip(self._sum + step, -0.3 * self._most, 0.3 * self._most)
        wanted = self._p * (target - seen) - self._d * self._speed + self._sum
        return np.clip(wanted, -self._most, self._most)


def mechanism(table: Table, hidden: Hidden, ball_m: tuple[float, float] | None) -> Any:
    """MuJoCo's table, which shares the names of the rig file with the product and no equation."""
    from tests.support.mujoco_engine.position_table import table_of_lengths

    f = table.frame
    size = (f.arm_m, f.rod_m, f.base_m, f.plate_m, f.height_m)
    made = table_of_lengths(
        size,
        2.0 * f.lever_m if not f.three else table.side_m,
        (RADIUS_m, MASS_kg),
        limit_rad=table.limit_rad,
        level_rad=level_arm_rad(f) if f.three else 0.0,
        ball_m=ball_m,
        play_rad=None if f.three else (float(hidden.play_rad[0]), float(hidden.play_rad[1])),
        friction_nm=PIVOT_Nm * float(f.lever_m.mean()) / f.arm_m,
    )
    made.model.opt.timestep, made.model.opt.tolerance = STEP_s, 1e-10
    s = np.sin(hidden.level_rad)
    made.model.opt.gravity[:] = G_m_s2 * np.array([s[0], s[1], -math.sqrt(1.0 - s @ s)])
    return made


class Recorder:
    """MuJoCo's table in motion: moves the arms and keeps the ball's way over the plate."""

    def __init__(self, table: Table, hidden: Hidden, seconds: float, start_m) -> None:
        self.made, self._hidden = mechanism(table, hidden, start_m), hidden
        self._push = self.made.data.body("ball").xfrc_applied
        self.way_m = np.zeros((round(seconds / LOOK_s) + 1, 2))  # a place each LOOK_s
        self.way_m[0] = self.made.ball_m()[:2]
        self._looks = 0

    def advance(self, angles: np.ndarray, push_m_s2: np.ndarray) -> bool:
        """Move on by a row; False where the ball has left the plate."""
        ball, every = np.zeros(3), round(LOOK_s / STEP_s)
        for first in range(0, len(angles), every):
            self._push[:2] = MASS_kg / ROLLING * (push_m_s2 - self._braked())
            for told in angles[first : first + every]:
                self.made.advance(told, 1)
            self._looks += 1
            ball = self.made.ball_m()
            self.way_m[self._looks] = ball[:2]
        return ball[2] > 0.5 * RADIUS_m

    def _braked(self) -> np.ndarray:
        """What drag and rolling resistance take off the ball's speed [m/s2]."""
        v = (self.way_m[self._looks] - self.way_m[max(self._looks - 1, 0)]) / LOOK_s
        size = max(math.hypot(v[0], v[1]), CREEP_m_s)
        return (self._hidden.rolling_m_s2 / size + self._hidden.drag_1_s) * v

    def seen_m(self, when_s: float) -> np.ndarray:
        """Where the ball was, as the camera's numbers have it."""
        at = max(when_s / LOOK_s, 0.0)
        k = min(int(at), self._looks)
        x, y = self.way_m[k] + (at - k) * (self.way_m[min(k + 1, self._looks)] - self.way_m[k])
        c, s = math.cos(self._hidden.yaw_rad), math.sin(self._hidden.yaw_rad)
        return (1.0 + self._hidden.camera) * np.array([c * x - s * y, s * x + c * y])


class Run(NamedTuple):
    """Columns of a log, and what only MuJoCo knows a row: arms, sines of the tilt, ball."""

    columns: dict[str, np.ndarray]
    arms_rad: np.ndarray
    sines: np.ndarray
    ball_m: np.ndarray


def run(rng: np.random.Generator, kind: str, seconds: float = 60.0, **changes: Any) -> Run:
    """Random steps of the target, smaller ones where the ball would fall; see the module."""
    table = TABLES[kind]
    hidden, n = drawn(rng, table, changes), int(seconds * table.rows_hz)
    noise, push = rng.normal(0.0, 3e-4, (n, 2)), coloured(rng, (n, 2), 0.003, 0.05, table.rows_hz)
    levels = [steps(rng, n, table.rows_hz, table.target_m, (1.5, 4.0)) for _ in range(2)]
    start, count = tuple(rng.uniform(-0.02, 0.02, 2)), 2.0 * math.pi / 4096
    for shrink in (1.0, 0.7, 0.5, 0.3):
        targets, log, known = shrink * np.stack(levels, axis=1), np.zeros((n, 6)), []
        servos, pilot = Servos(table, hidden, n), Pilot(table)
        recorder = Recorder(table, hidden, seconds, start)
        for row in range(n):
            when_s = row / table.rows_hz - table.delay_s - hidden.late_s
            log[row, 4:] = recorder.seen_m(when_s) + noise[row]
            log[row, :2] = pilot.command(log[row, 4:], targets[row])
            arms = recorder.made.arms_rad()
            log[row, 2:4] = np.round(arms[:2] / count) * count
            known.append((*arms, *recorder.made.sines(), *recorder.made.ball_m()[:2]))
            if not recorder.advance(servos.answer(row, log[row, :2]), push[row]):
                break
        if len(known) == n and np.abs(log[:, 4:]).max() < 0.5 * table.side_m:
            names = "command_x_rad command_y_rad theta_x_rad theta_y_rad ball_x_m ball_y_m".split()
            columns = {"t_s": np.arange(n) / table.rows_hz} | dict(zip(names, log.T, strict=True))
            if not table.read_back:
                del columns["theta_x_rad"], columns["theta_y_rad"]
            true = np.array(known)
            return Run(columns, true[:, :-4], true[:, -4:-2], true[:, -2:])
    raise RuntimeError("the ball fell")


class Case(NamedTuple):
    """One hidden effect of a table: its names ("|": twins that say the same of such a log), key and
    field of `Hidden`, and from where to where its size is drawn: 3 to 12 tolerances
    if it has one, of twins the widest.

    spread: "axes" (x, y or both, each by its own), "all" (every servo alike), "table" (one number);
    signed: either way.
    """

    table: str
    names: str
    key: str
    field: str
    low: float
    high: float
    spread: str = "axes"
    signed: bool = False


DELAYS = "camera_delay|servo_dead_time"
SCALES = "camera_scale|ball_inertia|linkage_gain"
CASES = {
    "healthy_rc": Case("rc", "", "", "", 0.0, 0.0),
    "healthy_bus": Case("bus", "", "", "", 0.0, 0.0),
    "healthy_arms": Case("arms", "", "", "", 0.0, 0.0),
    "servo_lag_rc": Case("rc", "servo_lag", "lag_s", "lag_s", 0.015, 0.06),
    "servo_lag_bus": Case("bus", "servo_lag", "lag_s", "lag_s", 0.015, 0.06),
    "servo_dead_time_bus": Case("bus", "servo_dead_time", "delay_s", "dead_time_s", 0.009, 0.036),
    "camera_delay_bus": Case("bus", "camera_delay", "extra_s", "late_s", 0.006, 0.024, "table"),
    "camera_delay_arms": Case("arms", DELAYS, "extra_s", "late_s", 0.009, 0.036, "table"),
    "rate_limit_rc": Case("rc", "rate_limit", "limit_rad_s", "rate_rad_s", 0.6, 1.2),
    "command_dead_band_rc": Case(
        "rc", "command_dead_band", "half_width_rad", "band_rad", 0.3 * DEG, 1.2 * DEG
    ),
    "command_dead_band_bus": Case(
        "bus", "command_dead_band", "half_width_rad", "band_rad", 0.3 * DEG, 1.2 * DEG
    ),
    "angle_scale_bus": Case("bus", "angle_scale", "fraction", "scale", 0.03, 0.12, signed=True),
    "angle_scale_arms": Case(
        "arms", f"angle_scale|{SCALES}", "fraction", "scale", 0.03, 0.12, "all", signed=True
    ),
    "angle_zero_bus": Case(
        "bus", "angle_zero", "offset_rad", "zero_rad", 0.3 * DEG, 1.2 * DEG, signed=True
    ),
    "level_offset_arms": Case(
        "arms", "level_offset|angle_zero", "slope_rad", "level_rad", 0.3 * DEG, 1.2 * DEG,
        signed=True,
    ),
    "camera_scale_bus": Case(
        "bus", SCALES, "fraction", "camera", 0.009, 0.036, "table", signed=True
    ),
    "joint_backlash_rc": Case(
        "rc", "joint_backlash", "play_rad", "play_rad", 0.24 * DEG, 0.96 * DEG
    ),
    "joint_backlash_bus": Case(
        "bus", "joint_backlash", "play_rad", "play_rad", 0.24 * DEG, 0.96 * DEG
    ),
    "rolling_resistance_bus": Case(
        "bus", "rolling_resistance", "deceleration_m_s2", "rolling_m_s2", 0.0045, 0.018, "table"
    ),
    "viscous_drag_arms": Case("arms", "viscous_drag", "rate_1_s", "drag_1_s", 0.1, 0.5, "table"),
}  # fmt: skip


def _sizes(case: Case, rng: np.random.Generator) -> tuple[Any, dict[str, dict[str, float]]]:
    """The change of the case's field, and the truth's numbers by axis."""
    way = rng.choice((-1.0, 1.0), 2) if case.signed else np.ones(2)
    size = way * rng.uniform(case.low, case.high, 2)
    which = rng.integers(3)
    if case.spread == "table":
        return float(size[0]), {"xy": {case.key: float(size[0])}}
    if case.spread == "all":
        return size[0], {axis: {case.key: float(size[0])} for axis in "xy"}
    none = np.inf if case.field == "rate_rad_s" else 0.0
    hit = np.array([which != 1, which != 0])
    there = {axis: {case.key: float(size[i])} for i, axis in enumerate("xy") if hit[i]}
    return np.where(hit, size, none), there


def _rig(table: Table) -> str:
    f = table.frame
    linkage: dict[str, Any] = {"arm_radius_m": f.arm_m, "rod_length_m": f.rod_m}
    if f.three:
        linkage |= {"kind": '"three-arms"', "plate_side_m": table.side_m, "height_m": f.height_m}
        linkage |= {"base_radius_m": f.base_m, "plate_radius_m": f.plate_m}
    else:
        linkage |= {f"{a}.plate_side_m": 2.0 * f.lever_m[i] for i, a in enumerate("xy")}
    more = {"angle_limit_rad": table.limit_rad, "stop_rad": 1.2, "angle_measured": table.read_back}
    dry = 0.0 if f.three else PIVOT_Nm
    return rig_toml(
        drive={"arm_friction_nm": 0.0, "joint_friction_nm": dry},
        top={"control_rate_hz": table.rows_hz},
        servo={"kind": '"position"', **table.servo, **more, "encoder_counts_per_rev": 4096},
        linkage=linkage,
        ball={"hollow": False, "radius_m": RADIUS_m, "mass_kg": MASS_kg},
        camera={"rate_hz": table.rows_hz, "delay_s": table.delay_s, "noise_m": 3e-4},
    )


def world(name: str, seed: int) -> World:
    """60 s of the case of this name; its truth leaves out the small faults beside the effect."""
    case, rng = CASES[name], np.random.default_rng([zlib.crc32(name.encode()), seed])
    change, there = _sizes(case, rng) if case.names else (0.0, {})
    changes = {case.field: change} if case.names else {}
    found = truth({case.names: there}) if case.names else truth({}, kind="healthy")
    return run(rng, case.table, **changes).columns, _rig(TABLES[case.table]), found


WORLDS = {f"position_mujoco_{name}": partial(world, name) for name in CASES}
