"""MuJoCo's tables with servos that take an angle hold what their truth says: seen again by plain
least squares, by steps and by balls that roll, none of it by the method that is tried on them.
"""

from typing import Any

import numpy as np
import pytest

from rig.effects import BY_NAME
from rig.rigfile import read_rig
from tests.support.worlds import WORLDS, position_mujoco
from tests.support.worlds.position_mujoco import (
    CASES,
    ROLLING,
    TABLES,
    Hidden,
    RADIUS_m,
    Recorder,
    Servos,
    STEP_s,
    drawn,
    mechanism,
    run,
)

G_m_s2 = 9.81
RNG = np.random.default_rng


def faultless(kind: str, **there: Any) -> Hidden:
    """Nothing hidden on this table but what is `there`, and a play of 6 microrad."""
    hidden = drawn(RNG(0), TABLES[kind], {})
    none = {key: np.zeros(np.shape(value)) for key, value in hidden._asdict().items()}
    none |= {"rate_rad_s": hidden.rate_rad_s, "play_rad": np.full(2, 6e-6)}
    return hidden._replace(**none | {k: np.asarray(v, float) for k, v in there.items()})


def smooth(values: np.ndarray, rows: float) -> np.ndarray:
    """Gaussian mean of this many rows along the first axis; the edges are for the caller to cut."""
    k = np.arange(-4 * int(rows), 4 * int(rows) + 1)
    weight = np.exp(-0.5 * (k / rows) ** 2)
    return np.stack([np.convolve(v, weight / weight.sum(), "same") for v in values.T], axis=1)


def pair(columns: dict[str, np.ndarray], name: str) -> np.ndarray:
    return np.stack([columns[name.format(axis)] for axis in "xy"], axis=1)


def test_every_case_names_effects_and_keys_of_the_catalogue():
    assert {f"position_mujoco_{name}" for name in CASES} <= set(WORLDS)
    for case in CASES.values():
        if case.names:
            known = [BY_NAME[name] for name in case.names.split("|") if name in BY_NAME]
            own = known[0]
            assert case.key in [p.key for p in own.parameters]
            assert (case.spread == "table") == (own.axes == ("xy",))
            tolerance = max(effect.tolerance for effect in known)
            if tolerance:
                assert case.low == pytest.approx(3 * tolerance)
                assert case.high == pytest.approx(12 * tolerance)


@pytest.mark.parametrize("kind", TABLES)
def test_a_log_has_the_columns_of_the_contract(kind, tmp_path):
    table = TABLES[kind]
    columns = run(RNG(5), kind, seconds=3.0).columns
    angles = {"theta_x_rad", "theta_y_rad"} if table.read_back else set()
    told = {"t_s", "command_x_rad", "command_y_rad", "ball_x_m", "ball_y_m"}
    assert set(columns) == told | angles
    assert all(len(c) == 3 * table.rows_hz and np.isfinite(c).all() for c in columns.values())
    np.testing.assert_allclose(np.diff(columns["t_s"]), 1 / table.rows_hz)
    (tmp_path / "rig.toml").write_text(position_mujoco._rig(table), "utf-8")
    rig = read_rig(tmp_path / "rig.toml")
    assert rig.servo.angle_measured is table.read_back
    assert rig.camera.delay_s == table.delay_s


@pytest.mark.slow
def test_a_world_is_a_minute_of_its_seed():
    columns, _, truth = WORLDS["position_mujoco_viscous_drag_arms"](3)
    again = position_mujoco.world("viscous_drag_arms", 3)
    assert len(columns["t_s"]) == 3000
    assert truth == again[2]
    np.testing.assert_array_equal(columns["ball_x_m"], again[0]["ball_x_m"])
    assert 0.1 <= truth["required"]["viscous_drag"]["xy"]["rate_1_s"] <= 0.5


def test_a_servo_waits_turns_at_its_rate_and_stops_short():
    """In an angle of 0.3 rad: 10 ms and the pulse's start, 1 rad/s, the lag's end, the band."""
    there = {"dead_time_s": (0.01, 0.0), "rate_rad_s": (1.0, 2.0), "band_rad": (0.004, 0.0)}
    table = TABLES["rc"]
    servos, told = Servos(table, faultless("rc", **there), 60), np.array([0.3, 0.3])
    way = np.concatenate([servos.answer(row, told).copy() for row in range(60)])
    t, late = STEP_s * np.arange(1, len(way) + 1), 0.008 - position_mujoco.ACTUATOR_s
    assert t[np.argmax(way[:, 0] > 0)] == pytest.approx(late + 0.01, abs=3 * STEP_s)
    assert t[np.argmax(way[:, 1] > 0)] == pytest.approx(late, abs=3 * STEP_s)
    assert np.diff(way[:, 0]).max() / STEP_s == pytest.approx(1.0)
    assert np.diff(way[:, 1]).max() / STEP_s == pytest.approx(2.0)
    goal = round(0.3 / 0.0016) * 0.0016
    np.testing.assert_allclose(way[-1], goal - np.array([0.007, 0.003]), atol=1e-5)
    left = goal - 0.003 - way[:, 1]
    falling = (left < 0.1) & (left > 0.001)
    slope = np.polyfit(t[falling], np.log(left[falling]), 1)[0]
    assert -1.0 / slope == pytest.approx(0.055, rel=0.01)


def test_actuators_are_as_late_as_the_servos_leave_room_for():
    """A ramp of 1 rad/s: what the arm lies behind is the time by which it is late."""
    made = mechanism(TABLES["bus"], faultless("bus"), None)
    for k in range(1000):
        made.advance(np.array([1.0, -1.0]) * STEP_s * k, 1)
    behind = np.array([1.0, -1.0]) * STEP_s * 1000 - made.arms_rad()
    np.testing.assert_allclose(np.abs(behind), position_mujoco.ACTUATOR_s, atol=2e-4)


def test_three_arms_hold_the_tilt_that_is_told():
    table = TABLES["arms"]
    made, told = mechanism(table, faultless("arms"), None), np.array([0.08, -0.05])
    servos = Servos(table, faultless("arms"), 100)
    for row in range(100):
        for angles in servos.answer(row, told * min(row / 40, 1.0))[::10]:
            made.advance(angles, 10)
    np.testing.assert_allclose(made.sines(), np.sin(told), atol=4e-3)  # 2 mrad of band a servo


@pytest.mark.parametrize("play", [0.0042, 0.0168])
def test_play_is_a_hysteresis_of_its_width_at_slow_motion(play):
    """Both ways through level, 0.3 rad/s at most; the pivot's friction holds the plate."""
    table = TABLES["rc"]
    made = mechanism(table, faultless("rc", play_rad=(play, 6e-6)), None)
    t = STEP_s * np.arange(round(4.0 / STEP_s))
    there, told = np.zeros((len(t), 4)), 0.1 * np.sin(np.pi * t)
    for k, angle in enumerate(told):
        before = made.arms_rad()  # MuJoCo's poses are those of the step's beginning
        made.advance(np.array([angle, angle]), 1)
        there[k] = *before, *made.sines()
    late = t > 2.0  # the second turn
    widths = []
    for i in range(2):
        arm, horn = there[:, i], there[:, 2 + i] / (table.frame.arm_m / table.frame.lever_m[i])
        up, down = late & (np.gradient(arm) > 0), late & (np.gradient(arm) < 0)
        crossing = [float(np.interp(0, *ordered(arm[w], (arm - horn)[w]))) for w in (up, down)]
        widths.append(crossing[0] - crossing[1])
    assert widths[0] == pytest.approx(play, rel=0.03)
    assert abs(widths[1]) < 5e-5


def ordered(along: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    order = np.argsort(along)
    return along[order], values[order]


@pytest.mark.parametrize(
    ("there", "left"),
    [
        ({}, lambda t: 0.05 + 0 * t),
        ({"drag_1_s": 0.5}, lambda t: 0.05 * np.exp(-0.5 * t)),
        ({"rolling_m_s2": 0.03}, lambda t: 0.05 - 0.03 * t),
    ],
)
def test_a_rolling_ball_loses_the_speed_that_the_truth_says(there, left):
    recorder = Recorder(TABLES["bus"], faultless("bus", **there), 1.0, (-0.02, 0.0))
    free = int(recorder.made.model.body("ball").dofadr[0])
    recorder.made.data.qvel[free : free + 6] = 0.05, 0, 0, 0, 0.05 / RADIUS_m, 0
    for _ in range(100):
        assert recorder.advance(np.zeros((50, 2)), np.zeros(2))
    speed = np.gradient(recorder.way_m[:, 0], 1e-3)
    t = 1e-3 * np.arange(len(speed))
    np.testing.assert_allclose(speed[20:980:20], left(t)[20:980:20], atol=5e-4)
    assert np.abs(recorder.way_m[:, 1]).max() < 1e-4


def test_a_level_error_pulls_towards_its_own_sign_and_resistance_holds_a_ball():
    slope = np.array([0.01, -0.004])
    for rolling, share in ((0.0, 1.0), (0.1, 0.0)):
        hidden = faultless("bus", level_rad=slope, rolling_m_s2=rolling)
        recorder = Recorder(TABLES["bus"], hidden, 0.5, (0.0, 0.0))
        for _ in range(50):
            recorder.advance(np.zeros((50, 2)), np.zeros(2))
        fallen = 0.5 * ROLLING * G_m_s2 * slope * 0.5**2
        np.testing.assert_allclose(recorder.way_m[-1], share * fallen, rtol=0.01, atol=1e-4)


def test_the_cameras_delay_and_scale_are_in_the_log():
    """The log's ball against MuJoCo's own, shifted: 15 ms and 24 ms more, 3 % too far."""
    table = TABLES["bus"]
    made = run(RNG(2), "bus", seconds=12.0, late_s=0.024, camera=0.03)
    t, seen = made.columns["t_s"], pair(made.columns, "ball_{}_m")
    rows, shifts = slice(20, None), np.arange(0.0, 0.08, 0.0005)
    missed, scales = [], []
    for shift in shifts:
        old = np.stack([np.interp(t - shift, t, made.ball_m[:, i]) for i in range(2)], axis=1)
        scales.append((old * seen)[rows].sum() / (old * old)[rows].sum())
        missed.append(((seen - scales[-1] * old)[rows] ** 2).mean())
    best = int(np.argmin(missed))
    assert shifts[best] == pytest.approx(table.delay_s + 0.024, abs=0.002)
    assert scales[best] == pytest.approx(1.03, abs=0.0025)
    assert np.sqrt(missed[best]) == pytest.approx(3e-4, rel=0.15)


def servo_of(columns: dict[str, np.ndarray], axis: str) -> tuple[float, float, float]:
    """Lag [s], scale and zero [rad] of a bus servo by least squares: a row's way of the angle
    against the command of 15.7 ms ago and the angle, off which the band of 4.9 mrad is taken.

    Rows whose way the band or the rate limit cuts are left out.
    """
    theta, told = columns[f"theta_{axis}_rad"], columns[f"command_{axis}_rad"]
    h, late, band = 0.01, 0.0157, 0.0049
    heard = (late / h - 1.0) * told[:-3] + (2.0 - late / h) * told[1:-2]
    now, way = theta[2:-1], theta[3:] - theta[2:-1]
    steady = np.abs(told[1:-2] - told[:-3]) < 0.02
    used = (np.abs(heard - now) > 4 * band) & (np.abs(way) < 4.0 * h) & steady
    held = now + np.sign(heard - now) * band
    terms = np.stack([heard, -held, np.ones(len(held))], axis=1)[used]
    p, q, z = np.linalg.lstsq(terms, way[used], rcond=None)[0]
    return float(-h / np.log(1.0 - q)), float(p / q - 1.0), float(z / q)


@pytest.mark.slow
def test_lag_scale_and_zero_of_bus_servos_are_in_the_log():
    """Of the file 35 ms; small faults: 2.5 ms, 0.5 % and 0.9 mrad."""
    there = {"lag_s": (0.0, 0.04), "scale": (0.08, 0.0), "zero_rad": (0.0, -0.0175)}
    for changes in ({}, there):
        columns = run(RNG(4), "bus", seconds=40.0, **changes).columns
        true = np.array([changes.get(key, (0.0, 0.0)) for key in ("lag_s", "scale", "zero_rad")])
        found = np.array([servo_of(columns, axis) for axis in "xy"]).T
        np.testing.assert_allclose(found[0] - 0.035, true[0], atol=0.006)
        np.testing.assert_allclose(found[1], true[1], atol=0.015)
        np.testing.assert_allclose(found[2], true[2], atol=0.002)


@pytest.mark.slow
def test_a_healthy_ball_follows_the_angle():
    """x'' + r phi'' = 5/7 g phi for the mean of 0.1 s, phi by arm and lever; the small faults are
    2 mm/s2 of the level and of rolling resistance, and camera noise is 4 mm/s2 of that mean."""
    table = TABLES["bus"]
    columns = run(RNG(8), "bus", seconds=40.0).columns
    ratio = table.frame.arm_m / table.frame.lever_m
    phi = np.arcsin(ratio * np.sin(pair(columns, "theta_{}_rad")))
    late = table.delay_s * table.rows_hz
    ball, phi = smooth(pair(columns, "ball_{}_m"), 10), smooth(phi, 10)
    n = np.arange(len(phi))
    phi = np.stack([np.interp(n - late, n, phi[:, i]) for i in range(2)], axis=1)
    pull, jolt = (np.diff(v, 2, axis=0) * table.rows_hz**2 for v in (ball, RADIUS_m * phi))
    felt = ROLLING * G_m_s2 * phi[1:-1]
    a, b = (pull + jolt)[100:-100], felt[100:-100]
    for i in range(2):
        slope, level = np.polyfit(b[:, i], a[:, i], 1)
        assert slope == pytest.approx(1.0, abs=0.02)
        assert abs(level) < ROLLING * G_m_s2 * 5e-4
        left = a[:, i] - slope * b[:, i] - level
        assert left.std() < 0.05 * b[:, i].std()
