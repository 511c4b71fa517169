"""The parser in C and the one in Python agree, whatever comes; the state machine keeps its word."""

import random
import struct
import subprocess
from dataclasses import astuple
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from rig.hardware.board.wire import KINDS, Packet, Parser, encode
from tests.support import ROOT
from tests.support.boards.host import FIRMWARE, parse
from tests.support.parts import need

SANITIZERS = "-fsanitize=address,undefined"


def payload(packet: Packet) -> bytes:
    return bytes([packet.KIND]) + struct.pack(packet.LAYOUT, *astuple(packet))


def in_python(data: bytes) -> tuple[list[bytes], int]:
    parser = Parser()
    return [payload(packet) for packet in parser.feed(data)], parser.bad_frames & 0xFF


def rough_stream(n: int, seed: int) -> bytes:
    """n bytes: packets, most of them damaged somehow, and noise rich in zeros and short codes."""
    rng, out = random.Random(seed), bytearray()
    kinds = list(KINDS.values())
    while len(out) < n:
        kind = rng.choice(kinds)
        body = rng.randbytes(struct.calcsize(kind.LAYOUT))
        frame = bytearray(encode(kind(*struct.unpack(kind.LAYOUT, body))))
        damage = rng.randrange(8)
        if damage == 0:
            frame[rng.randrange(len(frame))] ^= 1 << rng.randrange(8)
        elif damage == 1:
            del frame[rng.randrange(len(frame)) :]
        elif damage == 2:
            frame = bytearray(rng.choices(range(4), k=rng.randrange(100)))
        elif damage == 3:
            frame = bytearray(rng.randbytes(rng.randrange(100)))
        out += frame
    return bytes(out[:n])


@given(st.binary(max_size=300))
def test_both_parsers_agree_on_any_bytes(data: bytes):
    assert parse(data + b"\0") == in_python(data + b"\0")


@given(st.integers(0, 2**32))
def test_both_parsers_agree_on_rough_streams(seed: int):
    data = rough_stream(500, seed)
    found = in_python(data)
    assert parse(data) == found


def fuzzed(folder: Path, program: str, kind: str, data: bytes) -> list[str]:
    """What a program of tests/support/boards prints that feeds bytes to a kind of board."""
    need("cc")
    binary, source = folder / "fuzz", ROOT / f"tests/support/boards/{program}.c"
    flags = [SANITIZERS, "-fno-sanitize-recover=all", "-O1", "-g", f"-I{FIRMWARE}"]
    sources = [source, FIRMWARE / "protocol.c", FIRMWARE / f"{kind}.c"]
    subprocess.run(["cc", *flags, *sources, "-o", binary], check=True)
    done = subprocess.run([binary], input=data, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr.decode()[:500]
    return done.stdout.decode().splitlines()


def test_a_million_bytes_under_the_sanitizers(tmp_path: Path):
    """No undefined step, no broken promise of the state machine, the same packets as in Python."""
    data = rough_stream(1_000_000, 1)
    *lines, bad = fuzzed(tmp_path, "board_fuzz", "volts", data)
    payloads, bad_frames = in_python(data)
    assert len(payloads) > 10_000
    assert [bytes.fromhex(line) for line in lines] == payloads
    assert bad == f"bad {bad_frames}"


def test_a_million_bytes_never_give_a_pulse_that_no_servo_should_get(tmp_path: Path):
    """Whatever is configured and asked: in the servo's range, at its rate, none unless armed."""
    (line,) = fuzzed(tmp_path, "pulse_fuzz", "pulses", rough_stream(1_000_000, 1))
    _, armed, _, pulses = line.split()
    assert int(armed) > 5_000
    assert int(pulses) > int(armed)
