"""A table as a Functional Mock-up Unit: FMI 3.0, co-simulation."""

import hashlib
import shutil
import tempfile
import zipfile
from collections.abc import Mapping, Sequence
from io import BytesIO
from pathlib import Path

from experiments.export import own_effects
from experiments.export.fmu import variables as kinds
from experiments.export.fmu.compiler import WINDOWS, compile_library, find_compiler, own_platform
from experiments.export.fmu.description import IDENTIFIER, build_description, model_description
from experiments.export.fmu.source import source
from rig.effects import BY_NAME
from rig.files import write_whole
from rig.parameters import Rig
from rig.plant.plant_record import pack

_DATED = (2026, 1, 1, 0, 0, 0)  # chosen: the same table gives the same bytes


def left_out(rig: Rig) -> list[str]:
    """What the FMU does not carry of this rig, one line each."""
    told = [
        "Outputs are the true motion: encoder counts, tachometer and camera (rate, delay, noise) "
        "are not in it.",
        "Volts and angles are taken as they come: limits and controller are the importer's.",
    ]
    seen = [name for name in rig.effects if BY_NAME[name].side == "camera"]
    if seen:
        told.append(f"Effects of the camera are not in it: {', '.join(sorted(seen))}.")
    return told


def write_fmu(
    rig: Rig,
    name: str,
    out: Path,
    intervals: Mapping[str, tuple[float, float]],
    lost: Sequence[str] = (),
) -> list[str]:
    """Write the FMU of a rig to `out`; returns what it does not carry, one line each.

    name: of the model; intervals: least and greatest value by parameter (`variables.parameters`);
    lost: lines to add to what it does not carry.
    ValueError (one line): no C compiler, or an interval without the rig's own value. OSError: it
    cannot be written. RuntimeError: the compiler refused the source.
    """
    own, rig = own_effects.left_out(rig), own_effects.without_own(rig)
    compiler, record = find_compiler(), pack(rig)
    found, strange = kinds.bounded(kinds.parameters(rig, record), intervals)
    told = [*left_out(rig), *own, *lost]
    told += [
        f"The interval of {one} is not in it: no parameter bears this name." for one in strange
    ]
    fed = list(enumerate([*kinds.inputs(rig), *kinds.outputs(rig)], start=1))
    numbered = fed + list(enumerate(found, start=kinds.FIRST_PARAMETER))
    code = source(rig, record, "{token}", numbered)
    token = hashlib.sha256((name + code).encode()).hexdigest()[:32]
    code = code.replace("{token}", token)
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        (folder / "sources").mkdir()
        written = folder / "sources" / f"{IDENTIFIER}.c"
        written.write_text(code, encoding="utf-8")
        (folder / "sources" / "buildDescription.xml").write_text(build_description(written.name))
        platform, ending = own_platform()
        compile_library(compiler, written, folder / "binaries" / platform / (IDENTIFIER + ending))
        other = shutil.which(WINDOWS)
        if other and ending != ".dll":
            library = folder / "binaries" / "x86_64-windows" / f"{IDENTIFIER}.dll"
            compile_library(other, written, library)
        elif ending != ".dll":
            told.append(f"No Windows binary: {WINDOWS} is not installed; the C is in sources/.")
        text = model_description(name, token, numbered, tick_s=1 / rig.control_rate_hz, told=told)
        (folder / "modelDescription.xml").write_text(text, encoding="utf-8")
        write_whole(out, _packed(folder))
    return told


def _packed(folder: Path) -> bytes:
    """The folder's files as a zip archive."""
    out = BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for path in sorted(p for p in folder.rglob("*") if p.is_file()):
            info = zipfile.ZipInfo(path.relative_to(folder).as_posix(), _DATED)
            info.compress_type, info.external_attr = zipfile.ZIP_DEFLATED, 0o755 << 16
            archive.writestr(info, path.read_bytes())
    return out.getvalue()
