"""What goes over the cable: frames and packets to bytes and back. Pure; twin of the firmware.

Frame: COBS(payload + CRC-16/CCITT-FALSE little-endian) + 0x00, 64 bytes at most. Payload: one
byte of kind, then the fields of the packet, little-endian, in the order of its dataclass.
"""

import binascii
import struct
from dataclasses import astuple, dataclass
from typing import ClassVar, get_args

VERSION = 4
LONGEST_FRAME = 64  # the closing zero included
LONGEST_PAYLOAD = LONGEST_FRAME - 4  # COBS byte, CRC and the closing zero
NEVER = 65535
HAS_TACHOMETER, TAKES_ANGLE, HAS_THREE, REFUSED = 1, 4, 8, 16  # features of a board
# Flags of a telemetry packet.
ARMED, LEVELLING, LATCHED, CONFIGURED = 0x01, 0x02, 0x04, 0x08
BY_WATCHDOG, BY_ANGLE, BY_STALL, HOMED = 0x10, 0x20, 0x40, 0x80
LIMITED, EXPIRED, LATE_TICK, BYTES_LOST = 0x100, 0x200, 0x400, 0x800


@dataclass(frozen=True)
class ConfigRequest:
    """Host to board: who asks, and how the table is wired. It ends a latch but never arms.

    nonce: comes back in the answer; period_ms: of the telemetry; wired: bit 0 the zeros are known,
    bits 1 and 2 channel 0, 1 has negative polarity, bit 3 motor plugs are crossed; zero_0, zero_1:
    zero counts of channels 0, 1; counts_per_rev: of an encoder at the load shaft; angle_limit
    [counts]; limit_mV: of the volts; time_constant_ms, top_speed_mrad_s: of the servo at limit_mV,
    by which the board brakes. sure_up_0 to sure_down_1: volts that surely move channel 0, 1 so that
    its counts rise, and fall [mV], NEVER where nobody knows; push_V_ms: more than these without a
    motion is a stall (`rig.safety.motion_watch`).
    """

    KIND: ClassVar[int] = 0x01
    LAYOUT: ClassVar[str] = "<BHBBiiHHHHHHHHHH"
    version: int
    nonce: int
    period_ms: int
    wired: int
    zero_0: int
    zero_1: int
    counts_per_rev: int
    angle_limit: int
    limit_mV: int
    time_constant_ms: int = 25
    top_speed_mrad_s: int = 9180
    sure_up_0: int = NEVER
    sure_down_0: int = NEVER
    sure_up_1: int = NEVER
    sure_down_1: int = NEVER
    push_V_ms: int = NEVER


@dataclass(frozen=True)
class Arm:
    """Host to board: let volts flow. token: of the last answer; commands are newer than
    sequence.
    """

    KIND: ClassVar[int] = 0x02
    LAYOUT: ClassVar[str] = "<IH"
    token: int
    sequence: int


@dataclass(frozen=True)
class Disarm:
    """Host to board: 0 V now, and no command is obeyed until the board is armed again."""

    KIND: ClassVar[int] = 0x03
    LAYOUT: ClassVar[str] = "<"


@dataclass(frozen=True)
class Command:
    """Host to board: volts of motor channels 0, 1 [mV], for ttl_ms at most; the newest counts."""

    KIND: ClassVar[int] = 0x04
    LAYOUT: ClassVar[str] = "<HBhh"
    sequence: int
    ttl_ms: int
    mV_0: int
    mV_1: int


@dataclass(frozen=True)
class PulseConfigRequest:
    """Host to a board with hobby servos: who asks, and which pulses they take. Never arms.

    version, nonce, period_ms: as in ConfigRequest; servos: how many (1 to 3); frame_us: from pulse
    to pulse. By servo: level, lowest, highest: pulses [half us]; slope [0.1 us/rad], signed; limit:
    of the angle to each side [0.1 mrad]; rate: of the angle [mrad/s].
    """

    KIND: ClassVar[int] = 0x05
    LAYOUT: ClassVar[str] = "<BHBBH" + 3 * "HhHHHH"
    version: int
    nonce: int
    period_ms: int
    servos: int
    frame_us: int
    level_0: int
    slope_0: int
    lowest_0: int
    highest_0: int
    limit_0: int
    rate_0: int
    level_1: int = 0
    slope_1: int = 0
    lowest_1: int = 0
    highest_1: int = 0
    limit_1: int = 0
    rate_1: int = 0
    level_2: int = 0
    slope_2: int = 0
    lowest_2: int = 0
    highest_2: int = 0
    limit_2: int = 0
    rate_2: int = 0


@dataclass(frozen=True)
class PulseCommand:
    """Host to a board with hobby servos: their angles [0.1 mrad], held until a newer command."""

    KIND: ClassVar[int] = 0x06
    LAYOUT: ClassVar[str] = "<Hhhh"
    sequence: int
    angle_0: int
    angle_1: int
    angle_2: int = 0


@dataclass(frozen=True)
class ConfigAnswer:
    """Board to host: answer to the request with this nonce, accepted where its version is ours.

    token: arms once; clock_us: the board's clock; period_ms: of its telemetry; homing: the token
    that last armed it with unknown zeros, 0 where none did since its reset; features: bit 0 it has
    tachometer inputs, bit 2 it takes angles, bit 3 of three servos, bit 4 it refused what was
    asked, which was another kind's or out of its bounds. Every version's answer is as long.
    """

    KIND: ClassVar[int] = 0x11
    LAYOUT: ClassVar[str] = "<BHIIBIB"
    version: int
    nonce: int
    token: int
    clock_us: int
    period_ms: int
    homing: int
    features: int


@dataclass(frozen=True)
class Status:
    """How every telemetry begins.

    clock_us: the board's clock; sequence: of the last command that it took; flags: bits above;
    bad_frames: frames refused so far, modulo 256.
    """

    clock_us: int
    sequence: int
    flags: int
    bad_frames: int


@dataclass(frozen=True)
class Telemetry(Status):
    """Board to host, every period: counts of the encoders, volts applied [mV]."""

    KIND: ClassVar[int] = 0x12
    LAYOUT: ClassVar[str] = "<IHHBiihh"
    count_0: int
    count_1: int
    mV_0: int
    mV_1: int


@dataclass(frozen=True)
class TelemetryWithTachometer(Telemetry):
    """Telemetry and what the inputs of tachometers 0, 1 read [mV]."""

    KIND: ClassVar[int] = 0x13
    LAYOUT: ClassVar[str] = "<IHHBiihhhh"
    tachometer_0_mV: int
    tachometer_1_mV: int


@dataclass(frozen=True)
class PulseTelemetry(Status):
    """Board to host, every period: the servos' pulses as put out [half us]; 0: none."""

    KIND: ClassVar[int] = 0x14
    LAYOUT: ClassVar[str] = "<IHHBHHH"
    pulse_0: int
    pulse_1: int
    pulse_2: int


Request = ConfigRequest | PulseConfigRequest
Packet = (
    Request | Arm | Disarm | Command | PulseCommand
    | ConfigAnswer | Telemetry | TelemetryWithTachometer | PulseTelemetry
)  # fmt: skip
KINDS: dict[int, type[Packet]] = {kind.KIND: kind for kind in get_args(Packet)}


def cobs(data: bytes) -> bytes:
    """Return at most 254 bytes as bytes without a zero (consistent overhead byte stuffing).

    Cheshire and Baker, IEEE/ACM Trans. Networking 7(2), 1999. ValueError: more than 254 bytes.
    """
    if len(data) > 254:
        raise ValueError(f"a frame of {len(data)} bytes is too long; at most 254")
    out = bytearray()
    for part in data.split(b"\0"):
        out.append(len(part) + 1)
        out += part
    return bytes(out)


def uncobs(data: bytes) -> bytes | None:
    """Return the bytes that `cobs` has stuffed; None where `data` is no such thing."""
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
    """Return the CRC-16/CCITT-FALSE: polynomial 0x1021, start 0xFFFF, not reflected."""
    return binascii.crc_hqx(data, 0xFFFF)


def encode(packet: Packet) -> bytes:
    """Return the packet as one frame, its closing zero included. ValueError: a field does not
    fit.
    """
    try:
        body = struct.pack(packet.LAYOUT, *astuple(packet))
    except struct.error as error:
        raise ValueError(f"{packet} does not fit its frame: {error}") from None
    payload = bytes([packet.KIND]) + body
    return cobs(payload + crc(payload).to_bytes(2, "little")) + b"\0"


def decode(frame: bytes) -> Packet | None:
    """Return the packet of a frame without its closing zero; None: damaged or unknown."""
    data = uncobs(frame) if len(frame) < LONGEST_FRAME else None
    if data is None or len(data) < 3 or crc(data[:-2]) != int.from_bytes(data[-2:], "little"):
        return None
    kind = KINDS.get(data[0])
    if kind is None or struct.calcsize(kind.LAYOUT) != len(data) - 3:
        return None
    return kind(*struct.unpack(kind.LAYOUT, data[1:-2]))


class Parser:
    """Finds packets in a stream of bytes; damaged frames are counted (bad_frames) and skipped."""

    def __init__(self) -> None:
        self.bad_frames = 0
        self._buffer = bytearray()
        self._too_long = False

    def feed(self, data: bytes) -> list[Packet]:
        """Return the packets that `data` completes, in order."""
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
