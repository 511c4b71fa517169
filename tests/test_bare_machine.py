"""With Python and pip alone the tests are green: what needs more is skipped and listed."""

import subprocess
import sys

import pytest

from tests.support import ROOT
from tests.support.parts import PARTS, UV_LINE

# The tests that need parts; the slow one below takes all.
NEEDY = (
    "tests/benchmarks/test_entries.py",
    "tests/engines/test_against_mujoco.py",
    "tests/engines/test_mujoco_closed_loop.py",
    "tests/engines/test_mujoco_logs.py",
    "tests/experiments/blind/test_cluster.py",
    "tests/experiments/dashboard/test_browser.py",
    "tests/experiments/dashboard/test_own_film.py",
    "tests/experiments/dashboard/session/test_foxglove_stream.py",
    "tests/experiments/doctor/test_doctor_devices.py",
    "tests/experiments/export/test_fmu.py",
    "tests/experiments/export/test_mjcf.py",
    "tests/experiments/export/test_translation.py",
    "tests/experiments/export/test_windows_fmu.py",
    "tests/experiments/gap/test_recordings.py",
    "tests/experiments/importing/test_extra_formats.py",
    "tests/experiments/importing/test_workbooks.py",
    "tests/rig/firmware",
    "tests/rig/gym",
    "tests/rig/hardware/board/test_board.py",
    "tests/rig/hardware/board/test_board_fuzz.py",
    "tests/rig/hardware/board/test_pulse_board.py",
    "tests/rig/hardware/board/test_pulse_commands.py",
    "tests/rig/hardware/board/test_pulse_table.py",
    "tests/test_architecture.py",
    "tests/vision/tracking/test_real_footage.py",
    "tests/vision/tracking/test_third_world.py",
)
ALL = ("-m", "slow or not slow")


def on_a_bare_machine(*words: str) -> subprocess.CompletedProcess:
    command = [sys.executable, "-m", "pytest", "-p", "tests.support.bare_machine", "-n0", "-q"]
    return subprocess.run([*command, *words], cwd=ROOT, capture_output=True, text=True)


@pytest.mark.slow
def test_every_missing_part_is_a_skip_with_its_cure():
    done = on_a_bare_machine(*NEEDY, *ALL, "-k", "not heavy and not outgrown and not screen")
    assert done.returncode == 0, done.stdout[-2000:]
    said = done.stdout.rpartition("not tried on this machine")[2]
    for name, part in PARTS.items():
        assert f"{name}: {part.untested}" in said
        assert all(package in said for package in part.debian)
    assert UV_LINE in said
    assert said.count("apt-get") == 1


@pytest.mark.slow
def test_everything_is_collected_without_the_parts():
    done = on_a_bare_machine("--collect-only", *ALL)
    assert done.returncode == 0, done.stdout[-2000:]


def test_ci_installs_what_debian_brings_for_the_tests():
    said = (ROOT / ".ci/run").read_text()
    assert all(package in said.split() for part in PARTS.values() for package in part.debian)
