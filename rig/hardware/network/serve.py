"""`rig serve`: a table on this machine, driven from another one over the network.

One thread ticks the table, whoever is connected or not. One user at a time; who falls silent loses
the table (see `client_watchdog.ClientWatchdog`). Nothing is listened to but who proves to know the
token.
"""

import secrets
import select
import socket
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from math import nan

from rig.hardware.network import remote_wire as wire
from rig.hardware.network.client_watchdog import ClientWatchdog
from rig.hardware.network.greetings import Greetings, Peer
from rig.hardware.network.remote_wire import DriveRequest, Ping, ProtocolError, RemoteReading
from rig.hardware.network.token_file import check_host
from rig.hardware.wiring import Wiring
from rig.parameters import Servo
from rig.shared_memory import encoded
from rig.table import Reading, Table

GONE_S = 1.0  # a user who was stopped for silence and says nothing more makes room for another
IDLE_S = 30.0  # one who has not armed the table yet
BACKLOG, LET_IN = 128, 4  # connections that wait, and that a tick takes; chosen: 2000/s at 500 Hz
MOST_BYTES = 2048  # that are taken at once; chosen: 50 times what an honest user says in a tick
ANSWER_SHARE = 0.4  # of a tick: so long is the answer to this very tick waited for


class Server:
    """Serves `table`, opened with its channels as they are (raw wiring), to one user at a time.

    A context manager. port 0 takes any free one; the attribute `port` tells which. servo: of the
    table, both axes alike; say: gets a line for a person about whoever comes and
    goes. ValueError: the host is no address; OSError: it cannot listen at that host and port.
    """

    def __init__(
        self,
        table: Table,
        token: bytes,
        *,
        servo: Servo,
        host: str = "127.0.0.1",
        port: int = wire.PORT,
        say: Callable[[str], None] = lambda text: None,
    ) -> None:
        self._table, self._say = table, say
        self._raw = Wiring(counts_per_rev=servo.encoder_counts_per_rev)
        self.watchdog = ClientWatchdog(table.voltage_limit_V, servo, table.period_s)
        self.boot_id = secrets.token_bytes(16)
        check_host(host)
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        try:
            socket.getaddrinfo(host, port, family)
            self._door = socket.create_server((host, port), family=family, backlog=BACKLOG)
        except socket.gaierror:
            raise ValueError(f"--host {host!r}: name an address of this machine") from None
        except OSError as error:
            raise OSError(
                f"rig serve cannot listen at {host}:{port} ({error.strerror}): is another one "
                "running? else choose with --host and --port"
            ) from None
        self._door.setblocking(False)
        self.port = int(self._door.getsockname()[1])
        self._user: Peer | None = None
        self._next: Peer | None = None  # waits until the arms have come to rest
        self._greetings = Greetings(token, say)
        self._tick = 0
        self._reading: Reading | None = None
        self._speeds = False

    def __enter__(self) -> "Server":
        return self

    def __exit__(self, kind: object, error: BaseException | None, _: object) -> None:
        """Level, 0 V and hang up; the table's own context is its owner's."""
        if self._user is not None:
            self._user.tell(wire.FAULT, b"rig serve was ended there")
            self._user.wire.close()
        if self._next is not None:
            self._next.wire.close()
        self._greetings.close()
        self._door.close()
        try:
            if not isinstance(error, Exception):  # else the table itself has failed
                self._level()
        finally:
            self._table.drive((0.0, 0.0))

    def _level(self) -> None:
        """What the user's silence would bring: level, where homing has told where that is."""
        self.watchdog.stop(time.monotonic())
        while not self.watchdog.rests(time.monotonic()):
            self._drive(self._angles(self._table.read()))

    def run(self, until: Callable[[], bool] = lambda: False) -> None:
        """Tick until `until` is true; raise what the table raises, after telling the user."""
        try:
            while not until():
                self.tick()
        except Exception as error:
            self._tell_fault(f"the table there failed: {error}")
            raise

    def tick(self) -> None:
        """Run one tick: read the table, tell the user, wait shortly for the answer, drive. OSError:
        the table is lost.
        """
        reading = self._table.read()
        now_s = time.monotonic()
        self._tick = (self._tick + 1) & 0xFFFFFFFF
        theta = self._angles(reading)
        self._speeds = reading.motor_speed_rad_s is not None
        if self._user is not None:
            self._user.tell(wire.READING, self._telemetry(reading, theta, now_s).pack())
        fault = self.watchdog.watch(replace(reading, theta_rad=theta), now_s)
        if fault is not None:
            self._tell_fault(f"stopped the table: {fault.reason}")
        self._let_in(now_s)
        self._listen(now_s + ANSWER_SHARE * self._table.period_s)
        self._drive(theta)

    def _angles(self, reading: Reading) -> tuple[float, float]:
        """The angles that the user's wiring makes of the encoders."""
        counts = [round(a / self._raw.step_rad) for a in reading.theta_rad]
        x, y = self.watchdog.wiring.angles(counts)
        return x, y

    def _drive(self, theta: tuple[float, float]) -> None:
        volts = self.watchdog.volts(theta, time.monotonic())
        self._table.drive(self.watchdog.wiring.to_board(volts))

    def _tell_fault(self, text: str) -> None:
        self._say(text)
        if self._user is not None:
            self._user.tell(wire.FAULT, encoded(text, 300))

    def _telemetry(self, reading: Reading, theta, now_s: float) -> RemoteReading:
        flags = wire.ARMED * self.watchdog.armed | wire.LATCHED * self.watchdog.latched
        speed, xy, covariance, exposed = (nan, nan), (nan, nan), (nan, nan, nan), nan
        if reading.motor_speed_rad_s is not None:
            flags |= wire.WITH_SPEED
            speed = self.watchdog.wiring.from_board(reading.motor_speed_rad_s)
        if reading.ball is not None:
            flags |= wire.WITH_BALL
            ball = reading.ball
            xy, covariance, exposed = ball.xy_m, ball.cov_m2, ball.exposed_s
        echo = self._user.echo if self._user is not None else (nan, nan)
        floats = [reading.t_s, now_s, *echo, *theta, *speed, *xy, *covariance, exposed]
        return RemoteReading(self._tick, flags, *floats)

    # --- who comes, what is said ---
    def _let_in(self, now_s: float) -> None:
        with suppress(OSError):
            for _ in range(LET_IN):
                self._greetings.welcome(*self._door.accept(), now_s)
        for peer in self._greetings.proven(now_s):
            first = self._user or self._next
            if first is None:
                self._next = peer
                continue
            peer.tell(wire.REFUSE, f"is used by {first.name} already".encode())
            peer.wire.close()
        if self._next is not None and self.watchdog.rests(now_s):
            self._seat(self._next, now_s)
            self._next = None

    def _seat(self, user: Peer, now_s: float) -> None:
        """The user's seat for one who has proven to know the token."""
        self._user, user.heard_s = user, now_s
        self.watchdog.meet()
        table = self._table
        numbers = (table.period_s, table.voltage_limit_V, self._raw.counts_per_rev)
        user.tell(
            wire.WELCOME,
            wire.Welcome(wire.VERSION, self.boot_id, *numbers, int(self._speeds)).pack(),
        )
        self._say(f"{user.name} is connected")

    def _listen(self, until_s: float) -> None:
        """Take what the user says, waiting until the answer to this tick, but not longer."""
        user = self._user
        if user is None:
            return
        while True:
            wait_s = until_s - time.monotonic() if self.watchdog.armed else 0.0
            ready = not user.gone and select.select([user.wire.sock], [], [], max(wait_s, 0.0))[0]
            now_s = time.monotonic()
            answered = False
            if ready:
                try:
                    for kind, payload in user.wire.receive(MOST_BYTES):
                        user.heard_s = now_s
                        answered = self._obey(user, kind, payload, now_s) or answered
                except (ProtocolError, ValueError) as error:
                    user.gone = f"said what no honest user says ({error})"
                except OSError:
                    user.gone = user.gone or "is gone"
            patience_s = GONE_S if self.watchdog.latched else IDLE_S
            if not user.gone and now_s - user.heard_s > patience_s:
                user.gone = f"was silent for {patience_s:g} s"
            if user.gone:
                self._part(user, now_s)
                return
            if answered or not ready or now_s >= until_s:
                return

    def _obey(self, user: Peer, kind: int, payload: bytes, now_s: float) -> bool:
        """One message; True for a command that answers this tick."""
        if kind == wire.PING:
            sent_s = Ping.unpack(payload).sent_s
            self.watchdog.hear(sent_s, now_s)
            user.tell(wire.PONG, Ping(sent_s, now_s).pack())
        elif kind == wire.CONFIGURE:
            said = wire.Configure.unpack(payload)
            if said.counts_per_rev != self._raw.counts_per_rev:  # no angle would be what it is
                raise ProtocolError(f"{said.counts_per_rev} counts a turn")
            self.watchdog.configure(said.wiring(), bool(said.homed), said.sure_V())
        elif kind == wire.ARM:
            self.watchdog.arm(now_s)
        elif kind == wire.DRIVE:
            request = DriveRequest.unpack(payload)
            if self.watchdog.obey(request, now_s):
                user.echo = (request.sent_s, now_s)
            return request.tick == self._tick
        elif kind == wire.BYE:
            user.gone = "said goodbye"
            self.watchdog.disarm()
        else:
            raise ProtocolError(f"kind {kind}")
        return False

    def _part(self, user: Peer, now_s: float) -> None:
        self.watchdog.stop(now_s)
        self._say(f"{user.name} {user.gone}")
        user.wire.close()
        self._user = None
