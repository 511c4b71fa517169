"""The one slot through which a running loop is spoken to: stops, pushes, gains, setpoints."""

from collections import deque
from dataclasses import dataclass
from threading import RLock
from typing import Protocol


@dataclass(frozen=True)
class Stop:
    """End the run now; outcome and reason go into the recording."""

    reason: str
    outcome: str = "aborted"


@dataclass(frozen=True)
class Push:
    """Push the (simulated) ball with this acceleration for so long."""

    acceleration_m_s2: tuple[float, float]
    seconds: float = 0.08


@dataclass(frozen=True)
class Target:
    """Send the ball here instead of where the protocol says; None gives the protocol back."""

    xy_m: tuple[float, float] | None


@dataclass(frozen=True)
class SetGains:
    """Change outer gains: proportional [rad/m], integral [rad/m/s], derivative [rad s/m]."""

    kp: float
    ki: float
    kd: float


Command = Stop | Push | Target | SetGains
LONGEST_QUEUE = 64


class Inbox(Protocol):
    """Where a loop takes its commands from, at every tick."""

    def take(self) -> list[Command]: ...


class CommandSlot:
    """Callbacks put, the loop takes at its next tick; a stop is never lost or delayed by others."""

    def __init__(self) -> None:
        self._lock = RLock()  # a signal's handler may put while its own thread takes
        self._stop: Stop | None = None
        self._waiting: deque[Command] = deque(maxlen=LONGEST_QUEUE)

    def put(self, command: Command) -> None:
        with self._lock:
            if isinstance(command, Stop):
                self._stop = self._stop or command
            else:
                self._waiting.append(command)

    def take(self) -> list[Command]:
        """Everything put since the last take, a stop alone when there is one."""
        with self._lock:
            waiting = list(self._waiting)
            self._waiting.clear()
            return [self._stop] if self._stop is not None else waiting
