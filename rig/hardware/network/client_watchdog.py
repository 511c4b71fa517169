"""The guard over a served table: what its user may do, and what happens when the user is silent.

Pure but for its own state: times come in, volts go out.
"""

from math import inf, isfinite

from rig.hardware.remote_wire import SILENT_S, Drive
from rig.hardware.wiring import Wiring
from rig.levelling import Levelling
from rig.limits import limit
from rig.parameters import ANGLE_MARGIN_RAD
from vision.clock import ForeignClock

LEVEL_S = 0.5
HOLD_S = 0.05  # so long a command's volts last without a newer one
HOMING_LIMIT_V = 3.0  # while nobody knows where the stops are


class Guard:
    """Volts of the newest fresh command while armed, for 50 ms; silent for 100 ms: level for 0.5 s,
    then 0 V, latched."""

    def __init__(self, voltage_limit_V: float, angle_limit_rad: float) -> None:
        self._limit_V, self._angle_limit_rad = voltage_limit_V, angle_limit_rad
        self.armed = self.latched = False
        self.homed = False
        self.wiring = Wiring()
        self._volts = (0.0, 0.0)
        self._fresh_s = self._stopped_s = -inf
        self._levelling = Levelling(voltage_limit_V)
        self.stale = 0
        self.meet()
        self._clamped(self._volts, self._volts)  # compiles now, not while a user waits

    def meet(self) -> None:
        """A new user with a clock of their own."""
        self._clock, self._sent_s = ForeignClock(), -inf

    def hear(self, sent_s: float, now_s: float) -> float:
        """How long a message was on its way, beyond the fastest so far [s]; inf for an old one."""
        if not sent_s > self._sent_s:
            return inf
        self._sent_s = sent_s
        return now_s - self._clock.to_rig(sent_s, now_s)

    def configure(self, wiring: Wiring, homed: bool) -> None:
        """What channels mean, from now on; disarms."""
        self.disarm()
        self.wiring, self.homed = wiring, homed

    def arm(self, now_s: float) -> None:
        self.armed, self.latched = True, False
        self._volts, self._fresh_s = (0.0, 0.0), now_s

    def disarm(self) -> None:
        """0 V from now on; for a user who says goodbye."""
        self.armed, self._stopped_s = False, -inf

    def stop(self, now_s: float) -> None:
        """Level, then 0 V, until armed anew."""
        if self.armed:
            self.armed, self.latched, self._stopped_s = False, True, now_s
            self._levelling = Levelling(self._limit_V)

    def obey(self, wish: Drive, now_s: float) -> bool:
        """A command that arrived; one that was too long on its way is not obeyed."""
        age_s = self.hear(wish.sent_s, now_s)
        if age_s > 1e-3 * wish.ttl_ms or not (isfinite(wish.x_V) and isfinite(wish.y_V)):
            self.stale += 1
            return False
        self._volts, self._fresh_s = (wish.x_V, wish.y_V), now_s
        return True

    def volts(self, theta_rad: tuple[float, float], now_s: float) -> tuple[float, float]:
        """Volts (x, y) for this tick."""
        if self.armed and now_s - self._fresh_s > SILENT_S:
            self.stop(now_s)
        if self.armed:
            is_held = now_s - self._fresh_s > HOLD_S
            return (0.0, 0.0) if is_held else self._clamped(self._volts, theta_rad)
        if self.homed and now_s - self._stopped_s < LEVEL_S:
            return self._levelling.volts(theta_rad, now_s)
        return 0.0, 0.0

    def _clamped(self, volts, theta_rad) -> tuple[float, float]:
        """The table's own bounds, whatever the user's program allows itself."""
        most = self._limit_V if self.homed else min(HOMING_LIMIT_V, self._limit_V)
        reach = self._angle_limit_rad + ANGLE_MARGIN_RAD if self.homed else inf
        x, y = (
            limit(wish, a, 0.0, 0.0, most, reach, inf)
            for wish, a in zip(volts, theta_rad, strict=True)
        )
        return x, y
