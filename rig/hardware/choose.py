"""From `[table]` of rig.toml to an open table. Each driver is imported where it is chosen."""

import re
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np

from rig.hardware.observations import ObservationSource
from rig.hardware.wiring import Wiring, file_wiring, raw_wiring
from rig.parameters import ANGLE_KINDS, BUS_KINDS, PULSES, QUANSER, Rig
from rig.safety.late_watch import longest_round_trip_s
from rig.safety.motion_watch import Both, sure_volts
from rig.table import Table

if TYPE_CHECKING:
    from rig.hardware.bus.vendor import Vendor


# What the loop's limiter alone is proven for (tests/rig/safety/test_limits.py): boards and served
# tables brake their arms themselves. At 12 V of the default servo it is passed by 3 degrees, at 100
# ticks a second by 2, with 64 counts a turn by 3; at 12 rad/s after a pause of 48 ms by 4.
FASTEST_RAD_S, SLOWEST_HZ, FEWEST_COUNTS = 10.0, 200.0, 400


class OpenTable(Table, AbstractContextManager, Protocol):
    """A table whose context arms it; leaving the context levels it and gives 0 V."""


def host_and_port(address: str) -> tuple[str, int]:
    """Return ("host", port) of "host:port" or "[v6]:port". ValueError: the address is neither."""
    found = re.fullmatch(r"(?:\[([^\]]+)\]|([^:\s]+)):(\d{1,5})", address)
    if found is None or not 0 < int(found[3]) < 65536:
        raise ValueError(f"table.address = '{address}': must be host:port, such as 10.0.0.5:7643")
    return found[1] or found[2], int(found[3])


def check_drive(rig: Rig) -> None:
    """Raise ValueError (one line) where the rig's servos take what its table does not give.

    A servo that is told an angle must get no volts, and the reverse.
    """
    kind, servo = rig.table.kind, rig.servo
    if kind == "simulated":
        return
    if servo.takes_angle and kind not in ANGLE_KINDS:
        raise ValueError(
            f"servo.kind = 'position': table.kind = '{kind}' drives volts, which would be wrong; "
            f"tables that are told an angle: {', '.join(ANGLE_KINDS)}"
        )
    if kind == QUANSER:
        _check_limiter(rig)
    if kind not in ANGLE_KINDS:
        return
    if not servo.takes_angle:
        raise ValueError(f"table.kind = '{kind}' is told angles: set servo.kind = 'position'")
    if kind == PULSES and servo.has_angle:
        raise ValueError("servo.angle_measured = true: servos on pulses tell nobody their angle")


def _check_limiter(rig: Rig) -> None:
    """Raise ValueError where the loop's limiter, which alone guards this table, may be too slow."""
    servo, rate_hz = rig.servo, rig.control_rate_hz
    fastest = servo.gain_rad_s_V * servo.voltage_limit_V
    why = "or an arm passes its angle limit"
    if fastest > FASTEST_RAD_S:
        raise ValueError(
            f"servo.voltage_limit_V = {servo.voltage_limit_V:g}: at most "
            f"{FASTEST_RAD_S / servo.gain_rad_s_V:.2g} with gain_rad_s_V = {servo.gain_rad_s_V:g} "
            f"({FASTEST_RAD_S:g} rad/s), {why}"
        )
    if rate_hz < SLOWEST_HZ:
        raise ValueError(f"control_rate_hz = {rate_hz:g}: at least {SLOWEST_HZ:g} here, {why}")
    if servo.encoder_counts_per_rev < FEWEST_COUNTS:
        raise ValueError(
            f"servo.encoder_counts_per_rev = {servo.encoder_counts_per_rev}: at least "
            f"{FEWEST_COUNTS} here, {why}"
        )


def open_table(
    rig: Rig,
    eye: ObservationSource | None = None,
    *,
    wiring: Wiring | None = None,
    homed: bool = True,
    breakaway_V: tuple[Both, ...] = (),
) -> OpenTable:
    """Return the table that `rig.table` names, open and disarmed or at 0 V; `with` arms it.

    eye: where observations of the ball come from (None: without a camera); wiring: what homing
    found (default: the rig file's), breakaway_V: too, for what
    watches the arms there; homed False: channels as they are, for homing itself; such a
    table is never levelled. ValueError: the rig file or its token file is wrong, or its servos take
    what the table does not give. OSError: the table is not there, in one line with the cure.
    """
    kind = rig.table.kind
    wired = wiring or (file_wiring(rig) if homed else raw_wiring(rig))
    if kind == "simulated":
        return _simulated(rig, homed)
    check_drive(rig)
    if kind in BUS_KINDS:
        return _bus(rig, eye, wired, homed)
    if kind == PULSES:
        return _pulses(rig, eye, wired)
    if kind in ("serial", "usb"):
        return _board(rig, eye, wired, homed, sure_volts(rig, breakaway_V))
    if kind == QUANSER:
        from rig.hardware.quanser.quanser import QuanserTable

        return QuanserTable(rig, wired, eye=eye, homed=homed)
    from rig.hardware.network.remote import RemoteTable
    from rig.hardware.network.token_file import read_token

    token = read_token(Path(rig.table.token_file))
    host, port = host_and_port(rig.table.address)
    sure_V, tick_s = sure_volts(rig, breakaway_V), 1 / rig.control_rate_hz
    return RemoteTable(
        host,
        port,
        token,
        wired,
        eye=eye,
        homed=homed,
        sure_V=sure_V,
        period_s=tick_s,
        longest_trip_s=longest_round_trip_s(rig),
    )


def _simulated(rig: Rig, homed: bool) -> OpenTable:
    """The virtual table at the wall clock's pace, its ball at rest in the middle."""
    from rig.loop.paced import Paced
    from rig.simulation.simulator import SimulatedTable

    table = Paced(SimulatedTable(rig, np.random.default_rng(1)))
    if not homed:
        table.level_s = 0.0
    return table


def _board(
    rig: Rig,
    eye: ObservationSource | None,
    wiring: Wiring,
    homed: bool,
    sure_V: tuple[Both, Both],
) -> OpenTable:
    from rig.hardware.board.board import BoardTable

    if rig.table.kind == "serial":
        from rig.hardware.board.serial_link import SerialLink

        link = SerialLink(rig.table.port, rig.table.baud)
    else:
        from rig.hardware.board.usb_link import UsbLink

        link = UsbLink(*usb_numbers(rig.table.address))
    return BoardTable(
        link,
        wiring,
        period_s=1 / rig.control_rate_hz,
        voltage_limit_V=rig.servo.voltage_limit_V,
        angle_limit_rad=rig.servo.angle_limit_rad,
        time_constant_s=rig.servo.time_constant_s,
        top_speed_rad_s=rig.servo.gain_rad_s_V * rig.servo.voltage_limit_V,
        sure_V=sure_V,
        homed=homed,
        eye=eye,
        longest_trip_s=longest_round_trip_s(rig),
    )


def _bus(rig: Rig, eye: ObservationSource | None, wiring: Wiring, homed: bool) -> OpenTable:
    from rig.hardware.board.serial_link import SerialLink
    from rig.hardware.bus.bus import BusTable, check_period

    table, servo, period_s = rig.table, rig.servo, 1 / rig.control_rate_hz
    vendor = bus_vendor(rig)
    ids = table.by_channel("ids", rig.linkage.servos)
    check_period(vendor, len(ids), table.baud, period_s)
    if servo.encoder_counts_per_rev != vendor.counts_per_rev:
        raise ValueError(
            f"servo.encoder_counts_per_rev = {servo.encoder_counts_per_rev}: {vendor.name} servos "
            f"have {vendor.counts_per_rev}"
        )
    if servo.period_s > period_s:
        raise ValueError(
            f"servo.period_s = {servo.period_s:g} is longer than a tick of control_rate_hz "
            f"({period_s:g} s): {vendor.name} servos take every goal as it comes; set 0"
        )
    return BusTable(
        SerialLink(table.port, table.baud, "servo bus"),
        vendor,
        wiring,
        rig.linkage,
        ids=ids,
        period_s=period_s,
        angle_limit_rad=servo.angle_limit_rad,
        rate_limit_rad_s=servo.pair("rate_limit_rad_s"),
        voltage_limit_V=servo.voltage_limit_V,
        homed=homed,
        eye=eye,
    )


def _pulses(rig: Rig, eye: ObservationSource | None, wiring: Wiring) -> OpenTable:
    """Their level is a pulse, known before homing: such a table is always levelled."""
    from rig.hardware.board.open_pulses import open_pulse_board
    from rig.hardware.board.pulse_servo import PulseServo
    from rig.hardware.board.serial_link import SerialLink

    table, (lowest, highest) = rig.table, rig.table.pulse_range_us
    servos = [
        PulseServo(
            0.5 * (lowest + highest) + slope * zero * wiring.step_rad, sign * slope, lowest, highest
        )
        for slope, sign, zero in zip(
            table.by_channel("pulse_us_per_rad", rig.linkage.servos),
            wiring.sign_angle,
            wiring.zero_counts,
            strict=True,
        )
    ]
    link = SerialLink(table.port, table.baud, "servo board")
    return open_pulse_board(link, rig, servos, eye, order=wiring.order)


def bus_vendor(rig: Rig) -> "Vendor":
    """Return the maker of the servos on the rig's bus."""
    from rig.hardware.bus.dynamixel import Dynamixel
    from rig.hardware.bus.feetech import Feetech

    return Feetech() if rig.table.kind == "feetech" else Dynamixel()


def usb_numbers(address: str) -> tuple[int, ...]:
    """Return (vendor, product) of "1209:0001"; () of an empty address: the driver's own numbers.

    ValueError: the address is not like that.
    """
    if not address:
        return ()
    found = re.fullmatch(r"([0-9a-fA-F]{4}):([0-9a-fA-F]{4})", address)
    if found is None:
        raise ValueError(f"table.address = '{address}': a USB board's is like 1209:0001")
    return int(found[1], 16), int(found[2], 16)
