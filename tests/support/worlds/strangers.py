"""Effects that no catalogue has: "unknown" is the right answer."""

import numpy as np

from tests.support.worlds.belts import Belt, belt_log
from tests.support.worlds.logs import World, axis_log, rig_toml, table_log, truth

ROWS = 20000  # 40 s


def unknown(columns: dict, *accepted: str) -> World:
    """The log of a table with something that has no name."""
    return columns, rig_toml(), truth({}, *accepted, kind="unknown")


def heavy_sided_ball(seed: int) -> World:
    """Centre of mass 0.2 mm off the centre: up to 0.06 m/s2, turning with the ball."""
    rng = np.random.default_rng(seed)
    return unknown(table_log(rng, {}, {"off_centre_m": 0.0002}, {}))


def wavy_plate(seed: int) -> World:
    """Five waves of 40 to 110 mm in random directions, slopes of 4 mrad each."""
    rng = np.random.default_rng(seed)
    number, way = 2.0 * np.pi / rng.uniform(0.04, 0.11, 5), rng.uniform(0.0, np.pi, 5)
    waves = [np.full(5, 0.004), number * np.cos(way), number * np.sin(way), rng.uniform(0, 6.3, 5)]
    return unknown(table_log(rng, {}, {"waves": np.stack(waves, axis=1)}, {}))


def felt_on_one_half(seed: int) -> World:
    """The half of the plate where x > 0 brakes the ball by 0.06 m/s2, the other hardly."""
    rng = np.random.default_rng(seed)
    return unknown(table_log(rng, {}, {"felt_m_s2": 0.06}, {}))


def slipping_encoder(seed: int) -> World:
    """The encoder's wheel slips by up to 1.5 degrees, eight times in 40 s."""
    rng = np.random.default_rng(seed)
    jumps = np.zeros((ROWS, 2))
    jumps[rng.integers(1000, ROWS - 500, 8), rng.integers(0, 2, 8)] = rng.uniform(-0.026, 0.026, 8)
    return unknown(table_log(rng, {}, {}, {}, slipped=np.cumsum(jumps, axis=0)))


def pendulum(seed: int) -> World:
    """A rod on the arm: V - 0.5 V sin(theta); equal to `cogging` with one period a turn."""
    rng = np.random.default_rng(seed)
    return unknown(axis_log(rng, {"pendulum_V": 0.5}, target_rad=1.5), "cogging")


def cable(seed: int) -> World:
    """A cable pulls like a spring of 3 V/rad beyond 0.1 rad, on one side alone."""
    rng = np.random.default_rng(seed)
    columns = axis_log(rng, {"spring_V_rad": 3.0, "spring_from_rad": 0.1}, target_rad=0.6)
    return unknown(columns)


def elastic_belt(seed: int) -> World:
    """A quarter to a third of the inertia hangs behind a belt that swings at 6 to 12 Hz."""
    rng = np.random.default_rng(seed)
    belt = Belt(rng.uniform(0.25, 0.35), rng.uniform(6.0, 12.0), rng.uniform(0.03, 0.1))
    return unknown(belt_log(rng, belt))


def twisting_plate(seed: int) -> World:
    """The plate's joints twist: it swings at 3 to 7 Hz behind the servos, whose angle is read."""
    rng = np.random.default_rng(seed)
    swing = {"swing_hz": rng.uniform(3.0, 7.0), "swing_damping": rng.uniform(0.03, 0.25)}
    return unknown(table_log(rng, {}, swing, {}))


def centred_play(seed: int) -> World:
    """A spring holds the joints in the middle of their play of 12 to 25 mrad either way: there the
    plate turns by a third of its servo's angle."""
    rng = np.random.default_rng(seed)
    return unknown(table_log(rng, {}, {"centred_rad": rng.uniform(0.012, 0.025)}, {}))


def losing_bridge(seed: int) -> World:
    """The bridge loses 0.1 to 0.25 V against the sign of the motor's current."""
    rng = np.random.default_rng(seed)
    return unknown(table_log(rng, {"bridge_V": rng.uniform(0.1, 0.25, 2)}, {}, {}))


def fan(seed: int) -> World:
    """Gusts of 0.12 m/s2 towards +x and +y/2, one to three seconds long, a third of the time."""
    rng = np.random.default_rng(seed)
    push, row = np.zeros((ROWS, 2)), 0
    while row < ROWS:
        start = row + int(rng.uniform(2.0, 6.0) * 500)
        row = start + int(rng.uniform(1.0, 3.0) * 500)
        push[start:row] = 0.12, 0.06
    return unknown(table_log(rng, {}, {}, {}, push=push, size_m=0.07))


def swaying_floor(seed: int) -> World:
    """The floor leans by 4 mrad, at 0.2 to 0.45 Hz of its own about each axis, as on a boat."""
    rng = np.random.default_rng(seed)
    t_s = np.arange(ROWS)[:, None] / 500.0
    hz, begin = rng.uniform(0.2, 0.45, 2), rng.uniform(0.0, 6.3, 2)
    push = 5.0 / 7.0 * 9.81 * 0.004 * np.sin(2.0 * np.pi * hz * t_s + begin)
    return unknown(table_log(rng, {}, {}, {}, push=push, size_m=0.07))


def slipping_ball(seed: int) -> World:
    """An oily plate: friction coefficient 0.006, the ball slides where the plate is steep."""
    rng = np.random.default_rng(seed)
    return unknown(table_log(rng, {}, {"mu": 0.006}, {}))


def rubbing_tooth(seed: int) -> World:
    """A tooth that rubs: at one angle of each servo 0.3 to 0.6 V more of dry friction."""
    rng = np.random.default_rng(seed)
    tooth = {"tooth_V": rng.uniform(0.3, 0.6, 2), "tooth_rad": rng.uniform(-0.1, 0.1, 2)}
    return unknown(table_log(rng, tooth, {}, {}))


def one_way_friction(seed: int) -> World:
    """Dry friction F of 0.15 to 0.3 V in one direction of the turn alone: while it turns equal to
    a friction of F/2 and an offset of -F/2."""
    rng = np.random.default_rng(seed)
    columns = table_log(rng, {"one_way_V": rng.uniform(0.15, 0.3, 2)}, {}, {})
    return unknown(columns, "coulomb_friction", "voltage_offset")


def _smoothed(frames: np.ndarray, share: float) -> np.ndarray:
    """Frames (n,), NaN where none came, by the recursion s += share (frame - s)."""
    seen = np.flatnonzero(np.isfinite(frames))
    out, value = frames.copy(), frames[seen[0]]
    for row in seen:
        value += share * (frames[row] - value)
        out[row] = value
    return out


def smoothing_tracker(seed: int) -> World:
    """A tracker that smooths places with a time constant of 40 to 100 ms."""
    rng = np.random.default_rng(seed)
    columns = table_log(rng, {}, {}, {})
    share = 1.0 - np.exp(-1.0 / 60.0 / rng.uniform(0.04, 0.1))
    for name in ("ball_x_m", "ball_y_m"):
        columns[name] = _smoothed(columns[name], share)
    return unknown(columns, "camera_delay")


def losing_encoder(seed: int) -> World:
    """An encoder that loses 3 to 6 % of its counts where the servo turns faster than 1.2 rad/s."""
    rng = np.random.default_rng(seed)
    columns, lost = table_log(rng, {}, {}, {}), rng.uniform(0.03, 0.06)
    for name in ("theta_x_rad", "theta_y_rad"):
        turned = np.diff(columns[name], prepend=columns[name][:1])
        speed = np.convolve(turned * 500.0, np.full(9, 1.0 / 9.0), mode="same")
        columns[name] = np.cumsum(np.where(np.abs(speed) > 1.2, 1.0 - lost, 1.0) * turned)
    return unknown(columns)


def heating_motors(seed: int) -> World:
    """Motors that lose 10 to 20 % of their gain as they heat up, with a time constant of 15 s."""
    rng = np.random.default_rng(seed)
    columns, lost = table_log(rng, {}, {}, {}), rng.uniform(0.1, 0.2)
    gain = 1.0 - lost * (1.0 - np.exp(-columns["t_s"] / 15.0))
    for name in ("voltage_x_V", "voltage_y_V"):
        columns[name] = columns[name] / gain
    return unknown(columns, "gain_drift")


def yielding_mount(seed: int) -> World:
    """A camera whose mount gives way: the picture moves by 4 to 10 mm for each radian of an arm."""
    rng = np.random.default_rng(seed)
    columns, gives = table_log(rng, {}, {}, {}), rng.uniform(0.004, 0.01, 2)
    for name, angle, m_rad in zip(
        ("ball_x_m", "ball_y_m"), ("theta_x_rad", "theta_y_rad"), gives, strict=True
    ):
        columns[name] = columns[name] + m_rad * columns[angle]
    return unknown(columns)


def smoothed_angles(seed: int) -> World:
    """Angles that the recorder smooths with a time constant of 8 to 20 ms: a camera that is earlier
    by as much."""
    rng = np.random.default_rng(seed)
    columns = table_log(rng, {}, {}, {})
    share = 1.0 - np.exp(-0.002 / rng.uniform(0.008, 0.02))
    for name in ("theta_x_rad", "theta_y_rad"):
        columns[name] = _smoothed(columns[name], share)
    return unknown(columns, "camera_delay")
