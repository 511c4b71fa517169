"""Gather what `rig doctor` checks on this machine.

Nothing is moved, and no port of a board is opened: some boards reset when that is done.
"""

import os
import sys
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any

from experiments.doctor.doctor import PACKAGES, Device, Facts
from experiments.picture_files import style_trouble
from rig.parameters import Rig
from vision.compiled import CACHE_NOTE


def gather(rig: Rig, rig_file: Path | None) -> Facts:
    """Look at this machine for what the table of `rig` needs, and return what was found.

    rig_file: where the rig is from, for its homing; None where none was given. A remote table is
    asked whether it answers; nothing is moved.
    """
    usb, library = _usb_devices()
    rtprio, memlock = _limits()
    files = [name for name in (rig.table.token_file, rig.table.calibration) if name]
    return Facts(
        platform=sys.platform,
        user=_user(),
        serial=_serial_ports(),
        usb=usb,
        usb_library=library,
        sdk=_sdk(),
        cameras=_cameras(),
        rtprio=rtprio,
        memlock_bytes=memlock,
        packages=_packages(),
        missing_files=tuple(name for name in files if not Path(name).is_file()),
        calibration=_calibration(rig),
        remote=_remote(rig),
        homing=_homing(rig, rig_file),
        cache=CACHE_NOTE,
        style=_style(),
    )


def _style() -> str:
    try:
        import_module("matplotlib")  # reads its settings
    except UnicodeDecodeError as error:
        return style_trouble(error)
    return ""


def _user() -> str:
    import getpass

    with suppress(OSError, KeyError, ImportError):
        return getpass.getuser()
    return "you"


def _device(path: str, about: str = "", **numbers) -> Device:
    node = Path(path)
    group = ""
    with suppress(OSError, KeyError, NotImplementedError, ImportError):
        group = node.group()
    allowed = os.access(path, os.R_OK | os.W_OK) if node.exists() else True
    return Device(path, allowed, group, about, **numbers)


def _serial_ports() -> tuple[Device, ...]:
    try:
        from serial.tools.list_ports import comports

        ports = comports()
    except (ImportError, OSError, TypeError, ValueError):  # or one was unplugged meanwhile
        return ()
    return tuple(_device(p.device, p.description or "", vendor=p.vid, product=p.pid) for p in ports)


def _usb_devices() -> tuple[tuple[Device, ...], bool]:
    try:
        import usb.core

        found = list(usb.core.find(find_all=True) or ())
    except ImportError:
        return (), False
    except Exception as error:  # no libusb, or it fails: the library has a family of errors
        return (), type(error).__name__ != "NoBackendError"
    devices = []
    one: Any
    for one in found:
        path = f"/dev/bus/usb/{one.bus or 0:03d}/{one.address or 0:03d}"
        devices.append(_device(path, vendor=one.idVendor, product=one.idProduct))
    return tuple(devices), True


def _sdk() -> str:
    from importlib.util import find_spec

    try:
        return "" if find_spec("quanser.hardware") is not None else "not installed"
    except (ImportError, ValueError) as error:
        return str(error)


def _cameras() -> tuple[Device, ...]:
    found = []
    for node in sorted(Path("/dev").glob("video*")):
        name = Path("/sys/class/video4linux") / node.name / "name"
        about = name.read_text().strip() if name.is_file() else ""
        found.append(_device(str(node), about))
    return tuple(found)


def _limits() -> tuple[int | None, int | None]:
    """Real-time priority and locked memory that this session may have."""
    try:
        import resource
    except ImportError:
        return None, None

    def soft(name: str, most: int) -> int | None:
        if not hasattr(resource, name):
            return None
        value = resource.getrlimit(getattr(resource, name))[0]
        return most if value == resource.RLIM_INFINITY else value

    if hasattr(os, "geteuid") and os.geteuid() == 0:
        return 99, 2**62  # root is asked for nothing
    return soft("RLIMIT_RTPRIO", 99), soft("RLIMIT_MEMLOCK", 2**62)


def _packages() -> dict[str, str | None]:
    from importlib.metadata import PackageNotFoundError, version

    found: dict[str, str | None] = {}
    for name in PACKAGES:
        found[name] = None
        with suppress(PackageNotFoundError):
            found[name] = version(name)
    return found


def _calibration(rig: Rig) -> str | None:
    """Why the calibration of a real table's camera cannot be used; None where it can, or is not
    there."""
    if rig.table.kind == "simulated" or not Path(rig.table.calibration or "").is_file():
        return None
    from experiments.runs.live_eye import real_calibration

    try:
        real_calibration(rig)
    except (OSError, ValueError) as error:
        return str(error)
    return None


def _remote(rig: Rig) -> str | None:
    """Why the remote table cannot be used; None where it can, or is not asked for."""
    if rig.table.kind != "remote":
        return None
    from rig.hardware.choose import open_table

    try:
        open_table(rig, homed=False).close()
    except (OSError, ValueError) as error:
        return str(error)
    return None


def _homing(rig: Rig, rig_file: Path | None) -> str | None:
    if rig.table.kind == "simulated" or rig_file is None:
        return None
    from rig.hardware.homing.homed import NotHomed, home_file, load

    try:
        kept = load(home_file(rig_file))
        kept.check(rig, kept.boot_id)
    except NotHomed as error:
        return str(error)
    return None
