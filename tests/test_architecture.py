"""The house rules that a machine can keep."""

import ast
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support import ROOT
from tests.support.parts import need

PACKAGES = ("vision", "rig", "calibration", "experiments")
HEAVY = {
    "cv2",
    "numba",
    "matplotlib",
    "sklearn",
    "scipy",
    "numpy",
    "viser",
    "av",
    "mcap",
    "pyarrow",
}
SOURCES = [path for package in PACKAGES for path in (ROOT / package).rglob("*.py")]


def lint_imports(folder: Path) -> subprocess.CompletedProcess:
    """The contracts of pyproject.toml asked of the packages in `folder`."""
    need("importlinter")
    code = (
        f"import sys; sys.path.insert(0, {str(folder)!r})\n"
        "from importlinter.cli import lint_imports\n"
        "sys.exit(lint_imports('pyproject.toml', no_cache=True))"
    )
    command = [sys.executable, "-c", code]
    return subprocess.run(command, capture_output=True, text=True, cwd=folder)


def test_packages_and_rooms_import_one_way():
    out = lint_imports(ROOT)
    assert out.returncode == 0, out.stdout


@pytest.mark.parametrize(
    ("room", "bad"),
    [
        ("vision/view.py", "import rig.table"),
        ("rig/loop/process.py", "import rig.hardware.camera.eye"),
        ("calibration/gap/model/fit.py", "import calibration.gap.name.screen"),
    ],
)
def test_the_import_contracts_would_notice(tmp_path: Path, room: str, bad: str):
    for package in PACKAGES:
        shutil.copytree(ROOT / package, tmp_path / package, ignore=shutil.ignore_patterns("*.pyc"))
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    (tmp_path / room).write_text(f"def f():\n    {bad}\n")
    out = lint_imports(tmp_path)
    assert out.returncode == 1
    assert bad.removeprefix("import ") in out.stdout


def test_help_imports_nothing_heavy():
    code = (
        "import sys\nsys.argv = ['rig', '--help']\nfrom experiments.cli import main\n"
        "try:\n    main()\nexcept SystemExit:\n    pass\n"
        f"print('HEAVY', sorted({HEAVY!r} & set(sys.modules)))"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "HEAVY []" in out.stdout, out.stdout[-300:]


def test_no_file_has_outgrown_its_noun():
    sizes = {path: len(path.read_text(encoding="utf-8").splitlines()) for path in SOURCES}
    assert not {path: lines for path, lines in sizes.items() if lines > 400}


def test_a_function_fits_a_screen():
    long = [
        f"{path.relative_to(ROOT)}:{node.lineno} {node.name}"
        for path in SOURCES
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        and (node.end_lineno or 0) - node.lineno >= 60
    ]
    assert not long


def test_a_floor_holds_no_more_files_than_a_stranger_reads():
    floors = {folder: len(list(folder.glob("*.py"))) for folder in {p.parent for p in SOURCES}}
    assert not {folder: files for folder, files in floors.items() if files > 20}


# Files that nobody else could have put there: new ones (a name that must not exist, a folder made
# for this, a name of their own that takes the place of the other), or what a user named.
WRITES_ITSELF = {
    "rig/hardware/network/token_file.py",  # exist_ok=False
    "experiments/blind/analysis_jobs.py",  # a temporary folder
    "experiments/dashboard/session/calibration_tasks.py",  # an archive in memory
    "experiments/export/fmu/archive.py",  # a temporary folder, and a file beside the other
    "experiments/records/run_folder.py",  # after `freed`
    "experiments/own_controllers/train.py",  # --out FILE
}


def test_files_are_written_whole_and_over_no_link():
    found = {
        path.relative_to(ROOT).as_posix()
        for path in SOURCES
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call)
        and (
            getattr(node.func, "attr", "") in ("write_text", "write_bytes", "touch")
            or ("ZipFile" in ast.unparse(node.func) and len(node.args) > 1)  # to be written
        )
    }
    assert found == WRITES_ITSELF
