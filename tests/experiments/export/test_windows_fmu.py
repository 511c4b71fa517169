"""The FMU's Windows binary, cross-compiled: a 64-bit DLL with the functions of the Linux one."""

import re
import shutil
import subprocess
import zipfile
from pathlib import Path

import pytest

from experiments.export.export_model import export_model
from experiments.export.fmu.compiler import WINDOWS, compile_library
from experiments.runs.assemble import load_rig
from tests.support.parts import need

need("cc", "mingw")


@pytest.fixture(scope="module")
def binaries(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("windows")
    told = export_model(load_rig(Path("default")), "default", "fmu", made / "t.fmu")
    assert not any("Windows" in line for line in told)
    with zipfile.ZipFile(made / "t.fmu") as archive:
        archive.extractall(made)
    return made / "binaries"


def _read(*command: str | Path) -> str:
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


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
