"""From `[table]` of rig.toml to an open table. Each driver is imported where it is chosen."""

import re
from pathlib import Path
from typing import Protocol

import numpy as np

from rig.hardware.wiring import Wiring
from rig.parameters import Rig
from rig.table import Table
from vision.frames import Observation


class Eye(Protocol):
    """Whoever sees the ball: the newest observation whose light fell after `after_s`, or None."""

    def latest(self, after_s: float) -> Observation | None: ...


def raw_wiring(rig: Rig) -> Wiring:
    """Channels as they are: homing finds out what they mean."""
    return Wiring(counts_per_rev=rig.servo.encoder_counts_per_rev)


def file_wiring(rig: Rig) -> Wiring:
    """Signs and swap as the rig file says, zero where the encoders are zero."""
    table = rig.table
    return Wiring(
        swap=table.swap,
        crossed=table.crossed,
        sign_volts=table.sign_volts,
        sign_angle=table.sign_angle,
        counts_per_rev=rig.servo.encoder_counts_per_rev,
    )


def host_and_port(address: str) -> tuple[str, int]:
    """("host", port) of "host:port" or "[v6]:port". ValueError where it is neither."""
    found = re.fullmatch(r"(?:\[([^\]]+)\]|([^:\s]+)):(\d{1,5})", address)
    if found is None or not 0 < int(found[3]) < 65536:
        raise ValueError(f"table.address = '{address}': must be host:port, such as 10.0.0.5:7643")
    return found[1] or found[2], int(found[3])


def open_table(rig: Rig, eye: Eye | None = None, *, wiring: Wiring | None = None) -> Table:
    """The table that `rig.table` names, open and disarmed or at 0 V; a context manager.

    `wiring` (default: the rig file's) is what homing found. ValueError: the rig file is wrong;
    OSError: the table is not there, in one line with the cure.
    """
    kind, wired = rig.table.kind, wiring or file_wiring(rig)
    if kind == "simulated":
        return _simulated(rig)
    if kind in ("serial", "usb"):
        return _board(rig, eye, wired)
    if kind == "quanser":
        from rig.hardware.quanser import QuanserTable

        return QuanserTable(rig, wired, eye=eye)
    from rig.hardware.remote import RemoteTable, read_token

    host, port = host_and_port(rig.table.address)
    return RemoteTable(host, port, read_token(Path(rig.table.token_file)), wired, eye=eye)


def _simulated(rig: Rig) -> Table:
    """The virtual table at the wall clock's pace, its ball at rest in the middle."""
    from rig.paced import Paced
    from rig.simulator import SimulatedTable

    return Paced(SimulatedTable(rig, np.random.default_rng(1)))


def _board(rig: Rig, eye: Eye | None, wiring: Wiring) -> Table:
    raise NotImplementedError
