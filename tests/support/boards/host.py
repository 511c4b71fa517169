"""The firmware's own C files, built for this machine: boards without a chip."""

import atexit
import ctypes
import subprocess
import tempfile
from functools import cache
from pathlib import Path

from tests.support import ROOT
from tests.support.parts import need

FIRMWARE = ROOT / "rig/firmware"
SUPPLY_V = 12.0
_BUILT = tempfile.TemporaryDirectory(prefix="board")
atexit.register(_BUILT.cleanup)

# What the headers keep to themselves is opaque here; these few calls are all that is needed.
_GLUE = """
#include <stdlib.h>
void glue_free(board_t *b) { free(b); }
void glue_receive(board_t *b, const uint8_t *data, int n) {
    while (n--) board_byte(b, *data++);
}
static int glue_ticked(board_t *b, uint8_t *out) {
    int n = 0, length;
    board_tick(b);
    while ((length = board_frame(b, out + n)) > 0) n += length;
    return n;
}
int glue_parse(const uint8_t *data, int n, uint8_t *out) { /* payloads, each after its length */
    parser_t p = {{0}, 0, 0};
    int used = 0;
    while (n--) {
        uint8_t length = parser_byte(&p, *data++, out + used + 1);
        if (length) out[used] = length, used += length + 1;
    }
    return used << 8 | p.bad_frames;
}
"""
_KINDS = {
    "volts": """
#include "volts.h"
GLUE
board_t *glue_new(int tachometer) {
    board_t *b = malloc(sizeof *b);
    if (b) board_init(b, (uint8_t)tachometer);
    return b;
}
int glue_tick(board_t *b, int c0, int c1, int t0, int t1, uint8_t *out, int16_t *mV) {
    int n;
    b->counts[0] = c0, b->counts[1] = c1;
    b->tachometer_mV[0] = (int16_t)t0, b->tachometer_mV[1] = (int16_t)t1;
    n = glue_ticked(b, out);
    mV[0] = b->applied_mV[0], mV[1] = b->applied_mV[1];
    return n;
}
""",
    "pulses": """
#include "pulses.h"
GLUE
board_t *glue_new(int servos) {
    board_t *b = malloc(sizeof *b);
    if (b) board_init(b, (uint8_t)servos);
    return b;
}
int glue_tick(board_t *b, uint8_t *out, uint16_t *pulse) {
    int i, n = glue_ticked(b, out);
    for (i = 0; i < MOST_SERVOS; i++) pulse[i] = b->pulse[i];
    return n;
}
""",
}


@cache
def library(kind: str, *changes: str) -> ctypes.CDLL:
    """protocol.c and a kind of board as a shared library; skips the test loudly where there is no
    C compiler.

    changes: compiler's options that spoil it on purpose, to see whether a test notices.
    """
    need("cc")
    folder = Path(_BUILT.name) / "_".join([kind, *changes])
    folder.mkdir()
    (folder / "glue.c").write_text(_KINDS[kind].replace("GLUE", _GLUE))
    sources = [folder / "glue.c", FIRMWARE / "protocol.c", FIRMWARE / f"{kind}.c"]
    flags = ["-shared", "-fPIC", "-O2", f"-I{FIRMWARE}", *changes]
    subprocess.run(["cc", *flags, *sources, "-o", folder / "b.so"], check=True)
    found = ctypes.CDLL(str(folder / "b.so"))
    found.glue_new.restype = ctypes.c_void_p
    return found


class _Built:
    """A board built for this machine, as `world.World` takes one: bytes in and out, a reset."""

    kind = ""

    def __init__(self, given: int, *changes: str) -> None:
        self._c, self._given = library(self.kind, *changes), given
        self._out, self._sent = ctypes.create_string_buffer(256), bytearray()
        self._board = ctypes.c_void_p(self._c.glue_new(given))

    def receive(self, data: bytes) -> None:
        self._c.glue_receive(self._board, data, len(data))

    def take(self) -> bytes:
        sent = bytes(self._sent)
        self._sent.clear()
        return sent

    def reset(self) -> None:
        self.close()
        self._board = ctypes.c_void_p(self._c.glue_new(self._given))
        self._sent.clear()

    def close(self) -> None:
        self._c.glue_free(self._board)


class HostBoard(_Built):
    """A board with H-bridges."""

    kind = "volts"

    def __init__(self, *changes: str, tachometer: bool = False) -> None:
        super().__init__(int(tachometer), *changes)
        self._mV = (ctypes.c_int16 * 2)()

    def run_ms(self, counts: tuple[int, int], tachometer_V=(0.0, 0.0), *, pace=1.0) -> None:
        millivolts = (round(1000 * v) for v in tachometer_V)
        n = self._c.glue_tick(self._board, *counts, *millivolts, self._out, self._mV)
        self._sent += self._out.raw[:n]

    def volts(self) -> tuple[float, float]:
        return self._mV[0] / 1000, self._mV[1] / 1000

    def reset(self) -> None:
        super().reset()
        self._mV[0] = self._mV[1] = 0


class StuckBoard(HostBoard):
    """A board whose bridges keep the volts that they had when the host fell silent."""

    _held = (0.0, 0.0)

    def volts(self) -> tuple[float, float]:
        now = super().volts()
        self._held = now if any(now) else self._held
        return self._held


class HostPulseBoard(_Built):
    """A board with hobby servos, two or three."""

    kind = "pulses"

    def __init__(self, *changes: str, servos: int = 2) -> None:
        super().__init__(servos, *changes)
        self._pulses = (ctypes.c_uint16 * 3)()

    def run_ms(self, *, pace=1.0) -> None:
        n = self._c.glue_tick(self._board, self._out, self._pulses)
        self._sent += self._out.raw[:n]

    def pulses_us(self) -> tuple[float, ...]:
        """The pulses put out [us]; 0: none."""
        return tuple(pulse / 2 for pulse in self._pulses)

    def reset(self) -> None:
        super().reset()
        self._pulses[0] = self._pulses[1] = self._pulses[2] = 0


def parse(data: bytes) -> tuple[list[bytes], int]:
    """Payloads that protocol.c's parser finds, and its count of bad frames modulo 256."""
    out = ctypes.create_string_buffer(2 * len(data) + 128)
    answer = library("volts").glue_parse(data, len(data), out)
    used, payloads, raw, i = answer >> 8, [], out.raw, 0
    while i < used:
        payloads.append(raw[i + 1 : i + 1 + raw[i]])
        i += raw[i] + 1
    return payloads, answer & 0xFF
