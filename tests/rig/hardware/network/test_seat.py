"""The seat of a served table, tick by tick by hand: who gets it, who is sent away, who loses it.

No clock runs and no thread: the peers are sockets of this machine, whose bytes are there at once.
"""

import select
import socket
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from math import isnan
from types import SimpleNamespace

import pytest

from rig.hardware.network import remote_wire as wire
from rig.hardware.network.client_watchdog import CATCH_TAUS, LEVEL_S
from rig.hardware.network.greetings import GREETING_S, LINES, LINES_S, MOST, Greetings
from rig.hardware.network.remote_wire import Wire
from rig.hardware.network.serve import GONE_S, IDLE_S, Server
from rig.hardware.wiring import Wiring
from rig.parameters import Servo
from rig.safety.monitor import Fault
from rig.table import Observation, Reading

TOKEN = b"0123456789abcdef"
NONCE = b"c" * wire.NONCE_BYTES
WAIT_S = LEVEL_S + CATCH_TAUS * Servo().time_constant_s  # until arms that nobody holds have rested


class Stranger:
    """Somebody at the other end of a connection to `port`."""

    def __init__(self, port: int) -> None:
        self.sock = socket.create_connection(("127.0.0.1", port))
        self.sock.settimeout(0.5)  # what was sent is there already
        self.wire = Wire(self.sock)
        self.name = "{}:{}".format(*self.sock.getsockname()[:2])
        self._heard: list[tuple[int, bytes]] = []

    def hears(self, kind: int) -> bytes:
        """What was said of this kind; it has to come next."""
        if not self._heard:
            self._heard = self.wire.receive()
        found, payload = self._heard.pop(0)
        assert found == kind
        return payload

    def proves(self, token: bytes = TOKEN) -> None:
        """Answer the greeting."""
        hello = self.hears(wire.HELLO)
        assert hello[0] == wire.VERSION
        self.wire.send(wire.PROOF, NONCE + wire.proof(token, hello[1:], NONCE))
        self.wire.seal(token, hello[1:], NONCE, server=False)

    @property
    def is_hung_up_on(self) -> bool:
        """Whether the other end closes the connection after what was heard."""
        try:
            while self.wire.receive():
                pass
        except ConnectionResetError:
            return True
        except TimeoutError:
            return False
        return False


# --- at the door ---
@contextmanager
def at_the_door():
    """Greetings, what they say, and what makes the next one knock: (stranger, from which host)."""
    said: list[str] = []
    greetings = Greetings(TOKEN, said.append)
    strangers: list[Stranger] = []
    with socket.create_server(("127.0.0.1", 0)) as door:

        def knock(now_s: float = 0.0, host: str = "") -> Stranger:
            one = Stranger(door.getsockname()[1])
            sock, address = door.accept()
            greetings.welcome(sock, (host or address[0], *address[1:]), now_s)
            strangers.append(one)
            return one

        yield greetings, said, knock
        greetings.close()
        for one in strangers:
            one.sock.close()


def test_who_proves_to_know_the_token_is_let_in_once_and_sealed():
    with at_the_door() as (greetings, said, knock):
        assert greetings.proven(0.0) == []
        one, silent = knock(), knock()
        assert greetings.proven(0.1) == []  # nobody has said anything
        one.proves()
        (peer,) = greetings.proven(GREETING_S)
        assert (peer.name, peer.host, peer.gone) == (one.name, "127.0.0.1", "")
        assert all(map(isnan, peer.echo))
        peer.tell(wire.PONG, b"sealed")
        assert one.hears(wire.PONG) == b"sealed"
        one.wire.send(wire.PING, b"and back")
        assert peer.wire.receive() == [(wire.PING, b"and back")]
        assert greetings.proven(GREETING_S) == []
        assert said == []
        assert silent.hears(wire.HELLO)  # still waits
        peer.wire.close()


def test_numbers_of_a_greeting_are_never_used_twice():
    with at_the_door() as (_, _, knock):
        first, second = knock().hears(wire.HELLO)[1:], knock().hears(wire.HELLO)[1:]
        assert len(first) == wire.NONCE_BYTES
        assert first != second


@pytest.mark.parametrize(
    ("say", "why"),
    [
        (lambda one: one.proves(b"another-token-x!"), "did not know the token"),
        (lambda one: one.wire.send(wire.HELLO, b"hello"), "did not know the token"),
        (lambda one: one.wire.send(wire.PROOF, b""), "did not know the token"),
        (lambda one: one.sock.sendall(b"\xff\xff\xff"), "said what no honest user says"),
        (lambda one: one.sock.sendall(b"\x02\x00\x08x"), "said what no honest user says"),
        (lambda one: one.sock.close(), "is gone"),
    ],
)
def test_who_does_not_is_sent_away_with_a_reason(say, why: str):
    with at_the_door() as (greetings, said, knock):
        one = knock()
        say(one)
        assert greetings.proven(0.1) == []
        assert said == [f"{one.name} {why}"]
        if why.startswith("did not"):
            if one.wire._in == b"":
                one.hears(wire.HELLO)
            assert one.hears(wire.REFUSE).startswith(b"refused the token")
        assert greetings.proven(0.2) == []
        assert len(said) == 1


def test_a_proof_with_the_kind_of_another_message_is_none():
    with at_the_door() as (greetings, said, knock):
        one = knock()
        hello = one.hears(wire.HELLO)
        one.wire.send(wire.REFUSE, NONCE + wire.proof(TOKEN, hello[1:], NONCE))
        assert greetings.proven(0.1) == []
        assert said == [f"{one.name} did not know the token"]


def test_of_two_answers_to_a_greeting_the_first_counts():
    with at_the_door() as (greetings, said, knock):
        one = knock()
        hello = one.hears(wire.HELLO)
        one.wire.send(wire.PROOF, NONCE + wire.proof(b"another-token-x!", hello[1:], NONCE))
        one.wire.send(wire.PROOF, NONCE + wire.proof(TOKEN, hello[1:], NONCE))
        assert greetings.proven(0.1) == []
        assert said == [f"{one.name} did not know the token"]


def test_the_servers_tick_never_waits_for_who_says_nothing():
    module = vars(sys.modules[Greetings.__module__])
    waited = []

    def select(*given):
        waited.append(given[-1])
        return [], [], []

    with at_the_door() as (greetings, _, knock):
        knock()
        before = module["select"]
        module["select"] = SimpleNamespace(select=select)
        try:
            assert greetings.proven(0.1) == []
        finally:
            module["select"] = before
    assert waited == [0.0]


def test_half_a_proof_is_waited_for_but_not_for_long():
    with at_the_door() as (greetings, said, knock):
        one = knock(now_s=10.0)
        one.sock.sendall(b"\x41")
        assert greetings.proven(10.0 + GREETING_S) == []
        assert said == []
        assert greetings.proven(10.001 + GREETING_S) == []
        assert said == [f"{one.name} was silent for 2 s"]
        one.hears(wire.HELLO)
        assert one.is_hung_up_on


def test_where_too_many_wait_the_oldest_of_the_busiest_address_goes():
    with at_the_door() as (greetings, said, knock):
        early = knock(host="10.0.0.1")
        assert MOST == 8
        crowd = [knock(host="10.0.0.2") for _ in range(MOST - 1)]
        assert greetings.proven(0.1) == []
        late = knock(host="10.0.0.3")
        crowd[0].hears(wire.HELLO)
        assert crowd[0].is_hung_up_on
        for one in (early, *crowd[1:], late):
            one.proves()
        peers = greetings.proven(0.2)
        assert [p.name.partition(":")[2] for p in peers] == [
            one.name.partition(":")[2] for one in (early, *crowd[1:], late)
        ]
        for peer in peers:
            peer.wire.close()
        place = f"10.0.0.2:{crowd[0].name.partition(':')[2]}"
        assert said == [f"{place} made room: too many were at the door"]


def test_a_scan_of_ports_is_a_few_lines_and_a_count_a_minute():
    """Each of its thousands of connections had a line, and a run's own were out of sight."""
    with at_the_door() as (greetings, said, knock):

        def scanned(count: int, now_s: float) -> list[str]:
            names = []
            for _ in range(count):
                one = knock(now_s=now_s)
                one.sock.sendall(b"\xff\xff\xff")
                assert greetings.proven(now_s) == []
                names.append(f"{one.name} said what no honest user says")
            return names

        assert (LINES, LINES_S) == (5, 60.0)
        named = scanned(LINES, 10.0)
        assert said == named
        newest = scanned(3, 10.0 + LINES_S - 0.1)[-1]
        assert said == named
        assert greetings.proven(10.0 + LINES_S - 0.01) == []
        assert said == named
        for now_s in (10.0 + LINES_S, 11.0 + LINES_S):
            assert greetings.proven(now_s) == []
            assert said[LINES:] == [
                f"and 3 more within 60 s were turned away; the newest: {newest}"
            ]
        # a minute begins with its first
        again = scanned(LINES, 300.0)
        assert said[LINES + 1 :] == again
        assert greetings.proven(300.0 + LINES_S) == []
        assert said[LINES + 1 :] == again
        newest = scanned(LINES + 1, 400.0)[-1]
        greetings.close()
        assert said[-1] == f"and 1 more within 60 s were turned away; the newest: {newest}"
        greetings.close()
        assert len(said) == 3 * LINES + 2


def test_the_door_that_closes_hangs_up_on_all():
    with at_the_door() as (greetings, _, knock):
        strangers = [knock(), knock()]
        greetings.close()
        for one in strangers:
            one.hears(wire.HELLO)
            assert one.is_hung_up_on


def test_one_who_does_not_read_is_gone():
    with at_the_door() as (greetings, _, knock):
        one = knock()
        one.proves()
        (peer,) = greetings.proven(0.1)
        assert not peer.wire.sock.getblocking()
        for _ in range(100_000):
            peer.tell(wire.PONG, b"x" * 300)
            if peer.gone:
                break
        assert peer.gone == "does not read what it is told"
        peer.gone = "before"
        peer.tell(wire.PONG, b"x" * 300)
        assert peer.gone == "before"
        peer.wire.close()


# --- in the seat ---
class Bench:
    """A table that keeps what it is given and shows what it is told to."""

    period_s, voltage_limit_V = 0.002, 6.0

    def __init__(self) -> None:
        self.reading = Reading(0.0, (0.0, 0.0), None, None)
        self.volts: list[tuple[float, float]] = []

    def read(self) -> Reading:
        self.reading = replace(self.reading, t_s=self.reading.t_s + self.period_s)
        return self.reading

    def drive(self, volts: tuple[float, float]) -> None:
        self.volts.append(volts)


class Served:
    """A server whose clock stands until it is moved on."""

    def __init__(self) -> None:
        self.bench, self.said, self.now_s = Bench(), [], 100.0
        self.strangers: list[Stranger] = []
        self.server = Server(self.bench, TOKEN, servo=Servo(), port=0, say=self.said.append)
        assert not self.server._door.getblocking()  # nobody who may come is waited for
        module = sys.modules[Server.__module__]
        module.time = SimpleNamespace(monotonic=self._clock)  # pyright: ignore
        module.select = SimpleNamespace(select=self._select)  # pyright: ignore
        self._asked, self.slow_s = 0, 0.0
        self.waits: list[float] = []  # for which a tick was ready to wait for the user

    def _select(self, *waiting_for):
        *sockets, seconds = waiting_for
        assert 0.0 <= seconds <= self.bench.period_s, "a tick waits longer than a tick"
        self.waits.append(seconds)
        return select.select(*sockets, 0.0)

    def _clock(self) -> float:
        self._asked += 1
        assert self._asked < 10_000, "it waits for a clock that stands"
        self.now_s += self.slow_s
        return self.now_s

    def ticks(self, count: int = 1, each_s: float = 0.002) -> None:
        for _ in range(count):
            self.now_s += each_s
            self._asked = 0
            self.waits.clear()
            self.server.tick()

    def user(self) -> Stranger:
        """Somebody who knows the token and has been let in (or refused)."""
        one = Stranger(self.server.port)
        self.strangers.append(one)
        self.ticks()
        one.proves()
        self.ticks()
        return one


@contextmanager
def served() -> Iterator[Served]:
    module = sys.modules[Server.__module__]
    real = module.time, module.select  # pyright: ignore
    one = Served()
    try:
        yield one
    finally:
        if one.server._user is not None:
            one.server._user.wire.close()
        if one.server._next is not None:
            one.server._next.wire.close()
        one.server._greetings.close()
        one.server._door.close()
        for stranger in one.strangers:
            stranger.sock.close()
        module.time, module.select = real  # pyright: ignore


def arm(one: Served, user: Stranger, *, homed: bool = True) -> None:
    """Have a user's table armed."""
    user.wire.send(wire.CONFIGURE, wire.Configure.of(Wiring(), homed).pack())
    user.wire.send(wire.ARM)
    one.ticks()


def drive(one: Served, user: Stranger, volts: tuple[float, float], *, tick: int = 0) -> None:
    user.wire.send(wire.DRIVE, wire.DriveRequest(tick, one.now_s, 20, *volts).pack())
    one.ticks()


def test_a_user_whose_encoders_are_others_is_sent_away_before_any_volt():
    """By other counts a turn every angle, and so the angle limit, would be another one."""
    with served() as one:
        user = one.user()
        odd = Wiring(counts_per_rev=Wiring().counts_per_rev * 8)
        user.wire.send(wire.CONFIGURE, wire.Configure.of(odd, True).pack())
        user.wire.send(wire.ARM)
        one.ticks()
        assert not one.server.watchdog.armed
        assert user.is_hung_up_on


def test_the_first_user_gets_the_seat_and_is_told_what_the_table_is():
    with served() as one:
        user = one.user()
        told = wire.Welcome.unpack(user.hears(wire.WELCOME))
        assert told == wire.Welcome(wire.VERSION, one.server.boot_id, 0.002, 6.0, 4096, 0)
        assert len(one.server.boot_id) == 16
        assert one.said == [f"{user.name} is connected"]
        one.ticks()
        reading = wire.RemoteReading.unpack(user.hears(wire.READING))
        assert (reading.tick, reading.flags) == (3, 0)
        assert reading.t_s == pytest.approx(0.006)
        assert reading.sent_s == pytest.approx(one.now_s)
        assert (reading.theta_x, reading.theta_y) == (0.0, 0.0)
        for empty in (reading.echo_sent_s, reading.speed_x, reading.ball_x, reading.exposed_s):
            assert isnan(empty)


def test_a_second_user_is_refused_by_name_and_the_first_goes_on():
    with served() as one:
        first = one.user()
        second = one.user()
        assert second.hears(wire.REFUSE) == f"is used by {first.name} already".encode()
        assert second.is_hung_up_on
        first.wire.send(wire.PING, wire.Ping(7.0).pack())
        one.ticks()
        first.hears(wire.WELCOME)
        kinds = [kind for kind, _ in (first._heard or first.wire.receive())]
        assert wire.PONG in kinds
        assert one.said == [f"{first.name} is connected"]


def test_volts_pass_while_armed_and_goodbye_ends_them_and_frees_the_seat():
    with served() as one:
        user = one.user()
        drive(one, user, (1.0, -1.0))
        assert one.bench.volts[-1] == (0.0, 0.0)  # not armed
        arm(one, user)
        assert one.server.watchdog.armed
        drive(one, user, (1.0, -1.0))
        assert one.bench.volts[-1] == (1.0, -1.0)
        user.wire.send(wire.BYE)
        one.ticks()
        assert one.bench.volts[-1] == (0.0, 0.0)
        assert not one.server.watchdog.armed
        assert not one.server.watchdog.latched
        assert one.said[-1] == f"{user.name} said goodbye"
        goodbye_s = one.now_s
        again, third = one.user(), one.user()
        assert third.hears(wire.REFUSE) == f"is used by {again.name} already".encode()
        while one.server._user is None:  # the arms are being caught
            one.ticks()
        assert one.now_s - goodbye_s == pytest.approx(WAIT_S, abs=0.01)
        again.hears(wire.WELCOME)


def test_who_waits_for_the_seat_when_the_server_ends_is_hung_up_on():
    with served() as one:
        user = one.user()
        arm(one, user)
        user.wire.send(wire.BYE)
        one.ticks()
        again = one.user()
        one.bench.drive = lambda volts: setattr(one, "now_s", one.now_s + 0.01)
        one.server.__exit__(None, None, None)
        assert again.is_hung_up_on


def test_echoes_give_the_clocks_and_flags_tell_the_state():
    with served() as one:
        one.bench.reading = replace(
            one.bench.reading,
            motor_speed_rad_s=(0.5, -0.5),
            ball=Observation((0.01, 0.02), (1e-6, 0.0, 2e-6), 0.004),
        )
        user = one.user()
        assert wire.Welcome.unpack(user.hears(wire.WELCOME)).tachometers == 1
        arm(one, user)
        sent_s = one.now_s
        drive(one, user, (0.0, 0.0))
        taken_s = one.now_s
        one.ticks()
        readings = [wire.RemoteReading.unpack(user.hears(wire.READING)) for _ in range(3)]
        last = readings[-1]
        assert last.flags == wire.ARMED | wire.WITH_BALL | wire.WITH_SPEED
        assert (last.echo_sent_s, last.echo_received_s) == (sent_s, taken_s)
        assert (last.speed_x, last.speed_y) == (0.5, -0.5)
        assert (last.ball_x, last.ball_y, last.cov_xx, last.cov_yy) == (0.01, 0.02, 1e-6, 2e-6)
        assert last.exposed_s == 0.004
        stale = wire.DriveRequest(0, one.now_s - 5.0, 20, 1.0, 0.0)  # sent before the last one
        user.wire.send(wire.DRIVE, stale.pack())
        one.ticks(2)
        assert one.server._user is not None
        assert one.server._user.echo == (sent_s, taken_s)


def test_who_falls_silent_is_levelled_and_loses_the_seat_a_second_later():
    with served() as one:
        user = one.user()
        arm(one, user)
        drive(one, user, (1.0, 1.0))
        one.ticks(60)
        assert one.server.watchdog.latched
        assert one.server._user is not None
        one.now_s = 100.0 + GONE_S
        one.ticks(each_s=0.0)
        assert one.server._user is not None  # heard a little after 100 s
        one.now_s += 0.1
        one.ticks()
        assert one.server._user is None
        assert one.said[-1] == f"{user.name} was silent for 1 s"


def test_who_never_arms_may_think_for_half_a_minute():
    with served() as one:
        user = one.user()
        heard_s = one.now_s
        one.now_s = heard_s + IDLE_S
        one.ticks(each_s=0.0)
        assert one.server._user is not None
        one.now_s = heard_s + IDLE_S + 0.01
        one.ticks(each_s=0.0)
        assert one.server._user is None
        assert one.said[-1] == f"{user.name} was silent for 30 s"


@pytest.mark.parametrize(
    ("say", "why"),
    [
        (lambda user: user.wire.send(wire.READING, b""), "said what no honest user says (kind 10)"),
        (lambda user: user.wire.send(wire.DRIVE, b"short"), "said what no honest user says"),
        (lambda user: user.sock.close(), ""),  # "is gone" or "does not read", as the bytes come
    ],
)
def test_who_lies_or_leaves_while_armed_is_levelled_and_parted_from(say, why: str):
    with served() as one:
        user = one.user()
        arm(one, user)
        drive(one, user, (2.0, 0.0))
        say(user)
        one.bench.reading = replace(one.bench.reading, theta_rad=(0.01, 0.0))
        one.ticks()
        assert one.server._user is None
        assert one.server.watchdog.latched
        assert one.said[-1].startswith(f"{user.name} {why}")
        one.ticks(2)
        assert one.bench.volts[-1][0] < 0.0  # towards level


def test_a_tick_of_an_armed_table_waits_for_its_answer_and_not_longer():
    with served() as one:
        user = one.user()
        one.ticks()
        assert one.waits == [0.0]  # nothing moves: nobody has to answer
        arm(one, user)
        one.ticks()
        share = pytest.approx(0.4 * one.bench.period_s)
        assert one.waits == [share]
        drive(one, user, (0.0, 0.0), tick=one.server._tick + 1)
        assert one.waits == [share]  # that was the answer
        drive(one, user, (0.0, 0.0), tick=one.server._tick)
        assert one.waits == [share, share]  # of an earlier tick
        user.wire.send(wire.PING, wire.Ping(7.0).pack())
        one.ticks()
        assert one.waits == [share, share]
        request = wire.DriveRequest(one.server._tick + 1, one.now_s, 20, 0.0, 0.0)
        user.wire.send(wire.DRIVE, request.pack())
        user.wire.send(wire.PING, wire.Ping(8.0).pack())
        one.ticks()
        assert one.waits == [share]
        one.slow_s = 0.001  # the time is over before anybody was listened to
        user.wire.send(wire.PING, wire.Ping(9.0).pack())
        one.ticks()
        assert one.waits == [0.0]


def test_who_says_anything_keeps_the_seat():
    with served() as one:
        user = one.user()
        for _ in range(3):
            one.now_s += 0.9 * IDLE_S
            user.wire.send(wire.PING, wire.Ping(7.0).pack())
            one.ticks()
            assert one.server._user is not None


def test_one_who_floods_makes_no_tick_long():
    """Thousands of messages that wait are taken some at a time, each tick in turn."""
    with served() as one:
        user = one.user()
        user.sock.settimeout(2.0)
        ping = wire.Ping(7.0).pack()
        for _ in range(2000):
            user.wire.send(wire.PING, ping)
        obeyed = []
        obey = one.server._obey
        one.server._obey = lambda *words: obeyed.append(words) or obey(*words)
        one.slow_s = 4e-4  # a look at the clock
        one.ticks()
        assert 0 < len(obeyed) < 200
        one.ticks(100)
        assert len(obeyed) == 2000
        assert one.server._user is not None


def test_who_hangs_up_is_gone():
    with served() as one:
        user = one.user()
        user.sock.shutdown(socket.SHUT_WR)
        one.ticks()
        assert one.server._user is None
        assert one.said[-1] == f"{user.name} is gone"


def test_a_fault_of_the_table_is_told_to_the_user():
    with served() as one:
        user = one.user()
        arm(one, user)
        fault = Fault("stalled", "the arm x does not follow" + 400 * "!", True)
        one.server.watchdog.watch = lambda reading, now_s: fault
        one.ticks()
        user.hears(wire.WELCOME)
        user.hears(wire.READING)
        user.hears(wire.READING)
        told = user.hears(wire.FAULT)
        assert told.startswith(b"stopped the table: the arm x does not follow!")
        assert len(told) == 300
        assert one.said[-1] == f"stopped the table: {fault.reason}"


def test_leaving_levels_tells_the_user_and_leaves_0_V():
    with served() as one:
        user = one.user()
        knocking = Stranger(one.server.port)
        one.strangers.append(knocking)
        arm(one, user)
        one.bench.reading = replace(one.bench.reading, theta_rad=(0.05, 0.0))
        drive_of, begin_s = one.bench.drive, one.now_s

        def slow_drive(volts: tuple[float, float]) -> None:
            one.now_s += 0.01
            drive_of(volts)

        one.bench.drive = slow_drive
        count = len(one.bench.volts)
        assert one.server.__enter__() is one.server
        one.server.__exit__(None, None, None)
        knocking.hears(wire.HELLO)
        assert knocking.is_hung_up_on
        given = one.bench.volts[count:]
        assert len(given) >= 50
        assert given[0][0] < 0.0
        assert given[-1] == (0.0, 0.0)
        assert one.now_s - begin_s == pytest.approx(WAIT_S, abs=0.05)
        user.hears(wire.WELCOME)
        user.hears(wire.READING)
        assert user.hears(wire.FAULT) == b"rig serve was ended there"
        assert user.is_hung_up_on


def test_nobody_in_the_seat_is_told_nothing_when_the_server_ends():
    with served() as one:
        one.bench.read = lambda: 1 / 0
        with pytest.raises(ZeroDivisionError):
            one.server.run()
        del one.bench.read
        one.server.__exit__(None, None, None)
        assert one.bench.volts == [(0.0, 0.0)]


def test_a_table_that_failed_is_not_levelled_but_left_at_0_V():
    with served() as one:
        arm(one, one.user())
        count = len(one.bench.volts)
        one.server.__exit__(OSError, OSError("gone"), None)
        assert one.bench.volts[count:] == [(0.0, 0.0)]


def test_it_runs_until_told_and_tells_why_it_cannot():
    with served() as one:
        user = one.user()
        count = len(one.bench.volts)
        one.server.run(lambda: len(one.bench.volts) >= count + 3)
        assert len(one.bench.volts) == count + 3

        def fail() -> Reading:
            raise OSError("no power")

        one.bench.read = fail
        with pytest.raises(OSError, match="no power"):
            one.server.run()
        user.hears(wire.WELCOME)
        for _ in range(3):
            user.hears(wire.READING)
        assert user.hears(wire.FAULT) == b"the table there failed: no power"


def test_a_host_that_is_no_address_is_bad_input():
    with pytest.raises(
        ValueError, match=r"^--host '999\.1\.1\.1': name an address of this machine"
    ):
        Server(Bench(), TOKEN, servo=Servo(), host="999.1.1.1", port=0)
