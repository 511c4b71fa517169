"""Eq. 9 and the ball filter on readings made by hand: what they recover, what they cannot."""

from dataclasses import replace

import numpy as np
import pytest

from rig.estimation import observers
from rig.parameters import GEARS_INERTIA_HIGH_KG_M2, Gains, Rig, Servo
from rig.table import R_BALL, R_EXPOSED, R_MOTOR, R_NEW, R_THETA, R_TIME, blank_reading

TICK_S = 0.002
RIG = Rig()
TAU = RIG.gains.torque_filter_s
FRAME_S = 1 / 60


def motor_inertia(rig=RIG):
    """What the motor turns on its side of the shaft: all but gears and plate."""
    return rig.servo.inertia_kg_m2 - GEARS_INERTIA_HIGH_KG_M2 - rig.drive.plate_inertia_kg_m2


def torques(speed, volts, *, theta=None, rig=RIG):
    """T_e and Omega (n,) of axis x along speeds and volts (n,), the volts of the tick before."""
    q, b = observers.settings(rig), observers.start()
    estimated, observed = [], []
    for k, (w, v) in enumerate(zip(speed, volts, strict=True)):
        row = blank_reading()
        row[R_TIME], row[R_MOTOR], row[R_MOTOR + 1] = k * TICK_S, w, w
        row[R_THETA] = row[R_THETA + 1] = 0.0 if theta is None else theta[k]
        observers.observe(b, q, row, np.array([v, v]))
        estimated.append(b["torque"].copy())
        observed.append(b["observed"].copy())
    estimated, observed = np.array(estimated), np.array(observed)
    np.testing.assert_array_equal(estimated[:, 0], estimated[:, 1])
    return estimated[:, 0], observed[:, 0]


def test_constant_load_at_constant_speed_is_recovered_exactly():
    """J omega' = A V - B omega - T: at constant speed T_e = A V - B omega, whatever J and tau."""
    n, speed, load = 400, 0.8, 0.03
    volts = (RIG.servo.damping_nm_s * speed + load) / RIG.servo.torque_per_volt_nm
    estimated, observed = torques(np.full(n, speed), np.full(n, volts))
    assert estimated[-1] == pytest.approx(load, rel=1e-9)
    assert observed[-1] == pytest.approx(RIG.gains.observer_gain * load, rel=1e-9)


def test_no_load_at_constant_speed_is_zero():
    speed = RIG.servo.gain_rad_s_V * 0.7
    estimated, _ = torques(np.full(400, speed), np.full(400, 0.7))
    assert abs(estimated[-1]) < 1e-9


def test_step_of_load_at_standstill_is_the_step_response_of_the_filter():
    """T_m steps, the shaft holds the motor: T_e rises as 1 - exp(-t/tau), Omega a filter later."""
    n, volts = 60, 0.5
    estimated, observed = torques(np.zeros(n), np.full(n, volts))
    t = TICK_S * np.arange(1, n + 1)  # the volts of the tick before the first reading
    step = RIG.servo.torque_per_volt_nm * volts
    np.testing.assert_allclose(estimated, step * (1 - np.exp(-t / TAU)), rtol=1e-12)
    twice = step * (1 - (1 + t / TAU) * np.exp(-t / TAU))
    np.testing.assert_allclose(observed, twice, atol=0.05 * step)


def test_an_accelerating_motor_without_load_shows_a_small_torque_only():
    """First-order run-up of the motor alone: J omega' cancels T_m but for the discrete filter.

    The inertia's part is found to T/(2 tau) = 5 % of it, with ticks of T = 2 ms.
    """
    servo, n, volts = RIG.servo, 200, 1.0
    tau = motor_inertia() / servo.damping_nm_s
    t = TICK_S * np.arange(n)
    speed = servo.gain_rad_s_V * volts * (1 - np.exp(-t / tau))
    given = np.where(t > 0, volts, 0.0)
    estimated, _ = torques(speed, given)
    assert np.abs(estimated).max() < 0.06 * servo.torque_per_volt_nm * volts
    assert abs(estimated[-1]) < 1e-4


def test_steady_acceleration_costs_the_inertia_of_the_motors_side_alone():
    """A ramp of speed, T_m = J alpha + B omega with the motor's J: no shaft torque is left.

    A filter of 0.2 s, so that ticks of 2 ms blur the inertia's part by 0.5 % only.
    """
    rig, alpha, n = Rig(gains=Gains(torque_filter_s=0.2)), 1.0, 1000
    speed = alpha * TICK_S * np.arange(n)
    needed = motor_inertia() * alpha
    between = speed - 0.5 * alpha * TICK_S  # volts act over the tick before the reading
    volts = (needed + rig.servo.damping_nm_s * between) / rig.servo.torque_per_volt_nm
    estimated, _ = torques(speed, volts, rig=rig)
    damping_of_half_a_tick = rig.servo.damping_nm_s * 0.5 * alpha * TICK_S
    assert abs(estimated[-1] + damping_of_half_a_tick) < 0.012 * needed


def test_load_is_found_within_ticks_of_a_few_tau():
    """A load comes at t = 0.2 s while the motor runs: within 5 tau T_e is within 2 % of it."""
    servo, load, n = RIG.servo, 0.02, 300
    inertia = motor_inertia()
    speed, w = [], 0.5 * servo.gain_rad_s_V
    for k in range(n):
        speed.append(w)
        for _ in range(200):
            drag = servo.damping_nm_s * w + (load if k >= 100 else 0.0)
            w += 1e-5 * (servo.torque_per_volt_nm * 0.5 - drag) / inertia
    estimated, _ = torques(speed, np.full(n, 0.5))
    assert abs(estimated[99]) < 1e-3 * load
    assert estimated[100 + round(5 * TAU / TICK_S) :] == pytest.approx(load, rel=0.02)


def test_gain_and_time_constant_of_the_observer_are_the_rigs():
    rig = Rig(gains=replace(Gains(), observer_gain=2.5, torque_filter_s=0.05))
    estimated, observed = torques(np.zeros(500), np.full(500, 0.5), rig=rig)
    step = rig.servo.torque_per_volt_nm * 0.5
    assert observed[-1] == pytest.approx(2.5 * step, rel=1e-6)
    assert estimated[24] == pytest.approx(step * (1 - np.exp(-1)), rel=1e-9)


def test_without_a_tachometer_the_encoder_takes_its_place():
    rig = Rig(servo=Servo(tachometer=False))
    speed, load = 0.8, 0.03
    volts = (rig.servo.damping_nm_s * speed + load) / rig.servo.torque_per_volt_nm
    n = 400
    theta = speed * TICK_S * np.arange(n)
    estimated, _ = torques(np.full(n, np.nan), np.full(n, volts), theta=theta, rig=rig)
    assert np.all(np.isfinite(estimated))
    assert estimated[-1] == pytest.approx(load, rel=1e-6)


# --- the ball filter -------------------------------------------------------------------------


def filtered(exposed, xy, *, noise=None, rig=RIG):
    """Belief after every observation: position, velocity (n, 2) at the exposures."""
    q, b = observers.settings(rig), observers.start()
    places, velocities = [], []
    for t, (x, y) in zip(exposed, xy if noise is None else xy + noise, strict=True):
        row = blank_reading()
        row[R_TIME], row[R_NEW], row[R_EXPOSED] = t + 0.012, 1.0, t
        row[R_BALL], row[R_BALL + 1] = x, y
        observers.observe_ball(b, q, row)
        places.append(b["ball"].copy())
        velocities.append(b["velocity"].copy())
    return np.array(places), np.array(velocities), b


def test_ball_filter_follows_constant_velocity_without_error():
    t = FRAME_S * np.arange(1, 61)
    v = np.array([0.2, -0.15])
    places, velocities, b = filtered(t, t[:, None] * v)
    np.testing.assert_allclose(velocities[-1], v, rtol=1e-6)
    np.testing.assert_allclose(places[-1], t[-1] * v, atol=1e-8)
    # And carried on from the exposure to the tick in which it is used.
    assert observers.ball_now(b, t[-1] + 0.012, 0) == pytest.approx((t[-1] + 0.012) * 0.2, abs=1e-8)


def test_ball_filter_follows_through_uneven_frames():
    rng = np.random.default_rng(0)
    t = np.cumsum(rng.choice([1, 2, 3], 80) * FRAME_S)
    places, velocities, _ = filtered(t, t[:, None] * [0.2, -0.15])
    np.testing.assert_allclose(velocities[-1], [0.2, -0.15], rtol=1e-4)
    np.testing.assert_allclose(places[-1], t[-1] * np.array([0.2, -0.15]), atol=1e-6)


def test_ball_filter_has_the_gains_of_a_critically_damped_one():
    """Fading memory of order one: both poles at rho = exp(-w T)."""
    t = FRAME_S * np.arange(1, 40)
    xy = np.zeros((39, 2))
    xy[0] = 1.0  # then back to zero: the error must decay as (a + b k) rho^k
    places, _, _ = filtered(t, xy)
    rho = np.exp(-RIG.gains.ball_filter_rad_s * FRAME_S)
    k = np.arange(39)
    shape = places[:, 0] / rho**k
    np.testing.assert_allclose(np.diff(shape), np.diff(shape)[0], rtol=1e-6)


def test_noise_of_the_ball_filter_is_that_of_its_poles():
    """Variances of the fading-memory filter: (1-r)(1+4r+5r^2)/(1+r)^3, 2 (1-r)^3/T^2/(1+r)^3."""
    n, sigma = 20000, 3e-4
    noise = sigma * np.random.default_rng(1).standard_normal((n, 2))
    t = FRAME_S * np.arange(1, n + 1)
    places, velocities, _ = filtered(t, np.zeros((n, 2)), noise=noise)
    r = np.exp(-RIG.gains.ball_filter_rad_s * FRAME_S)
    position = sigma * np.sqrt((1 - r) * (1 + 4 * r + 5 * r * r) / (1 + r) ** 3)
    velocity = sigma / FRAME_S * np.sqrt(2 * (1 - r) ** 3 / (1 + r) ** 3)
    assert places[100:].std() == pytest.approx(position, rel=0.03)
    assert velocities[100:].std() == pytest.approx(velocity, rel=0.03)


def test_a_tick_without_observation_changes_no_belief():
    _, _, b = filtered([0.1, 0.2], np.array([[0.1, 0.1], [0.11, 0.1]]))
    before = b.tobytes()
    observers.observe_ball(b, observers.settings(RIG), blank_reading())
    assert b.tobytes() == before


def test_after_a_long_gap_the_filter_starts_afresh():
    places, velocities, _ = filtered([0.1, 0.11, 1.0], np.array([[0, 0], [0.01, 0], [0.1, 0.05]]))
    assert velocities[1, 0] > 0
    np.testing.assert_array_equal(places[2], [0.1, 0.05])
    np.testing.assert_array_equal(velocities[2], [0.0, 0.0])


def test_seconds_blind_counts_from_the_light():
    _, _, b = filtered([0.1], np.array([[0.0, 0.0]]))
    row = blank_reading()
    row[R_TIME] = 0.35
    assert observers.seconds_blind(b, row) == pytest.approx(0.25)


@pytest.mark.parametrize("observe", ["observe_torque", "observe_angles"])
def test_ticks_that_were_missed_are_made_up_for(observe: str):
    """Of an arm that turns evenly the same is known in the end, seen at every tick or at some."""
    seen = {"all": range(60), "some": [*range(12), 19, 20, 27, 34, 35, 52, 59]}
    found = {}
    for name, ticks in seen.items():
        q, b = observers.settings(RIG), observers.start()
        for k in ticks:
            row = blank_reading()
            row[R_TIME] = k * TICK_S
            row[R_THETA], row[R_THETA + 1] = 0.3 * k * TICK_S, -2.0 * k * TICK_S
            volts = (np.array([1.5, -3.0]),) if observe == "observe_torque" else ()
            getattr(observers, observe)(b, q, row, *volts)
        found[name] = {field: b[field] for field in ("rate", "free_rate", "torque", "observed")}
    for field, value in found["all"].items():
        np.testing.assert_allclose(found["some"][field], value, rtol=1e-9, err_msg=field)
    assert found["all"]["rate"] == pytest.approx([0.3, -2.0], rel=0.05)
