"""What a machine needs to drive a table, compared with what it has: pure checks of `Facts`.

`experiments.doctor.facts.gather` looks at the machine; nothing here does.
"""

from dataclasses import dataclass, field

from rig.parameters import (
    ANGLE_KINDS,
    BUS_KINDS,
    POSITION,
    PULSES,
    QUANSER,
    VOLT_KINDS,
    VOLTAGE,
    Rig,
)

OK, NOTE, BAD = "ok", "note", "bad"
BOARD_VENDORS = {
    0x2341: "Arduino", 0x2A03: "Arduino", 0x1A86: "CH340 converter", 0x0403: "FTDI converter",
    0x10C4: "CP210x converter", 0x16C0: "Teensy or V-USB", 0x1209: "pid.codes",
}  # fmt: skip
USB_VENDOR, USB_PRODUCT = 0x1209, 0x0001
REALTIME_PRIORITY = 50
MEMORY_BYTES = 512 * 2**20
MISSING_CURE = "correct [table]; a calibration is made by rig calibrate camera, then table"
CURE_RATE = "two bus servos: control_rate_hz = 250, three: 200"
PACKAGES = ("numpy", "numba", "scipy", "opencv-python-headless", "mcap", "pyserial", "pyusb")


@dataclass(frozen=True)
class Device:
    """A device file of the machine.

    usable: this user may read and write it; group: the group that may; about: what it is; vendor,
    product: USB numbers, None where it has none.
    """

    path: str
    usable: bool
    group: str = ""
    about: str = ""
    vendor: int | None = None
    product: int | None = None


@dataclass(frozen=True)
class Facts:
    """What was found on the machine.

    serial, usb, cameras: device files by kind; usb_library: libusb is there; rtprio, memlock_bytes:
    limits of this session (None: this system has none); sdk: why the vendor's module is missing, ""
    where it is installed; packages: versions by name, None where missing; missing_files: files that
    the rig file names; calibration, homing: why the camera's, or that, cannot be used, remote: why
    the remote table does not answer (None: nothing wrong, or not checked); cache: why compiled
    functions cannot be kept, style: why no figure can be drawn, and the cures, "" where they can.
    """

    platform: str = "linux"
    user: str = "you"
    serial: tuple[Device, ...] = ()
    usb: tuple[Device, ...] = ()
    usb_library: bool = True
    sdk: str = "not installed"
    cameras: tuple[Device, ...] = ()
    rtprio: int | None = 0
    memlock_bytes: int | None = 0
    packages: dict[str, str | None] = field(default_factory=dict)
    missing_files: tuple[str, ...] = ()
    calibration: str | None = None
    remote: str | None = None
    homing: str | None = None
    cache: str = ""
    style: str = ""


@dataclass(frozen=True)
class Finding:
    """One line of `rig doctor`: what was checked, its state (OK, NOTE or BAD), and what to do."""

    what: str
    state: str
    text: str
    cure: str = ""


def udev_rule(vendor: int = USB_VENDOR, product: int = USB_PRODUCT) -> str:
    """Line for a file of udev rules that lets the group plugdev open the USB board with the numbers
    `vendor` and `product`.
    """
    return (
        f'SUBSYSTEM=="usb", ATTR{{idVendor}}=="{vendor:04x}", ATTR{{idProduct}}=="{product:04x}", '
        'MODE="0660", GROUP="plugdev", TAG+="uaccess"'
    )


def usable(findings: list[Finding]) -> bool:
    """True if the rig file's table can be driven from this machine: no finding is BAD."""
    return all(finding.state != BAD for finding in findings)


def examine(facts: Facts, rig: Rig) -> list[Finding]:
    """Compare the facts of a machine with what the rig file's table needs.

    Returns first the findings on packages, table, camera and files, which may be BAD, then those
    that only inform, NOTE at most (homing, real time, other devices). ValueError: `table.address`
    of a USB board is wrong.
    """
    of_kind = {
        "simulated": _simulated,
        "serial": _serial,
        "usb": _usb,
        QUANSER: _quanser,
        "remote": _remote,
        PULSES: _serial,
    } | dict.fromkeys(BUS_KINDS, _bus)
    found = [*_packages(facts), *of_kind[rig.table.kind](facts, rig), *_camera(facts, rig)]
    found += [Finding(name, BAD, "no such file", MISSING_CURE) for name in facts.missing_files]
    if facts.calibration:
        found.append(Finding("calibration", BAD, facts.calibration))
    if rig.table.kind != "simulated":
        found += _angles(rig) + _homing(facts)
        if rig.table.kind != "remote":
            found += _real_time(facts)
    if facts.cache:
        why, _, cure = facts.cache.partition("; ")
        found.append(Finding("cache of compiled functions", NOTE, why, cure))
    if facts.style:
        why, _, cure = facts.style.rpartition(": ")
        found.append(Finding("figures", NOTE, why, cure))
    return found + _around(facts, rig)


def _packages(facts: Facts) -> list[Finding]:
    missing = [name for name, version in facts.packages.items() if version is None]
    if missing:
        cure = f"uv sync, or pip install {' '.join(missing)}"
        return [Finding("Python packages", BAD, f"missing: {', '.join(missing)}", cure)]
    return [Finding("Python packages", OK, f"{len(facts.packages)} found")]


def _angles(rig: Rig) -> list[Finding]:
    from rig.hardware.choose import check_drive

    try:
        check_drive(rig)
    except ValueError as error:
        cure = f"set servo.kind, or table.kind to one of {', '.join(ANGLE_KINDS)}"
        return [Finding("servos", BAD, str(error), cure)]
    return []


def _simulated(facts: Facts, rig: Rig) -> list[Finding]:
    takes = rig.servo.takes_angle
    mine, others = (ANGLE_KINDS, VOLT_KINDS) if takes else (VOLT_KINDS, ANGLE_KINDS)
    here, there = (", ".join(f'"{kind}"' for kind in kinds) for kinds in (mine, others))
    servos = "motors that are given volts" if takes else "hobby or bus servos, told an angle"
    other = f'{servos} ([servo] kind = "{VOLTAGE if takes else POSITION}"): {there}'
    cure = f"for a real one name it: [table] kind = {here}; for {other}"
    return [Finding("table", OK, f"the virtual table is always there; {cure}")]


def _group_cure(facts: Facts, group: str) -> str:
    return f"sudo usermod -aG {group} {facts.user}, then log in anew"


def _serial(facts: Facts, rig: Rig, what: str = "board") -> list[Finding]:
    port = rig.table.port
    found = next((d for d in facts.serial if d.path == port), None)
    if found is None:
        others = ", ".join(d.path for d in facts.serial) or "none"
        cure = f"plug the {what} in; ports here: {others}; set table.port"
        return [Finding(f"serial port {port}", BAD, "is not there", cure)]
    if not found.usable:
        cure = _group_cure(facts, found.group or "dialout")
        return [Finding(f"serial port {port}", BAD, "may not be opened", cure)]
    return [Finding(f"serial port {port}", OK, found.about or "can be opened")]


def _bus(facts: Facts, rig: Rig) -> list[Finding]:
    """The adapter's port, and whether a tick leaves time for the bus; no servo is asked."""
    from rig.hardware.bus.bus import check_period
    from rig.hardware.choose import bus_vendor

    found, table = _serial(facts, rig, "adapter"), rig.table
    ids = table.by_channel("ids", rig.linkage.servos)
    name = f"servo bus, ids {', '.join(map(str, ids))}"
    try:
        check_period(bus_vendor(rig), len(ids), table.baud, 1 / rig.control_rate_hz)
    except ValueError as error:
        return [*found, Finding(name, BAD, str(error), CURE_RATE)]
    text = f"{table.baud} baud is fast enough for {rig.control_rate_hz:g} Hz; rig home asks them"
    return [*found, Finding(name, OK, text)]


def _usb(facts: Facts, rig: Rig) -> list[Finding]:
    if not facts.usb_library:
        cure = "sudo apt install libusb-1.0-0 (Windows: the libusb DLL beside Python)"
        return [Finding("USB library", BAD, "libusb was not found", cure)]
    vendor, product = _numbers(rig)
    name = f"USB board {vendor:04x}:{product:04x}"
    found = next((d for d in facts.usb if (d.vendor, d.product) == (vendor, product)), None)
    if found is None:
        return [Finding(name, BAD, "is not there", "plug the board in, or set table.address")]
    if not found.usable:
        rule = f"write to /etc/udev/rules.d/60-rig.rules: {udev_rule(vendor, product)}"
        cure = f"{rule} ; then sudo udevadm control --reload, plug in anew; group plugdev"
        return [Finding(name, BAD, "may not be opened", cure)]
    return [Finding(name, OK, "can be opened")]


def _numbers(rig: Rig) -> tuple[int, int]:
    from rig.hardware.choose import usb_numbers

    found = usb_numbers(rig.table.address)
    return (found[0], found[1]) if found else (USB_VENDOR, USB_PRODUCT)


def _quanser(facts: Facts, rig: Rig) -> list[Finding]:
    if facts.sdk:
        cure = (
            "install the Quanser SDK with its Python packages; for the Q2-USB that is Windows "
            'only: else run "rig serve" there and set kind = "remote" here'
        )
        return [Finding("Quanser SDK", BAD, f"quanser.hardware: {facts.sdk}", cure)]
    text = "quanser.hardware is there; the driver here has not yet run on a card"
    return [Finding("Quanser SDK", NOTE, text, "first run: hand at the motors' switch")]


def _remote(facts: Facts, rig: Rig) -> list[Finding]:
    name = f"remote table {rig.table.address}"
    if facts.remote:
        cure = f'there: "rig serve --host 0.0.0.0"; here: the same token in {rig.table.token_file}'
        return [Finding(name, BAD, facts.remote, cure)]
    return [Finding(name, OK, "answers and takes the token")]


def _camera(facts: Facts, rig: Rig) -> list[Finding]:
    address = rig.table.camera
    if not address:
        if rig.table.kind == "simulated":
            return []
        cure = "set table.camera and table.calibration; without it only servo protocols run"
        return [Finding("camera", NOTE, "the rig file names none", cure)]
    path = f"/dev/video{address}" if address.isdigit() else address
    if not path.startswith("/dev/"):
        return [Finding(f"camera {address}", NOTE, "not looked at: not a device of this machine")]
    found = next((d for d in facts.cameras if d.path == path), None)
    if found is None and facts.platform != "linux":
        return [Finding(f"camera {address}", NOTE, "cannot be looked for on this system")]
    if found is None:
        others = ", ".join(d.path for d in facts.cameras) or "none"
        cure = f"plug it in; cameras here: {others}"
        return [Finding(f"camera {address}", BAD, "is not there", cure)]
    if not found.usable:
        cure = _group_cure(facts, found.group or "video")
        return [Finding(f"camera {address}", BAD, "may not be opened", cure)]
    return [Finding(f"camera {address}", OK, found.about or "can be opened")]


def _homing(facts: Facts) -> list[Finding]:
    if facts.homing:
        return [Finding("homing", NOTE, facts.homing, "rig home --rig (this file)")]
    return [Finding("homing", OK, "is kept; a run checks it against the table")]


def _real_time(facts: Facts) -> list[Finding]:
    """Real-time limits: a NOTE at most, since late ticks are counted and reported anyway."""
    found = []
    limits = "/etc/security/limits.d/90-rig.conf"
    if facts.rtprio is None:
        return [Finding("real time", NOTE, f"no such limit on {facts.platform}")]
    if facts.rtprio < REALTIME_PRIORITY:
        cure = f'write "{facts.user} - rtprio {REALTIME_PRIORITY}" to {limits}, then log in anew'
        found.append(Finding("real-time priority", NOTE, f"limit is {facts.rtprio}", cure))
    else:
        found.append(Finding("real-time priority", OK, f"limit is {facts.rtprio}"))
    if facts.memlock_bytes is not None and facts.memlock_bytes < MEMORY_BYTES:
        cure = f'write "{facts.user} - memlock unlimited" to {limits}, then log in anew'
        mib = facts.memlock_bytes // 2**20
        found.append(Finding("locked memory", NOTE, f"limit is {mib} MiB", cure))
    return found


def _around(facts: Facts, rig: Rig) -> list[Finding]:
    """Other devices that are plugged in, to find the name of one."""
    found = []
    for device in facts.serial:
        maker = BOARD_VENDORS.get(device.vendor or -1, "")
        if device.path != rig.table.port and (maker or device.vendor is not None):
            text = " ".join(part for part in (maker, device.about) if part)
            cure = f'[table] kind = "serial", port = "{device.path}"'
            found.append(Finding(f"seen: {device.path}", NOTE, text, cure))
    for device in facts.cameras:
        if rig.table.camera and device.path.endswith(rig.table.camera):
            continue
        found.append(Finding(f"seen: {device.path}", NOTE, device.about or "a camera"))
    return found
