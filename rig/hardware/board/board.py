"""A table on a board with H-bridges: packets behind `read / drive / close`, whatever the cable."""

import math
import secrets
import time
from collections.abc import Callable
from math import pi

from rig.hardware.board import wire
from rig.hardware.board.link import Link
from rig.hardware.board.session import BoardSession
from rig.hardware.board.wire import Command, ConfigRequest, Telemetry
from rig.hardware.observations import ObservationFeed, ObservationSource
from rig.hardware.wiring import Wiring
from rig.safety.late_watch import LONGEST_ROUND_TRIP_S
from rig.safety.motion_watch import UNKNOWN, Both, bounded, way_of
from rig.table import Reading

COMMAND_TTL_S = 0.02
# SRV02: 1.5 V per 1000 rpm of the motor, 70 turns of which are one of the load shaft.
TACHOMETER_RAD_S_V = 1000 / 1.5 * 2 * pi / 60 / 70


class BoardTable(BoardSession):
    """A table on a serial or USB board with H-bridges: configured and disarmed when opened.

    The board's tick is the loop's: `read` waits for its next telemetry, of several the newest.
    time_constant_s, top_speed_rad_s: of the servo at voltage_limit_V, by which the board brakes;
    sure_V: volts that surely move each arm, by axis.
    homed False: the zeros are not known yet, so the board keeps to 1.5 V and does not level. eye:
    where observations of the ball come from; tachometer_rad_s_V: speed at the load shaft per volt
    of the tachometer; longest_trip_s: of `longest_round_trip_s`; clock, random_below: as of
    `BoardSession`. ValueError: a period or a field that the board cannot take. LinkLost: the board
    does not answer, speaks another version, or drives servos by pulses.
    """

    telemetry = Telemetry

    def __init__(
        self,
        link: Link,
        wiring: Wiring | None = None,
        *,
        period_s: float = 0.002,
        voltage_limit_V: float = 6.0,
        angle_limit_rad: float = pi / 6,
        time_constant_s: float = 0.025,
        top_speed_rad_s: float = 9.18,
        sure_V: tuple[Both, Both] = UNKNOWN,
        homed: bool = True,
        eye: ObservationSource | None = None,
        tachometer_rad_s_V: float = TACHOMETER_RAD_S_V,
        longest_trip_s: float = LONGEST_ROUND_TRIP_S,
        clock: Callable[[], float] = time.monotonic,
        random_below: Callable[[int], int] = secrets.randbelow,
    ) -> None:
        super().__init__(
            link,
            period_s,
            longest_trip_s=longest_trip_s,
            clock=clock,
            random_below=random_below,
        )
        self.voltage_limit_V = voltage_limit_V
        self._wiring, self._feed = wiring or Wiring(), ObservationFeed(eye)
        self._tachometer, self._homed = tachometer_rad_s_V, homed
        if not homed:
            self.level_s = 0.0  # nobody knows where level is
        servo = (time_constant_s, top_speed_rad_s)
        watched = self._watched(sure_V, top_speed_rad_s / voltage_limit_V)
        self._open(lambda: self._request(angle_limit_rad, servo, watched, homed))

    @property
    def boot_id(self) -> str:
        """Name of the last homing of the board's counts: a reset ends it, and so does another
        homing, whichever rig file it is for, as soon as it arms the board.
        """
        homes = self._armed and not self._homed
        return f"{self._answer.token if homes else self._answer.homing:08x}"

    def _watched(self, sure_V: tuple[Both, Both], gain_rad_s_V: float) -> list[int]:
        """What the board needs to see an arm that stands still: mV by channel, and V ms."""
        found: list[float] = []
        for axis, sign in zip(self._wiring.order, self._wiring.sign_angle, strict=True):
            up, down = bounded(sure_V)[axis]
            found += [1000 * up, 1000 * down] if sign > 0 else [1000 * down, 1000 * up]
        way_rad = way_of(self._wiring.step_rad)[1]
        return [math.ceil(min(v, wire.NEVER)) for v in (*found, 1000 * way_rad / gain_rad_s_V)]

    def _request(
        self,
        angle_limit_rad: float,
        servo: tuple[float, float],
        watched: list[int],
        homed: bool,
    ) -> ConfigRequest:
        wiring, period_ms = self._wiring, self._period_ms()
        zero_0, zero_1 = wiring.zero_counts
        negative = [polarity < 0 for polarity in wiring.polarities()]
        bits = homed | negative[0] << 1 | negative[1] << 2 | wiring.crossed << 3
        return ConfigRequest(
            wire.VERSION,
            self._random_below(65536),
            period_ms,
            bits,
            zero_0,
            zero_1,
            wiring.counts_per_rev,
            round(angle_limit_rad / wiring.step_rad),
            round(1000 * self.voltage_limit_V),
            *(min(max(math.ceil(1000 * number), 1), 65535) for number in servo),
            *watched,
        )

    # --- the contract ---
    def read(self) -> Reading:
        """Wait for the board's next telemetry and return its reading.

        LinkLost: the board vanished, is silent or deaf (raised within 100 ms), or late.
        BoardStopped: it took the volts away by itself. CameraStopped: the camera of `eye` failed.
        """
        packet, t_s = self._tick()
        assert isinstance(packet, Telemetry)  # a board says one kind only
        speeds = None
        if isinstance(packet, wire.TelemetryWithTachometer):
            x, y = self._wiring.from_board(
                (packet.tachometer_0_mV / 1000, packet.tachometer_1_mV / 1000)
            )
            speeds = (self._tachometer * x, self._tachometer * y)
        x, y = self._wiring.angles((packet.count_0, packet.count_1))
        return Reading(t_s, (x, y), speeds, self._feed.take(t_s))

    def drive(self, volts: tuple[float, float]) -> None:
        """Command volts (x, y), which the board applies for 20 ms at most without a newer command.

        ValueError: volts that are not finite, or other than 0 V on a board that is not armed.
        LinkLost, BoardStopped: the board is lost or has stopped.
        """
        if not all(map(math.isfinite, volts)):
            raise ValueError(f"volts must be finite, got {volts}; use rig.safety.limits.limit")
        if not self._may_command(volts):
            return
        limit = self.voltage_limit_V
        mV = [round(1000 * min(max(v, -limit), limit)) for v in self._wiring.to_board(volts)]
        ttl_ms = round(1000 * COMMAND_TTL_S)
        self._command(lambda sequence: Command(sequence, ttl_ms, *mV))
