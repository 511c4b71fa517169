"""A table on a board with hobby (RC) servos: angles become pulses, and nobody reads them back."""

import secrets
import time
from collections.abc import Callable, Sequence
from math import nan

from rig.hardware.board import wire
from rig.hardware.board.link import Link
from rig.hardware.board.pulse_servo import STEPS_RAD, STEPS_US, PulseServo
from rig.hardware.board.session import BoardSession
from rig.hardware.board.wire import ConfigAnswer, PulseCommand, PulseConfigRequest, PulseTelemetry
from rig.hardware.observations import ObservationFeed, ObservationSource
from rig.hardware.servo_table import ServoTable
from rig.linkage import Linkage
from rig.table import Reading

FRAME_S = 0.02  # the longest, which every RC servo takes
SHORTEST_FRAME_S = 0.004
SETTLING_S = 0.5  # chosen: some lags of a slow servo (66 ms) and of its plate


class PulseTable(ServoTable, BoardSession):
    """A table whose hobby servos a board drives by pulses: configured and disarmed when opened.

    The ball's loop alone closes over the link, which is slower than a servo's: no round trip is
    too long for it but that of a board that counts as deaf.

    Arming begins the pulses at level; a servo goes there from wherever it is as fast as it can.
    `drive` takes angles, which the board reaches at rate_limit_rad_s [rad/s] at most; leaving the
    context levels the plate and ends the pulses. servos: by channel of the board, 1 to 3; linkage:
    what they do to the plate; order: by channel, the linkage's servo on it; angle_limit_rad,
    rate_limit_rad_s: of x and y; frame_s: from pulse to pulse, 4 to 20 ms; eye: where observations
    of the ball come from; clock, random_below: as of `BoardSession`. ValueError: what no board or
    servo can take. LinkLost: the board does not answer, speaks another version, drives H-bridges,
    or refuses.
    """

    telemetry = PulseTelemetry
    voltage_limit_V = 0.0

    def __init__(
        self,
        link: Link,
        servos: Sequence[PulseServo],
        linkage: Linkage,
        order: Sequence[int],
        *,
        angle_limit_rad: float,
        rate_limit_rad_s: tuple[float, float],
        frame_s: float = FRAME_S,
        period_s: float = 0.002,
        eye: ObservationSource | None = None,
        clock: Callable[[], float] = time.monotonic,
        random_below: Callable[[int], int] = secrets.randbelow,
    ) -> None:
        ServoTable.__init__(self, linkage, angle_limit_rad)
        BoardSession.__init__(self, link, period_s, clock=clock, random_below=random_below)
        self._servos, self._order, self._feed = servos, order, ObservationFeed(eye)
        rates = linkage.servo_rates(rate_limit_rad_s)
        ways = zip(self._limits_rad, rates, strict=True)
        self.level_s = SETTLING_S + max(limit / rate for limit, rate in ways)
        limits, rates = (self._by_channel(one) for one in (self._limits_rad, rates))
        self._open(lambda: self._request(limits, rates, frame_s))

    def _by_channel(self, by_servo: Sequence[float]) -> list[float]:
        return [by_servo[servo] for servo in self._order]

    def _request(
        self, limits_rad: Sequence[float], rates_rad_s: Sequence[float], frame_s: float
    ) -> PulseConfigRequest:
        if not SHORTEST_FRAME_S <= frame_s <= FRAME_S:
            raise ValueError(
                f"servo.period_s = {frame_s:g}: pulses come every {SHORTEST_FRAME_S:g} to "
                f"{FRAME_S:g} s"
            )
        fields = [
            field
            for servo, limit, rate in zip(self._servos, limits_rad, rates_rad_s, strict=True)
            for field in servo.fields(limit, rate)
        ]
        return PulseConfigRequest(
            wire.VERSION,
            self._random_below(65536),
            self._period_ms(),
            len(self._servos),
            round(1e6 * frame_s),
            *fields,
        )

    def _why_refused(self, answer: ConfigAnswer) -> str:
        if len(self._servos) > 2 and not answer.features & wire.HAS_THREE:
            return "its timer has two servo pins; three arms take an Arduino Mega"
        return super()._why_refused(answer)

    @property
    def pulses_us(self) -> tuple[float, ...]:
        """The pulses that the board puts out, by channel, as it last told [us]; 0: none."""
        newest = self.newest
        if not isinstance(newest, PulseTelemetry):
            return (0.0,) * len(self._servos)
        pulses = (newest.pulse_0, newest.pulse_1, newest.pulse_2)
        return tuple(pulse / STEPS_US for pulse in pulses[: len(self._servos)])

    @property
    def travel_rad(self) -> tuple[float, ...]:
        """By servo, twice the way from level to the nearer end of its pulses [rad]."""
        return self._by_servo(
            [
                2
                * min(one.level_us - one.lowest_us, one.highest_us - one.level_us)
                / abs(one.us_per_rad)
                for one in self._servos
            ]
        )

    @property
    def turned_rad(self) -> tuple[float, ...]:
        """By servo, the angle that its pulse tells it [rad]; 0 without a pulse."""
        pulses = zip(self._servos, self.pulses_us, strict=True)
        return self._by_servo([one.angle_rad(pulse) if pulse else 0.0 for one, pulse in pulses])

    def _by_servo(self, by_channel: Sequence[float]) -> tuple[float, ...]:
        return tuple(by_channel[self._order.index(servo)] for servo in range(len(self._order)))

    # --- the contract ---
    def read(self) -> Reading:
        """Wait for the board's next telemetry and return its reading: the angles are NaN.

        LinkLost: the board vanished, is silent or deaf (raised within 100 ms). BoardStopped: it
        levels the plate and ends the pulses by itself. CameraStopped: the camera of `eye` failed.
        """
        _, t_s = self._tick()
        return Reading(t_s, (nan, nan), ball=self._feed.take(t_s))

    def _tell(self, angles: Sequence[float]) -> None:
        """Tell the servos angles from level [rad]. LinkLost, BoardStopped: the board is lost or has
        stopped.
        """
        if self._may_command(angles):
            told = [round(STEPS_RAD * one) for one in self._by_channel(angles)]
            self._command(lambda sequence: PulseCommand(sequence, *told))
