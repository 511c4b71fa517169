"""A table as another lab would write it: shares no code with the product, one compiled loop.

Each servo is one inertia: tau omega' = K (V - friction) - omega. Plays are stop operators whose
driven side stays where it was left. The ball is Newton and Euler in the plate's frame: position p =
(x, y, r), plate rate O = (o1, o2, 0), ball's own rate w, rolling x' = r (w_2 - o2), y' = -r (w_1 -
o1), contact force F: J (w' + O x w) = -r z x F and m (p'' + 2 O x p' + O' x p + O x (O x p)) = F +
m g. With F eliminated, j = J/(m r^2), k = 1/(1 + j), u = x' + r o2, v = y' - r o1, spin n = w_3:
    u' = k (g s_x + o2^2 x - o1 o2 y) + (1 - k) r n o1,   n' = -(o1 x' + o2 y')/r,
    v' = k (g s_y + o1^2 y - o1 o2 x) + (1 - k) r n o2,   o2 = s_x'/c, o1 = -s_y'/c
(s = sines of the tilt, c = sqrt(1 - s.s); z stays put in the world, so z' = -O x z in the frame).
Midpoint rule (RK2) throughout, at most 0.25 ms a step; per-axis numbers are arrays (2,).
"""

from math import cos, exp, floor, pi, sin, sqrt

import numpy as np
from numba import njit

G = 9.81
RATIO = 2 * 0.0254 / 0.275  # of the linkage, 2 R_d/L
HALF_M = 0.1375
RADIUS_M = 0.019625
COUNT_RAD = 2 * pi / 4096
VOLTS_HOLD_S = 0.002  # servo noise is white down to this time
JET_M, JET_M_S = 0.04, 1.0


@njit(cache=True)
def _held(commands, dt, begin, h):
    """Mean of the held commands over [begin, begin + h]; 0 before the run."""
    if begin + h <= 0.0:
        return 0.0
    first, last = int(floor(begin / dt + 1e-9)), int(floor((begin + h) / dt - 1e-9))
    before = commands[first] if first >= 0 else 0.0
    if first == last:
        return before
    share = (last * dt - begin) / h
    return share * before + (1.0 - share) * commands[last]


@njit(cache=True)
def _at_motor(p, odd, a, volts, other, theta, t):
    """What is left of an axis's volts: sag, dead zone, asymmetry, fading, offset, cogging, cable.

    `volts`, `other`: of this and the other axis, delayed and saturated.
    """
    v = volts * (1.0 - p.sag * (abs(volts) + abs(other)))
    if v > 0.0:
        v = max(v - p.dead_above[a], 0.0) * (1.0 + p.asymmetry[a])
    else:
        v = min(v + p.dead_below[a], 0.0) * (1.0 - p.asymmetry[a])
    v = v * (1.0 - p.fading[a] * t) + p.offset[a]
    if p.cog[a] != 0.0:
        v += p.cog[a] * sin(p.cog_turns[a] * theta + p.cog_phase[a])
    if odd.cable[a] != 0.0:
        side = 1.0 if odd.cable_from[a] >= 0.0 else -1.0
        v -= side * odd.cable[a] * max(side * (theta - odd.cable_from[a]), 0.0)
    return v


@njit(cache=True)
def _servo(p, a, theta, omega, volts, h):
    """theta, omega one step on: dry friction that stops the shaft dead and may hold it."""
    dry = p.friction[a]
    if p.stribeck[a] != 0.0:
        dry += p.stribeck[a] * exp(-((omega / p.stribeck_speed[a]) ** 2))
    if omega == 0.0 and abs(volts) <= dry:
        return theta, 0.0
    way = omega if omega != 0.0 else volts
    net = p.gain[a] * (volts - (dry if way > 0.0 else -dry))
    brake = 1.0 + p.lopsided[a] if way > 0.0 else 1.0 - p.lopsided[a]
    middle = omega + 0.5 * h * (net - brake * omega) / p.tau[a]
    new = omega + h * (net - brake * middle) / p.tau[a]
    if dry > 0.0 and new * way < 0.0:
        new = 0.0
    return theta + 0.5 * h * (omega + new), new


@njit(cache=True)
def _behind(left, drive, width, middle):
    """The angle behind a play: it stays where it was `left` unless it is pushed or pulled."""
    return min(max(left, drive - middle - 0.5 * width), drive - middle + 0.5 * width)


@njit(cache=True)
def _felt(p, a, load, joint):
    """Through ripple, joint and linkage: updates the angle behind the joint; sine that tilts."""
    drive = load[a]
    if p.ripple[a] != 0.0:
        turned = sin(p.ripple_turns[a] * drive + p.ripple_phase[a])
        drive += p.ripple[a] * (turned - sin(p.ripple_phase[a]))
    q = joint[a] = _behind(joint[a], drive, p.joint[a], p.joint_middle[a])
    return sin(q + p.quadratic[a] * q * q + p.cubic[a] * q * q * q)


@njit(cache=True)
def _tilt(p, load, joint, sines):
    """The plate's sines (2,) from the servos' angles behind the gears."""
    x, y = _felt(p, 0, load, joint), _felt(p, 1, load, joint)
    sines[0], sines[1] = RATIO * (x + p.cross[0] * y), RATIO * (y + p.cross[1] * x)


@njit(cache=True)
def _odd_forces(odd, factor, x, y, vx, vy, heavy, t):
    """Accelerations of the ball that are in no catalogue [m/s2]."""
    ax, ay = 0.0, 0.0
    if odd.dent != 0.0:
        dx, dy = (x - odd.dent_at[0]) / odd.dent_width, (y - odd.dent_at[1]) / odd.dent_width
        pull = odd.dent * exp(0.5 * (1.0 - dx * dx - dy * dy))
        ax, ay = -pull * dx, -pull * dy
    if odd.shake[0] != 0.0 or odd.shake[1] != 0.0:
        beat = sin(2 * pi * odd.shake_hz * t + odd.shake_phase)
        ax, ay = ax + odd.shake[0] * beat, ay + odd.shake[1] * beat
    if odd.bump_from <= t < odd.bump_to:
        ax, ay = ax + factor * G * odd.bump[0], ay + factor * G * odd.bump[1]
    if heavy[0] != 0.0 or heavy[1] != 0.0:  # first order in lever/radius
        weight = factor * (G + (vx * vx + vy * vy) / RADIUS_M) / RADIUS_M
        ax, ay = ax + weight * heavy[0], ay + weight * heavy[1]
    if odd.draught != 0.0:
        wind = JET_M_S * exp(-(((y - odd.draught_at) / JET_M) ** 2))
        past = sqrt((wind - vx) ** 2 + vy * vy)
        calm = sqrt(vx * vx + vy * vy)  # still air's share belongs to every table
        push = odd.draught / JET_M_S**2
        ax, ay = ax + push * (past * (wind - vx) + calm * vx), ay + push * (calm - past) * vy
    return ax, ay


@njit(cache=True)
def _slopes(p, odd, b, sx, sy, o1, o2, heavy, t):
    """Time derivatives of b = (x, y, u, v, n) at tilt sines sx, sy, which the level adds to."""
    x, y, k, spin = b[0], b[1], p.factor, (1.0 - p.factor) * RADIUS_M * b[4]
    vx, vy = b[2] - RADIUS_M * o2, b[3] + RADIUS_M * o1
    ax, ay = _odd_forces(odd, k, x, y, vx, vy, heavy, t)
    sx, sy = sx + p.slope[0] + p.slope_rate[0] * t, sy + p.slope[1] + p.slope_rate[1] * t
    ax += k * (G * sx + o2 * o2 * x - o1 * o2 * y) + spin * o1 - p.bowl * x - p.drag * vx
    ay += k * (G * sy + o1 * o1 * y - o1 * o2 * x) + spin * o2 - p.bowl * y - p.drag * vy
    return vx, vy, ax, ay, -(o1 * vx + o2 * vy) / RADIUS_M


@njit(cache=True)
def _moved(b, rate, h):
    x, y, u, v, n = b
    return x + h * rate[0], y + h * rate[1], u + h * rate[2], v + h * rate[3], n + h * rate[4]


@njit(cache=True)
def _roll(p, odd, b, s, s_new, heavy, t, h):
    """The ball one step on; the plate goes from sines s to s_new at a steady rate."""
    sx, sy = 0.5 * (s[0] + s_new[0]), 0.5 * (s[1] + s_new[1])
    c = sqrt(1.0 - sx * sx - sy * sy)
    o1, o2 = -(s_new[1] - s[1]) / (h * c), (s_new[0] - s[0]) / (h * c)
    rate = _slopes(p, odd, b, s[0], s[1], o1, o2, heavy, t)
    middle = _moved(b, rate, 0.5 * h)
    b = _moved(b, _slopes(p, odd, middle, sx, sy, o1, o2, heavy, t + 0.5 * h), h)
    vx, vy = b[2] - RADIUS_M * o2, b[3] + RADIUS_M * o1
    if p.rolling > 0.0:  # takes at most the whole speed: then the ball is stuck
        speed = sqrt(vx * vx + vy * vy)
        loss = min(h * p.rolling / speed, 1.0) if speed > 0.0 else 0.0
        b = (b[0], b[1], b[2] - loss * vx, b[3] - loss * vy, b[4])
    return b, _turned(heavy, -vy / RADIUS_M, vx / RADIUS_M, b[4], h)


@njit(cache=True)
def _turned(e, w1, w2, w3, h):
    """The lever e (3 numbers) a step later on a ball that turns at w; its length stays."""
    if e[0] == 0.0 and e[1] == 0.0 and e[2] == 0.0:
        return e
    f1 = e[0] + 0.5 * h * (w2 * e[2] - w3 * e[1])
    f2 = e[1] + 0.5 * h * (w3 * e[0] - w1 * e[2])
    f3 = e[2] + 0.5 * h * (w1 * e[1] - w2 * e[0])
    g1 = e[0] + h * (w2 * f3 - w3 * f2)
    g2 = e[1] + h * (w3 * f1 - w1 * f3)
    g3 = e[2] + h * (w1 * f2 - w2 * f1)
    keep = sqrt((e[0] ** 2 + e[1] ** 2 + e[2] ** 2) / (g1 * g1 + g2 * g2 + g3 * g3))
    return g1 * keep, g2 * keep, g3 * keep


@njit(cache=True)
def _pilot(q, dt, target, seen, memory, theta, has_ball, volts):
    """Volts (2,) from the newest position `seen`; memory (2, 2): filtered position, integral."""
    gain, soft = min(q.inner, 0.6 / (1.53 * dt)), min(1.0, 0.06 / dt)  # slow loops are soft
    for a in range(2):
        want = target[a]
        if has_ball:
            error = target[a] - seen[a]
            change = (1.0 - exp(-50.0 * dt)) * (seen[a] - memory[0, a])
            memory[0, a], speed = memory[0, a] + change, change / dt
            want = soft * (soft * q.p * error - q.d * speed) + memory[1, a]
            if abs(want) < q.angle:
                step = memory[1, a] + soft**3 * q.i * error * dt
                memory[1, a] = min(max(step, -q.windup), q.windup)
        want = min(max(want, -q.angle), q.angle)
        volts[a] = min(max(gain * (want - theta[a]), -q.volts), q.volts)


@njit(cache=True)
def _look(eye, frame, x, y, out):
    """What the camera measures of (x, y) in this frame, and when it says it saw it -> out (3,)."""
    grow = (1.0 + eye.scale) * (1.0 + eye.k1 * (x * x + y * y))
    c, s = cos(eye.yaw), sin(eye.yaw)
    out[0] = grow * (c * x - s * y) + frame[1]
    out[1] = grow * (s * x + c * y) + frame[2]
    out[2] = frame[0] + eye.extra


@njit(cache=True)
def _handed_over(eye, frames, shots, given, taken, t, seen, row):
    """Frames whose time has come go to `seen` (2,) and the row, in place; how many are given."""
    while given < taken and shots[given, 2] + eye.delay <= t + 1e-9:
        if frames[given, 3] == 0.0:
            seen[:] = shots[given, :2]
            row[5:7] = seen
            row[12] = shots[given, 2]
        given += 1
    return given


@njit(cache=True)
def _drives(p, odd, commands, dt, noise, motor, load, t, h):
    """Both servos one step on: motor (2, 2) angles and rates, load (2,) angles, in place."""
    x = _held(commands[0], dt, t - p.delay[0], h)
    y = _held(commands[1], dt, t - p.delay[1], h)
    x, y = min(max(x, -p.limit[0]), p.limit[0]), min(max(y, -p.limit[1]), p.limit[1])
    for a in range(2):
        here, other = (x, y) if a == 0 else (y, x)
        v = _at_motor(p, odd, a, here, other, motor[0, a], t) + noise[a]
        motor[0, a], motor[1, a] = _servo(p, a, motor[0, a], motor[1, a], v, h)
        load[a] = _behind(load[a], motor[0, a], p.gear[a], p.gear_middle[a])


@njit(cache=True)
def run(p, eye, odd, pilot, course):
    """Rows (n, 13) of t, V, theta, ball, motor speed, target, push, exposed; and how many count.

    p, eye, odd, pilot: packed records; course: a `Course`. Fewer rows than asked for count where
    the ball's contact point left the plate. The plate starts level, at rest.
    """
    n, dt, sub = len(course.target), course.dt, course.sub
    h = dt / sub
    rows, commands = np.full((n, 13), np.nan), np.zeros((2, n))
    motor, volts, theta = np.zeros((2, 2)), np.zeros(2), np.zeros(2)
    load = 0.5 * p.gear * course.left[:2] - p.gear_middle
    joint = load + 0.5 * p.joint * course.left[2:] - p.joint_middle
    s, s_new, b = np.zeros(2), np.zeros(2), course.ball
    ball, heavy = (b[0], b[1], b[2], b[3], b[4]), (odd.heavy[0], odd.heavy[1], odd.heavy[2])
    _tilt(p, load, joint, s)
    memory, seen = np.zeros((2, 2)), course.ball[:2].copy()
    memory[0] = seen
    shots, taken, given = np.zeros((len(course.frames), 3)), 0, 0
    for i in range(n):
        t, row = i * dt, rows[i]
        given = _handed_over(eye, course.frames, shots, given, taken, t, seen, row)
        theta[:] = np.floor(load / COUNT_RAD + 0.5) * COUNT_RAD
        _pilot(pilot, dt, course.target[i], seen, memory, theta, course.has_ball, volts)
        commands[:, i] = volts
        row[0], row[1:3], row[3:5], row[7:9] = t, volts, theta, motor[1]
        row[9:11], row[11] = course.target[i], 1.0 if course.push[i].any() else 0.0
        for j in range(sub):
            now = t + j * h
            noise = course.volts_noise[int(now / VOLTS_HOLD_S)]
            _drives(p, odd, commands, dt, noise, motor, load, now, h)
            if not course.has_ball:
                continue
            _tilt(p, load, joint, s_new)
            x, y = ball[0], ball[1]
            ball, heavy = _roll(p, odd, ball, s, s_new, heavy, now, h)
            kick_x = h * course.push[i, 0] + course.kicks[i * sub + j, 0]
            kick_y = h * course.push[i, 1] + course.kicks[i * sub + j, 1]
            ball = (ball[0], ball[1], ball[2] + kick_x, ball[3] + kick_y, ball[4])
            s[0], s[1] = s_new[0], s_new[1]
            if taken < len(shots) and course.frames[taken, 0] <= now + h:
                part = (course.frames[taken, 0] - now) / h
                where_x, where_y = x + part * (ball[0] - x), y + part * (ball[1] - y)
                _look(eye, course.frames[taken], where_x, where_y, shots[taken])
                taken += 1
        if abs(ball[0]) > HALF_M or abs(ball[1]) > HALF_M:
            return rows, i + 1
    return rows, n
