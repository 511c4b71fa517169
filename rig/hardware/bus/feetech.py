"""Feetech STS and SMS servos (STS3215 and its kin; magnetic encoder, low byte first).

Packet: FF FF, id, length, instruction or error, data, check sum; length = data + 2, check sum = the
low byte of ~(id + length + instruction + data). Sources: Feetech, Communication Protocol User
Manual (FT-SCS; 1.1 to 1.3.7); Feetech, STS3215 memory table. SCS servos (potentiometer, high byte
first, 1024 counts) have other registers and are not these.
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

LONGEST_DATA = 64  # far above what is asked for; a longer packet is damaged
# The error byte of every answer (memory table, servo status).
ALARMS = {1: "voltage", 2: "encoder", 4: "temperature", 8: "current", 32: "overload"}
POSITION_MODE, FINE_SPEED = 0, 4  # register 33; bit 2 of register 18: speed in counts a second
SIGN, LOAD_SIGN = 1 << 15, 1 << 10


def check_sum(body: bytes) -> int:
    """Check sum of everything between header and check sum."""
    return ~sum(body) & 0xFF


def packet(servo_id: int, instruction: int, data: bytes) -> bytes:
    """Return a packet with header and check sum."""
    body = bytes((servo_id, len(data) + 2, instruction)) + data
    return b"\xff\xff" + body + bytes((check_sum(body),))


def magnitude(value: int, sign: int) -> int:
    """The number that a register of sign and magnitude holds; sign: weight of its sign bit."""
    return -(value & (sign - 1)) if value & sign else value & (sign - 1)


def signed(number: int, sign: int) -> int:
    """Such a register's value of a number: the inverse of `magnitude`."""
    return abs(number) | (sign if number < 0 else 0)


class FeetechParser(Parser):
    """Packets of the STS protocol."""

    def _answer(self, whole: bytes) -> Status | None:
        return Status(whole[2], whole[4], whole[5:-1]) if whole[2] != BROADCAST else None

    def _next(self) -> bytes | None:
        heard = self._heard
        while (begin := heard.find(b"\xff\xff")) >= 0:
            del heard[:begin]
            while heard[2:3] == b"\xff":  # no id: the header begins a byte later
                del heard[0]
            if len(heard) < 4:
                return None
            end = heard[3] + 4
            if 2 <= heard[3] <= LONGEST_DATA + 2:
                if len(heard) < end:
                    return None
                whole = bytes(heard[:end])
                if check_sum(whole[2:-1]) == whole[-1]:
                    del heard[:end]
                    return whole
            self.bad_packets += 1
            del heard[0]  # what looked like a header was none
        del heard[: len(heard) - heard.endswith(b"\xff")]
        return None


class Feetech:
    """The servos' registers (memory table). They have no watchdog: silent, they hold their goal.

    A goal switches torque on by itself (the maker's examples, WritePosEx, rely on it): a servo
    that starts anew between two goals turns on, and its speed register is 0, as fast as it can.
    """

    name = "Feetech"
    counts_per_rev, middle, overhead = 4096, 2048, 6
    setup, present, health = Block(9, 25), Block(56, 8), Block(40, 8)
    torque, goal, speed = 40, 42, 46

    def parser(self) -> FeetechParser:
        """Return a parser that has heard nothing yet."""
        return FeetechParser()

    def ask(self, block: Block, ids: tuple[int, ...]) -> bytes:
        """Sync read (1.3.7) of a block."""
        return packet(BROADCAST, READ_ALL, bytes((block.address, block.length, *ids)))

    def tell(self, address: int, data: dict[int, bytes]) -> bytes:
        """Sync write (1.3.6) of {id: bytes}."""
        each = b"".join(bytes((servo_id,)) + one for servo_id, one in data.items())
        length = len(next(iter(data.values())))
        return packet(BROADCAST, WRITE_ALL, bytes((address, length)) + each)

    def read_setup(self, data: bytes) -> Setup:
        """Limits (9, 11), unit of speed (18), angle of a count (30) and mode (33); limits of 0 are
        none.
        """
        low, high = int.from_bytes(data[0:2], "little"), int.from_bytes(data[2:4], "little")
        unit = 2 * pi / self.counts_per_rev * (1 if data[9] & FINE_SPEED else 50)
        wrong = ""
        if data[24] != POSITION_MODE:
            wrong = f"is in operating mode {data[24]}: set register 33 to 0 (position)"
        if data[21] > 1:  # it turns by so many steps a count
            wrong = f"has an angular resolution of {data[21]}: set register 30 to 1"
        return Setup(low, high or self.counts_per_rev - 1, unit, wrong)

    def read_present(self, data: bytes) -> Present:
        """Position (56), speed (58), load (60), voltage (62) and temperature (63)."""
        position, load = int.from_bytes(data[0:2], "little"), int.from_bytes(data[4:6], "little")
        share = 1e-3 * magnitude(load, LOAD_SIGN)
        return Present(magnitude(position, SIGN), share, 0.1 * data[6], float(data[7]))

    def goal_data(self, counts: int) -> bytes:
        """Goal position (42): 2 bytes, sign and magnitude."""
        return signed(counts, SIGN).to_bytes(2, "little")

    def speed_data(self, units: int) -> bytes:
        """Goal speed (46): 2 bytes; 0 would be as fast as it can."""
        return min(max(units, 1), SIGN - 1).to_bytes(2, "little")

    def watchdog(self, on: bool) -> None:
        """None: these servos have none."""
        return

    def alarm(self, error: int) -> str:
        """What the error byte tells."""
        return bits(error, ALARMS)

    def health_alarm(self, data: bytes) -> str:
        """Torque switch (40) and speed (46) of an armed servo: 0 after a reset, the former also
        where it protects itself.
        """
        if not data[0]:
            return "torque off (was its supply cut?)"
        return "" if any(data[6:8]) else "speed limit lost (was its supply cut?)"
