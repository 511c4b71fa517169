"""What goes over the network between a remote table and its user: small sealed binary messages.

A frame is length (2 bytes), kind (1 byte), payload, seal (8 bytes). The token never travels: both
ends prove that they know it over two random numbers, and every message after that is sealed by a
key made of all three and numbered, so that nobody can add, change, repeat or reorder any.
"""

import hmac
import socket
import struct
from contextlib import suppress
from dataclasses import astuple, dataclass
from math import inf, nan

from rig.hardware.wiring import Wiring
from rig.safety.motion_watch import UNKNOWN, Both

VERSION = 2
NONCE_BYTES, SEAL_BYTES, LONGEST = 32, 8, 400
PORT = 7643
SILENT_S = 0.1  # without a fresh command for so long the table stops by itself

# Kinds of messages: the first three are not sealed.
HELLO, PROOF, REFUSE, WELCOME, PING, PONG, CONFIGURE, ARM, DRIVE, READING, FAULT, BYE = range(1, 13)
UNSEALED = (HELLO, PROOF, REFUSE)
PROOF_BYTES = 2 + 1 + NONCE_BYTES + 32  # of the whole frame: length, kind, random number, HMAC
ARMED, LATCHED, WITH_BALL, WITH_SPEED = 1, 2, 4, 8  # flags of a reading


class ProtocolError(Exception):
    """Bytes that no peer with the right token and this protocol sends."""


def _packs(layout: str):
    """A dataclass of numbers <-> bytes, field by field in `layout` (struct)."""
    size = struct.Struct("<" + layout)

    def add(kind):
        kind.pack = lambda self: size.pack(*astuple(self))

        def unpack(payload: bytes):
            if len(payload) != size.size:
                raise ProtocolError(f"{kind.__name__} has {len(payload)} bytes, not {size.size}")
            return kind(*size.unpack(payload))

        kind.unpack = staticmethod(unpack)
        return kind

    return add


class _Packed:
    def pack(self) -> bytes:
        raise NotImplementedError

    @staticmethod
    def unpack(payload: bytes):
        raise NotImplementedError


@_packs("H16sddHB")
@dataclass(frozen=True)
class Welcome(_Packed):
    """Server to user: what the table is. boot_id is new when the encoders may have lost their
    place.

    tachometers: 1 where the table has them, else 0.
    """

    version: int
    boot_id: bytes
    period_s: float
    voltage_limit_V: float
    counts_per_rev: int
    tachometers: int


@_packs("dd")
@dataclass(frozen=True)
class Ping(_Packed):
    """Clock question and answer: sent_s on the asker's clock, received_s on the other's."""

    sent_s: float
    received_s: float = nan


@_packs("BBbbbbiiHBffff")
@dataclass(frozen=True)
class Configure(_Packed):
    """User to server: the wiring that homing found; homed 0: channels as they are, at low volts.

    up_x_V, down_x_V, up_y_V, down_y_V: that surely move an arm, inf where nobody knows.
    """

    swap: int
    crossed: int
    volts_0: int
    volts_1: int
    angle_0: int
    angle_1: int
    zero_0: int
    zero_1: int
    counts_per_rev: int
    homed: int
    up_x_V: float = inf
    down_x_V: float = inf
    up_y_V: float = inf
    down_y_V: float = inf

    @classmethod
    def of(cls, w: Wiring, homed: bool, sure_V: tuple[Both, Both] = UNKNOWN) -> "Configure":
        """Return the message of a wiring; sure_V: by axis, volts up and down that surely move."""
        (v_0, v_1), (a_0, a_1), (z_0, z_1) = w.sign_volts, w.sign_angle, w.zero_counts
        turns = (int(w.swap), int(w.crossed), v_0, v_1, a_0, a_1, z_0, z_1)
        return cls(*turns, w.counts_per_rev, int(homed), *sure_V[0], *sure_V[1])

    def sure_V(self) -> tuple[Both, Both]:
        """Return the volts that surely move each arm. ValueError: one is negative or NaN."""
        found = (self.up_x_V, self.down_x_V), (self.up_y_V, self.down_y_V)
        if not all(volts >= 0.0 for pair in found for volts in pair):
            raise ValueError(f"volts that move the arms: {found}")
        return found

    def wiring(self) -> Wiring:
        """Return the wiring of the message. ValueError: its numbers make none."""
        return Wiring(
            (1, 0) if self.swap else (0, 1),
            (self.volts_0, self.volts_1),
            (self.angle_0, self.angle_1),
            (self.zero_0, self.zero_1),
            self.counts_per_rev,
            bool(self.crossed),
        )


@_packs("IdHdd")
@dataclass(frozen=True)
class DriveRequest(_Packed):
    """User to server: volts (x, y), sent at `sent_s` on the user's clock, good for `ttl_ms`.

    tick: of the reading that it answers.
    """

    tick: int
    sent_s: float
    ttl_ms: int
    x_V: float
    y_V: float


@_packs("IBdddddddddddddd")
@dataclass(frozen=True)
class RemoteReading(_Packed):
    """Server to user: one tick of the table.

    flags: ARMED, LATCHED, WITH_BALL, WITH_SPEED; t_s: the reading's time; sent_s: on the server's
    clock; echo_*: when the newest command was sent (user's clock) and received (server's), for the
    clocks; theta [rad], speed [rad/s], ball [m], cov [m2], exposed_s: as in `Reading`, NaN where
    missing.
    """

    tick: int
    flags: int
    t_s: float
    sent_s: float
    echo_sent_s: float
    echo_received_s: float
    theta_x: float
    theta_y: float
    speed_x: float
    speed_y: float
    ball_x: float
    ball_y: float
    cov_xx: float
    cov_xy: float
    cov_yy: float
    exposed_s: float


def proof(token: bytes, server_nonce: bytes, client_nonce: bytes) -> bytes:
    """Return the proof of knowing the token: an HMAC-SHA-256 of both random numbers by it."""
    return _key(token, b"rig client", server_nonce, client_nonce)


def _key(token: bytes, label: bytes, server_nonce: bytes, client_nonce: bytes) -> bytes:
    return hmac.digest(token, label + b"|" + server_nonce + client_nonce, "sha256")


class Wire:
    """One end of a connection: frames out, frames in, sealed once `seal` was called."""

    def __init__(self, sock: socket.socket) -> None:
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.sock = sock
        self._buffer = bytearray()
        self._out = self._in = b""
        self._sent = self._received = 0

    def seal(self, token: bytes, server_nonce: bytes, client_nonce: bytes, *, server: bool) -> None:
        """Make both directions' keys from the token and both random numbers; server: at which end.

        Every message but those of UNSEALED is sealed from then on.
        """
        labels = (b"rig down", b"rig up") if server else (b"rig up", b"rig down")
        keys = (_key(token, label, server_nonce, client_nonce) for label in labels)
        self._out, self._in = keys

    def send(self, kind: int, payload: bytes = b"") -> None:
        """Send a message of `kind`, sealed if it has to be.

        OSError: the connection is gone, or the other end takes nothing more (BlockingIOError).
        """
        seal = b""
        if kind not in UNSEALED:
            seal = self._seal(self._out, self._sent, kind, payload)
            self._sent += 1
        body = bytes([kind]) + payload + seal
        frame = struct.pack("<H", len(body)) + body
        if self.sock.send(frame) != len(frame):
            raise BlockingIOError("the other end does not read")

    def receive(self, most: int = 65536) -> list[tuple[int, bytes]]:
        """Return all whole messages (kind, payload) that are there, of at most so many bytes more.

        Waits for the first bytes as long as the socket's time limit says. ProtocolError: not of
        this protocol, or a wrong seal; ConnectionResetError, another OSError: the connection is
        gone.
        """
        with suppress(BlockingIOError):
            data = self.sock.recv(most)
            if not data:
                raise ConnectionResetError("the other end closed the connection")
            self._buffer += data
        return self._frames()

    def _frames(self) -> list[tuple[int, bytes]]:
        found = []
        while len(self._buffer) >= 2:
            (length,) = struct.unpack_from("<H", self._buffer)
            if not 1 <= length <= LONGEST:
                raise ProtocolError(f"a message of {length} bytes")
            if len(self._buffer) < 2 + length:
                break
            body = bytes(self._buffer[2 : 2 + length])
            del self._buffer[: 2 + length]
            found.append(self._opened(body[0], body[1:]))
        return found

    def _opened(self, kind: int, payload: bytes) -> tuple[int, bytes]:
        if kind in UNSEALED:
            if self._in and kind != REFUSE:
                raise ProtocolError("an unsealed message after the greeting")
            return kind, payload
        if not self._in:
            raise ProtocolError("a sealed message before the greeting")
        payload, seal = payload[:-SEAL_BYTES], payload[-SEAL_BYTES:]
        if not hmac.compare_digest(seal, self._seal(self._in, self._received, kind, payload)):
            raise ProtocolError("a message with a wrong seal")
        self._received += 1
        return kind, payload

    @staticmethod
    def _seal(key: bytes, number: int, kind: int, payload: bytes) -> bytes:
        return hmac.digest(key, struct.pack("<QB", number, kind) + payload, "sha256")[:SEAL_BYTES]

    def close(self) -> None:
        """Close the connection; does nothing where it is gone."""
        with suppress(OSError):
            self.sock.close()
