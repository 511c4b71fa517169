"""A simulated table behind the same seam as a real one: `read / drive / close`.

`read` advances simulated time by one tick, so a run goes as fast as the machine. The operator
(place, hold, release, push) acts on the plant, never on the controller.
"""

from math import floor, nan
from types import TracebackType
from typing import Protocol

import numpy as np

from rig.compiled import compiled
from rig.parameters import Rig
from rig.plant import own_equations, plant, plant_record
from rig.plant.effect_equations import camera_map
from rig.plant.own_equations import DivergedError
from rig.plant.plant import (
    ARM,
    MOTOR_RATE,
    SEEN_SX,
    SEEN_SY,
    SEEN_T,
    SEEN_VX,
    SEEN_VY,
    SEEN_X,
    SEEN_Y,
)
from rig.plant.position_plant import advance_commanded
from rig.safety.levelling import LevelOnExit
from rig.simulation import statistical_camera
from rig.simulation.statistical_camera import deliver, look, next_exposure, queue_observation
from rig.table import (
    R_BALL,
    R_EXPOSED,
    R_MOTOR,
    R_NEW,
    R_THETA,
    R_TIME,
    R_VARIANCE,
    Reading,
    blank_reading,
)
from vision.frames import Observation

_ANGLES = [plant.MOTOR, plant.ARM, plant.PLATE]
MOST_RAD = 100.0  # chosen: sixteen turns, where the arms' stops are within one
_BLOCK = 256


@compiled
def table_tick(s, p, history, applied, push_x, push_y, held, t, tick_s, exposure_s, seen):
    """Apply volts or angles and move the plant one tick on; True when the ball fell.

    history (n, 2) is shifted by one row and `applied` (2,) [V or rad] becomes its first; the other
    arguments are those of `plant.advance` and `position_plant.advance_commanded`.
    """
    for i in range(history.shape[0] - 1, 0, -1):
        history[i, 0], history[i, 1] = history[i - 1, 0], history[i - 1, 1]
    history[0, 0], history[0, 1] = applied[0], applied[1]
    if p.position:
        return advance_commanded(s, p, history, t, tick_s, push_x, push_y, held, exposure_s, seen)
    return plant.advance(s, p, history, t, tick_s, push_x, push_y, held, exposure_s, seen)


class CameraModel(Protocol):
    """A camera that looks at the simulated table, for example one that renders frames."""

    def see(
        self,
        exposed_s: float,
        ball_xy_m: tuple[float, float] | None,
        tilt_sines_true: tuple[float, float],
        velocity_m_s: tuple[float, float],
        theta_rad: tuple[float, float],
    ) -> Observation | None:
        """Return what is measured of the exposure at `exposed_s`, None where the ball is not seen.

        ball_xy_m: true position in the plate's frame [m], None without a ball; tilt_sines_true:
        (sin phi_x, sin phi_y); velocity_m_s: of the ball; theta_rad: encoder angles, a hint of the
        pose.
        """
        ...


class _Numbers:
    """Random rows drawn block by block: the same numbers as one draw of any length."""

    def __init__(self, draw) -> None:
        self._draw, self._rows, self._next = draw, draw(_BLOCK), 0

    def take(self) -> np.ndarray:
        if self._next == _BLOCK:
            self._rows, self._next = self._draw(_BLOCK), 0
        self._next += 1
        return self._rows[self._next - 1]


def camera_numbers(noise: np.random.Generator, drop: np.random.Generator, n: int) -> np.ndarray:
    """Return n rows of two normal numbers (from `noise`) and one uniform number (from `drop`),
    (n, 3).
    """
    return np.column_stack([noise.standard_normal((n, 2)), drop.random(n)])


class SimulatedTable(LevelOnExit):
    """The plant of `rig` (effects included) with its sensors; every random number comes from `rng`.

    The ball starts at `start_m` and is held there where `held`. `eye` replaces the statistical
    camera: noise and dropouts are then its own, while the effects and the delay of the rig file
    still hold. fallen: the ball has left the plate.
    """

    def __init__(
        self,
        rig: Rig,
        rng: np.random.Generator,
        *,
        start_m: tuple[float, float] = (0.0, 0.0),
        held: bool = False,
        eye: CameraModel | None = None,
    ) -> None:
        self.period_s = 1 / rig.control_rate_hz
        self.voltage_limit_V = rig.servo.voltage_limit_V
        self.takes_angle = rig.servo.takes_angle
        self.held = held
        self.fallen = False
        self._p, self._own = plant_record.pack(rig), rig.own
        self._s = plant.rest(start_m, rig.linkage.height_m)
        self._camera = statistical_camera.start(rig.camera.rate_hz)
        self._eye = eye
        noise, drop, tachometer = rng.spawn(3)
        self._eyes = _Numbers(lambda n: camera_numbers(noise, drop, n))
        self._tachometer = _Numbers(lambda n: tachometer.standard_normal((n, 2)))
        self._history = plant_record.no_volts(rig)
        self._applied, self._push = np.zeros(2), (0.0, 0.0)
        self._seen, self._tick = np.full(7, nan), -1
        self._covariances: dict[float, tuple[float, float, float]] = {}
        self._last = blank_reading()
        self._draws = self._eyes.take()

    # --- the operator ---
    def place(self, xy_m: tuple[float, float]) -> None:
        """Put the ball down at `xy_m` (plate frame [m]) and hold it there."""
        self._s[plant.BALL] = xy_m
        self._s[plant.BALL_W] = 0.0
        self._s[plant.SPIN] = 0.0
        self.held, self.fallen = True, False

    def release(self) -> None:
        """Let the ball go."""
        self.held = False

    def push(self, acceleration_m_s2: tuple[float, float]) -> None:
        """Push the ball with acceleration_m_s2 (x, y) until the next call."""
        self._push = acceleration_m_s2

    # --- the contract ---
    def read(self) -> Reading:
        """Advance the plant by one tick (not at the first call) and return what its sensors
        show. DivergedError: the equations do not hold for what the rig file says.
        """
        if self._tick >= 0:
            self._advance()
        self._tick += 1
        row = self._last
        row[R_TIME] = self._tick * self.period_s
        read_drives(self._s, self._p, self._tachometer.take(), row)
        deliver(self._camera, row)
        return self._reading(row)

    def drive(self, volts: tuple[float, float]) -> None:
        """Apply volts (x, y), or angles [rad] where the servos take them, from now to the next
        tick. ValueError: they are not finite.
        """
        if not all(map(np.isfinite, volts)):
            what = "angles" if self.takes_angle else "volts"
            raise ValueError(f"{what} must be finite, got {volts}; use rig.safety.limits.limit")
        self._applied[:] = volts

    def close(self) -> None:
        """Set 0 V, or the angle 0."""
        self._applied[:] = 0.0

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Level it as any table, but not where a signal ends the program: it is nobody's, and what
        levelling asks may have to be compiled, for half a minute, before that.
        """
        if kind is None or issubclass(kind, Exception):
            super().__exit__(kind, error, trace)
        else:
            self.close()

    @property
    def volts_V(self) -> tuple[float, float]:
        """Volts (x, y) that stand at the motors' terminals; angles [rad] where servos take them."""
        return float(self._applied[0]), float(self._applied[1])

    def truth(self) -> dict[str, np.ndarray]:
        """Return the plant's true state, for scorers alone: by name, (2,) arrays of both axes.

        motor_rad, arm_rad, plate_rad: angles at the servo [rad]; ball_m: the ball's position [m].
        """
        rows = {"motor_rad": plant.MOTOR, "arm_rad": plant.ARM, "plate_rad": plant.PLATE}
        return {name: self._s[row].copy() for name, row in rows.items()} | {
            "ball_m": self._s[plant.BALL].copy()
        }

    def _advance(self) -> None:
        t = self._tick * self.period_s
        fell = table_tick(
            self._s,
            self._p,
            self._history,
            self._applied,
            *self._push,
            self.held,
            t,
            self.period_s,
            next_exposure(self._camera),
            self._seen,
        )
        own_equations.check(self._p["own"], self._own)
        angle_rad = float(np.abs(self._s[_ANGLES]).max())
        if not angle_rad < MOST_RAD:
            raise DivergedError(
                f"the simulation diverged at {t:.3f} s (an angle of {angle_rad:.1e} rad): check "
                "stiffness, inertia and masses of the rig file"
            )
        self.fallen = self.fallen or fell
        if np.isnan(self._seen[SEEN_T]):
            return
        if self._eye is not None:
            self._look_with_eye()
        elif self.fallen:
            self._camera["frame"] += 1
        else:
            look(self._camera, self._p, self._seen, self._draws)
        self._draws = self._eyes.take()

    def _look_with_eye(self) -> None:
        self._camera["frame"] += 1
        seen, theta = self._seen, self._last[R_THETA : R_THETA + 2]
        if not self._p["has_angle"]:
            theta = self._applied
        observation = self._eye.see(  # pyright: ignore[reportOptionalMemberAccess]
            float(seen[SEEN_T]),
            None if self.fallen else (float(seen[SEEN_X]), float(seen[SEEN_Y])),
            (float(seen[SEEN_SX]), float(seen[SEEN_SY])),
            (float(seen[SEEN_VX]), float(seen[SEEN_VY])),
            (float(theta[0]), float(theta[1])),
        )
        if observation is None:
            return
        p = self._p  # what the rig file says of the camera holds for a rendered one too
        x, y = camera_map(
            observation.xy_m[0] + p["camera_height"] * seen[SEEN_SX],
            observation.xy_m[1] + p["camera_height"] * seen[SEEN_SY],
            p["camera_scale_fraction"][0],
            p["camera_yaw_angle_rad"][0],
            p["lens_distortion_k1_1_m2"][0],
        )
        exposed = observation.exposed_s + float(p["camera_delay_extra_s"][0])
        cov = observation.cov_m2
        self._covariances = {t: c for t, c in self._covariances.items() if t > exposed - 1}
        self._covariances[exposed] = cov
        usable = float(seen[SEEN_T]) + float(self._p["camera_delay"])
        queue_observation(self._camera, x, y, exposed, usable, 0.5 * (cov[0] + cov[2]))

    def _reading(self, row: np.ndarray) -> Reading:
        ball = None
        if row[R_NEW]:
            exposed, variance = float(row[R_EXPOSED]), float(row[R_VARIANCE])
            cov = self._covariances.get(exposed, (variance, 0.0, variance))
            ball = Observation((float(row[R_BALL]), float(row[R_BALL + 1])), cov, exposed)
        speeds = (float(row[R_MOTOR]), float(row[R_MOTOR + 1]))
        return Reading(
            float(row[R_TIME]),
            (float(row[R_THETA]), float(row[R_THETA + 1])),
            None if np.isnan(speeds[0]) else speeds,
            ball,
        )


@compiled
def read_drives(s, p, draws, reading):
    """Write encoder angles [rad] and motor speeds [rad/s] of state s into reading (READING_SIZE,).

    Angles are those of the arm, to the nearest count, NaN where nobody measures them; speeds those
    of the motor, ahead of the gears, with the tachometer's scale error and noise from draws (2,) of
    normal numbers, NaN without a tachometer.
    """
    for a in range(2):
        angle = floor(s[ARM, a] / p.encoder_step + 0.5) * p.encoder_step
        reading[R_THETA + a] = angle if p.has_angle else nan
        speed = s[MOTOR_RATE, a] * (1.0 + p.tachometer_scale) + p.tachometer_noise * draws[a]
        reading[R_MOTOR + a] = speed if p.tachometer > 0.0 else nan
