"""What goes over the cable: frames and packets to bytes and back. Pure; twin of protocol.c.

Frame: COBS(payload + CRC-16/CCITT-FALSE little-endian) + 0x00, 64 bytes at most. Payload: one
byte of kind, then the fields of the packet, little-endian, in the order of its dataclass.
"""

import binascii
import struct
from dataclasses import astuple, dataclass
from typing import ClassVar

VERSION = 1
LONGEST_FRAME = 64  # the closing zero included
LONGEST_PAYLOAD = LONGEST_FRAME - 4  # COBS byte, CRC and the closing zero
HAS_TACHOMETER, IS_FRESH = 1, 2  # features of a board
# Flags of a telemetry packet.
ARMED, LEVELLING, LATCHED, CONFIGURED = 0x01, 0x02, 0x04, 0x08
BY_WATCHDOG, BY_ANGLE, BY_STALL, HOMED = 0x10, 0x20, 0x40, 0x80
LIMITED, EXPIRED, LATE_TICK, BYTES_LOST = 0x100, 0x200, 0x400, 0x800


@dataclass(frozen=True)
class ConfigRequest:
    """Host to board: who I am and how the table is wired. Ends a latch, never arms.

    nonce comes back in the answer; period_ms of the telemetry; wired: bit 0 zeros are known, bits
    1 and 2 channel 0, 1 has negative polarity, bit 3 motor plugs are crossed; zero counts of
    channels 0, 1; counts_per_rev; angle limit in counts; limit of volts [mV].
    """

    KIND: ClassVar[int] = 0x01
    LAYOUT: ClassVar[str] = "<BHBBiiHHH"
    version: int
    nonce: int
    period_ms: int
    wired: int
    zero_0: int
    zero_1: int
    counts_per_rev: int
    angle_limit: int
    limit_mV: int


@dataclass(frozen=True)
class Arm:
    """Host to board: arm with the token of the last answer; commands are newer than sequence."""

    KIND: ClassVar[int] = 0x02
    LAYOUT: ClassVar[str] = "<IH"
    token: int
    sequence: int


@dataclass(frozen=True)
class Disarm:
    """Host to board: 0 V now, no command until armed again."""

    KIND: ClassVar[int] = 0x03
    LAYOUT: ClassVar[str] = "<"


@dataclass(frozen=True)
class Command:
    """Host to board: volts of motor channels 0, 1 [mV], for ttl_ms at most; the newest wins."""

    KIND: ClassVar[int] = 0x04
    LAYOUT: ClassVar[str] = "<HBhh"
    sequence: int
    ttl_ms: int
    mV_0: int
    mV_1: int


@dataclass(frozen=True)
class ConfigAnswer:
    """Board to host: accepted where the version is the host's; the token arms once.

    features: bit 0 it has tachometer inputs, bit 1 this is the first request since it was reset.
    """

    KIND: ClassVar[int] = 0x11
    LAYOUT: ClassVar[str] = "<BHIIBHHB"
    version: int
    nonce: int
    token: int
    clock_us: int
    period_ms: int
    supply_mV: int
    limit_mV: int
    features: int


@dataclass(frozen=True)
class Telemetry:
    """Board to host: its clock, the last command it took, flags, counts and volts [mV] applied."""

    KIND: ClassVar[int] = 0x12
    LAYOUT: ClassVar[str] = "<IHHBiihh"
    clock_us: int
    sequence: int
    flags: int
    bad_frames: int  # refused so far, modulo 256
    count_0: int
    count_1: int
    mV_0: int
    mV_1: int


@dataclass(frozen=True)
class TelemetryWithTachometer(Telemetry):
    """The same with what the tachometer inputs read [mV]."""

    KIND: ClassVar[int] = 0x13
    LAYOUT: ClassVar[str] = "<IHHBiihhhh"
    tachometer_0_mV: int
    tachometer_1_mV: int


Packet = ConfigRequest | Arm | Disarm | Command | ConfigAnswer | Telemetry | TelemetryWithTachometer
KINDS: dict[int, type[Packet]] = {
    kind.KIND: kind
    for kind in (
        ConfigRequest,
        Arm,
        Disarm,
        Command,
        ConfigAnswer,
        Telemetry,
        TelemetryWithTachometer,
    )
}


def cobs(data: bytes) -> bytes:
    """Consistent overhead byte stuffing of at most 254 bytes: the same bytes without a zero."""
    if len(data) > 254:
        raise ValueError(f"a frame of {len(data)} bytes is too long; at most 254")
    out = bytearray()
    for part in data.split(b"\0"):
        out.append(len(part) + 1)
        out += part
    return bytes(out)


def uncobs(data: bytes) -> bytes | None:
    """The inverse of `cobs` (at most 254 bytes without a zero); None where it is no such thing."""
    out = bytearray()
    i = 0
    while i < len(data):
        code = data[i]
        if code == 0 or i + code > len(data):
            return None
        out += data[i + 1 : i + code]
        i += code
        if i < len(data):
            out.append(0)
    return bytes(out)


def crc(data: bytes) -> int:
    """CRC-16/CCITT-FALSE: polynomial 0x1021, start 0xFFFF, not reflected."""
    return binascii.crc_hqx(data, 0xFFFF)


def encode(packet: Packet) -> bytes:
    """The packet as one frame. ValueError: a field does not fit its place."""
    try:
        body = struct.pack(packet.LAYOUT, *astuple(packet))
    except struct.error as error:
        raise ValueError(f"{packet} does not fit its frame: {error}") from None
    payload = bytes([packet.KIND]) + body
    return cobs(payload + crc(payload).to_bytes(2, "little")) + b"\0"


def decode(frame: bytes) -> Packet | None:
    """The packet of a frame without its closing zero; None where it is damaged or unknown."""
    data = uncobs(frame) if len(frame) < LONGEST_FRAME else None
    if data is None or len(data) < 3 or crc(data[:-2]) != int.from_bytes(data[-2:], "little"):
        return None
    kind = KINDS.get(data[0])
    if kind is None or struct.calcsize(kind.LAYOUT) != len(data) - 3:
        return None
    return kind(*struct.unpack(kind.LAYOUT, data[1:-2]))


class Parser:
    """Finds packets in a stream of bytes; damaged frames are counted and skipped."""

    def __init__(self) -> None:
        self.bad_frames = 0
        self._buffer = bytearray()
        self._too_long = False

    def feed(self, data: bytes) -> list[Packet]:
        """The packets that `data` completes, in order."""
        found: list[Packet] = []
        *ended, rest = data.split(b"\0")
        for part in ended:
            self._take(part)
            if packet := self._finish():
                found.append(packet)
        self._take(rest)
        return found

    def _take(self, part: bytes) -> None:
        """Keep the bytes of a frame that is not yet complete, as many as a frame may have."""
        self._buffer += part[: LONGEST_FRAME - len(self._buffer)]
        self._too_long = len(self._buffer) >= LONGEST_FRAME

    def _finish(self) -> Packet | None:
        frame, too_long = bytes(self._buffer), self._too_long
        self._buffer.clear()
        if not frame:  # zeros between frames mean nothing
            return None
        packet = None if too_long else decode(frame)
        self.bad_frames += packet is None
        return packet
