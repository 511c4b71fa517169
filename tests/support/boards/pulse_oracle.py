"""An independent judge of a servo board: which pulses it may give with the bytes that reach it."""

from rig.hardware.board.wire import PulseCommand
from rig.parameters import Rig
from tests.support.boards.chip_oracle import LATE_S, LEVEL_S, WATCHDOG_S, Oracle
from tests.support.boards.world import PulseWorld

SEEN_S = 0.045  # a pulse is known from its end, and till then the one before it; two frames
ROUGH_RAD = 0.002  # a us of pulse


class PulseOracle(Oracle):
    """Watches a PulseWorld every millisecond; `unsafe` lists what must never be.

    Armed and not yet commanded, a servo board holds level: longer than a campaign's run.
    """

    world: PulseWorld
    KEPT = 100  # commands that the servo may still be on its way from: 0.2 s

    def __init__(self, world: PulseWorld, rig: Rig) -> None:
        self._way_s = rig.servo.angle_limit_rad / min(rig.servo.pair("rate_limit_rad_s"))
        super().__init__(world, rig)

    def asked(self, packet) -> tuple[float, float] | None:
        """The angles that a packet commands [rad]."""
        if not isinstance(packet, PulseCommand):
            return None
        return packet.angle_0 / 1e4, packet.angle_1 / 1e4

    def look(self) -> None:
        """Judge the present millisecond."""
        world, since_s = self.world, self.world.now_s - self._fresh_s
        self.worst_rad = max(self.worst_rad, *map(abs, world.arms_rad))
        if max(map(abs, world.arms_rad)) > self._limit:
            self._tell("plate beyond its limit")
        for axis, (servo, pulse) in enumerate(
            zip(world.servos, world.board.pulses_us(), strict=False)
        ):
            if pulse == 0.0:
                continue
            told = servo.angle_rad(pulse)
            asked = [0.0, *(command[axis] for command in self._commands)]
            if not servo.lowest_us - 1.0 <= pulse <= servo.highest_us + 1.0:
                self._tell("a pulse out of the servo's range")
            if self._sequence is None:
                if world.now_s > self._reset_s + SEEN_S:
                    self._tell("pulses while disarmed")
            elif self._commands and since_s > WATCHDOG_S + self._way_s + LEVEL_S + SEEN_S + LATE_S:
                self._tell("pulses without a fresh command")
            elif not min(asked) - ROUGH_RAD <= told <= max(asked) + ROUGH_RAD:
                self._tell("an angle that nobody asked for")
