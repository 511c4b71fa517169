"""Every benchmark imports what it needs and says what it measures."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.support import ROOT
from tests.support.parts import needs

HERE = Path(__file__).parent
PROGRAMS = sorted(
    path
    for path in HERE.rglob("*.py")
    if path != Path(__file__) and '__name__ == "__main__"' in path.read_text("utf-8")
)
ENGINE = {"agreement", "exported_models", "speed"}


@pytest.mark.slow
@pytest.mark.parametrize(
    "program",
    [
        pytest.param(p, marks=needs("mujoco") if p.stem in ENGINE else (), id=p.stem)
        for p in PROGRAMS
    ],
)
def test_a_benchmark_answers_help(program: Path):
    done = subprocess.run(
        [sys.executable, str(program), "--help"], cwd=ROOT, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr[-500:]
    assert "usage:" in done.stdout
