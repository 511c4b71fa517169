"""Single quiet runs of the foreign table with everything set by hand: what closed forms need."""

from collections.abc import Callable

import numpy as np

from experiments.benchmark.engines.foreign.parts import Course, Eye, Odd, Pilot, Plant, packed
from experiments.benchmark.engines.foreign.plant import run
from experiments.benchmark.engines.foreign.table import (
    CAMERA_DELAY_S,
    COLUMNS,
    NOMINAL_GAIN,
    NOMINAL_TAU,
    STEP_S,
)
from experiments.benchmark.engines.foreign.truth import plant_and_eye, strange

DT = 0.002
Engine = Callable[[Plant, Eye, Odd, Pilot, Course], np.ndarray]
SLACK = Pilot(volts=0.0)  # never moves a servo


def bang(volts: float) -> Pilot:
    """Full volts towards the sign of the target, whatever the angle."""
    return Pilot(volts=volts, angle=1e9)


def nothing_odd() -> Odd:
    return strange(None, np.random.default_rng(0), 1.0)


def foreign(plant: Plant, eye: Eye, odd: Odd, pilot: Pilot, course: Course) -> np.ndarray:
    """Rows of a course on the foreign table."""
    rows, n = run(packed(plant), packed(eye), packed(odd), packed(pilot), course)
    return rows[:n]


def quiet(
    effects=None,
    *,
    seconds: float = 1.0,
    way=(0.0, 0.0),
    pilot: Pilot = SLACK,
    ball=None,
    odd: Odd | None = None,
    push=(0.0, 0.0),
    dt: float = DT,
    gain=NOMINAL_GAIN,
    tau=NOMINAL_TAU,
    engine: Engine = foreign,
    step_s: float = STEP_S,
) -> dict[str, np.ndarray]:
    """Columns of a run without any noise. `way` (2,) or (n, 2): signs of the volts; `ball`: x, y,
    x', y' and spin at the start, None = servos alone. Hollow ball. `engine`: whose table, in
    steps of `step_s`.
    """
    n, sub = round(seconds / dt), max(round(dt / step_s), 1)
    frames = np.zeros((int(60 * seconds), 4))
    frames[:, 0] = (np.arange(len(frames)) + 0.37) / 60
    course = Course(
        dt=dt,
        sub=sub,
        target=1e12 * np.broadcast_to(np.array(way, float), (n, 2)).copy(),
        push=np.tile(np.array(push, float), (n, 1)),
        ball=np.zeros(5) if ball is None else np.array(ball, float),
        has_ball=ball is not None,
        frames=frames,
        volts_noise=np.zeros((round(seconds / 0.002) + 2, 2)),
        kicks=np.zeros((n * sub, 2)),
        left=np.zeros(4),
    )
    plant, eye = plant_and_eye(effects or {}, gain, tau, delay_s=CAMERA_DELAY_S, factor=0.6)
    rows = engine(plant, eye, odd or nothing_odd(), pilot, course)
    return dict(zip(COLUMNS, rows.T, strict=True))


def seen(log: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Claimed times of exposure (m,) and positions (m, 2) of the frames in a log."""
    xy = np.column_stack([log["ball_x_m"], log["ball_y_m"]])
    new = np.isfinite(xy[:, 0])
    return log["ball_exposed_s"][new], xy[new]


def slope(x: float, y: float) -> dict:
    return {"level_offset": {"x": {"slope_rad": x}, "y": {"slope_rad": y}}}
