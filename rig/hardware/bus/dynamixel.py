"""Dynamixel X servos by Protocol 2.0.

Packet: FF FF FD 00, id, length (2), instruction, [error,] data, CRC (2), low bytes first; length =
data + 3; FF FF FD behind the length is followed by one FD more (byte stuffing); CRC-16 of all bytes
before it, polynomial 0x8005, start 0, no reflection. Sources: ROBOTIS e-Manual, DYNAMIXEL Protocol
2.0 (Packet, Packet Process, Sync Read, Sync Write); CRC Calculation; XL430-W250, control table.
"""

from math import pi

from rig.hardware.bus.vendor import (
    BROADCAST,
    READ_ALL,
    WRITE_ALL,
    Block,
    Parser,
    Present,
    Setup,
    Status,
    bits,
)

HEADER, STUFFED, STUFFING = b"\xff\xff\xfd\x00", b"\xff\xff\xfd", b"\xff\xff\xfd\xfd"
STATUS = 0x55
LONGEST = 256  # far above what is asked for; a longer packet is damaged
ALERT = 0x80  # of the error byte: hardware error status (70) tells which
POSITION_MODE, TIME_BASED = 3, 4  # register 11; bit 2 of register 10
SPEED_RAD_S = 0.229 * 2 * pi / 60  # unit of profile velocity (112)
WATCHDOG_UNITS, WATCHDOG_ERROR = 5, 255  # of 20 ms: 0.1 s, as the boards of this rig have it
HARDWARE = {1: "voltage", 4: "temperature", 8: "encoder", 16: "electrical shock", 32: "overload"}
ERRORS = {
    1: "result fail", 2: "instruction", 3: "CRC", 4: "data range", 5: "data length",
    6: "data limit", 7: "access",
}  # fmt: skip


def _table() -> tuple[int, ...]:
    rows = []
    for byte in range(256):
        crc = byte << 8
        for _ in range(8):
            crc = (crc << 1) ^ (0x8005 if crc & 0x8000 else 0)
        rows.append(crc & 0xFFFF)
    return tuple(rows)


_CRC = _table()


def crc16(data: bytes) -> int:
    """CRC of a packet's bytes before the CRC."""
    crc = 0
    for byte in data:
        crc = (crc << 8 & 0xFFFF) ^ _CRC[crc >> 8 ^ byte]
    return crc


def packet(servo_id: int, instruction: int, data: bytes) -> bytes:
    """Return a packet with header, stuffing and CRC."""
    body = (bytes((instruction,)) + data).replace(STUFFED, STUFFING)
    whole = HEADER + bytes((servo_id,)) + (len(body) + 2).to_bytes(2, "little") + body
    return whole + crc16(whole).to_bytes(2, "little")


class DynamixelParser(Parser):
    """Packets of Protocol 2.0."""

    def _answer(self, whole: bytes) -> Status | None:
        body = whole[7:-2].replace(STUFFING, STUFFED)
        return Status(whole[4], body[1], body[2:]) if body[0] == STATUS and len(body) > 1 else None

    def _next(self) -> bytes | None:
        heard = self._heard
        while (begin := heard.find(HEADER)) >= 0:
            del heard[:begin]
            if len(heard) < 7:
                return None
            length = int.from_bytes(heard[5:7], "little")
            if 3 <= length <= LONGEST:
                if len(heard) < length + 7:
                    return None
                whole = bytes(heard[: length + 7])
                if crc16(whole[:-2]) == int.from_bytes(whole[-2:], "little"):
                    del heard[: length + 7]
                    return whole
            self.bad_packets += 1
            del heard[0]  # what looked like a header was none
        del heard[: max(len(heard) - len(HEADER) + 1, 0)]
        return None


class Dynamixel:
    """The servos' registers (control table of the X series)."""

    name = "Dynamixel"
    counts_per_rev, middle, overhead = 4096, 2048, 11
    setup, present, health = Block(10, 46), Block(126, 21), Block(64, 35)
    torque, goal, speed = 64, 116, 112

    def parser(self) -> DynamixelParser:
        """Return a parser that has heard nothing yet."""
        return DynamixelParser()

    def ask(self, block: Block, ids: tuple[int, ...]) -> bytes:
        """Sync read of a block."""
        where = block.address.to_bytes(2, "little") + block.length.to_bytes(2, "little")
        return packet(BROADCAST, READ_ALL, where + bytes(ids))

    def tell(self, address: int, data: dict[int, bytes]) -> bytes:
        """Sync write of {id: bytes}."""
        each = b"".join(bytes((servo_id,)) + one for servo_id, one in data.items())
        length = len(next(iter(data.values())))
        where = address.to_bytes(2, "little") + length.to_bytes(2, "little")
        return packet(BROADCAST, WRITE_ALL, where + each)

    def read_setup(self, data: bytes) -> Setup:
        """Drive mode (10), operating mode (11), position limits (max 48, min 52)."""
        high, low = (int.from_bytes(data[k : k + 4], "little") for k in (38, 42))
        wrong = ""
        if data[1] != POSITION_MODE:
            wrong = f"is in operating mode {data[1]}: set register 11 to 3 (position)"
        elif data[0] & TIME_BASED:
            wrong = "has a time-based profile: clear bit 2 of its drive mode, register 10"
        return Setup(low, high, SPEED_RAD_S, wrong)

    def read_present(self, data: bytes) -> Present:
        """Load or current (126), position (132), input voltage (144), temperature (146)."""
        load = int.from_bytes(data[0:2], "little", signed=True)
        position = int.from_bytes(data[6:10], "little", signed=True)
        voltage = int.from_bytes(data[18:20], "little")
        return Present(position, 1e-3 * load, 0.1 * voltage, float(data[20]))

    def goal_data(self, counts: int) -> bytes:
        """Goal position (116): 4 bytes."""
        return counts.to_bytes(4, "little", signed=True)

    def speed_data(self, units: int) -> bytes:
        """Profile velocity (112): 4 bytes; 0 would be as fast as it can."""
        return min(max(units, 1), 32767).to_bytes(4, "little")

    def watchdog(self, on: bool) -> tuple[int, bytes]:
        """Bus watchdog (98); 0 also forgets that it has bitten."""
        return 98, bytes((WATCHDOG_UNITS if on else 0,))

    def alarm(self, error: int) -> str:
        """What the error byte tells; of a hardware error it does not say which."""
        known = ERRORS.get(error & ~ALERT, "unknown error" if error & ~ALERT else "")
        return "hardware error" if error & ALERT else known

    def health_alarm(self, data: bytes) -> str:
        """Torque (64), hardware error (70) and bus watchdog (98) of an armed servo."""
        if data[6]:
            return bits(data[6], HARDWARE) or f"hardware error {data[6]}"
        if data[34] == WATCHDOG_ERROR:
            return f"its watchdog: no word for {20 * WATCHDOG_UNITS} ms"
        if data[0] and data[34] != WATCHDOG_UNITS:
            return "its watchdog was set otherwise (does another program use the bus?)"
        return "" if data[0] else "torque off (was its supply cut?)"
