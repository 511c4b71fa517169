"""Parts that some tests need beyond Python and pip: how each is found and what brings it.

A test that lacks one is skipped with a reason that begins `needs NAME:` or `needs NAME, NAME:`;
`tests/conftest.py` lists at the end of a run what was not tried for that.
"""

import importlib.util
import shutil
from ctypes.util import find_library
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.support import ROOT

UV_LINE = "uv run --group dev --group entries --extra cluster pytest"
RECORDINGS = ROOT.parent / "shared/data"
FOOTAGE = ROOT.parent / "shared/data/ball_on_plate/balancing_1.mp4"


@dataclass(frozen=True)
class Part:
    """`untested`: what is not tried without it. Found by any of `programs` on the PATH, by `file`,
    as a shared `library`, or as a `module`; brought by the Debian packages `debian`, by uv (a
    module), or by hand (`by_hand`)."""

    untested: str
    programs: tuple[str, ...] = ()
    file: Path | None = None
    library: str = ""
    module: str = ""
    debian: tuple[str, ...] = ()
    by_hand: str = ""

    def find(self) -> str | None:
        """Path of the program or file, name of the module; None where it is missing."""
        for program in self.programs:
            if found := shutil.which(program):
                return found
        if self.file is not None and self.file.is_file():
            return str(self.file)
        if self.library and (found := find_library(self.library)):
            return found
        if self.module and importlib.util.find_spec(self.module) is not None:
            return self.module
        return None


PARTS = {
    "cc": Part(
        "protocol.c of the firmware and exported tables, built for this machine",
        programs=("cc",),
        debian=("gcc", "libc6-dev"),
    ),
    "mingw": Part(
        "exported tables built for Windows",
        programs=("x86_64-w64-mingw32-gcc",),
        by_hand="Debian's gcc-mingw-w64-x86-64-posix (too large to ask for in general)",
    ),
    "wine": Part(
        "exported tables for Windows, run",
        programs=("wine64", "wine"),
        file=Path("/usr/lib/wine/wine64"),
        by_hand="Debian's wine64 (too large to ask for in general)",
    ),
    "make": Part("the firmware's Makefile", programs=("make",), debian=("make",)),
    "avr-gcc": Part("the firmware's binary", programs=("avr-gcc",), debian=("gcc-avr", "avr-libc")),
    "simavr": Part(
        "the firmware's binary on a simulated chip",
        file=Path("/usr/include/simavr/sim_avr.h"),
        debian=("simavr", "libsimavr-dev", "libelf-dev"),
    ),
    "umockdev": Part(
        "rig doctor with devices plugged in", programs=("umockdev-run",), debian=("umockdev",)
    ),
    "libusb": Part(
        "rig doctor with a USB board plugged in", library="usb-1.0", debian=("libusb-1.0-0",)
    ),
    "chromium": Part(
        "the dashboard in a browser",
        programs=("chromium",),
        debian=("chromium", "fonts-dejavu-core"),
    ),
    "playwright": Part("the dashboard in a browser", module="playwright"),
    "mujoco": Part("the simulator against an independent engine", module="mujoco"),
    "EGL": Part(
        "films of MuJoCo's renderer",
        library="EGL",
        debian=("libegl1", "libgl1-mesa-dri", "libopengl0"),
    ),
    "pysindy": Part("sparse regression of the discrepancy", module="pysindy"),
    "gplearn": Part("symbolic regression of the discrepancy", module="gplearn"),
    "fmpy": Part("exported tables in an FMI importer", module="fmpy"),
    "importlinter": Part("the order of packages and rooms", module="importlinter"),
    "distributed": Part("trials on a Dask cluster", module="distributed"),
    "nptdms": Part("rig import of LabVIEW's TDMS files", module="nptdms"),
    "foxglove": Part("the live stream for Foxglove", module="foxglove"),
    "gymnasium": Part("the Gymnasium environment", module="gymnasium"),
    "mcap_ros2": Part("rig import of ROS 2 bags", module="mcap_ros2"),
    "openpyxl": Part("rig import of workbooks", module="openpyxl"),
    "footage": Part(
        "the tracker on real footage",
        file=FOOTAGE,
        by_hand=f"balancing_1.mp4 in {FOOTAGE.parent.relative_to(ROOT.parent)} beside the checkout",
    ),
    "recordings": Part(
        "rig gap on recordings of real tables",
        file=RECORDINGS / "position_table/run.csv",
        by_hand="position_table and positioning_axis in shared/data beside the checkout",
    ),
}


def missing(*names: str) -> str | None:
    """Why a test that needs these parts cannot run; None where it can."""
    absent = [name for name in names if PARTS[name].find() is None]
    return f"needs {', '.join(absent)}: {PARTS[absent[0]].untested}" if absent else None


def need(*names: str) -> None:
    """Skip the test, or at the top of a file all its tests, unless every part is there."""
    if reason := missing(*names):
        pytest.skip(reason, allow_module_level=True)


def needs(*names: str) -> pytest.MarkDecorator:
    """`need` as a mark on one test or one parameter."""
    return pytest.mark.skipif(bool(missing(*names)), reason=missing(*names) or "")


def advice(names: set[str]) -> list[str]:
    """Lines that say what was not tried without the parts `names`, and what brings them all."""
    lines = [f"{name}: {PARTS[name].untested}" for name in PARTS if name in names]
    debian = [package for name in PARTS if name in names for package in PARTS[name].debian]
    if debian:
        packages = " ".join(dict.fromkeys(debian))
        lines.append(f"sudo apt-get install --no-install-recommends {packages}")
    if any(PARTS[name].module for name in names):
        lines.append(UV_LINE)
    return lines + [PARTS[name].by_hand for name in PARTS if name in names and PARTS[name].by_hand]
