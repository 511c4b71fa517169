"""The FMU's Windows binary, cross-compiled: a 64-bit DLL with the functions of the Linux one."""

import os
import re
import shutil
import subprocess
import zipfile
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from experiments.export.export_model import export_model
from experiments.export.fmu.compiler import WINDOWS, compile_library
from experiments.runs.assemble import load_rig
from tests.support import ROOT
from tests.support.parts import PARTS, needs

pytestmark = needs("cc", "mingw")
COMMANDED = ("voltage_x_V", "voltage_y_V")
SEEN = ("theta_x_rad", "theta_y_rad", "ball_x_m", "ball_y_m")


@pytest.fixture(scope="module")
def binaries(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("windows")
    told = export_model(load_rig(Path("default")), "default", "fmu", made / "t.fmu")
    assert not any("Windows" in line for line in told)
    with zipfile.ZipFile(made / "t.fmu") as archive:
        archive.extractall(made)
    return made / "binaries"


def _read(*command: str | Path, env: dict[str, str] | None = None) -> str:
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=env)
    return done.stdout


def test_the_dll_exports_what_the_linux_library_exports(binaries: Path):
    library = binaries / "x86_64-windows/balancing_table.dll"
    read = _read("x86_64-w64-mingw32-objdump", "-p", library)
    assert "file format pei-x86-64" in read
    linux = _read("nm", "-D", "--defined-only", binaries / "x86_64-linux/balancing_table.so")
    names = set(re.findall(r" T (fmi3\w+)$", linux, re.MULTILINE))
    assert {"fmi3InstantiateCoSimulation", "fmi3DoStep", "fmi3GetFloat64"} <= names
    assert set(re.findall(r"\b(fmi3[A-Z]\w+)$", read, re.MULTILINE)) == names


def test_the_dll_needs_nothing_that_windows_lacks(binaries: Path):
    library = binaries / "x86_64-windows/balancing_table.dll"
    read = _read("x86_64-w64-mingw32-objdump", "-p", library)
    wanted = {name.lower() for name in re.findall(r"DLL Name: (\S+)", read)}
    assert wanted <= {"kernel32.dll", "msvcrt.dll"}


def test_the_same_table_gives_the_same_bytes(binaries: Path, tmp_path: Path):
    source = binaries.parent / "sources/balancing_table.c"
    again = tmp_path / "elsewhere/balancing_table.dll"
    found = shutil.which(WINDOWS)
    assert found is not None
    compile_library(found, source, again)
    own = binaries / "x86_64-windows/balancing_table.dll"
    assert again.read_bytes() == own.read_bytes()


def _ran(host: list[str | Path], library: Path, tmp_path: Path) -> np.ndarray:
    """Outputs (300, n) of the library under commands to and fro."""
    root = ElementTree.parse(library.parents[2] / "modelDescription.xml").getroot()
    variables = root.find("ModelVariables")
    assert variables is not None
    places = {one.get("name"): one.get("valueReference") for one in variables}
    words = [root.get("instantiationToken"), "300", *(places[name] for name in COMMANDED + SEEN)]
    quiet = {"WINEPREFIX": str(tmp_path / "wine"), "WINEDEBUG": "-all", "DISPLAY": ""}
    read = _read(*host, library, *words, env=os.environ | quiet)
    bits = [[int(word, 16) for word in line.split()] for line in read.splitlines()]
    return np.array(bits, dtype=np.uint64).view(np.float64)


@needs("cc", "mingw", "wine")
def test_the_dll_computes_what_the_linux_library_computes(binaries: Path, tmp_path: Path):
    """In wine, whose C library is not that of Linux: a sine may differ in its last bits."""
    source, hosts = ROOT / "tests/support/fmu_host.c", [tmp_path / "host", tmp_path / "host.exe"]
    subprocess.run(["cc", "-o", hosts[0], source, "-ldl"], check=True)
    subprocess.run([WINDOWS, "-o", hosts[1], source], check=True)
    linux = _ran([hosts[0]], binaries / "x86_64-linux/balancing_table.so", tmp_path)
    wine: list[str | Path] = [PARTS["wine"].find() or "", hosts[1]]
    windows = _ran(wine, binaries / "x86_64-windows/balancing_table.dll", tmp_path)
    assert linux.shape == (300, len(SEEN))
    assert np.ptp(linux, axis=0).min() > 1e-3
    assert np.abs(linux - windows).max() < 1e-14
