"""A table that another machine drives: the user's end of `rig serve`."""

import math
import secrets
import select
import socket
import time
from contextlib import suppress
from dataclasses import asdict
from typing import Any, Self

from rig.hardware.board.link import LinkLost
from rig.hardware.network import remote_wire as wire
from rig.hardware.network.link_clock import LinkClock
from rig.hardware.network.remote_wire import RemoteReading, Wire
from rig.hardware.observations import ObservationFeed, ObservationSource, TickClock
from rig.hardware.wiring import Wiring
from rig.safety.late_watch import LONGEST_ROUND_TRIP_S, LateWatch
from rig.safety.levelling import LevelOnExit
from rig.safety.motion_watch import UNKNOWN, Both
from rig.table import Reading
from vision.frames import Observation

CONNECT_S = 5.0
DEAD_S = 0.09  # the table ticks all the time: so long a silence is a dead link
TTL_MS = 50  # a command that took longer is not obeyed
PINGS = 10
LATE_CURE = "use Ethernet, or run the program on the table's machine"


class RemoteTable(LevelOnExit):
    """A table that `rig serve` drives on another machine; of several ticks the newest counts.

    `with` arms it, for this connection and until a stop by silence: then the table stays at 0 V.
    wiring: what homing found; homed False: the channels as they are, at low volts;
    sure_V: volts that surely move each arm, for the server's monitor. The ball comes
    from the server's camera, or from `eye` here. clock: how the server's clock stands to ours;
    late_ticks: readings that a newer one replaced; period_s: of the ticks that the caller reckons
    with (None: any); longest_trip_s: of `longest_round_trip_s`. LinkLost: nobody answers there, or
    the token is refused; ValueError: the server's encoders have another number of counts than the
    wiring, or its ticks another period.
    """

    def __init__(
        self,
        host: str,
        port: int,
        token: bytes,
        wiring: Wiring,
        *,
        eye: ObservationSource | None = None,
        homed: bool = True,
        sure_V: tuple[Both, Both] = UNKNOWN,
        period_s: float | None = None,
        longest_trip_s: float = LONGEST_ROUND_TRIP_S,
    ) -> None:
        self._name = f"remote table {host}:{port}"
        self._time, self._feed, self.clock = TickClock(), ObservationFeed(eye), LinkClock()
        self._tick, self._dead, self._last_exposed_s = 0, "", -math.inf
        self._echoed_s, self._way_s = -math.inf, 0.0
        self._late, self._trip_s = LateWatch(longest_trip_s), 0.0
        self._armed = False
        self.late_ticks = 0
        self._wire = self._connect(host, port)
        try:
            welcome = self._greet(token)
            self.boot_id = welcome.boot_id.hex()
            self.period_s, self.voltage_limit_V = welcome.period_s, welcome.voltage_limit_V
            if welcome.counts_per_rev != wiring.counts_per_rev:
                raise ValueError(
                    f"{self._name}: its encoders have {welcome.counts_per_rev} counts a turn, the "
                    f"rig file says {wiring.counts_per_rev}: correct servo.encoder_counts_per_rev"
                )
            if period_s is not None and not math.isclose(self.period_s, period_s, rel_tol=1e-3):
                raise ValueError(
                    f"{self._name}: ticks {1 / self.period_s:g} times a second, the rig file says "
                    f"control_rate_hz = {1 / period_s:g}: set both alike"
                )
            self._ask_clock()
            self._wire.sock.settimeout(DEAD_S)
            self._send(wire.CONFIGURE, wire.Configure.of(wiring, homed, sure_V).pack())
        except BaseException:
            self._wire.close()
            raise
        if not homed:
            self.level_s = 0.0  # nobody knows where level is

    def _connect(self, host: str, port: int) -> Wire:
        try:
            return Wire(socket.create_connection((host, port), CONNECT_S))
        except OSError as error:
            raise LinkLost(
                f"{self._name}: {error.strerror or error}; is rig serve running there, and does a "
                "firewall let it through?"
            ) from None

    def _greet(self, token: bytes) -> wire.Welcome:
        """Prove to know the token, see that the other end knows it, learn what the table is."""
        hello = self._await(wire.HELLO)
        version, theirs = int.from_bytes(hello[:1]), hello[1:]
        if version != wire.VERSION or len(theirs) != wire.NONCE_BYTES:
            raise LinkLost(
                f"{self._name}: speaks version {version}, this program {wire.VERSION}: update both"
            )
        ours = secrets.token_bytes(wire.NONCE_BYTES)
        self._send(wire.PROOF, ours + wire.proof(token, theirs, ours))
        self._wire.seal(token, theirs, ours, server=False)
        return wire.Welcome.unpack(self._await(wire.WELCOME))

    def _ask_clock(self) -> None:
        for _ in range(PINGS):
            sent_s = time.monotonic()
            self._send(wire.PING, wire.Ping(sent_s).pack())
            answer = wire.Ping.unpack(self._await(wire.PONG))
            arrived_s = time.monotonic()
            self.clock.exchange(answer.sent_s, answer.received_s, answer.received_s, arrived_s)
        self._way_s = 0.5 * self.clock.record().round_trip_s

    def __enter__(self) -> Self:
        self.arm()
        return self

    def arm(self) -> None:
        """Let commands through; anew after a stop by silence.

        LinkLost: the connection is gone, or its fastest round trip longer than longest_trip_s.
        """
        fastest_s = self.clock.fastest_s()
        if not fastest_s <= self._late.longest_s:
            raise self._lost(self._late.why(fastest_s, LATE_CURE))
        self._send(wire.ARM)
        self._armed = False  # until the table says so

    @property
    def zero_s(self) -> float:
        """Moment of the first reading on this machine's monotonic clock [s]; NaN before it."""
        return self._time.zero_s

    def read(self) -> Reading:
        """Wait for the served table's next tick and return its reading, in times of this machine.

        LinkLost: the connection is gone, silent for DEAD_S or late, the table there failed, or it
        was stopped because it heard nothing from here. CameraStopped: the camera of `eye` failed.
        """
        newest, ball, more = None, None, True
        while newest is None or more:
            for kind, payload in self._receive(DEAD_S):
                if kind == wire.READING:
                    if newest is not None:
                        self.late_ticks += 1
                    newest = RemoteReading.unpack(payload)
                    ball = self._ball(newest) or ball
            more = bool(select.select([self._wire.sock], [], [], 0.0)[0])
        arrived_s = time.monotonic()
        self._tick = newest.tick
        if newest.echo_sent_s > self._echoed_s:
            self._echoed_s = newest.echo_sent_s
            times = (newest.echo_sent_s, newest.echo_received_s, newest.sent_s, arrived_s)
            self._trip_s = self.clock.exchange(*times)
        self._armed = self._armed or bool(newest.flags & wire.ARMED)
        if self._armed and newest.flags & wire.LATCHED:
            raise self._lost(
                f"heard nothing from this program for {1000 * wire.SILENT_S:.0f} ms and stopped "
                "the table; look why, then run again"
            )
        if self._late.is_late(self._trip_s, arrived_s):
            raise self._lost(self._late.why(self._trip_s, LATE_CURE))
        return self._reading(newest, ball, arrived_s)

    def _reading(self, row: RemoteReading, ball: tuple | None, arrived_s: float) -> Reading:
        """The table's times on this machine's clock."""
        t_s = self._time.time(row.t_s, arrived_s - self._way_s, self.period_s)
        speed = (row.speed_x, row.speed_y) if row.flags & wire.WITH_SPEED else None
        seen = None
        if ball is not None:
            xy_m, cov_m2, exposed_s = ball
            exposed_s = t_s - (row.t_s - exposed_s)
            seen = Observation(xy_m, cov_m2, exposed_s)
        return Reading(t_s, (row.theta_x, row.theta_y), speed, seen or self._feed.take(t_s))

    def _ball(self, row: RemoteReading) -> tuple | None:
        if not row.flags & wire.WITH_BALL or row.exposed_s <= self._last_exposed_s:
            return None
        self._last_exposed_s = row.exposed_s
        covariance = (row.cov_xx, row.cov_xy, row.cov_yy)
        return (row.ball_x, row.ball_y), covariance, row.exposed_s

    def drive(self, volts: tuple[float, float]) -> None:
        """Send volts (x, y); before `arm` the table keeps them at 0.

        ValueError: volts that are not finite. LinkLost: the connection is gone.
        """
        if not all(map(math.isfinite, volts)):
            raise ValueError(f"volts must be finite, got {volts}; use rig.safety.limits.limit")
        now_s = time.monotonic()
        self._send(wire.DRIVE, wire.DriveRequest(self._tick, now_s, TTL_MS, *volts).pack())

    def notes(self) -> dict[str, Any]:
        """Return what a recording keeps of this link: the clock's record and late_ticks."""
        return {"clock": asdict(self.clock.record()), "late_ticks": self.late_ticks}

    def close(self) -> None:
        """Disarm and hang up; the server brings the table to 0 V whatever arrives of it."""
        if not self._dead:
            with suppress(LinkLost):
                self._send(wire.BYE)
        self._dead = self._dead or f"{self._name}: is closed"
        self._wire.close()

    def _await(self, wanted: int) -> bytes:
        """The next message of a kind during the greeting."""
        deadline_s = time.monotonic() + CONNECT_S
        while time.monotonic() < deadline_s:
            for kind, payload in self._receive(CONNECT_S):
                if kind == wanted:
                    return payload
        raise self._lost("does not answer; is it a rig serve?")

    def _receive(self, patience_s: float) -> list[tuple[int, bytes]]:
        """What has come, waiting for it; `LinkLost` for silence, faults and refusals."""
        if self._dead:
            raise LinkLost(self._dead)
        try:
            if not select.select([self._wire.sock], [], [], patience_s)[0]:
                raise self._lost(f"silent for {1000 * patience_s:.0f} ms")
            found = self._wire.receive()
        except wire.ProtocolError as error:
            raise self._lost(f"{error}; is the token the same on both machines?") from None
        except LinkLost:
            raise
        except OSError as error:
            raise self._lost(error.strerror or str(error)) from None
        for kind, payload in found:
            if kind in (wire.REFUSE, wire.FAULT):
                raise self._lost(payload.decode("utf-8", "replace"))
        return found

    def _send(self, kind: int, payload: bytes = b"") -> None:
        if self._dead:
            raise LinkLost(self._dead)
        try:
            self._wire.send(kind, payload)
        except OSError as error:
            raise self._lost(error.strerror or str(error)) from None

    def _lost(self, why: str) -> LinkLost:
        self._dead = f"{self._name}: {why}"
        return LinkLost(self._dead)
