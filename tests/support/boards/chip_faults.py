"""Faults on the cable between host and board, drawn from a seed; each by what happens to bytes."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from tests.support.boards.world import World, WorldLink

TTY_BUFFER = 4096  # what a halted host's kernel keeps


class HostKilledError(BaseException):
    """kill -9: nothing of the host runs after this, not even a finally."""


@dataclass
class Fault:
    """What goes wrong from `begin_s` to `end_s`; `size` says how badly, in the kind's own unit."""

    kind: str
    begin_s: float
    end_s: float
    size: float
    rng: np.random.Generator
    kept: dict[str, list[bytes]] = field(default_factory=lambda: {"in": [], "out": []})

    def on(self, now_s: float) -> bool:
        return self.begin_s <= now_s < self.end_s


Mangle = Callable[[Fault, bytes, str], bytes]


def _dropped(fault: Fault, frame: bytes, way: str) -> bytes:
    return b"" if fault.rng.random() < fault.size else frame


def _duplicated(fault: Fault, frame: bytes, way: str) -> bytes:
    """Twice at once, or once more much later."""
    kept = fault.kept[way]
    kept.append(frame)
    old = kept[fault.rng.integers(len(kept))]
    return frame + (old if fault.rng.random() < fault.size else b"")


def _reordered(fault: Fault, frame: bytes, way: str) -> bytes:
    kept = fault.kept[way]
    kept.append(frame)
    if fault.rng.random() < fault.size and len(kept) < 30:
        return b""
    fault.rng.shuffle(kept)
    out = b"".join(kept)
    kept.clear()
    return out


def _flipped(fault: Fault, frame: bytes, way: str) -> bytes:
    bits = np.unpackbits(np.frombuffer(frame, np.uint8))
    bits ^= (fault.rng.random(bits.size) < fault.size).astype(np.uint8)
    return np.packbits(bits).tobytes()


def _truncated(fault: Fault, frame: bytes, way: str) -> bytes:
    if fault.rng.random() > fault.size:
        return frame
    end = b"\0" if fault.rng.random() < 0.5 else b""
    return frame[: fault.rng.integers(len(frame))] + end


def _baud(fault: Fault, data: bytes, way: str) -> bytes:
    return resampled(data, fault.size if way == "out" else 1 / fault.size)


MANGLE: dict[str, Mangle] = {
    "dropped packets": _dropped,
    "duplicated packets": _duplicated,
    "reordered packets": _reordered,
    "flipped bits": _flipped,
    "truncated packets": _truncated,
    "baud mismatch": _baud,
}
KINDS = (
    *MANGLE, "host killed", "host halted", "cable out and in", "board reset", "clock drift"
)  # fmt: skip
SIZES = {  # drawn between, logarithmically
    "dropped packets": (0.02, 1.0),
    "duplicated packets": (0.05, 1.0),
    "reordered packets": (0.1, 0.95),
    "flipped bits": (1e-4, 0.05),
    "truncated packets": (0.02, 1.0),
    "baud mismatch": (0.5, 2.0),
    "clock drift": (0.97, 1.03),
}


def resampled(data: bytes, ratio: float) -> bytes:
    """What a receiver at `ratio` times the sender's baud makes of bytes sent without a gap.

    8N1, sampled in the middle of each bit; a byte without its stop bit is read as 0, as board and
    kernel do.
    """
    levels = [1] * 4
    for byte in data:
        levels += [0, *(byte >> i & 1 for i in range(8)), 1]
    levels += [1] * 24
    line, out, at = np.array(levels, np.int8), bytearray(), 0.0
    while True:
        low = np.flatnonzero(line[int(at) :] == 0)
        if low.size == 0:
            return bytes(out)
        start = max(int(at) + int(low[0]), at)
        places = (start + (np.arange(10) + 0.5) / ratio).astype(int)
        if places[-1] >= len(line):
            return bytes(out)
        bits = line[places]
        if bits[0]:  # no start bit after all
            at = start + 1 / ratio
            continue
        out.append(int(np.packbits(bits[1:9].astype(np.uint8), bitorder="little")[0]))
        if not bits[9]:
            out[-1] = 0
        at = start + 9.5 / ratio


def draw(kind: str, seed: int, later_s: float = 0.0) -> Fault:
    """A fault that begins 0.05 to 0.5 s after the run does, or as much later as `later_s` says."""
    rng = np.random.default_rng([seed, KINDS.index(kind)])
    begin = later_s + rng.uniform(0.05, 0.5)
    low, high = SIZES.get(kind, (1.0, 1.0))
    size = float(np.exp(rng.uniform(np.log(low), np.log(high))))
    if kind == "baud mismatch" and rng.random() < 0.5:
        size = float(rng.choice([0.5, 115200 / 500000, 250000 / 500000, 0.97, 1.03, 0.94, 1.06]))
        begin = 0.0  # opened so
    return Fault(kind, begin, begin + rng.uniform(0.02, 1.0), size, rng)


class FaultyLink(WorldLink):
    """A cable, a host and a board that suffer `fault`."""

    name = "board in lock step"

    def __init__(self, world: World, fault: Fault) -> None:
        super().__init__(world)
        self.fault, self._done = fault, False
        self._halves = {"in": b"", "out": b""}
        self._vanishes = fault.rng.random() < 0.5  # or its bytes just go nowhere
        if fault.kind == "clock drift":
            world.pace = fault.size

    def send(self, data: bytes) -> None:
        self._strike()
        if self._unplugged():
            return
        self.world.board.receive(self._mangled(data, "out"))

    def receive(self) -> bytes:
        self._strike()
        arrived = super().receive()
        return b"" if self._unplugged() else arrived

    def wait(self, timeout_s: float) -> bool:
        self._strike()
        until = self.world.now_s + timeout_s
        while not self._arrived:
            self.world.step()
            self._strike()
            self._take()
            if self.world.now_s >= until - 1e-9:
                break
        return bool(self._arrived)

    def _take(self) -> None:
        data = self._mangled(self.world.board.take(), "in")
        if not self._unplugged():
            self._arrived += data

    def _unplugged(self) -> bool:
        """Is the cable out? A device that vanishes says so: `cut` makes the next call raise."""
        out = self.fault.kind == "cable out and in" and self.fault.on(self.world.now_s)
        self.cut = self.cut or (out and self._vanishes)
        return out

    def _strike(self) -> None:
        """What happens once, when its time has come. A killed host stays so: no level, no word."""
        if self._done and self.fault.kind == "host killed":
            raise HostKilledError
        if self._done or self.world.now_s < self.fault.begin_s:
            return
        self._done = True
        if self.fault.kind == "host killed":
            raise HostKilledError
        if self.fault.kind == "board reset":
            self.world.board.reset()
        if (
            self.fault.kind == "host halted"
        ):  # SIGSTOP; its kernel keeps what arrives, up to a point
            self.world.run(self.fault.end_s - self.fault.begin_s)
            self._take()
            del self._arrived[TTY_BUFFER:]

    def _mangled(self, data: bytes, way: str) -> bytes:
        """Bytes as they arrive: whole packets are dropped, doubled, turned, cut."""
        mangle = MANGLE.get(self.fault.kind)
        if mangle is None or not self.fault.on(self.world.now_s):
            return data
        if mangle is _baud:
            return mangle(self.fault, data, way) if data else data
        *frames, self._halves[way] = (self._halves[way] + data).split(b"\0")
        return b"".join(mangle(self.fault, frame + b"\0", way) for frame in frames)
