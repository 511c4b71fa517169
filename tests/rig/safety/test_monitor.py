"""The guard: silent on every healthy run that ships, and each fault named in time."""

from dataclasses import FrozenInstanceError, astuple, replace
from math import inf, nan, sqrt
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from experiments.runs.assemble import another_unit, load_rig
from experiments.runs.protocol import read_protocol
from experiments.runs.runner import RunRequest, simulate_runs
from rig.log import INDEX, Log
from rig.parameters import ANGLE_MARGIN_RAD, Rig, Servo
from rig.safety.follow_watch import FollowLimits, FollowWatch
from rig.safety.monitor import (
    Fault,
    MonitorLimits,
    MonitorState,
    StallWatch,
    check,
    check_command,
    check_step,
    watch_stall,
    without,
)
from rig.safety.motion_watch import MotionLimits, MotionWatch, is_overdue, watch_motion
from rig.table import Reading
from tests.support import ROOT
from vision.frames import Observation

LIMITS = MonitorLimits.of_rig(Rig())
COVARIANCE = slice(INDEX["ball_cov_xx_m2"], INDEX["ball_cov_yy_m2"] + 1)
TABLE = load_rig(None)
TICK = 0.002


def derived() -> dict:
    """What the tests made of the guard's own names, made again (for its mutants)."""
    return {"LIMITS": MonitorLimits.of_rig(Rig())}


def see(exposed_s: float, xy=(0.0, 0.0), cov=(1e-8, 0.0, 1e-8)) -> Observation:
    return Observation(xy, cov, exposed_s)


def watch(readings, volts=lambda k: (0.0, 0.0), *, balancing=False, late=lambda k: 0.0):
    """Look at readings one by one: (tick of the trip, trip), or (None, None)."""
    state = MonitorState()
    for k, reading in enumerate(readings):
        state, fault = check(state, LIMITS, reading, volts(k), balancing=balancing, late_s=late(k))
        if fault is not None:
            return k, fault
    return None, None


def ticks(n, theta=lambda k: 0.0, axis=0, **more):
    def angles(k):
        return (theta(k), 0.0) if axis == 0 else (0.0, theta(k))

    return [Reading(k * TICK, angles(k), **more) for k in range(n)]


def readings_of(log: Log):
    for row in log.rows:
        ball = see(row[12], (row[5], row[6]), tuple(row[COVARIANCE])) if row[5] == row[5] else None
        yield Reading(row[0], (row[3], row[4]), None, ball)


def healthy(log: Log, servo_only: bool) -> Fault | None:
    state, volts = MonitorState(), (0.0, 0.0)
    for row, reading in zip(log.rows, readings_of(log), strict=True):
        balancing = row[INDEX["phase"]] == 2 and not servo_only
        state, fault = check(state, LIMITS_OF_TABLE, reading, volts, balancing=balancing)
        if fault is not None:
            return fault
        volts = (row[1], row[2])
    return None


LIMITS_OF_TABLE = MonitorLimits.of_rig(TABLE)
QUICK = ("free-release", "servo-squares", "steps")  # by default; the others are slow tests
PROTOCOLS = [
    p.stem if p.stem in QUICK else pytest.param(p.stem, marks=pytest.mark.slow)
    for p in sorted((ROOT / "experiments/protocols").glob("*.toml"))
]


@pytest.mark.parametrize("name", PROTOCOLS)
def test_no_healthy_run_of_a_shipped_protocol_trips_it(name: str, tmp_path: Path):
    """Both arms, the default table and three other units of its kind."""
    protocol = read_protocol(name)
    protocol = protocol.model_copy(update={"duration_s": min(protocol.duration_s, 8.0)})
    rigs = [TABLE, *[another_unit(TABLE, seed) for seed in range(3)]]
    requests = [
        RunRequest(rig, protocol, arm, seed, tmp_path, kind=TABLE)
        for seed, rig in enumerate(rigs)
        for arm in ("without", "with")
    ]
    logs = simulate_runs(requests, lambda request, run: run)
    for request, run in zip(requests, logs, strict=True):
        if run.outcome == "completed":
            assert healthy(run.log, protocol.servo_only) is None, (name, request.seed, request.arm)
    assert sum(run.outcome == "completed" for run in logs) >= len(logs) / 2


def test_limits_are_the_tables_own():
    servo = Rig().servo
    assert LIMITS.period_s == 0.002
    assert LIMITS.rate_rad_s == 2 * servo.gain_rad_s_V * servo.voltage_limit_V
    assert LIMITS.noise_rad == 4 * servo.encoder_step_rad
    assert LIMITS.angle_rad == servo.angle_limit_rad + ANGLE_MARGIN_RAD
    defaults = MonitorLimits(1.0, 2.0, 3.0, 4.0)
    healthy_table = (2.0, 0.08, 0.004, 1.25, 0.5, 0.1, 0.05, 25.0)
    assert astuple(defaults) == (1.0, 2.0, 3.0, 4.0, *healthy_table, True, None, None)


def test_servos_that_take_an_angle_have_their_own_rate_no_stall_and_perhaps_no_angle():
    servo = Servo(kind="position", x={"rate_limit_rad_s": 9.0}, rate_limit_rad_s=5.0)
    limits = MonitorLimits.of_rig(Rig(servo=servo))
    assert (limits.rate_rad_s, limits.stall_V, limits.measured) == (18.0, inf, False)
    unseen = Reading(0.0, (nan, nan))
    assert check(MonitorState(), limits, unseen, (0.3, 0.3), balancing=False)[1] is None
    back = MonitorLimits.of_rig(Rig(servo=replace(servo, angle_measured=True)))
    fault = check(MonitorState(), back, unseen, (0.3, 0.3), balancing=False)[1]
    assert fault is not None
    assert fault.name == "no number"
    state, _ = check(MonitorState(), back, Reading(0.0, (0.0, 0.0)), (0, 0), balancing=False)
    fault = check(state, back, Reading(0.002, (0.06, 0.0)), (0, 0), balancing=False)[1]
    assert fault is not None
    assert fault.name == "encoder jump"


# --- what is no number ---
@pytest.mark.parametrize("bad", [nan, inf, -inf])
def test_what_is_no_number_ends_the_run(bad: float):
    for reading in (Reading(bad, (0.0, 0.0)), Reading(0.0, (bad, 0.0)), Reading(0.0, (0.0, bad))):
        _, fault = watch([reading])
        assert fault is not None
        assert (fault.name, fault.level) == ("no number", False)
    _, fault = check(MonitorState(), LIMITS, Reading(bad, (0.0, 0.0)), (0, 0), balancing=False)
    assert fault is not None
    assert "time" in fault.reason
    balls = (see(bad), see(0.0, (bad, 0.0)), see(0.0, (0.0, bad)), see(0.0, cov=(bad, 0.0, 0.0)))
    for ball in balls:
        _, fault = watch([Reading(0.0, (0.0, 0.0), None, ball)])
        assert fault is not None
        assert (fault.name, fault.level) == ("no number", True)
    for wish in ((bad, 0.0), (0.0, bad)):
        fault = check_command(*wish)
        assert fault is not None
        assert (fault.name, fault.level) == ("no number", True)
    assert check_command(5.0, -1e9) is None


# --- encoder jump ---
@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize("axis", [0, 1])
def test_an_encoder_that_jumps_is_seen_in_the_same_tick(sign: int, axis: int):
    most = LIMITS.rate_rad_s * TICK + LIMITS.noise_rad
    for size, expected in ((1.01 * most, 50), (0.99 * most, None)):
        way = ticks(60, lambda k, size=size: sign * size if k >= 50 else 0.0, axis)
        k, fault = watch(way)
        assert k == expected
        if fault is not None:
            assert (fault.name, fault.level) == ("encoder jump", False)
            assert f"servo {'xy'[axis]}" in fault.reason
            assert "in 2.0 ms" in fault.reason


def test_a_longer_time_allows_a_longer_way():
    state, _ = check(MonitorState(), LIMITS, Reading(0.0, (0.0, 0.0)), (0.0, 0.0), balancing=False)
    far = LIMITS.rate_rad_s * 0.02
    for t_s, name in ((0.022, None), (0.012, "encoder jump")):
        _, fault = check(state, LIMITS, Reading(t_s, (far, 0.0)), (0.0, 0.0), balancing=False)
        assert (fault and fault.name) == name


# --- runaway ---
@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize("axis", [0, 1])
def test_an_arm_beyond_its_limit_ends_the_run(sign: int, axis: int):
    for angle, expected in ((LIMITS.angle_rad - 1e-6, None), (LIMITS.angle_rad + 1e-6, 99)):
        k, fault = watch(ticks(100, lambda k, a=angle: sign * a * k / 99, axis))
        assert k == expected
        if fault is not None:
            assert (fault.name, fault.level) == ("limit", True)
            assert "0.60 rad" in fault.reason


# --- stall ---
@pytest.mark.parametrize("volts", [2.0, -6.0])
@pytest.mark.parametrize("axis", [0, 1])
def test_volts_without_motion_are_a_stall_within_a_tenth_of_a_second(volts: float, axis: int):
    for drift in (0.0, -np.sign(volts) * 5.0):  # blocked; reversed: it runs the other way

        def drive(k):
            return ((volts, 0.0) if axis == 0 else (0.0, volts)) if k > 10 else (0.0, 0.0)

        way = ticks(120, lambda k, d=drift: d * TICK * max(0, k - 10), axis)
        k, fault = watch(way, drive)
        assert fault is not None
        assert (fault.name, fault.level) == ("stall", False)
        assert f"servo {'xy'[axis]}" in fault.reason
        assert k is not None
        soonest = 11 + 0.08 / TICK if volts == 2.0 else 30  # strong ones need no 80 ms
        assert soonest - 1 <= k <= 12 + 0.08 / TICK
        assert (k - 10) * TICK < 0.1


def test_weak_volts_and_slow_motion_are_no_stall():
    assert watch(ticks(500), lambda k: (1.99, -1.99))[1] is None
    slow = 1.5 * LIMITS.stall_rad / LIMITS.stall_s
    assert watch(ticks(500, lambda k: slow * k * TICK), lambda k: (2.5, 0.0))[1] is None
    slower = 0.5 * LIMITS.stall_rad / LIMITS.stall_s
    assert watch(ticks(500, lambda k: slower * k * TICK), lambda k: (2.5, 0.0))[1] is not None
    weak = lambda k: (2.5, 0.0) if k % 42 < 10 else (0.0, 0.0)  # noqa: E731
    assert watch(ticks(500), weak)[1] is None


def test_strong_volts_with_pauses_are_a_stall():
    for rest_V in (0.0, 1.99, -1.0):
        volts = lambda k, v=rest_V: (6.0, 0.0) if k % 39 < 38 else (v, 0.0)  # noqa: E731
        k, fault = watch(ticks(500), volts)
        assert fault is not None
        assert (fault.name, fault.axis) == ("stall", 0)
        assert k is not None
        assert k * TICK < 0.1


@pytest.mark.parametrize("tau_s", [0.01, 0.048, 0.1, 0.5])
@pytest.mark.parametrize("volts", [2.0, 6.0])
def test_an_arm_turned_round_at_full_speed_is_no_stall(tau_s: float, volts: float):
    """Volts against its full speed: it still falls back for a while. 0.048 s is the slowest motor
    on record."""
    limits = MonitorLimits.of_servo(Servo(time_constant_s=tau_s), TICK)
    top, speed, theta, angles = 1.53 * volts, -1.53 * 6.0, 0.0, []
    for _ in range(round(3 * tau_s / TICK) + 60):
        angles.append(theta)
        speed += (top - speed) * TICK / tau_s
        theta += speed * TICK
    seen = StallWatch()
    for k, angle in enumerate(angles):
        seen = watch_stall(seen, limits, volts, angle, k * TICK)
        assert k * TICK - seen.since_s <= limits.stall_s


def test_a_stall_is_called_so_as_soon_as_the_servo_allows():
    """Closed form: tau ln(1 + 6 V / 2 V) to stand, 3 degrees of play and 0.012 rad behind K 2 V;
    80 ms at least."""
    known = {
        tau: MonitorLimits.of_servo(Servo(time_constant_s=tau), TICK).stall_s for tau in (0.02, 0.5)
    }
    assert known[0.02] == 0.08
    q = 0.0658939 / (3.06 * 0.5)
    way = 0.5 * (q + sqrt(q * q + 8 * q)) / 2
    assert known[0.5] == pytest.approx(0.5 * 1.386294 + way + TICK)


@pytest.mark.parametrize("tau_s", [0.025, 0.046, 0.1, 0.5])
@pytest.mark.parametrize("play_rad", [0.0175, 0.0524])
@pytest.mark.parametrize("counts", [64, 400, 4096])
def test_a_motor_that_crosses_its_gears_play_is_no_stall(tau_s: float, play_rad: float, counts):
    """The arm stays, held by friction, until the motor that was turned round at full speed has
    crossed the gap: told by an encoder of so many counts."""
    servo = Servo(time_constant_s=tau_s, encoder_counts_per_rev=counts)
    limits, top = MonitorLimits.of_servo(servo, TICK), servo.gain_rad_s_V
    motor, arm, speed, seen = 0.0, 0.0, -6.0 * top, StallWatch()
    for k in range(round((4 * tau_s + 0.6) / TICK)):
        speed += (2.05 * top - speed) * TICK / tau_s
        motor += speed * TICK
        arm = min(max(arm, motor - play_rad), motor)
        angle = servo.encoder_step_rad * np.floor(arm / servo.encoder_step_rad)
        seen = watch_stall(seen, limits, 2.05, angle, k * TICK)
        assert k * TICK - seen.since_s <= limits.stall_s


def test_one_push_is_followed_step_by_step():
    p = watch_stall(StallWatch(), LIMITS, 3.0, 0.1, 1.0)
    assert p == StallWatch(1.0, 0.1, 1.0)
    assert watch_stall(p, LIMITS, 3.0, 0.111, 1.1) is p  # not far enough
    assert watch_stall(p, LIMITS, 3.0, 0.1, 1.1) is p
    assert watch_stall(p, LIMITS, 3.0, 0.05, 1.1) == StallWatch(
        1.0, 0.05, 1.0
    )  # fell back: no progress
    assert watch_stall(p, LIMITS, 3.0, 0.113, 1.1) == StallWatch(1.0, 0.113, 1.1)
    assert watch_stall(p, LIMITS, -3.0, 0.1, 1.1) == StallWatch(-1.0, 0.1, 1.1)
    assert watch_stall(p, LIMITS, 1.9, 0.1, 1.1) == StallWatch(0.0, 0.1, 1.1)
    assert watch_stall(StallWatch(-1.0, 0.1, 1.0), LIMITS, -2.0, 0.05, 1.2) == StallWatch(
        -1.0, 0.05, 1.2
    )
    exact = replace(LIMITS, stall_rad=0.25)
    assert watch_stall(StallWatch(1.0, 0.0, 1.0), exact, 3.0, 0.25, 1.1) == StallWatch(
        1.0, 0.25, 1.1
    )


# --- servos that take an angle ---
@pytest.mark.parametrize("axis", [0, 1])
def test_a_servo_that_stays_where_it_is_told_elsewhere_is_named_in_time(axis: int):
    servo = Servo(kind="position", angle_measured=True)
    limits = replace(MonitorLimits.of_servo(servo, 0.25), follow=FollowLimits(0.0, inf, 0.25))
    state, fault = check(MonitorState(), limits, Reading(0.0, (0.0, 0.0)), (0, 0), balancing=False)
    told = (0.3, 0.0) if axis == 0 else (0.0, 0.3)
    for t_s in (0.25, 0.5):
        assert fault is None
        state, fault = check(state, limits, Reading(t_s, (0.0, 0.0)), told, balancing=False)
    assert fault is not None
    assert (fault.name, fault.level, fault.axis) == ("stall", False, axis)
    assert fault.reason.startswith(f"servo {'xy'[axis]} stays at 0.00 rad, told elsewhere: is it")
    still = MonitorState()
    for k in range(20):  # of motors that take volts this says nothing
        volts = Reading(TICK * k, (0.0, 0.0))
        still, fault = check(still, LIMITS, volts, told, balancing=False)
        assert (fault, still.follows) == (None, (FollowWatch(), FollowWatch()))


# --- arms that stand still under weak volts ---
KNOWN = MonitorLimits.of_rig(Rig(), ((0.5, 0.5), (0.1, 0.3)))


@pytest.mark.parametrize(
    ("volts", "axis", "said"),
    [
        (1.5, 0, "x stands still under more than 1.0 V"),
        (-0.9, 1, "y stands still under more than -0.5 V"),
    ],
)
def test_a_still_arm_under_weak_volts_is_a_stall_of_its_axis(volts: float, axis: int, said: str):
    """Their law: test_motion_watch.py; here, that each axis's own volts and angle go into it."""
    pair = (volts, 0.0) if axis == 0 else (0.0, volts)
    state, seen, found, at = MonitorState(), MotionWatch(), None, None
    assert KNOWN.motion is not None
    for k in range(500):
        reading = Reading(1.0 + k * TICK, (0.2, -0.3))
        state, found = check(state, KNOWN, reading, pair, balancing=False)
        seen = watch_motion(seen, KNOWN.motion, KNOWN.motion.sure_V[axis], volts, 0.1, TICK)
        assert (found is not None) == is_overdue(seen, KNOWN.motion)
        if found is not None:
            at = k
            break
    assert at is not None
    assert found is not None
    assert (found.name, found.level, found.axis) == ("stall", False, axis)
    assert said in found.reason
    moves = ticks(500, lambda k: np.sign(volts) * 0.0005 * k, axis)
    state = MonitorState()
    for reading in moves:
        state, found = check(state, KNOWN, reading, pair, balancing=False)
        assert found is None


def test_no_weak_volts_are_known_without_a_homing_nor_of_servos_that_take_an_angle():
    assert LIMITS.motion == MotionLimits.of_servo(Rig().servo)
    assert MonitorLimits.of_rig(Rig(servo=Servo(kind="position"))).motion is None
    bare = MonitorLimits(TICK, 100.0, 1.0, 1.0)
    state = MonitorState(motions=(MotionWatch(1.0), MotionWatch(2.0)))
    after, fault = check(state, bare, Reading(0.0, (0.0, 0.0)), (1.0, 1.0), balancing=False)
    assert (after.motions, fault) == (state.motions, None)


def test_a_fault_names_the_axis_whose_encoder_is_lost():
    state, _ = check(MonitorState(), LIMITS, Reading(0.0, (0.0, 0.0)), (0, 0), balancing=False)
    for theta, axis in (((nan, 0.0), 0), ((0.0, inf), 1), ((nan, nan), None), ((1.0, 0.0), 0)):
        for turned in (False, True):
            seen = theta[::-1] if turned else theta
            lost = 1 - axis if turned and axis is not None else axis
            _, fault = check(state, LIMITS, Reading(TICK, seen), (0, 0), balancing=False)
            assert fault is not None
            assert (fault.level, fault.axis) == (False, lost)
    pushed = replace(state, pushes=(StallWatch(1.0, 0.0, -9.0), StallWatch(1.0, 0.0, 0.0)))
    for a, pushes in enumerate((pushed.pushes, pushed.pushes[::-1])):
        held = replace(state, pushes=pushes)
        _, fault = check(held, LIMITS, Reading(TICK, (0.0, 0.0)), (3.0, 3.0), balancing=False)
        assert fault is not None
        assert fault.axis == a
    assert Fault("a", "b").axis is None


@pytest.mark.parametrize("axis", [0, 1])
def test_without_an_axis_the_other_is_watched_on(axis: int):
    watches = (StallWatch(1.0, 0.1, 2.0), StallWatch(-1.0, 0.2, 3.0))
    motions = (MotionWatch(1.0, 0.1, 0.2, 0.3), MotionWatch(2.0, 0.4, 0.5, 0.6))
    state = MonitorState(5.0, (0.1, 0.2), watches, motions)
    reading, after = without(Reading(6.0, (nan, nan)), axis, state)
    assert reading.theta_rad[axis] == state.theta_rad[axis]
    assert np.isnan(reading.theta_rad[1 - axis])
    assert after.pushes[axis] == StallWatch()
    assert np.isnan(after.motions[axis].theta_rad)
    assert (after.motions[axis].up_rad, after.motions[axis].down_rad) == (0.0, 0.0)
    assert after.pushes[1 - axis] == watches[1 - axis]
    assert after.motions[1 - axis] == motions[1 - axis]
    assert (after.t_s, after.theta_rad, reading.t_s) == (5.0, (0.1, 0.2), 6.0)


# --- time ---
def test_time_that_stands_still_is_a_silent_link():
    for t_s in (0.0, -0.002):
        k, fault = watch([Reading(0.0, (0.0, 0.0)), Reading(t_s, (0.0, 0.0))])
        assert k == 1
        assert fault is not None
        assert (fault.name, fault.level) == ("link silent", False)
        assert "0.000 s" in fault.reason


def test_a_tick_that_comes_much_too_late_ends_the_run():
    limit = LIMITS.late_s
    for late, name in ((limit + 1e-3, "late loop"), (limit - 1e-3, None)):
        way = [Reading(0.0, (0.0, 0.0)), Reading(TICK + late, (0.0, 0.0))]
        _, fault = watch(way)
        assert (fault and fault.name) == name
        _, fault = watch(ticks(2), late=lambda k, late=late: late)
        assert (fault and fault.name) == name
        if fault is not None:
            assert fault.level
            assert "101 ms late (limit 100)" in fault.reason
    _, fault = watch([Reading(0.0, (0.0, 0.0)), Reading(1.002, (0.0, 0.0))])
    assert fault is not None
    assert "1000 ms late" in fault.reason
    _, fault = watch(ticks(1), late=lambda k: 1.0)  # the first tick may be late, too
    assert fault is not None
    exact = replace(LIMITS, late_s=0.25)
    assert (
        check(MonitorState(), exact, ticks(1)[0], (0, 0), balancing=False, late_s=0.25)[1] is None
    )


@pytest.mark.parametrize("own", [False, True], ids=["wall clock", "table's time"])
def test_missed_ticks_add_up_and_are_forgiven(own: bool):
    """Every 10th missed: 26 net of what is forgiven ends it; every 25th is within the share."""
    for every, trips in ((10, True), (25, False)):
        t_s, way = 0.0, []
        for k in range(700):
            t_s += 2 * TICK if own and k % every == 0 else TICK
            way.append(Reading(t_s, (0.0, 0.0)))
        late = (lambda k: 0.0) if own else (lambda k, e=every: TICK if k % e == 0 else 0.0)
        k, fault = watch(way, late=late)
        assert (fault is not None) == trips
        if fault is not None and k is not None:
            assert fault.name == "late loop"
            assert fault.level
            assert "than 5 % of the ticks" in fault.reason
            net = 1 - 9 * LIMITS.late_share  # a missed tick and nine in time
            assert k == pytest.approx(10 * LIMITS.late_ticks / net, rel=0.1)
    almost = [Reading(k * 1.89 * TICK, (0.0, 0.0)) for k in range(700)]
    assert watch(almost)[1] is None
    assert watch(ticks(700), late=lambda k: 0.89 * TICK)[1] is None
    state = MonitorState()
    for k, reading in enumerate(ticks(27)):
        state, fault = check(state, LIMITS, reading, (0, 0), balancing=False, late_s=TICK)
        assert (fault is None) == (k < 25)
        assert state.missed == min(k + 1, 25)
    state, _ = check(MonitorState(missed=0.0), LIMITS, ticks(1)[0], (0, 0), balancing=False)
    assert state.missed == 0.0


# --- camera ---
def balls(n: int, exposed_of, every: int = 8):
    for k in range(n):
        ball = see(exposed_of(k * TICK)) if k % every == 0 else None
        yield Reading(k * TICK, (0.0, 0.0), None, ball)


def test_a_camera_that_stalls_is_named():
    k, fault = watch(balls(2000, lambda t: min(t, 1.0) - 0.01), balancing=True)
    assert fault is not None  # the same frame again and again is nothing new
    assert fault.name == "camera stall"
    assert fault.level
    assert k is not None
    assert k * TICK < 1.0 + LIMITS.unseen_s + 0.03
    k, fault = watch(balls(2000, lambda t: t - LIMITS.old_s - 1e-3), balancing=True)
    assert k == 0
    assert fault is not None
    assert "0.50 s old" in fault.reason
    assert watch(balls(2000, lambda t: t - LIMITS.old_s + 1e-3), balancing=True)[1] is None
    assert watch(balls(2000, lambda t: t - 0.012), balancing=True)[1] is None


def test_a_ball_never_seen_counts_from_the_begin_of_balancing():
    k, fault = watch(ticks(2000), balancing=True)
    assert fault is not None
    assert "1.25 s" in fault.reason
    assert k == pytest.approx(LIMITS.unseen_s / TICK, abs=2)
    assert watch(ticks(2000), balancing=False)[1] is None
    assert watch(balls(2000, lambda t: -3.0), balancing=False)[1] is None
    state = MonitorState()
    for reading in ticks(700):
        state, _ = check(state, LIMITS, reading, (0.0, 0.0), balancing=False)
    _, fault = check(state, LIMITS, Reading(1.41, (0.0, 0.0)), (0.0, 0.0), balancing=True)
    assert fault is None
    exact = replace(LIMITS, unseen_s=0.5, late_s=9.0, old_s=0.25)
    state = MonitorState(t_s=0.0, seen_s=0.0)
    still = Reading(0.5, (0.0, 0.0))
    assert check(state, exact, still, (0, 0), balancing=True)[1] is None
    old = Reading(0.5, (0.0, 0.0), None, see(0.25))
    after, fault = check(state, exact, old, (0, 0), balancing=True)
    assert fault is None
    assert (after.exposed_s, after.seen_s) == (0.25, 0.5)
    after, _ = check(after, exact, replace(old, t_s=0.6), (0, 0), balancing=True)
    assert after.seen_s == 0.5


def test_every_edge_itself_is_still_fine():
    """Numbers that a float holds exactly: at the limit is within it."""
    edge = MonitorLimits(0.25, 4.0, 0.5, 2.0, 2.0, 0.5, 0.25, 0.5, 0.25, 0.5, 0.05, 25.0)
    state, fault = check(
        MonitorState(), edge, Reading(8.0, (0.5, -0.5)), (3.0, 0.0), balancing=False
    )
    assert fault is None
    assert (state.t_s, state.theta_rad, state.late_s) == (8.0, (0.5, -0.5), 0.0)
    assert state.pushes == (StallWatch(1.0, 0.5, 8.0), StallWatch())
    after, fault = check(state, edge, Reading(8.25, (2.0, -2.0)), (0.0, 0.0), balancing=False)
    assert fault is None  # 1.5 rad in 0.25 s, and at the angle limit
    assert after.late_s == 0.0
    still = MonitorState(8.0, (0.0, 0.0), (StallWatch(1.0, 0.0, 7.75), StallWatch(-1.0, 0.0, 7.75)))
    after, fault = check(still, edge, Reading(8.25, (0.0, 0.0)), (2.0, -2.0), balancing=False)
    assert fault is None
    _, fault = check(after, edge, Reading(8.26, (0.0, 0.0)), (2.0, -2.0), balancing=False)
    assert fault is not None
    assert fault.name == "stall"
    for volts in (3.0, -3.0):  # the first push counts from its own time
        both = (volts, volts)
        _, fault = check(MonitorState(), edge, Reading(8.0, (0.0, 0.0)), both, balancing=False)
        assert fault is None
    early, _ = check(state, edge, Reading(8.125, (0.5, -0.5)), (0.0, 0.0), balancing=False)
    assert early.late_s == 0.0
    aged = Reading(8.25, (0.5, -0.5), None, see(6.5))
    _, fault = check(state, edge, aged, (0.0, 0.0), balancing=True)
    assert fault is not None
    assert "1.75 s old" in fault.reason
    for late_s, missed in ((0.9 * 0.25, 0.0), (0.2251, 1.0)):
        after, _ = check(state, edge, Reading(8.25, (0, 0)), (0, 0), balancing=False, late_s=late_s)
        assert (after.missed, after.late_s) == (missed, late_s)
    _, fault = check(state, edge, Reading(9.25, (0.5, -0.5)), (0.0, 0.0), balancing=False)
    assert fault is not None
    assert fault.reason.startswith("a tick came 1000 ms late (limit 500)")
    _, fault = check(state, edge, Reading(8.5, (9.0, -0.5)), (0.0, 0.0), balancing=False)
    assert fault is not None
    assert "from 0.500 to 9.000 rad in 500.0 ms" in fault.reason


def test_what_it_remembers_and_says_cannot_be_changed():
    for one, name in ((LIMITS, "stall_V"), (Fault("a", "b"), "name"), (StallWatch(), "sign")):
        with pytest.raises(FrozenInstanceError):
            setattr(one, name, 0.0)
    with pytest.raises(FrozenInstanceError):
        MonitorState().missed = 0.0  # type: ignore[misc]


ANY = st.floats(allow_nan=True, allow_infinity=True)
ODD = st.builds(
    Reading,
    ANY,
    st.tuples(ANY, ANY),
    st.none(),
    st.none() | st.builds(Observation, st.tuples(ANY, ANY), st.tuples(ANY, ANY, ANY), ANY),
)


@given(st.lists(st.tuples(ODD, st.tuples(ANY, ANY), st.booleans(), ANY), max_size=20))
def test_it_never_raises_and_remembers_only_numbers(given_):
    state = MonitorState()
    for reading, volts, balancing, late_s in given_:
        state, fault = check(state, LIMITS, reading, volts, balancing=balancing, late_s=late_s)
        if fault is None:
            assert np.isfinite([state.t_s, *state.theta_rad, state.missed]).all()
            assert state.t_s == reading.t_s


def test_a_table_about_to_be_lost_ends_the_run_level():
    reading = Reading(0.0, (0.1, 0.0), lost="the card: expired")
    state, fault = check(MonitorState(), LIMITS, reading, (0.0, 0.0), balancing=False)
    assert fault == Fault("link lost", "the card: expired", level=True)
    assert state.theta_rad == (0.1, 0.0)


def test_after_a_late_tick_the_next_one_is_in_time():
    state, _ = check(MonitorState(), LIMITS, Reading(0.0, (0.0, 0.0)), (0, 0), balancing=False)
    late = Reading(0.2, (0.1, 0.0))
    state, fault = check(state, LIMITS, late, (0, 0), balancing=False)
    assert fault is not None
    assert fault.name == "late loop"
    after = Reading(0.2 + TICK, (0.1, 0.0))
    state, fault = check(state, LIMITS, after, (0, 0), balancing=False)
    assert (fault, state.late_s) == (None, pytest.approx(0.0))


@pytest.mark.parametrize("theta", [(nan, 0.2), (1.5, 0.2), (0.1, 1.6)])
def test_angles_of_a_lost_encoder_are_not_gone_on_from(theta: tuple[float, float]):
    """`without` puts the last good angle in the place of the lost one."""
    state, _ = check(MonitorState(), LIMITS, Reading(0.0, (0.1, 0.2)), (0, 0), balancing=False)
    after, fault = check(state, LIMITS, Reading(TICK, theta), (0, 0), balancing=False)
    assert fault is not None
    assert not fault.level
    assert (after.t_s, after.theta_rad) == (0.0, (0.1, 0.2))


def test_a_reading_is_judged_by_itself_and_by_the_one_before():
    first = Reading(7.0, (0.1, -0.1))
    assert check_step(None, LIMITS, first) is None
    most = LIMITS.rate_rad_s * TICK + LIMITS.noise_rad
    for way in (-1.0, 1.0):
        assert (
            check_step(first, LIMITS, Reading(7.0 + TICK, (0.1 + 0.99 * way * most, -0.1))) is None
        )
        jump = check_step(first, LIMITS, Reading(7.0 + TICK, (0.1, -0.1 + 1.01 * way * most)))
        assert jump is not None
        assert (jump.name, jump.level, jump.axis) == ("encoder jump", False, 1)
    for t_s in (7.0, 6.9):
        fault = check_step(first, LIMITS, Reading(t_s, (0.1, -0.1)))
        assert fault is not None
        assert (fault.name, fault.level) == ("link silent", False)
        assert "stands still at 7.000 s" in fault.reason
    for before in (None, first):
        fault = check_step(before, LIMITS, Reading(7.1, (nan, 0.0)))
        assert fault is not None
        assert (fault.name, fault.axis) == ("no number", 0)
