"""Tables whose servos take an angle: RC or bus servos on two rods, three arms, and what they lack.
Random steps for a PD; a frame a row, 33 to 100 rows a second."""

import numpy as np

from tests.support.worlds.angle_loops import run_commanded
from tests.support.worlds.angle_servos import Frame, Servos, fallen_axes, level_arm_rad, solve
from tests.support.worlds.logs import (
    DEG,
    SOLID,
    World,
    ball,
    coloured,
    loop,
    rig_toml,
    steps,
    truth,
)

RADIUS_m, MASS_kg = 0.015, 0.05
RODS = Frame(False, 0.024, np.array([0.15, 0.12]), 0.075, 0.0, 0.0, 0.0)
ARMS = Frame(True, 0.045, np.ones(2), 0.09, 0.055, 0.08, 0.105)
# What the rig files say of each table: servos, frame, side of the plate, rows a second, camera.
RC = {"lag_s": 0.05, "dead_time_s": 0.008, "rate_limit_rad_s": 6.0, "dead_band_rad": 0.003}
RC |= {"quantum_rad": 0.0016, "period_s": 0.02}
BUS = {"lag_s": 0.035, "dead_time_s": 0.015, "rate_limit_rad_s": 4.8, "dead_band_rad": 0.0045}
BUS |= {"quantum_rad": 0.00153, "period_s": 0.0}
LEGS = {"lag_s": 0.03, "dead_time_s": 0.0, "rate_limit_rad_s": 5.0, "dead_band_rad": 0.002}
LEGS |= {"quantum_rad": 0.0018, "period_s": 0.02}
TABLES = {
    "rc": (RC, RODS, 0.28, 50.0, 0.02),
    "bus": (BUS, RODS, 0.28, 100.0, 0.015),
    "pulsed bus": (BUS | {"period_s": 0.01}, RODS, 0.28, 100.0, 0.015),
    "slow": (RC | {"period_s": 0.0}, RODS, 0.28, 100.0 / 3.0, 0.03),
    "legs": (LEGS, ARMS, 0.24, 50.0, 0.02),
    "bus legs": (BUS, ARMS, 0.24, 100.0, 0.015),
}
READ_BACK = ("bus", "pulsed bus", "bus legs")


def _servos(rng: np.random.Generator, file: dict, n: int, changes: dict, swing_hz: float) -> Servos:
    """The file's n servos with faults inside half of the default tolerances, then the changes: each
    is added, but for a rate, which is the lower one."""
    true = {
        "lag_s": file["lag_s"] + rng.uniform(-0.0025, 0.0025, n),
        "dead_time_s": file["dead_time_s"] + rng.uniform(0.0, 0.0015, n),
        "rate_rad_s": np.full(n, file["rate_limit_rad_s"]),
        "band_rad": file["dead_band_rad"] + rng.uniform(0.0, 0.05 * DEG, n),
        "scale": rng.uniform(-0.005, 0.005, n),
        "zero_rad": rng.uniform(-0.05 * DEG, 0.05 * DEG, n),
    }
    true |= {k: np.zeros(n) for k in ("motor_s", "pull_rad", "cable_1", "sway_rad", "begin_s")}
    play_rad = rng.uniform(0.0, 0.04 * DEG, 2)
    for key, change in changes.items():
        more = np.asarray(change, float)
        true[key] = np.minimum(true[key], more) if key == "rate_rad_s" else true[key] + more
    shared = {"quantum_rad": file["quantum_rad"], "period_s": file["period_s"]}
    return Servos(
        **true, **shared, play_rad=play_rad, swing_hz=np.full(2, swing_hz), friction_nm=0.004
    )


def _rig(table: str) -> str:
    file, frame, side_m, rows_hz, delay_s = TABLES[table]
    linkage = {"kind": '"three-arms"', "plate_side_m": side_m, "arm_radius_m": frame.arm_m}
    linkage |= {"rod_length_m": frame.rod_m, "base_radius_m": frame.base_m}
    linkage |= {"plate_radius_m": frame.plate_m, "height_m": frame.height_m}
    if not frame.three:
        linkage = {"arm_radius_m": frame.arm_m, "rod_length_m": frame.rod_m}
        linkage |= {f"{a}.plate_side_m": 2.0 * frame.lever_m[i] for i, a in enumerate("xy")}
    most = {"angle_limit_rad": 0.2 if frame.three else 0.5, "stop_rad": 1.2}
    most["angle_measured"] = table in READ_BACK
    return rig_toml(
        top={"control_rate_hz": rows_hz},
        servo={"kind": '"position"', **file, **most},
        linkage=linkage,
        ball={"hollow": False, "radius_m": RADIUS_m, "mass_kg": MASS_kg},
        camera={"rate_hz": rows_hz, "delay_s": delay_s, "noise_m": 0.0003},
    )


def log_of(
    rng: np.random.Generator,
    table: str,
    servo: dict | None = None,
    plate: dict | None = None,
    scale: float = 0.0,
    late_s: float = 0.0,
    pushed: np.ndarray | float = 0.0,
    swing_hz: float = 0.0,
    seconds: float = 60.0,
) -> dict[str, np.ndarray]:
    """Random steps of up to 5 cm, smaller ones where the ball would fall; see the module. `pushed`:
    more acceleration of the ball (rows, 2) [m/s2]."""
    file, frame, side_m, rows_hz, delay_s = TABLES[table]
    servos = _servos(rng, file, 3 if frame.three else 2, servo or {}, swing_hz)
    n = int(seconds * rows_hz)
    flaws = {"level_rad": rng.uniform(-0.01 * DEG, 0.01 * DEG, 2), "bowl_1_s2": 0.0}
    flaws |= {"rolling_m_s2": rng.uniform(0.0, 0.0007)}
    for key, more in (plate or {}).items():
        flaws[key] = flaws[key] + more
    b = ball(spin=SOLID, radius_m=RADIUS_m, arm_m=0.5 * side_m, side_m=side_m, **flaws)
    lever = 1.0 if frame.three else frame.arm_m / frame.lever_m.mean()
    late = delay_s + file["lag_s"] + file["dead_time_s"] + 0.5 * file["period_s"] + 0.5 / rows_hz
    speed, factor = 0.28 / late, SOLID / (1.0 + SOLID) * 9.81 * lever
    speed = min(speed, 3.0)
    gains = {"kp_rad_m": speed**2 / factor, "kd_rad_s_m": 1.6 * speed / factor}
    gains["ki_rad_m_s"] = 0.15 * gains["kp_rad_m"] * speed
    settings = loop(
        rows_hz=rows_hz,
        delay_s=delay_s + late_s + rng.uniform(-0.001, 0.001),
        scale=scale + rng.uniform(-0.0015, 0.0015),
        yaw_rad=rng.uniform(-0.075, 0.075) * DEG,
        speed_filter_s=0.1,
        angle_limit_rad=0.2 if frame.three else 0.5,
        **gains,
    )
    push = coloured(rng, (n, 2), 0.005, 0.05, rows_hz) + pushed
    noise = rng.normal(0.0, 0.0003, (n, 2))
    targets = np.stack([steps(rng, n, rows_hz, 0.05, (1.5, 4.0)) for _ in range(2)], axis=1)
    level = level_arm_rad(frame) if frame.three else 0.0
    names = "command_x_rad command_y_rad theta_x_rad theta_y_rad ball_x_m ball_y_m".split()
    for shrink in (1.0, 0.8, 0.6, 0.4, 0.2):
        log = run_commanded(
            b, MASS_kg, servos, frame, level, settings, shrink * targets, push, noise
        )
        if np.abs(log[:, 4:]).max() < 0.5 * side_m:
            break
    else:
        raise RuntimeError(f"the ball fell at x, y of {np.abs(log[:, 4:]).max(axis=0)} m")
    columns = {"t_s": np.arange(n) / rows_hz} | dict(zip(names, log.T, strict=True))
    unread = () if table in READ_BACK else ("theta_x_rad", "theta_y_rad")
    return {name: column for name, column in columns.items() if name not in unread}


def world_of(found: dict, table: str, seed: int, *accepted: str, **changes) -> World:
    columns = log_of(np.random.default_rng(seed), table, **changes)
    kind = {} if found else {"kind": "healthy"}
    return columns, _rig(table), truth(found, *accepted, **kind)


def healthy_rc_servos(seed: int) -> World:
    """RC servos on 20 ms pulses, two rods, 50 rows a second; small faults alone."""
    return world_of({}, "rc", seed)


def healthy_slow_rows(seed: int) -> World:
    """The same servos without a clock of their own, told 33 times a second."""
    return world_of({}, "slow", seed)


def healthy_three_arms(seed: int) -> World:
    """Three arms, 50 rows a second; small faults alone."""
    return world_of({}, "legs", seed)


def healthy_bus_servos(seed: int) -> World:
    """Servos that read their angle back, 100 rows a second; small faults alone."""
    return world_of({}, "bus", seed)


def healthy_slow_motors(seed: int) -> World:
    """Bus servos whose motors take up speed in 15 ms, and whose file is a fit of a lag and a dead
    time to their step: to 1/(T M s^2 + T s + 1) with T of 50 and M of 15 ms that is 38 and 14 ms.
    """
    servo = {"motor_s": 0.015, "lag_s": 0.015, "dead_time_s": -0.015}
    return world_of({}, "bus", seed, servo=servo)


def healthy_pd_servos(seed: int) -> World:
    """Bus servos whose file tells their lag, damping over stiffness, and not their inertia."""
    return world_of({}, "bus", seed, servo={"motor_s": 0.01})


def late_pd_servo(seed: int) -> World:
    """The same whose lag in x is 20 ms longer than their file's."""
    servo = {"motor_s": 0.01, "lag_s": (0.02, 0.0)}
    return world_of({"servo_lag": {"x": {"lag_s": 0.02}}}, "bus", seed, servo=servo)


def far_pd_servo(seed: int) -> World:
    """The same that turn 7 % further than told in x, in y 5 % less far."""
    size = {"x": {"fraction": 0.07}, "y": {"fraction": -0.05}}
    servo = {"motor_s": 0.01, "scale": (0.07, -0.05)}
    return world_of({"angle_scale": size}, "bus", seed, servo=servo)


WAITS = {"begin_s": (0.013, 0.006)}


def healthy_waiting_rc_servos(seed: int) -> World:
    """RC servos whose pulses come 13 and 6 ms after the rows; small faults alone."""
    return world_of({}, "rc", seed, servo=WAITS)


def healthy_waiting_bus_servos(seed: int) -> World:
    """Bus servos that are told theirs 3 and 6 ms after the rows, once a row; likewise."""
    return world_of({}, "pulsed bus", seed, servo=WAITS)


def dead_waiting_bus_servo(seed: int) -> World:
    """The same, and 30 ms more dead time in x."""
    found, late = {"servo_dead_time": {"x": {"delay_s": 0.03}}}, {"dead_time_s": (0.03, 0.0)}
    return world_of(found, "pulsed bus", seed, servo=WAITS | late)


def late_servo(seed: int) -> World:
    """40 ms more lag in x, 30 ms in y."""
    size = {"x": {"lag_s": 0.04}, "y": {"lag_s": 0.03}}
    return world_of({"servo_lag": size}, "rc", seed, servo={"lag_s": (0.04, 0.03)})


def dead_servo(seed: int) -> World:
    """25 ms more dead time on both axes."""
    size = {"x": {"delay_s": 0.025}, "y": {"delay_s": 0.025}}
    found = {"servo_dead_time|camera_delay": size}
    return world_of(found, "slow", seed, servo={"dead_time_s": 0.025})


def weak_servo(seed: int) -> World:
    """The servos turn at 0.9 rad/s at most, where the file says 6."""
    size = {"x": {"limit_rad_s": 0.9}, "y": {"limit_rad_s": 0.9}}
    return world_of({"rate_limit": size}, "rc", seed, servo={"rate_rad_s": 0.9})


def lazy_servo(seed: int) -> World:
    """0.6 degree more dead band in x."""
    found = {"command_dead_band": {"x": {"half_width_rad": 0.6 * DEG}}}
    return world_of(found, "rc", seed, servo={"band_rad": (0.6 * DEG, 0.0)})


def far_servo(seed: int) -> World:
    """The servos turn 7 % further than told, in y 5 % less far."""
    found = {"angle_scale": {"x": {"fraction": 0.07}, "y": {"fraction": -0.05}}}
    return world_of(found, "rc", seed, servo={"scale": (0.07, -0.05)})


def crooked_servo(seed: int) -> World:
    """The servo of x stands 1.2 degrees beside the angle that it is told."""
    zero = 1.2 * DEG
    found = {"level_offset|angle_zero": {"x": {"slope_rad": zero * RODS.arm_m / RODS.lever_m[0]}}}
    return world_of(found, "rc", seed, servo={"zero_rad": (zero, 0.0)})


def crooked_bus_servo(seed: int) -> World:
    """A servo that reads its angle back stands 0.5 degree beside its command; no tilt is off."""
    found = {"angle_zero": {"x": {"offset_rad": 0.5 * DEG}}}
    return world_of(found, "bus", seed, servo={"zero_rad": (0.5 * DEG, 0.0)})


def late_bus_servo(seed: int) -> World:
    """Servos that read their angle back: 15 ms more lag in x, 10 ms more dead time in y."""
    found = {
        "servo_lag": {"x": {"lag_s": 0.015}},
        "servo_dead_time": {"y": {"delay_s": 0.01}},
    }
    late = {"lag_s": (0.015, 0.0), "dead_time_s": (0.0, 0.01)}
    return world_of(found, "bus", seed, servo=late)


def late_bus_camera(seed: int) -> World:
    """Servos that read their angle back are as the file says; the camera is 20 ms later."""
    columns = log_of(np.random.default_rng(seed), "bus", late_s=0.02)
    return columns, _rig("bus"), truth({"camera_delay": {"xy": {"extra_s": 0.02}}})


def sprung_bus_servo(seed: int) -> World:
    """A spring on a gear draws the servo of x off by up to 1 degree, with the sine of its angle;
    the servos read their angle back."""
    columns = log_of(np.random.default_rng(seed), "bus", servo={"pull_rad": (1.0 * DEG, 0.0)})
    return columns, _rig("bus"), truth({}, kind="unknown")


def cable_bus_servo(seed: int) -> World:
    """A cable draws the servo of x back by 15 % of its way beyond 0.05 rad, on one side; the servos
    read their angle back."""
    columns = log_of(np.random.default_rng(seed), "bus", servo={"cable_1": (0.15, 0.0)})
    return columns, _rig("bus"), truth({}, kind="unknown")


def swaying_bus_servo(seed: int) -> World:
    """A servo that reads its angle back swings by 0.3 degree about what y is told, 1.7 Hz."""
    columns = log_of(np.random.default_rng(seed), "bus", servo={"sway_rad": (0.0, 0.3 * DEG)})
    return columns, _rig("bus"), truth({}, kind="unknown")


def elastic_plate(seed: int) -> World:
    """The plate swings behind its rods at 3 to 6 Hz."""
    rng = np.random.default_rng(seed)
    return log_of(rng, "rc", swing_hz=rng.uniform(3.0, 6.0)), _rig("rc"), truth({}, kind="unknown")


def healthy_bus_arms(seed: int) -> World:
    """Three arms whose servos read their angle back, 100 rows a second; small faults alone."""
    return world_of({}, "bus legs", seed)


def late_bus_arms(seed: int) -> World:
    """Three arms that read their angle back: each has 15 ms more lag."""
    size = {"x": {"lag_s": 0.015}, "y": {"lag_s": 0.015}}
    return world_of({"servo_lag": size}, "bus legs", seed, servo={"lag_s": 0.015})


def late_bus_arm(seed: int) -> World:
    """The one of them that stands on the x axis has 20 ms more lag."""
    found = {"servo_lag": {"x": {"lag_s": 0.02}}}
    return world_of(found, "bus legs", seed, servo={"lag_s": (0.02, 0.0, 0.0)})


def weak_bus_arms(seed: int) -> World:
    """Each of them turns at 0.4 rad/s at most, where the file says 4.8."""
    size = {"x": {"limit_rad_s": 0.4}, "y": {"limit_rad_s": 0.4}}
    return world_of({"rate_limit": size}, "bus legs", seed, servo={"rate_rad_s": 0.4})


def lazy_bus_arms(seed: int) -> World:
    """Each of them has 0.6 degree more dead band."""
    size = {"x": {"half_width_rad": 0.6 * DEG}, "y": {"half_width_rad": 0.6 * DEG}}
    return world_of({"command_dead_band": size}, "bus legs", seed, servo={"band_rad": 0.6 * DEG})


def far_bus_arm(seed: int) -> World:
    """The one on the x axis turns 9 % further than told: two thirds of that in the plate's x."""
    found = {"angle_scale": {"x": {"fraction": 0.06}}}
    return world_of(found, "bus legs", seed, servo={"scale": (0.09, 0.0, 0.0)})


def crooked_bus_arm(seed: int) -> World:
    """The one 120 degrees from it stands 1 degree too high, so that the plate falls both ways."""
    arms = np.array([0.0, 1.0 * DEG, 0.0]) + level_arm_rad(ARMS)
    pose = np.array([0.0, 0.0, 0.0, 0.0, 0.0, ARMS.height_m])
    solve(pose, arms, ARMS)
    x, y = fallen_axes(pose)
    found = {"angle_zero": {"x": {"offset_rad": x}, "y": {"offset_rad": y}}}
    return world_of(found, "bus legs", seed, servo={"zero_rad": (0.0, 1.0 * DEG, 0.0)})


def crooked_plate(seed: int) -> World:
    """Three arms that stand 0.4 degree off level in y."""
    found = {"level_offset|angle_zero": {"y": {"slope_rad": 0.4 * DEG}}}
    return world_of(found, "legs", seed, plate={"level_rad": np.array([0.0, 0.4 * DEG])})


def far_camera(seed: int) -> World:
    """The camera sees distances 5 % too long."""
    size = {"x": {"fraction": 0.05}, "y": {"fraction": 0.05}}
    return world_of({"angle_scale|camera_scale": size}, "slow", seed, scale=0.05)


def curved_plate(seed: int) -> World:
    """A hill of 0.4 1/s2."""
    found = {"plate_bowl": {"xy": {"stiffness_1_s2": -0.4}}}
    return world_of(found, "rc", seed, plate={"bowl_1_s2": -0.4})


def sinking_level(seed: int) -> World:
    """The level of y changes by 1.5e-4 rad/s (0.5 degree in a run)."""
    found = {"level_drift": {"y": {"rate_rad_s": 1.5e-4}}}
    grows_m_s3 = 9.81 * SOLID / (1.0 + SOLID) * np.array([0.0, 1.5e-4])
    grown = np.arange(3000)[:, None] / 50.0 * grows_m_s3
    return world_of(found, "rc", seed, "level_offset", pushed=grown)


WORLDS = (
    healthy_rc_servos,
    healthy_slow_rows,
    healthy_three_arms,
    healthy_bus_servos,
    healthy_waiting_rc_servos,
    healthy_waiting_bus_servos,
    dead_waiting_bus_servo,
    healthy_slow_motors,
    healthy_pd_servos,
    late_pd_servo,
    far_pd_servo,
    late_servo,
    dead_servo,
    weak_servo,
    lazy_servo,
    far_servo,
    crooked_servo,
    crooked_bus_servo,
    late_bus_servo,
    sprung_bus_servo,
    cable_bus_servo,
    swaying_bus_servo,
    elastic_plate,
    healthy_bus_arms,
    late_bus_arms,
    late_bus_arm,
    weak_bus_arms,
    lazy_bus_arms,
    far_bus_arm,
    crooked_bus_arm,
    crooked_plate,
    late_bus_camera,
    far_camera,
    curved_plate,
    sinking_level,
)
