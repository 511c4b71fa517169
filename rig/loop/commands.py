"""The one slot through which a running loop is spoken to: stops, pushes, gains, setpoints."""

from collections import deque
from dataclasses import dataclass
from math import atan2, degrees, hypot, isfinite
from threading import RLock
from typing import Protocol


@dataclass(frozen=True)
class Stop:
    """End the run at the next tick; outcome and reason are kept in its recording."""

    reason: str
    outcome: str = "aborted"


@dataclass(frozen=True)
class Push:
    """Push the (simulated) ball with this acceleration (x, y) for `seconds` [s]; at a real table it
    is only recorded.
    """

    acceleration_m_s2: tuple[float, float]
    seconds: float = 0.08


@dataclass(frozen=True)
class Target:
    """Send the ball to xy_m in the plate's frame [m] in place of the course's targets; None: back
    to these.

    A place off the plate is refused with an event.
    """

    xy_m: tuple[float, float] | None


@dataclass(frozen=True)
class SetGains:
    """Change the gains of the outer PID: kp [rad/m], ki [rad/m/s], kd [rad s/m]."""

    kp: float
    ki: float
    kd: float


Command = Stop | Push | Target | SetGains
BY_HAND = "by hand: "  # so begins an event that a run would not have had by itself


def said(command: Push | Target | SetGains) -> str:
    """Return the event of a command that somebody gave during a run, in words and units that people
    read; it begins with BY_HAND.
    """
    if isinstance(command, Push):
        speeds = [command.seconds * a for a in command.acceleration_m_s2]
        if not all(map(isfinite, speeds)):
            return f"{BY_HAND}push of {speeds} m/s"
        towards = f"{degrees(atan2(speeds[1], speeds[0])) % 360:.0f} degrees from +x"
        x, y = (round(v / (hypot(*speeds) or 1.0), 6) for v in speeds)
        words = _DIRECTIONS.get((x, y), f"towards {towards}")
        return f"{BY_HAND}push {words}, {hypot(*speeds):.2f} m/s"
    if isinstance(command, SetGains):
        p, i, d = command.kp, command.ki, command.kd
        return f"{BY_HAND}gains P {p:.4g} rad/m, I {i:.4g} rad/(m s), D {d:.4g} rad s/m"
    if command.xy_m is None:
        return f"{BY_HAND}target of the protocol again"
    x, y = (100 * v for v in command.xy_m)
    return f"{BY_HAND}target x {x:+.1f}, y {y:+.1f} cm"


_DIRECTIONS: dict[tuple[float, float], str] = {
    (1, 0): "to the right",
    (-1, 0): "to the left",
    (0, 1): "away",
    (0, -1): "near",
}
LONGEST_QUEUE = 64


class Inbox(Protocol):
    """Where a loop takes its commands from, at every tick."""

    def take(self) -> list[Command]:
        """Return the commands put since the last call, in order; a stop alone when there is one."""
        ...


class CommandSlot:
    """A slot for commands from any thread; the loop takes them at its next tick.

    A stop is never lost or delayed by other commands; of these the newest LONGEST_QUEUE are kept.
    """

    def __init__(self) -> None:
        self._lock = RLock()  # a signal's handler may put while its own thread takes
        self._stop: Stop | None = None
        self._waiting: deque[Command] = deque(maxlen=LONGEST_QUEUE)

    def put(self, command: Command) -> None:
        """Add a command; of several stops the first is kept."""
        with self._lock:
            if isinstance(command, Stop):
                self._stop = self._stop or command
            else:
                self._waiting.append(command)

    def take(self) -> list[Command]:
        """Return the commands put since the last call, in order; a stop alone when there is one."""
        with self._lock:
            waiting = list(self._waiting)
            self._waiting.clear()
            return [self._stop] if self._stop is not None else waiting
