"""The learned policy that is shipped balances the ball, and its training finds such a one."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from experiments.analysis.metrics import run_metrics
from experiments.records.recording import read_run
from experiments.runs.assemble import load_rig
from experiments.runs.protocol import read_protocol
from experiments.runs.runs import run_protocol
from rig.control.agent import AgentView
from tests.support import ROOT
from tests.support.parts import needs

HERE = ROOT / "experiments/own_controllers"
PLAN = read_protocol(str(HERE / "learned.toml"))


def module(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, HERE / f"{name}.py")
    assert spec
    assert spec.loader
    made = sys.modules[name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(made)
    return made


def test_it_holds_the_ball_nearer_than_the_pid_does(tmp_path: Path):
    how = {"out": tmp_path, "seed": 3, "repetitions": 1}
    done = run_protocol(load_rig(None), PLAN, arms=["own", "without"], **how)
    runs = {run.meta["arm"]: run for run in (read_run(one.folder) for one in done)}
    assert [one.ending.outcome for one in done] == ["completed"] * 2
    learned, pid = (run_metrics(runs[arm].log).settled for arm in ("own", "without"))
    assert learned.error_rms_m < 0.0015
    assert learned.error_rms_m < 0.5 * pid.error_rms_m


def test_actions_are_linear_axis_by_axis():
    policy = module("linear_policy")
    weights = np.arange(12.0).reshape(2, 6)
    seen = np.zeros(12)
    np.testing.assert_array_equal(policy.actions(weights, seen), [5.0, 11.0])  # the constant
    seen[[0, 4, 10]] = 0.25, 1.0, 2.0  # ball, target and volts on x
    np.testing.assert_array_equal(policy.actions(weights, seen), [0.0 * 0.75 + 4.0 * 2 + 5.0, 11.0])
    many = policy.actions(np.stack([weights, -weights]), np.stack([seen, seen]))
    np.testing.assert_array_equal(many[0], -many[1])
    assert AgentView(load_rig(None)).high.shape == seen.shape


@needs("gymnasium")
@pytest.mark.slow
def test_a_few_generations_learn_to_keep_the_ball(tmp_path: Path, monkeypatch):
    module("linear_policy")
    trainer = module("train")
    out = tmp_path / "policy.json"
    words = ["train.py", "--generations", "5", "--seconds", "3", "--seed", "2", "--out", str(out)]
    monkeypatch.setattr(sys, "argv", words)
    trainer.main()
    weights = np.array(trainer.json.loads(out.read_text())["weights"])
    assert weights.shape == (2, 6)
    assert np.all(weights[:, 0] > 0.0)  # towards the target
    assert np.all(weights[:, 1] < 0.0)  # against the speed
