"""The seal of a remote table's messages: none is added, changed, repeated, reordered, reflected.

Each test plays the man in the middle between two ends of a connection.
"""

import hashlib
import hmac
import socket
import struct
from contextlib import contextmanager
from dataclasses import FrozenInstanceError
from itertools import product
from math import inf, nan

import pytest

from rig.hardware.network.remote_wire import (
    ARM,
    ARMED,
    BYE,
    CONFIGURE,
    DRIVE,
    FAULT,
    HELLO,
    LATCHED,
    LONGEST,
    NONCE_BYTES,
    PING,
    PONG,
    PORT,
    PROOF,
    PROOF_BYTES,
    READING,
    REFUSE,
    SILENT_S,
    VERSION,
    WELCOME,
    WITH_BALL,
    WITH_SPEED,
    Configure,
    DriveRequest,
    Ping,
    ProtocolError,
    RemoteReading,
    Welcome,
    Wire,
    proof,
)
from rig.hardware.wiring import Wiring

TOKEN, SERVER, CLIENT = b"0123456789abcdef", b"s" * 32, b"c" * 32


@contextmanager
def connection():
    """Two connected sockets of the network, the second one's reads never wait."""
    with socket.create_server(("127.0.0.1", 0)) as door:
        near = socket.create_connection(door.getsockname())
        far, _ = door.accept()
    with near, far:
        yield near, far


@contextmanager
def ends(*, user=(TOKEN, SERVER, CLIENT), server=(TOKEN, SERVER, CLIENT), sealed=True):
    """User's and server's `Wire` of one connection; what one sends is there for the other."""
    with connection() as (near, far):
        one, other = Wire(near), Wire(far)
        near.settimeout(2.0)
        far.settimeout(2.0)
        if sealed:
            one.seal(*user, server=False)
            other.seal(*server, server=True)
        yield one, other


def frames(*messages: tuple[int, bytes], wire: Wire) -> list[bytes]:
    """The bytes that a wire sends for messages, without sending them."""
    sock, out = wire.sock, []

    class Tap:
        def send(self, data: bytes) -> int:
            out.append(data)
            return len(data)

    wire.sock = Tap()  # type: ignore[assignment]
    for kind, payload in messages:
        wire.send(kind, payload)
    wire.sock = sock
    return out


def everything(wire: Wire, count: int) -> list[tuple[int, bytes]]:
    found: list = []
    while len(found) < count:
        found += wire.receive()
    return found


def refused(wire: Wire, say: str = "wrong seal") -> None:
    with pytest.raises(ProtocolError, match=say):
        everything(wire, 99)


def test_messages_pass_both_ways_in_order():
    with ends() as (user, server):
        sent = [(DRIVE, bytes([k]) * k) for k in range(0, 250, 7)]
        for kind, payload in sent:
            user.send(kind, payload)
        assert everything(server, len(sent)) == sent
        server.send(READING, b"there")
        server.send(READING, b"again")
        assert everything(user, 2) == [(READING, b"there"), (READING, b"again")]


def test_a_repeated_message_is_refused():
    with ends() as (user, server):
        (once,) = frames((DRIVE, b"3 V"), wire=user)
        user.sock.sendall(once)
        assert everything(server, 1) == [(DRIVE, b"3 V")]
        user.sock.sendall(once)
        refused(server)


def test_messages_out_of_order_or_left_out_are_refused():
    for order in ((1, 0), (0, 2), (1, 2)):
        with ends() as (user, server):
            all_three = frames((DRIVE, b"1"), (DRIVE, b"2"), (DRIVE, b"3"), wire=user)
            user.sock.sendall(b"".join(all_three[k] for k in order))
            refused(server)


def test_a_message_sent_back_to_its_sender_is_refused():
    with ends() as (user, server):
        (mine,) = frames((DRIVE, b"3 V"), wire=user)
        server.sock.sendall(mine)
        refused(user)
    with ends() as (user, server):
        (mine,) = frames((READING, b"far out"), wire=server)
        user.sock.sendall(mine)
        refused(server)


@pytest.mark.parametrize(
    "other",
    [(b"another token 16", SERVER, CLIENT), (TOKEN, b"x" * 32, CLIENT), (TOKEN, SERVER, b"x" * 32)],
    ids=["token", "server's nonce", "client's nonce"],
)
def test_keys_depend_on_the_token_and_on_both_random_numbers(other):
    """Else the messages of an earlier connection could be played again."""
    with ends(user=other) as (user, server):
        user.send(DRIVE, b"3 V")
        refused(server)
    with ends(server=other) as (user, server):
        server.send(READING, b"level")
        refused(user)
    assert proof(*other) != proof(TOKEN, SERVER, CLIENT)


def test_proof_and_seal_are_those_of_the_protocol():
    """HMAC-SHA-256 by its definition (RFC 2104), on the protocol's own layout."""

    def mac(key: bytes, text: bytes) -> bytes:
        block = key.ljust(64, b"\0")
        inner = hashlib.sha256(bytes(b ^ 0x36 for b in block) + text).digest()
        return hashlib.sha256(bytes(b ^ 0x5C for b in block) + inner).digest()

    assert proof(TOKEN, SERVER, CLIENT) == mac(TOKEN, b"rig client|" + SERVER + CLIENT)
    with ends() as (user, server):
        for wire_, label in ((user, b"rig up|"), (server, b"rig down|")):
            key = mac(TOKEN, label + SERVER + CLIENT)
            for number, frame in enumerate(frames((ARM, b""), (DRIVE, b"ab"), wire=wire_)):
                kind, text = ((ARM, b""), (DRIVE, b"ab"))[number]
                seal = mac(key, struct.pack("<QB", number, kind) + text)[:8]
                body = bytes([kind]) + text + seal
                assert frame == struct.pack("<H", len(body)) + body
    assert hmac.new(TOKEN, b"x", "sha256").digest() == mac(TOKEN, b"x")


def test_every_flipped_bit_is_refused():
    with ends() as (user, _):
        (frame,) = frames((DRIVE, b"0123"), wire=user)
    for place, bit in product(range(2, len(frame)), range(8)):
        with ends() as (_, server):
            bad = bytearray(frame)
            bad[place] ^= 1 << bit
            kind = bad[2]
            server.sock.settimeout(2.0)
            other = Wire.__new__(Wire)
            other.__dict__.update(server.__dict__)
            other._buffer = bytearray(bad)
            if kind == REFUSE:  # may come unsealed at any time: it ends the connection
                continue
            with pytest.raises(ProtocolError, match="seal"):
                other._frames()


def test_before_the_greeting_nothing_sealed_and_after_it_nothing_unsealed_passes():
    with ends(sealed=False) as (user, server):
        user.send(HELLO, b"hello")
        assert everything(server, 1) == [(HELLO, b"hello")]
        user.sock.sendall(struct.pack("<HB", 9, DRIVE) + bytes(8))
        refused(server, "before the greeting")
    for kind in (HELLO, 2):
        with ends() as (user, server):
            user.sock.sendall(struct.pack("<HB", 1, kind))
            refused(server, "after the greeting")
    with ends() as (user, server):
        server.send(REFUSE, b"no")  # even then: it only ends the connection
        assert everything(user, 1) == [(REFUSE, b"no")]


def test_numbers_of_the_protocol():
    """Both machines need the same: a change of one is another VERSION."""
    kinds = (HELLO, PROOF, REFUSE, WELCOME, PING, PONG, CONFIGURE, ARM, DRIVE, READING, FAULT, BYE)
    assert kinds == tuple(range(1, 13))
    assert (ARMED, LATCHED, WITH_BALL, WITH_SPEED) == (1, 2, 4, 8)
    assert (VERSION, NONCE_BYTES, LONGEST, PORT, SILENT_S) == (2, 32, 400, 7643, 0.1)
    said = CLIENT + proof(TOKEN, SERVER, CLIENT)
    assert len(struct.pack("<HB", 1 + len(said), PROOF) + said) == PROOF_BYTES


def test_lengths_beyond_the_longest_and_of_nothing_are_refused():
    for length, fits in ((0, False), (1, True), (400, True), (401, False), (65535, False)):
        with ends(sealed=False) as (user, server):
            user.sock.sendall(struct.pack("<H", length) + b"\1" * min(length, 400))
            if fits:
                assert everything(server, 1) == [(1, b"\1" * (length - 1))]
            else:
                refused(server, f"a message of {length} bytes")


def test_a_message_may_come_in_pieces():
    with ends() as (user, server):
        found = []
        for piece in b"".join(frames((DRIVE, b"piece"), (ARM, b""), wire=user)):
            user.sock.sendall(bytes([piece]))
            found += server.receive()
        assert found == [(DRIVE, b"piece"), (ARM, b"")]


def test_a_closed_connection_and_one_that_does_not_read_are_told():
    with ends() as (user, server):
        user.close()
        user.close()
        with pytest.raises(ConnectionResetError, match="closed"):
            server.receive()
    with ends() as (user, server):
        server.sock.setblocking(False)
        assert server.receive() == []  # nothing there, nobody waits
        user.sock.setblocking(False)
        flood = ((DRIVE, bytes(300)) for _ in range(10**6))
        with pytest.raises(BlockingIOError):
            all(user.send(*message) is None for message in flood)


def test_small_messages_are_not_held_back():
    with ends() as (user, _):
        assert user.sock.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)


def test_what_is_packed_is_unpacked_and_has_one_size():
    numbers = [float(k) for k in range(14)]
    messages = [
        (Welcome(1, b"i" * 16, 0.002, 6.0, 4096, 1), 2 + 16 + 8 + 8 + 2 + 1),
        (Ping(1.5, 2.5), 16),
        (Configure(1, 0, -1, 1, 1, -1, -5, 70000, 4096, 1, 0.5, 0.25), 2 + 4 + 8 + 2 + 1 + 16),
        (DriveRequest(7, 1.5, 50, -2.0, 3.0), 4 + 8 + 2 + 16),
        (RemoteReading(9, 15, *numbers), 5 + 14 * 8),
    ]
    for message, size in messages:
        data = message.pack()
        assert len(data) == size
        assert type(message).unpack(data) == message
        with pytest.raises(FrozenInstanceError):
            message.version = message.sent_s = message.homed = message.tick = 0  # type: ignore
        for bad in (data[:-1], data + b"\0"):
            with pytest.raises(ProtocolError, match=f"{len(bad)} bytes, not {size}"):
                type(message).unpack(bad)
    assert Ping(1.0).pack()[8:] == struct.pack("<d", float("nan"))


def test_the_wiring_travels():
    for swap, crossed, homed in product((False, True), repeat=3):
        wiring = Wiring((1, 0) if swap else (0, 1), (1, -1), (-1, 1), (5, -70000), 2048, crossed)
        message = Configure.of(wiring, homed, ((0.5, 0.25), (0.0, inf)))
        assert message.sure_V() == Configure.unpack(message.pack()).sure_V()
        assert message.sure_V() == ((0.5, 0.25), (0.0, inf))
        assert Configure.of(wiring, homed).sure_V() == ((inf, inf), (inf, inf))
        for bad in (-0.1, nan):
            with pytest.raises(ValueError, match="move the arms"):
                Configure.of(wiring, homed, ((0.5, 0.25), (bad, 0.1))).sure_V()
        assert message.wiring() == wiring
        assert (message.swap, message.crossed, message.homed) == (swap, crossed, homed)
        assert message.volts_0 == 1
        assert message.zero_1 == -70000
