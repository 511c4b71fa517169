"""The model beside the table: the rig's plant driven by what was applied to the table.

The ball integrates twice, so a free model leaves the table within seconds: once a second the model
is set onto the measurement, and the difference is its prediction error over up to a second.
"""

from collections import deque
from math import inf

import numpy as np

from rig.log import INDEX, Phase
from rig.parameters import Rig
from rig.plant import plant, plant_record
from rig.simulation.simulator import table_tick

ANCHOR_S = 1.0  # between two settings onto the measurement; chosen
SPEED_FROM = 6  # observations
_T, _THETA = INDEX["t_s"], INDEX["theta_x_rad"]
_VOLTS, _TOLD = INDEX["voltage_x_V"], INDEX["command_x_rad"]
_X, _EXPOSED, _PHASE = INDEX["ball_x_m"], INDEX["ball_exposed_s"], INDEX["phase"]


def noise_alone_m(rig: Rig) -> float:
    """How far the camera's noise alone drives model and ball apart in ANCHOR_S (root mean square):
    by the error of the speed, the slope of a line through SPEED_FROM observations, in x and in y.
    """
    spread_s = np.sqrt(SPEED_FROM * (SPEED_FROM**2 - 1) / 12.0) / rig.camera.rate_hz
    return float(np.sqrt(2.0) * rig.camera.noise_m / spread_s * ANCHOR_S)


class Ghost:
    """The rig's plant beside the table: after `follow`, `ball_m`, `plate_rad` and the twists are
    those of the model. on_plate: False while the model's ball has no sense (fallen, or not yet
    set).
    """

    def __init__(self, rig: Rig) -> None:
        self._tick_s = 1 / rig.control_rate_hz
        self._p = plant_record.pack(rig)
        self._history = plant_record.no_volts(rig)
        self._seen = np.full(7, np.nan)
        self._s = plant.rest(height_m=rig.linkage.height_m)
        self._applied = _TOLD if rig.servo.takes_angle else _VOLTS
        self._last_s = self._anchored_s = inf
        self._sights: deque[tuple[float, float, float]] = deque(maxlen=SPEED_FROM)
        self.on_plate = False

    @property
    def ball_m(self) -> np.ndarray:
        """Position (2,) [m] of the model's ball in the plate's frame."""
        return self._s[plant.BALL].copy()

    @property
    def plate_rad(self) -> np.ndarray:
        """Angles (2,) [rad] of the model's plate, at the servo's shaft."""
        return self._s[plant.PLATE].copy()

    @property
    def gear_twist_rad(self) -> np.ndarray:
        """Motor minus arm (2,) [rad]: where the tooth stands in the gear's gap."""
        return self._s[plant.MOTOR] - self._s[plant.ARM]

    @property
    def joint_twist_rad(self) -> np.ndarray:
        """Arm minus plate (2,) [rad]: where the tooth stands in the joint's gap."""
        return self._s[plant.ARM] - self._s[plant.PLATE]

    def follow(self, rows: list[np.ndarray]) -> None:
        """Advance the model by the volts or angles of these rows, (len(COLUMNS),) each."""
        for row in rows:
            self._tick(row)

    def _tick(self, row: np.ndarray) -> None:
        t_s = float(row[_T])
        if not 0 < t_s - self._last_s < 0.1:  # another run, or rows are missing
            self._sights.clear()
            self._anchored_s = -inf
        self._last_s = t_s
        if row[_X] == row[_X]:
            self._sights.append((float(row[_EXPOSED]), float(row[_X]), float(row[_X + 1])))
        if t_s - self._anchored_s >= ANCHOR_S and len(self._sights) == SPEED_FROM:
            self._anchor(t_s, row[_THETA : _THETA + 2])
        if not self._sights or t_s - self._sights[-1][0] > 0.3:
            self.on_plate = False
        held = bool(row[_PHASE] < Phase.RUN)
        applied = np.nan_to_num(row[self._applied : self._applied + 2])
        fell = table_tick(
            self._s,
            self._p,
            self._history,
            applied,
            0.0,
            0.0,
            held,
            t_s,
            self._tick_s,
            inf,
            self._seen,
        )
        if fell:
            self.on_plate = False

    def _anchor(self, t_s: float, theta_rad: np.ndarray) -> None:
        """Onto the measured ball, carried on to now, and the measured angles; twists stay, and so
        do angles that servos hold by themselves."""
        t, x, y = np.array(self._sights).T
        (v_x, x0), (v_y, y0) = np.polyfit(t - t_s, x, 1), np.polyfit(t - t_s, y, 1)
        self._s[plant.BALL], self._s[plant.BALL_W] = (x0, y0), (v_x, v_y)
        if self._applied == _VOLTS:
            away = theta_rad - self._s[plant.ARM]
            for part in (plant.MOTOR, plant.ARM, plant.PLATE):
                self._s[part] += away
        self._anchored_s, self.on_plate = t_s, True
