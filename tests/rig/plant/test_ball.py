"""The rolling ball: closed forms on a plate at rest, a full 3-D model on a moving one.

The 3-D model shares nothing with `rig.plant.ball`: the plate's rotation matrix is integrated in the
inertial frame, the ball is a free rigid body, and the contact force comes out of nine linear
equations (Newton, Euler, and the rolling constraint differentiated once).
"""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from rig.parameters import GRAVITY_M_S2, Ball, Rig
from rig.plant import plant, plant_record
from rig.plant.ball import plate_rates, plate_sines, rolling, velocity
from rig.plant.plant import BALL, BALL_W, PLATE, PLATE_RATE, SPIN
from tests.support.simulated import TICK_S, WEIGHTLESS, ball_state, moved, smooth_rig, tilted

RATIO = 2 * 0.0254 / 0.275
HOLLOW, SOLID = Ball(mass_kg=0.0), Ball(mass_kg=0.0, hollow=False)
FACTOR = {HOLLOW: 3 / 5, SOLID: 5 / 7}
START_M, START_M_S = (0.03, -0.05), (-0.06, 0.11)


@dataclass(frozen=True)
class Sway:
    """Servo angles of both axes: offset + amplitude sin(2 pi hz t + phase), all smooth."""

    amplitude_rad: tuple[float, float]
    hz: tuple[float, float]
    phase_rad: tuple[float, float] = (0.0, 0.0)

    def theta(self, t):
        """Angles, rates and accelerations, each (2,)."""
        a, w = np.array(self.amplitude_rad), 2 * np.pi * np.array(self.hz)
        u = w * t + np.array(self.phase_rad)
        return a * np.sin(u), a * w * np.cos(u), -a * w * w * np.sin(u)

    def sines(self, t):
        """sin(phi) of both axes by Eq. 14 with first and second derivative, each (2,)."""
        q, q1, q2 = self.theta(t)
        return (
            RATIO * np.sin(q),
            RATIO * np.cos(q) * q1,
            RATIO * (np.cos(q) * q2 - np.sin(q) * q1 * q1),
        )


# A loop that works hard (30 degrees is the servo's limit), and one far beyond what a servo does.
HARD = Sway((0.45, 0.35), (1.3, 0.9), (0.3, 1.9))
WILD = Sway((0.5, 0.5), (3.0, 4.1), (0.0, 1.0))

Z = np.array([0.0, 0.0, 1.0])


def plate_turning(rotation, s1, s2):
    """The plate's angular velocity and acceleration in the world, with no turn about its normal.

    From d/dt (e . z) = -s' for both edges e of the plate: three linear equations each.
    """
    e_x, e_y, n = rotation.T
    rows = np.array([np.cross(e_x, Z), np.cross(e_y, Z), n])
    omega = np.linalg.solve(rows, [-s1[0], -s1[1], 0.0])
    rest = [
        -s2[i] - np.dot(np.cross(omega, np.cross(omega, e)), Z) for i, e in enumerate((e_x, e_y))
    ]
    return omega, np.linalg.solve(rows, [*rest, 0.0])


def skew(v):
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def rigid_body_rates(t, y, sway, ball):
    """Newton-Euler in the inertial frame: y = centre (3), velocity (3), spin (3), plate (9)."""
    p, v, w, rotation = y[:3], y[3:6], y[6:9], y[9:].reshape(3, 3)
    _, s1, s2 = sway.sines(t)
    omega, alpha = plate_turning(rotation, s1, s2)
    n, r, m = rotation[:, 2], ball.radius_m, 0.003
    inertia = (2 / 3 if ball.hollow else 2 / 5) * m * r * r
    contact, dn = p - r * n, np.cross(omega, n)
    # Unknown: acceleration a, angular acceleration b, force f.
    left, right = np.zeros((9, 9)), np.zeros(9)
    left[:3, :3], left[:3, 6:], right[:3] = m * np.eye(3), -np.eye(3), -m * GRAVITY_M_S2 * Z
    left[3:6, 3:6], left[3:6, 6:] = inertia * np.eye(3), r * skew(n)
    # d/dt [v + w x (-r n) - omega x contact] = 0
    left[6:, :3], left[6:, 3:6] = np.eye(3), r * skew(n)
    right[6:] = r * np.cross(w, dn) + np.cross(alpha, contact) + np.cross(omega, v - r * dn)
    a, b = np.linalg.solve(left, right)[:6].reshape(2, 3)
    return np.concatenate([v, a, b, (skew(omega) @ rotation).ravel()])


@cache
def rigid_body(sway, ball, end_s):
    """Plate coordinates at `end_s`: x, y, height, spin about the normal, from the 3-D model."""
    s, s1, s2 = sway.sines(0.0)
    # Any rotation with these edge slopes will do: Gram-Schmidt from one edge to the other.
    e_x = np.array([np.sqrt(1 - s[0] ** 2), 0.0, -s[0]])
    side = -s[0] * s[1] / e_x[0]
    e_y = np.array([side, np.sqrt(1 - s[1] ** 2 - side**2), -s[1]])
    e_y[0] = -e_x[2] * e_y[2] / e_x[0]
    e_y[1] = np.sqrt(1 - e_y[0] ** 2 - e_y[2] ** 2)
    rotation = np.column_stack([e_x, e_y, np.cross(e_x, e_y)])
    np.testing.assert_allclose(rotation.T @ rotation, np.eye(3), atol=1e-14)
    omega, _ = plate_turning(rotation, s1, s2)
    n, r = rotation[:, 2], ball.radius_m
    p = rotation @ [*START_M, r]
    v = np.cross(omega, p) + rotation @ [*START_M_S, 0.0]
    w = np.cross(n, v - np.cross(omega, p - r * n)) / r  # rolling, no spin about the normal
    y0 = np.concatenate([p, v, w, rotation.ravel()])
    done = solve_ivp(
        rigid_body_rates, (0, end_s), y0, args=(sway, ball), method="DOP853", rtol=1e-11, atol=1e-13
    ).y[:, -1]
    rotation = done[9:].reshape(3, 3)
    np.testing.assert_allclose(-rotation[2, :2], sway.sines(end_s)[0], atol=1e-9)
    return np.array([*(rotation.T @ done[:3]), rotation[:, 2] @ done[6:9]])


def rig_equations(sway, ball, end_s):
    """x, y, spin at `end_s` from the functions of `rig.plant.ball`, integrated to many digits."""

    def motion(t):
        q, q1, _ = sway.theta(t)
        s_x, s_y = plate_sines(q[0], q[1], (RATIO, RATIO), 0.0, 0.0)
        return s_x, s_y, *plate_rates(q[0], q[1], q1[0], q1[1], (RATIO, RATIO), 0.0, 0.0, s_x, s_y)

    def rates(t, y):
        s_x, s_y, o1, o2 = motion(t)
        v_x, v_y = velocity(y[2], y[3], o1, o2, r)
        args = (y[0], y[1], v_x, v_y, y[4], s_x, s_y, o1, o2, ball.rolling_factor, r)
        return [v_x, v_y, *rolling(*args)]

    r = ball.radius_m
    _, _, o1, o2 = motion(0.0)
    y0 = [*START_M, START_M_S[0] + r * o2, START_M_S[1] - r * o1, 0.0]
    done = solve_ivp(rates, (0, end_s), y0, method="DOP853", rtol=1e-11, atol=1e-13).y[:, -1]
    return done[[0, 1, 4]]


@pytest.mark.parametrize("ball", [HOLLOW, SOLID], ids=["hollow", "solid"])
@pytest.mark.parametrize("sway", [HARD, WILD], ids=["hard", "wild"])
def test_moving_plate_is_the_rigid_body_model(sway, ball):
    x, y, height, spin = rigid_body(sway, ball, 1.0)
    assert height == pytest.approx(ball.radius_m, abs=1e-9)  # the 3-D ball stayed on the plate
    assert abs(spin) > 0.01  # and there is a spin to compare
    np.testing.assert_allclose(rig_equations(sway, ball, 1.0), [x, y, spin], atol=1e-8)


def plant_ball(sway, ball, end_s, step_s):
    """x, y, spin of the plant's own ball step under a prescribed plate."""
    p, s = plant_record.pack(Rig(ball=ball), step_s=step_s), plant.rest(START_M)
    s[PLATE], s[PLATE_RATE] = sway.theta(0.0)[:2]
    _, _, o1, o2 = plant.plate_motion(s, p)
    r = ball.radius_m
    s[BALL_W] = START_M_S[0] + r * o2, START_M_S[1] - r * o1
    for i in range(round(end_s / step_s)):
        s[PLATE], s[PLATE_RATE] = sway.theta((i + 1) * step_s)[:2]
        motion = plant.plate_motion(s, p)
        done = plant.ball_step(p, i * step_s, 0.0, 0.0, motion, plant.ball_of(s))
        s[BALL], s[BALL_W], s[SPIN, 0] = done[:2], done[2:4], done[4]
    return np.array([*s[BALL], s[SPIN, 0]])


@pytest.mark.parametrize("ball", [HOLLOW, SOLID], ids=["hollow", "solid"])
def test_plant_converges_to_the_rigid_body_model_in_first_order(ball):
    truth = rigid_body(HARD, ball, 1.0)[[0, 1, 3]]
    gaps = [np.abs(plant_ball(HARD, ball, 1.0, h) - truth)[:2].max() for h in (4e-4, 2e-4, 1e-4)]
    assert gaps[-1] < 1e-4  # 0.1 mm after a second, a third of the camera's noise
    assert 1.8 < gaps[0] / gaps[1] < 2.2
    assert 1.8 < gaps[1] / gaps[2] < 2.2


def test_the_moving_plate_matters():
    """Without the plate's motion (Eq. 13 alone) the same ball is millimetres away."""

    def rates(t, y):
        return [y[2], y[3], *(3 / 5 * GRAVITY_M_S2 * HARD.sines(t)[0])]

    plain = solve_ivp(rates, (0, 1.0), [*START_M, *START_M_S], rtol=1e-9, atol=1e-12).y[:2, -1]
    assert np.abs(plain - rigid_body(HARD, HOLLOW, 1.0)[:2]).max() > 1e-3


@pytest.mark.parametrize("ball", [HOLLOW, SOLID], ids=["hollow", "solid"])
def test_constant_tilt_is_the_parabola(ball):
    rig, theta = Rig(ball=ball), (0.08, -0.05)
    n = round(0.6 / TICK_S)
    states = moved(rig, np.zeros((n, 2)), state=tilted(plant.rest(), *theta))
    t = TICK_S * np.arange(n + 1)[:, None]
    pull = FACTOR[ball] * GRAVITY_M_S2 * RATIO * np.sin(theta)
    # Symplectic Euler is half a step ahead: x = a t (t + h)/2.
    np.testing.assert_allclose(states[:, BALL], 0.5 * pull * t * (t + 1e-4), rtol=1e-9, atol=1e-15)


@pytest.mark.parametrize(("ball", "published"), [(Ball(), 1.087), (Ball(hollow=False), 1.294)])
def test_ball_gain_is_the_published_one(ball, published):
    assert Rig(ball=ball).ball_gain_m_s2 == pytest.approx(published, abs=5e-4)
    rig = Rig(ball=replace(ball, mass_kg=0.0))
    states = moved(rig, np.zeros((250, 2)), state=tilted(plant.rest(), 0.01, 0.0))
    assert 2 * states[-1, BALL, 0] / 0.5**2 / 0.01 == pytest.approx(published, rel=1e-3)


def test_eq_15_is_the_linearisation():
    """What Eq. 15 leaves out of a plate at rest shrinks with theta cubed (theta - sin theta)."""
    gain = Rig().ball_gain_m_s2
    gaps = []
    for theta in (0.4, 0.2, 0.1):
        s_x, s_y = plate_sines(theta, 0.0, (RATIO, RATIO), 0.0, 0.0)
        a_x, a_y, _ = rolling(0.1, 0.1, 0.2, 0.2, 0.0, s_x, s_y, 0.0, 0.0, 3 / 5, 0.019625)
        assert a_y == 0.0
        gaps.append(gain * theta - a_x)
    assert gaps[0] / gaps[1] == pytest.approx(8, rel=0.03)
    assert gaps[1] / gaps[2] == pytest.approx(8, rel=0.01)
    assert gaps[2] / (gain * 0.1) == pytest.approx(0.1**2 / 6, rel=0.01)


def test_terms_of_the_moving_plate_as_published():
    """FACTS: x'' = k (g sin(phi_x) + x phi_x'^2 + y phi_x' phi_y') - r phi_x'', near level."""
    rate_x, rate_y, x, y = 0.7, -0.4, 0.09, 0.06
    a_x, a_y, _ = rolling(x, y, 0.0, 0.0, 0.0, 0.02, -0.03, -rate_y, rate_x, 3 / 5, 0.02)
    g = GRAVITY_M_S2
    assert a_x == pytest.approx(3 / 5 * (g * 0.02 + x * rate_x**2 + y * rate_x * rate_y))
    assert a_y == pytest.approx(3 / 5 * (-g * 0.03 + y * rate_y**2 + x * rate_x * rate_y))
    before, after = velocity(0.1, 0.1, 0.0, 0.0, 0.02), velocity(0.1, 0.1, -rate_y, rate_x, 0.02)
    assert after[0] - before[0] == pytest.approx(-0.02 * rate_x)  # the Euler term: -r phi''
    assert after[1] - before[1] == pytest.approx(-0.02 * rate_y)


@pytest.mark.parametrize("ball", [HOLLOW, SOLID], ids=["hollow", "solid"])
def test_energy_on_a_fixed_tilted_plate_is_kept(ball):
    """(1/2) v^2/k - g (s_x x + s_y y) per mass: rolling costs nothing."""
    state = tilted(ball_state((0.05, -0.06), (-0.2, 0.15)), 0.1, -0.12)
    states = moved(Rig(ball=ball), np.zeros((300, 2)), state=state)
    sines = RATIO * np.sin([0.1, -0.12])
    kinetic = 0.5 * (states[:, BALL_W] ** 2).sum(axis=1) / FACTOR[ball]
    energy = kinetic - GRAVITY_M_S2 * states[:, BALL] @ sines
    assert np.ptp(kinetic) > 0.005
    assert np.ptp(energy) < 1e-4 * np.ptp(kinetic) + 1e-6


def test_a_ball_on_a_level_plate_rolls_on_for_ever():
    rig = smooth_rig()
    states = moved(rig, np.zeros((400, 2)), state=ball_state((-0.1, 0.1), (0.2, -0.1)))
    t = TICK_S * np.arange(401)[:, None]
    np.testing.assert_allclose(states[:, BALL], [-0.1, 0.1] + t * [0.2, -0.1], atol=1e-12)


def test_weightless_means_that_the_plate_is_not_loaded():
    assert WEIGHTLESS.rolling_factor == Ball().rolling_factor
    states = moved(smooth_rig(), np.zeros((100, 2)), state=ball_state((0.1, 0.1)))
    assert np.all(states[:, PLATE] == 0.0)
