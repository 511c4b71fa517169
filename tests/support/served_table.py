"""A lab of its own: `rig serve` over a simulated plant whose ball is placed and let go in time.

Run as a process: python -m tests.support.served_table FOLDER [film]. FOLDER gets rig.token and,
once it serves, "port" (what [table] has to say); its volts are appended to "volts" (time, x, y)
from the plant's side of everything. With `film` the table sees nothing by itself: it shows what a
camera would see (virtual_film.py).
"""

import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from experiments.runs.assemble import load_rig
from rig.hardware.network.serve import Server
from rig.hardware.network.token_file import make_token, read_token
from rig.loop.paced import Paced
from rig.loop.realtime import go_realtime
from rig.simulation.simulator import SimulatedTable
from tests.support.virtual_film import Film

START_M = (-0.1, 0.1)
AWAY_M = (1.0, 1.0)  # of a ball that lies in a drawer
LET_GO_S = 2.5  # after the table was armed
FILM_HZ = 30.0


class Lab:
    """The plant and a patient assistant who puts the ball back whenever the table is at rest."""

    def __init__(self, folder: Path, *, film: bool) -> None:
        rig = load_rig(None)
        if film:
            rig = replace(rig, camera=replace(rig.camera, rate_hz=FILM_HZ))
        self.film = Film(folder) if film else None
        rng = np.random.default_rng(5)
        self.table = SimulatedTable(rig, rng, start_m=AWAY_M, held=True, eye=self.film)
        make_token(folder / "rig.token")
        self.server = Server(
            Paced(self.table), read_token(folder / "rig.token"), servo=rig.servo,
            port=0, say=print,
        )  # fmt: skip
        self._armed_s: float | None = None
        self._file = (folder / "volts").open("w", buffering=1)
        self._last, self._ticks = (0.0, 0.0), 0

    def tick(self) -> None:
        if self.film is not None:
            self.film.now_s = self._ticks * self.table.period_s
        self._ticks += 1
        self.server.tick()
        now_s, watchdog = time.monotonic(), self.server.watchdog
        if not (watchdog.armed and watchdog.homed):
            if self._armed_s is not None:
                self._armed_s = None
                self.table.place(AWAY_M)
        elif self._armed_s is None:
            self._armed_s = now_s
            self.table.place(START_M)
        elif now_s - self._armed_s > LET_GO_S:
            self.table.release()
        if self.table.volts_V != self._last:
            self._last = self.table.volts_V
            self._file.write(f"{now_s:.4f} {self._last[0]:.3f} {self._last[1]:.3f}\n")


if __name__ == "__main__":
    where = Path(sys.argv[1])
    lab = Lab(where, film="film" in sys.argv[2:])
    for _ in range(20):
        lab.tick()
    go_realtime()  # as rig serve
    address = f'address = "127.0.0.1:{lab.server.port}"'
    (where / "told").write_text(f'kind = "remote"\n{address}\ntoken_file = "rig.token"')
    (where / "told").rename(where / "port")
    while True:
        lab.tick()
