"""A lab of its own: `rig serve` over a simulated plant whose ball is placed and let go in time.

Run as a process: served_table.py FOLDER. FOLDER gets rig.token and, once it serves, "port"; its
volts are appended to "volts" (time, x, y) from the plant's side of everything.
"""

import sys
import time
from pathlib import Path

import numpy as np

from experiments.assemble import load_rig
from rig.hardware.remote_wire import make_token, read_token
from rig.hardware.serve import Server
from rig.paced import Paced
from rig.realtime import go_realtime
from rig.simulator import SimulatedTable

START_M = (-0.1, 0.1)
LET_GO_S = 2.5  # after the table was armed


class Lab:
    """The plant and a patient assistant who puts the ball back whenever the table is at rest."""

    def __init__(self, folder: Path) -> None:
        rig = load_rig(None)
        self.table = SimulatedTable(rig, np.random.default_rng(5), start_m=START_M, held=True)
        make_token(folder / "rig.token")
        self.server = Server(
            Paced(self.table), read_token(folder / "rig.token"), counts_per_rev=4096,
            angle_limit_rad=rig.servo.angle_limit_rad, port=0, say=print,
        )  # fmt: skip
        self._armed_s: float | None = None
        self._file = (folder / "volts").open("w", buffering=1)
        self._last = (0.0, 0.0)

    def tick(self) -> None:
        self.server.tick()
        now_s, guard = time.monotonic(), self.server.guard
        if not (guard.armed and guard.homed):
            if self._armed_s is not None:
                self._armed_s = None
                self.table.place(START_M)
        elif self._armed_s is None:
            self._armed_s = now_s
        elif now_s - self._armed_s > LET_GO_S:
            self.table.release()
        if self.table.volts_V != self._last:
            self._last = self.table.volts_V
            self._file.write(f"{now_s:.4f} {self._last[0]:.3f} {self._last[1]:.3f}\n")


if __name__ == "__main__":
    where = Path(sys.argv[1])
    lab = Lab(where)
    for _ in range(20):
        lab.tick()
    go_realtime()  # as rig serve
    (where / "port").write_text(str(lab.server.port))
    while True:
        lab.tick()
