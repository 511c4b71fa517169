"""The house rules that a machine can keep."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
ARROW = ("vision", "rig", "calibration", "experiments")
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


def imports(path: Path) -> set[str]:
    """Top-level package names that a file imports, wherever in the file."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            found.add((node.module or "").split(".")[0])
    return found


@pytest.mark.parametrize("package", ARROW)
def test_a_package_imports_only_from_its_left(package: str):
    allowed = set(ARROW[: ARROW.index(package) + 1])
    for path in (ROOT / package).rglob("*.py"):
        wrong = (imports(path) & set(ARROW)) - allowed
        assert not wrong, f"{path.relative_to(ROOT)} imports {wrong}: the arrow is {ARROW}"


def test_the_arrow_test_would_notice(tmp_path: Path):
    bad = tmp_path / "bad.py"
    bad.write_text("def f():\n    from experiments.cli import main\n    return main\n")
    assert imports(bad) == {"experiments"}


def test_help_imports_nothing_heavy():
    code = (
        "import sys\nsys.argv = ['rig', '--help']\nfrom experiments.cli import main\n"
        "try:\n    main()\nexcept SystemExit:\n    pass\n"
        f"print('HEAVY', sorted({HEAVY!r} & set(sys.modules)))"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "HEAVY []" in out.stdout, out.stdout[-300:]


def test_no_file_has_outgrown_its_noun():
    long = {
        str(path.relative_to(ROOT)): lines
        for package in ARROW
        for path in (ROOT / package).rglob("*.py")
        if (lines := len(path.read_text(encoding="utf-8").splitlines())) > 280
    }
    assert not long, f"over 280 lines: {long}"
