"""Everything that passes between a loop's process and the program that started it.

Rows and words come out through rings, commands go in; a stop has a place of its own, so that
nothing delays it and nothing overwrites it.
"""

import threading
import time

import numpy as np

from rig.log import COLUMNS
from rig.loop.commands import LONGEST_QUEUE, Command, Push, SetGains, Stop, Target
from rig.loop.silence import Silence
from rig.shared_memory import SharedArray, SharedRing, encoded

ROWS = 8192  # 16 s of a reader that does not read
EVENTS = 256
TEXT, OUTCOME = 240, 40  # bytes of UTF-8

EVENT = np.dtype([("t_s", np.float64), ("text", f"S{TEXT}")])
COMMAND = np.dtype([("kind", np.int64), ("numbers", np.float64, (3,))])
STOP = np.dtype([("reason", f"S{TEXT}"), ("outcome", f"S{OUTCOME}")])
PULSE = np.dtype(
    [
        ("parent_s", np.float64),
        ("loop_s", np.float64),
        ("state", np.int64),
        ("called", np.int64),
        ("may_open", np.int64),
    ]
)
CALLED = ("", "start", "control", "end")  # method of a user's controller that the loop is in
PUSH, TARGET, OWN_TARGET, GAINS = range(4)
STARTING, READY, RUNNING, ENDING, AT_REST = range(5)  # READY: to open the table; AT_REST: at 0 V


class SharedChannel:
    """The shared memory of one run; pickled to the loop's process by its names.

    rows: ring of rows (len(COLUMNS),); events: of times and texts; commands; stops: a ring of
    their own, of which the first counts; pulse: when each side last gave a sign of life, the
    loop's state, the method of a user's controller that it is in, and whether the program allows
    the loop to open the table.
    """

    def __init__(self) -> None:
        self.rows = SharedRing(np.dtype((np.float64, (len(COLUMNS),))), ROWS)
        self.events = SharedRing(EVENT, EVENTS)
        self.commands = SharedRing(COMMAND, LONGEST_QUEUE + 1)
        self.stops = SharedRing(STOP, 2)
        self.stopped: Stop | None = None  # as the loop has read it
        self.pulse = SharedArray((1,), PULSE)
        self._silences = {"parent_s": Silence(), "loop_s": Silence()}

    def close(self) -> None:
        """Let go of the memory; the process that made it frees it."""
        for part in (self.rows, self.events, self.commands, self.stops, self.pulse):
            part.close()

    def say(self, t_s: float, text: str) -> None:
        """Send an event of the run's time t_s [s] from the loop's process; a long text is cut."""
        self.events.write((t_s, encoded(text, TEXT)))

    def take_events(self) -> list[tuple[float, str]]:
        """Return the events (t_s, text) sent since the last call."""
        return [(float(w["t_s"]), w["text"].decode()) for w in self.events.read()]

    def beat(self, side: str, state: int | None = None) -> None:
        """Note that a side is alive: "parent_s" or "loop_s"; and the loop's state, where given."""
        self.pulse.array[side][0] = time.monotonic()
        if state is not None:
            self.pulse.array["state"][0] = state

    @property
    def state(self) -> int:
        """The loop's state: STARTING, READY, RUNNING, ENDING or AT_REST."""
        return int(self.pulse.array["state"][0])

    @property
    def may_open(self) -> bool:
        """Whether the program allows the loop to open the table."""
        return bool(self.pulse.array["may_open"][0])

    def allow_to_open(self) -> None:
        """Allow the loop to open the table; to be called in the program."""
        self.pulse.array["may_open"][0] = 1

    def call(self, method: str) -> None:
        """Note that the loop calls a user's controller: one of CALLED, "" when it has returned."""
        self.beat("loop_s")
        self.pulse.array["called"][0] = CALLED.index(method)

    @property
    def called(self) -> str:
        """The method of a user's controller that the loop is in; "" where it is in none."""
        return CALLED[int(self.pulse.array["called"][0])]

    def silent_s(self, side: str) -> float:
        """Time since a side, "parent_s" or "loop_s", was last alive, less what the asking side was
        held up itself [s].
        """
        return self._silences[side].seconds(float(self.pulse.array[side][0]))


class SharedCommandSlot:
    """Where the program that started the loop puts commands for it, from any thread; box: the run's
    channel.
    """

    def __init__(self, box: SharedChannel) -> None:
        self._box, self._lock, self._said = box, threading.RLock(), False

    def put(self, command: Command) -> None:
        """Send a command to the loop; of several stops the first is kept. TypeError: no command."""
        with self._lock:
            if isinstance(command, Stop):
                if not self._said:  # the first one wins
                    reason, outcome = (
                        encoded(command.reason, TEXT),
                        encoded(command.outcome, OUTCOME),
                    )
                    self._box.stops.write((reason, outcome))
                    self._said = True
            else:
                self._box.commands.write(_packed(command))


def _packed(command: Command) -> tuple[int, tuple[float, float, float]]:
    if isinstance(command, Push):
        return PUSH, (*command.acceleration_m_s2, command.seconds)
    if isinstance(command, SetGains):
        return GAINS, (command.kp, command.ki, command.kd)
    if isinstance(command, Target):
        return (OWN_TARGET, (0, 0, 0)) if command.xy_m is None else (TARGET, (*command.xy_m, 0))
    raise TypeError(f"{command!r} is no command")


def take_stop(box: SharedChannel) -> Stop | None:
    """Return the stop that was put, None: none was. To be called in the loop's process."""
    if box.stopped is None and box.stops.news:
        for stop in box.stops.read():
            box.stopped = Stop(stop["reason"].decode(), stop["outcome"].decode())
    return box.stopped


def take_commands(box: SharedChannel) -> list[Command]:
    """Return the commands put since the last call; a stop alone when there is one. To be called in
    the loop's process.
    """
    stop = take_stop(box)
    if stop is not None:
        return [stop]
    if not box.commands.news:
        return []
    return [_unpacked(int(order["kind"]), order["numbers"]) for order in box.commands.read()]


def _unpacked(kind: int, numbers: np.ndarray) -> Command:
    a, b, c = map(float, numbers)
    if kind == PUSH:
        return Push((a, b), c)
    if kind == GAINS:
        return SetGains(a, b, c)
    return Target((a, b) if kind == TARGET else None)
