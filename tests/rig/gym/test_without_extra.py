"""Without the extra everything else works, and `rig.gym` says what is missing."""

import subprocess
import sys

from tests.support import ROOT

WITHOUT = "import sys; sys.modules['gymnasium'] = None\n"


def python(code: str) -> subprocess.CompletedProcess:
    return subprocess.run(
        [sys.executable, "-c", WITHOUT + code], cwd=ROOT, capture_output=True, text=True
    )


def test_the_missing_extra_is_one_line_with_its_cure():
    done = python("import rig.gym")
    assert done.returncode == 1
    said = done.stderr.splitlines()[-1]
    assert said == "ImportError: rig.gym needs gymnasium, the extra `gym`: uv sync --extra gym"


def test_rig_and_a_learned_controller_do_not_need_it():
    done = python(
        "import rig, rig.simulation.stepped\n"
        "from rig.control.user_controller import load_controller\n"
        "file = 'experiments/own_controllers/linear_policy.py'\n"
        "load_controller(file + ':LinearPolicy').start(rig.Rig(), 0.002)\n"
        "print('fine')"
    )
    assert done.stdout == "fine\n", done.stderr
