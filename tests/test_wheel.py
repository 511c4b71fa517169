"""The wheel works without the tree: in a read-only folder whose name has spaces and other letters,
without a home, by a user who may not write beside it."""

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from tests.support import ROOT

PACKAGES = ("rig", "vision", "calibration", "experiments")
UNPRIVILEGED = ["setpriv", "--bounding-set", "-dac_override,-dac_read_search"]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    if not shutil.which("uv"):
        pytest.skip("uv is not on the PATH: the wheel is not built")
    out = tmp_path_factory.mktemp("dist")
    done = subprocess.run(
        ["uv", "build", "--wheel", "--out-dir", str(out)], cwd=ROOT, capture_output=True, text=True
    )
    if done.returncode and "Failed to fetch" in done.stderr:
        pytest.skip("no package index and no hatchling in the cache: the wheel is not built")
    assert done.returncode == 0, done.stderr
    return next(out.glob("*.whl"))


@pytest.mark.slow
def test_every_file_of_the_packages_is_in_the_wheel(wheel: Path):
    listed = subprocess.run(
        ["git", "ls-files", *PACKAGES], cwd=ROOT, capture_output=True, text=True, check=True
    )
    with zipfile.ZipFile(wheel) as archive:
        missing = set(listed.stdout.splitlines()) - set(archive.namelist())
    assert not missing


@pytest.mark.slow
def test_a_run_is_recorded_and_reported_from_the_wheel_alone(wheel: Path, tmp_path: Path):
    site, work = tmp_path / "ein Ordner ü", tmp_path / "läufe"
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(site)
    for folder in [site, *(path for path in site.rglob("*") if path.is_dir())]:
        folder.chmod(0o555)
    work.mkdir()
    before = UNPRIVILEGED if os.geteuid() == 0 and shutil.which("setpriv") else []
    environment = {"PATH": "/usr/bin:/bin", "PYTHONPATH": str(site), "LANG": "C.UTF-8"}

    def python(*words: str) -> str:
        command = [*before, sys.executable, *words]
        done = subprocess.run(command, cwd=work, env=environment, capture_output=True, text=True)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    try:
        assert str(site) in python("-c", "import rig; print(rig.__file__)")
        python("-m", "experiments.cli", "run", "free-release", "--arm", "with", "--out", "out")
        (run,) = (work / "out/runs").iterdir()
        python("-m", "experiments.cli", "report", str(run))
        assert "coulomb_friction" in python("-m", "experiments.cli", "effects")
    finally:
        for folder in [site, *(path for path in site.rglob("*") if path.is_dir())]:
            folder.chmod(0o755)
