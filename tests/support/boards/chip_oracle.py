"""An independent judge of a board: what it may do with the bytes that really reached it."""

from rig.hardware.board.wire import Arm, Command, ConfigAnswer, Parser
from rig.parameters import ANGLE_MARGIN_RAD, Rig
from tests.support.boards.world import World

WATCHDOG_S, LEVEL_S, LEVEL_V = 0.1, 0.5, 3.0
LATE_S = 0.03  # the way through the chip, and a crystal 3 % off
ROUGH_V = 0.02  # a step of the pulse width
TOKENS = 8


class Oracle:
    """Watches a World every millisecond; `unsafe` lists what must never be."""

    KEPT = 6  # commands that may still be seen in the volts

    def __init__(self, world: World, rig: Rig) -> None:
        self.world, self.unsafe = world, []
        self.worst_rad = 0.0
        self._limit = rig.servo.angle_limit_rad + ANGLE_MARGIN_RAD
        self._to_board, self._from_board = Parser(), Parser()
        self._tokens: list[int] = []
        self._sequence: int | None = None  # None: not armed
        self._fresh_s, self._commands, self._reset_s = -1e9, [], -1e9
        self._wires(world)
        world.watch = self.look

    def _wires(self, world: World) -> None:
        board = world.board
        receive, take, reset = board.receive, board.take, board.reset

        def hear(data: bytes) -> None:
            for packet in self._to_board.feed(data):
                self._heard(packet)
            receive(data)

        def say() -> bytes:
            data = take()
            for packet in self._from_board.feed(data):
                if isinstance(packet, ConfigAnswer):
                    self._tokens = [*self._tokens, packet.token][-TOKENS:]
            return data

        def forget() -> None:
            self._sequence, self._tokens, self._commands = None, [], []
            self._reset_s = self.world.now_s
            reset()

        board.receive, board.take, board.reset = hear, say, forget

    def _heard(self, packet) -> None:
        if isinstance(packet, Arm) and packet.token in self._tokens:
            self._sequence, self._commands = packet.sequence, []
            self._tokens.clear()
        asked = self.asked(packet)
        if asked is None or self._sequence is None:
            return
        if 0 < (packet.sequence - self._sequence) % 65536 < 32768:
            self._sequence, self._fresh_s = packet.sequence, self.world.now_s
            self._commands = [*self._commands, asked][-self.KEPT :]

    def asked(self, packet) -> tuple[float, float] | None:
        """The volts (x, y) that a packet commands; None: it is no command for such a board."""
        if not isinstance(packet, Command):
            return None
        return self.world.wiring.from_board((packet.mV_0 / 1000, packet.mV_1 / 1000))

    def look(self) -> None:
        """Judge the present millisecond."""
        arms, volts = self.world.arms_rad, self.world.volts
        self.worst_rad = max(self.worst_rad, *map(abs, arms))
        if max(map(abs, arms)) > self._limit:
            self._tell("plate beyond its limit")
        since_s = self.world.now_s - self._fresh_s
        for axis in (0, 1):
            v, theta = volts[axis], arms[axis]
            if v == 0.0:
                continue
            commanded = [c[axis] for c in self._commands]
            is_level = abs(v) <= LEVEL_V + ROUGH_V and (v * theta < 0 or abs(theta) < 0.1)
            if self._sequence is None:
                self._tell("volts while disarmed")
            elif since_s > WATCHDOG_S + LEVEL_S + LATE_S:
                self._tell("volts without a fresh command")
            elif not is_level and (since_s > 0.02 + LATE_S or not self._is_one(v, commanded)):
                self._tell("volts that nobody asked for")

    @staticmethod
    def _is_one(v: float, commanded: list[float]) -> bool:
        return any(abs(v - c) <= ROUGH_V for c in commanded)

    def _tell(self, what: str) -> None:
        if what not in self.unsafe:
            self.unsafe.append(what)
