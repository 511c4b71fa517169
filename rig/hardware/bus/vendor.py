"""What differs between makers of bus servos: how packets are framed, where the registers lie."""

from dataclasses import dataclass
from typing import Protocol

BROADCAST = 0xFE
READ_ALL, WRITE_ALL = 0x82, 0x83  # sync read, sync write: both makers' numbers


@dataclass(frozen=True)
class Block:
    """Neighbouring registers of a servo: the first one's address, and how many bytes."""

    address: int
    length: int


@dataclass(frozen=True)
class Status:
    """An answer of one servo: its id, the error byte, and what was read of it."""

    servo_id: int
    error: int
    data: bytes


@dataclass(frozen=True)
class Setup:
    """What a servo is set to: its position limits low, high [counts]; speed_rad_s: one unit of its
    speed register; wrong: why it cannot be driven as it is set, with the cure ("": it can).
    """

    low: int
    high: int
    speed_rad_s: float
    wrong: str = ""


@dataclass(frozen=True)
class Present:
    """What a servo measures: position [counts], load as a share of the most, supply and heat."""

    counts: int
    load: float
    voltage_V: float
    temperature_C: float


class Parser:
    """Bytes from the bus, in pieces of any size, to the answers in them.

    bad_packets: how many packets were damaged. A maker's own has `_next` and `_answer`.
    """

    def __init__(self) -> None:
        self.bad_packets = 0
        self._heard = bytearray()

    def feed(self, data: bytes) -> list[Status]:
        """Return the answers that `data` completes; what is no answer is passed over."""
        self._heard += data
        found = []
        while (whole := self._next()) is not None:
            if (status := self._answer(whole)) is not None:
                found.append(status)
        return found

    def clear(self) -> None:
        """Forget the begun packet."""
        self._heard.clear()

    def _next(self) -> bytes | None:
        """The next whole packet, taken off the bytes heard; None: there is none yet."""
        raise NotImplementedError

    def _answer(self, whole: bytes) -> Status | None:
        """The answer that a whole packet is; None: the echo of an instruction."""
        raise NotImplementedError


class Vendor(Protocol):
    """A maker's servos. All bytes go out by sync read and sync write, which no servo answers with
    anything that could be taken for another's word.

    setup, present, health: blocks to read; torque, goal, speed: addresses to write; counts_per_rev,
    middle: of the servo's own position; overhead: bytes of an answer besides its data.
    """

    name: str
    counts_per_rev: int
    middle: int
    overhead: int
    setup: Block
    present: Block
    health: Block
    torque: int
    goal: int
    speed: int

    def parser(self) -> Parser:
        """Return a parser that has heard nothing yet."""
        ...

    def ask(self, block: Block, ids: tuple[int, ...]) -> bytes:
        """Return the packet that asks these servos for a block; they answer in this order."""
        ...

    def tell(self, address: int, data: dict[int, bytes]) -> bytes:
        """Return the packet that writes {id: bytes} at an address; nobody answers. The bytes are
        equally many.
        """
        ...

    def read_setup(self, data: bytes) -> Setup:
        """Return what the block `setup` says."""
        ...

    def read_present(self, data: bytes) -> Present:
        """Return what the block `present` says."""
        ...

    def goal_data(self, counts: int) -> bytes:
        """Return the register of a goal [counts]."""
        ...

    def speed_data(self, units: int) -> bytes:
        """Return the register of the fastest speed [units of `Setup.speed_rad_s`], at least 1."""
        ...

    def watchdog(self, on: bool) -> tuple[int, bytes] | None:
        """Return address and bytes that set the servo's own watchdog; None where it has none."""
        ...

    def alarm(self, error: int) -> str:
        """Return what the error byte of an answer tells, "" where nothing is wrong."""
        ...

    def health_alarm(self, data: bytes) -> str:
        """Return what the block `health` of an armed servo tells, "" where nothing is wrong."""
        ...


def bits(value: int, names: dict[int, str]) -> str:
    """The names of the bits that are set in value, with commas; {bit's weight: name}."""
    return ", ".join(name for weight, name in names.items() if value & weight)
