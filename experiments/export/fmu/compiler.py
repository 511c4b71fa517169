"""The C compilers of this machine, and what they make of one source file."""

import os
import platform
import shutil
import subprocess
from pathlib import Path

WINDOWS = "x86_64-w64-mingw32-gcc"
# products and sums are not contracted: the equations keep the bits that they have in Python
_OPTIONS = ("-std=c99", "-O2", "-ffp-contract=off", "-fvisibility=hidden", "-shared")
# the same source gives the same bytes: no date, no base address made from the file's path
_SAME_BYTES = "-Wl,--no-insert-timestamp,--disable-auto-image-base"
_SYSTEMS = {
    "Linux": ("linux", ".so"),
    "Darwin": ("darwin", ".dylib"),
    "Windows": ("windows", ".dll"),
}
_MACHINES = {"amd64": "x86_64", "x86_64": "x86_64", "arm64": "aarch64", "aarch64": "aarch64"}


def find_compiler() -> str:
    """The C compiler: $CC, else cc, gcc or clang. ValueError (one line): there is none."""
    own = os.environ.get("CC")
    for name in (own,) if own else ("cc", "gcc", "clang"):
        if found := shutil.which(name):
            return found
    wanted = f"$CC = {own}" if own else "cc, gcc or clang"
    raise ValueError(f"--as fmu needs a C compiler ({wanted} not found): install one, such as gcc")


def own_platform() -> tuple[str, str]:
    """Folder below binaries/ and file ending of this machine's library, as FMI 3.0 names them."""
    system, ending = _SYSTEMS.get(platform.system(), ("linux", ".so"))
    machine = platform.machine().lower()
    return f"{_MACHINES.get(machine, machine)}-{system}", ending


def compile_library(compiler: str, source: Path, library: Path) -> None:
    """Compile one C file to a shared library. RuntimeError: the compiler refused it."""
    position = () if library.suffix == ".dll" else ("-fPIC",)
    static = ("-static-libgcc",) if library.suffix == ".dll" else ()
    dateless = (_SAME_BYTES,) if Path(compiler).name == WINDOWS else ()
    library.parent.mkdir(parents=True, exist_ok=True)
    options = [*_OPTIONS, *position, *static, *dateless]
    command = [compiler, *options, "-o", str(library), str(source), "-lm"]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        first = (done.stderr.strip().splitlines() or ["no reason given"])[0]
        raise RuntimeError(f"{compiler} could not compile the table: {first}")
