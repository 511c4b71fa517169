"""Closed-loop logs of a table that shares no code with the product: one call, one log.

`make_log` draws all that is small or random from the seed, runs the compiled table and returns the
columns of the log contract; `hidden` says afterwards what was in it.
"""

import csv
from collections.abc import Callable
from math import ceil
from pathlib import Path
from typing import NamedTuple

import numpy as np

from experiments.benchmark.engines.foreign.parts import Course, Eye, Odd, Pilot, Plant, packed
from experiments.benchmark.engines.foreign.plant import VOLTS_HOLD_S, run
from experiments.benchmark.engines.foreign.protocols import PROTOCOLS, SERVO_ONLY, ask
from experiments.benchmark.engines.foreign.truth import (
    SERVO_SPREAD,
    Effects,
    imperfections,
    merged,
    plant_and_eye,
    strange,
)

STEP_S = 0.25e-3
CAMERA_HZ, CAMERA_DELAY_S, NOISE_M = 60.0, 0.012, 0.0003
BALL_PROCESS = 0.002  # m/s/sqrt(s)
SERVO_PROCESS = 5e-4  # V sqrt(s)
TACHOMETER_RAD_S = 0.005
NOMINAL_GAIN, NOMINAL_TAU = (1.53, 1.53), (0.025, 0.025)
COLUMNS: tuple[str, ...] = (
    *("t_s", "voltage_x_V", "voltage_y_V", "theta_x_rad", "theta_y_rad", "ball_x_m", "ball_y_m"),
    *("motor_speed_x_rad_s", "motor_speed_y_rad_s", "target_x_m", "target_y_m", "push"),
    "ball_exposed_s",
)


# From plant, eye, oddities, pilot and course to rows (m, 13) in the order of COLUMNS.
Mechanism = Callable[[Plant, Eye, Odd, Pilot, Course], np.ndarray]


class Hidden(NamedTuple):
    """The truth of a log: K and tau (2,), effects as in a rig file, the stranger's numbers."""

    gain: np.ndarray
    tau: np.ndarray
    effects: dict[str, dict[str, dict[str, float]]]
    odd: Odd


def streams_of(seed: int) -> list[np.random.Generator]:
    """Truth, strangers, protocol, camera, process, start: one draw more in one moves no other."""
    return [np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(6)]


def hidden(
    *,
    effects: Effects | None,
    seed: int,
    seconds: float,
    imperfect: bool = True,
    gain=NOMINAL_GAIN,
    tau=NOMINAL_TAU,
    stranger: tuple[str, float] | None = None,
) -> Hidden:
    """What `make_log` with the same arguments hides in a log of this length."""
    truth, others, *_ = streams_of(seed)
    spread = truth.uniform(-SERVO_SPREAD, SERVO_SPREAD, (2, 2)) * (1.0 if imperfect else 0.0)
    small = imperfections(truth) if imperfect else {}
    gains, taus = np.array([gain, tau]) * (1 + spread)
    return Hidden(gains, taus, merged(small, effects or {}), strange(stranger, others, seconds))


def _frames(rng, seconds: float, *, noise_m: float, colour: float, dropout: float) -> np.ndarray:
    """Exposures at 60 Hz from a random phase, AR(1) noise of this standard deviation, losses."""
    at = np.arange(rng.uniform(), seconds * CAMERA_HZ, 1.0) / CAMERA_HZ
    white = rng.standard_normal((len(at), 2))
    lost = rng.uniform(size=len(at)) < dropout
    noise = white.copy()
    for k in range(1, len(at)):
        noise[k] = colour * noise[k - 1] + np.sqrt(1 - colour**2) * white[k]
    return np.column_stack([at, noise_m * noise, lost.astype(float)])


def course_of(
    protocol: str, streams, rate_hz: float, duration_s, process: float, camera, step_s: float
) -> Course:
    """Everything drawn for a run, in steps of at most `step_s`; `camera`: see `_frames`."""
    _, _, draws, eye, kicks, start = streams
    asked = ask(protocol, draws, rate_hz, duration_s)
    n, dt = len(asked.target), 1.0 / rate_hz
    sub = max(ceil(dt / step_s - 1e-9), 1)
    slots = ceil(n * dt / VOLTS_HOLD_S) + 1
    return Course(
        dt=dt,
        sub=sub,
        target=asked.target,
        push=asked.push,
        ball=np.array([*asked.start_m, 0.0, 0.0, 0.0]),
        has_ball=protocol not in SERVO_ONLY,
        frames=_frames(eye, n * dt, **camera),
        volts_noise=process * SERVO_PROCESS / VOLTS_HOLD_S**0.5 * kicks.standard_normal((slots, 2)),
        kicks=process * BALL_PROCESS * (dt / sub) ** 0.5 * kicks.standard_normal((n * sub, 2)),
        left=start.uniform(-1, 1, 4),
    )


def make_log(
    protocol: str,
    *,
    effects: Effects | None = None,
    seed: int,
    imperfect: bool = True,
    rate_hz: float = 500.0,
    gain=NOMINAL_GAIN,
    tau=NOMINAL_TAU,
    stranger: tuple[str, float] | None = None,
    process_scale: float = 1.0,
    colour: float = 0.0,
    dropout: float = 0.0,
    noise_scale: float = 1.0,
    duration_s: float | None = None,
    tachometer: bool = False,
    hollow: bool = True,
    pilot: Pilot | None = None,
    mechanism: Mechanism | None = None,
    step_s: float = STEP_S,
) -> dict[str, np.ndarray]:
    """Columns of a log by name, each (n,); blank = NaN. It ends where the ball leaves the plate.

    protocol: see `foreign_protocols`; effects: {name: {axis: {key: value}}} of the catalogue, in
    the place of the imperfection of that name and axis; stranger: (name, size) of `STRANGERS`;
    colour: of the camera's noise from frame to frame (AR(1)); dropout: share of frames lost;
    mechanism: what moves, with a longest step of step_s, by default the compiled table.
    ValueError: unknown protocol, effect or stranger.
    """
    streams = streams_of(seed)
    camera = {"noise_m": NOISE_M * noise_scale, "colour": colour, "dropout": dropout}
    course = course_of(protocol, streams, rate_hz, duration_s, process_scale, camera, step_s)
    truth = hidden(
        effects=effects,
        seed=seed,
        seconds=len(course.target) * course.dt,
        imperfect=imperfect,
        gain=gain,
        tau=tau,
        stranger=stranger,
    )
    plant, eye = plant_and_eye(
        truth.effects,
        truth.gain,
        truth.tau,
        delay_s=CAMERA_DELAY_S,
        factor=3 / 5 if hollow else 5 / 7,
    )
    rows = (mechanism or _compiled)(plant, eye, truth.odd, pilot or Pilot(), course)
    return columns_of(rows, streams[-1] if tachometer else None, course.has_ball)


def _compiled(plant: Plant, eye: Eye, odd: Odd, pilot: Pilot, course: Course) -> np.ndarray:
    rows, n = run(packed(plant), packed(eye), packed(odd), packed(pilot), course)
    return rows[:n]


def columns_of(
    rows: np.ndarray, tachometer: np.random.Generator | None, has_ball: bool
) -> dict[str, np.ndarray]:
    """Columns (n,) by name from rows (n, 13) in the order of COLUMNS; None: no tachometers."""
    log: dict[str, np.ndarray] = dict(zip(COLUMNS, rows.T.copy(), strict=True))
    for a in "xy":
        speed = log.pop(f"motor_speed_{a}_rad_s")
        if tachometer is not None:
            noise = TACHOMETER_RAD_S * tachometer.standard_normal(len(speed))
            log[f"motor_speed_{a}_rad_s"] = speed + noise
        if not has_ball:
            log[f"target_{a}_m"][:] = np.nan
    return log


def completed(log: dict[str, np.ndarray], protocol: str, duration_s: float | None = None) -> bool:
    """Whether the log has its whole length: the ball stayed on the plate."""
    t = log["t_s"]
    return bool(t[-1] + 1.5 * t[1] > (duration_s or PROTOCOLS[protocol][1]))


def write_csv(path: Path | str, log: dict[str, np.ndarray]) -> None:
    """One row a tick, the columns as named, NaN as a blank cell."""
    columns = [[("" if v != v else f"{v:.9g}") for v in log[name].tolist()] for name in log]
    with Path(path).open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(log)
        writer.writerows(zip(*columns, strict=True))
