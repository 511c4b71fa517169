"""From `[table]` of rig.toml to an open table. Each driver is imported where it is chosen."""

import re
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Protocol

import numpy as np

from rig.hardware.wiring import Wiring
from rig.parameters import Rig
from rig.table import Table
from vision.frames import Observation


class OpenTable(Table, AbstractContextManager, Protocol):
    """A table whose context arms it, and levels it and gives 0 V on the way out."""


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


def open_table(
    rig: Rig, eye: Eye | None = None, *, wiring: Wiring | None = None, homed: bool = True
) -> OpenTable:
    """The table that `rig.table` names, open and disarmed or at 0 V; `with` arms it.

    `wiring` (default: the rig file's) is what homing found. `homed` False: channels as they are,
    for homing itself; such a table is never levelled. ValueError: the rig file is wrong; OSError:
    the table is not there, in one line with the cure.
    """
    kind = rig.table.kind
    wired = wiring or (file_wiring(rig) if homed else raw_wiring(rig))
    if kind == "simulated":
        return _simulated(rig, homed)
    if kind in ("serial", "usb"):
        return _board(rig, eye, wired, homed)
    if kind == "quanser":
        from rig.hardware.quanser import QuanserTable

        return QuanserTable(rig, wired, eye=eye, homed=homed)
    from rig.hardware.remote import RemoteTable, read_token

    token = read_token(Path(rig.table.token_file))
    host, port = host_and_port(rig.table.address)
    return RemoteTable(host, port, token, wired, eye=eye, homed=homed)


def _simulated(rig: Rig, homed: bool) -> OpenTable:
    """The virtual table at the wall clock's pace, its ball at rest in the middle."""
    from rig.paced import Paced
    from rig.simulator import SimulatedTable

    table = Paced(SimulatedTable(rig, np.random.default_rng(1)))
    if not homed:
        table.level_s = 0.0
    return table


def _board(rig: Rig, eye: Eye | None, wiring: Wiring, homed: bool) -> OpenTable:
    from rig.hardware.board import BoardTable

    if rig.table.kind == "serial":
        from rig.hardware.serial_link import SerialLink

        link = SerialLink(rig.table.port, rig.table.baud)
    else:
        from rig.hardware.usb_link import UsbLink

        link = UsbLink(*usb_numbers(rig.table.address))
    table = BoardTable(
        link,
        wiring,
        period_s=1 / rig.control_rate_hz,
        voltage_limit_V=rig.servo.voltage_limit_V,
        angle_limit_rad=rig.servo.angle_limit_rad,
        homed=homed,
        eye=eye,
    )
    if not homed:
        table.level_s = 0.0
    return table


def usb_numbers(address: str) -> tuple[int, ...]:
    """(vendor, product) of "1209:0001"; () where nothing is said: the driver's own."""
    if not address:
        return ()
    found = re.fullmatch(r"([0-9a-fA-F]{4}):([0-9a-fA-F]{4})", address)
    if found is None:
        raise ValueError(f"table.address = '{address}': a USB board's is like 1209:0001")
    return int(found[1], 16), int(found[2], 16)
