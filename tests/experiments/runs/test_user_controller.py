"""A lab's own controller named in a protocol."""

import pytest

from experiments.records.recording import read_run
from experiments.runs.assemble import load_rig
from experiments.runs.protocol import read_protocol
from experiments.runs.runner import RunRequest, run, simulate_run
from rig.control.user_controller import load_controller

GOOD = """
class Mine:
    def start(self, rig, period_s):
        self.ticks = 0
    def control(self, now):
        self.ticks += 1
        if self.ticks > {last}:
            raise RuntimeError("out of ideas")
        return [14.0 * (3.45 * (t - x) - 2.11 * v - th) for t, x, v, th in zip(
            now.target_m, now.ball_m, now.velocity_m_s, now.theta_rad)]
    def end(self, outcome):
        pass
"""
NAMED = 'controller = "mine.py:Mine"\n'
PROTOCOL = 'title = "mine"\nduration_s = 1.0\ncontroller = "mine.py:Mine"\n[start]\nhold_s = 0.0\n'


def protocol(folder, last: int = 10**9, text: str = PROTOCOL):
    (folder / "mine.py").write_text(GOOD.format(last=last))
    (folder / "mine.toml").write_text(text)
    return read_protocol(str(folder / "mine.toml"))


def test_it_runs_and_is_recorded_as_its_own_arm(tmp_path):
    plan = protocol(tmp_path)
    assert plan.arms == ["own"]
    done = run(RunRequest(load_rig(None), plan, "own", 1, tmp_path / "runs"))
    assert done.ending.outcome == "completed"
    meta = read_run(done.folder).meta
    assert meta["arm"] == "own"
    assert meta["protocol"]["controller"].endswith("mine.py:Mine")


def test_what_it_raises_ends_the_run_with_the_reason_recorded(tmp_path):
    done = run(RunRequest(load_rig(None), protocol(tmp_path, 100), "own", 1, tmp_path / "runs"))
    assert done.ending.outcome == "aborted"
    whole = read_run(done.folder)
    assert whole.meta["outcome"] == "aborted"
    assert "out of ideas" in whole.meta["reason"]
    assert whole.log["voltage_x_V"][-1] == 0.0


def test_it_has_no_place_in_the_batch_kernel(tmp_path):
    with pytest.raises(ValueError, match="tick by tick"):
        simulate_run(RunRequest(load_rig(None), protocol(tmp_path), "own", 1, tmp_path))


@pytest.mark.parametrize(
    ('name', 'said'),
    [("none.py:Mine", "not found"), ("mine.py:Yours", "Yours"), ("bad.py:Bad", "lacks control"),
     ("broken.py:X", "SyntaxError"), ("mine.txt:Mine", "no Python file")],
)  # fmt: skip
def test_a_wrong_file_or_class_is_one_line(tmp_path, name, said):
    (tmp_path / "mine.py").write_text(GOOD.format(last=1))
    (tmp_path / "mine.txt").write_text("x")
    (tmp_path / "bad.py").write_text(
        "class Bad:\n    def start(self, r, p): ...\n    def end(self, o): ...\n"
    )
    (tmp_path / "broken.py").write_text("class X(:\n")
    with pytest.raises(ValueError, match=said) as error:
        load_controller(f"{tmp_path}/{name}")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ('text', 'said'),
    [(PROTOCOL + '[pushes]\nkind = "none"\n', None),
     ('arms = ["own"]\n' + PROTOCOL.replace(NAMED, ""), "belong together"),
     ('arms = ["with"]\n' + PROTOCOL, "belong together"),
     ('arms = ["wiht"]\n' + PROTOCOL.replace(NAMED, ""), "unknown arm")],
)  # fmt: skip
def test_arms_and_controller_of_a_protocol_fit(tmp_path, text, said):
    if said is None:
        assert protocol(tmp_path, text=text).controller
        return
    with pytest.raises(ValueError, match=said):
        protocol(tmp_path, text=text)
