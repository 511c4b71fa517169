"""Many tables: each is the single environment to the bit, in all of Gymnasium's reset modes."""

import importlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from experiments.runs.assemble import load_rig
from tests.support import ROOT
from tests.support.parts import need

need("gymnasium")

gymnasium: Any = importlib.import_module("gymnasium")
modes: Any = importlib.import_module("gymnasium.vector").AutoresetMode
gym: Any = importlib.import_module("rig.gym")
BalancingTables: Any = gym.BalancingTables
GAP = ROOT / "experiments/own_controllers/gap.json"
BUS = load_rig(Path("bus-servos"))


def assert_same(ours: dict, theirs: dict) -> None:
    """Infos of two vector environments: the same keys, and the same where their masks say so."""
    assert set(ours) == set(theirs)
    for key in (key for key in ours if not key.startswith("_")):
        mask = ours[f"_{key}"]
        np.testing.assert_array_equal(mask, theirs[f"_{key}"])
        if isinstance(ours[key], dict):
            assert_same(ours[key], theirs[key])
            continue
        for a, b in zip(np.asarray(ours[key])[mask], np.asarray(theirs[key])[mask], strict=True):
            np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("mode", [modes.NEXT_STEP, modes.SAME_STEP])
@pytest.mark.parametrize("table", [{"randomise": GAP, "play": True}, {"rig": BUS}], ids=["", "bus"])
def test_gymnasiums_own_vector_of_single_tables_is_the_same(mode, table: dict):
    words = {"num_envs": 5, "seconds": 0.8, **table}
    ours = gymnasium.make_vec(gym.ID, autoreset_mode=mode, **words)
    theirs = gymnasium.make_vec(
        gym.ID, vectorization_mode="sync", vector_kwargs={"autoreset_mode": mode}, **words
    )
    assert isinstance(ours, BalancingTables)
    assert ours.metadata["autoreset_mode"] == theirs.metadata["autoreset_mode"]
    assert ours.observation_space == theirs.observation_space
    assert ours.action_space == theirs.action_space
    np.testing.assert_array_equal(ours.reset(seed=11)[0], theirs.reset(seed=11)[0])
    rng, ends = np.random.default_rng(0), 0
    push = rng.choice([-0.5, 0.0, 0.5], (5, 2))  # some tables lose the ball, some do not
    for _ in range(900):
        actions = np.clip(push + rng.uniform(-0.5, 0.5, (5, 2)), -1, 1).astype(np.float32)
        a, b = ours.step(actions), theirs.step(actions)
        for mine, other in zip(a[:4], b[:4], strict=True):
            np.testing.assert_array_equal(mine, other)
            assert mine.dtype == other.dtype
        assert_same(a[4], b[4])
        ends += int(a[2].sum() + a[3].sum())
    assert ends >= 10


def test_without_autoreset_ended_tables_are_reset_by_a_mask():
    envs = BalancingTables(4, seconds=0.02, autoreset_mode="Disabled")
    first, _ = envs.reset(seed=5)
    for _ in range(10):
        seen, _, _, truncated, infos = envs.step(np.zeros((4, 2)))
    assert truncated.all()
    assert infos["outcome"].tolist() == ["completed"] * 4
    with pytest.raises(gymnasium.error.ResetNeeded):
        envs.step(np.zeros((4, 2)))
    mask = np.array([True, False, True, False])
    again, _ = envs.reset(seed=5, options={"reset_mask": mask})
    np.testing.assert_array_equal(again[mask], first[mask])
    np.testing.assert_array_equal(again[~mask], seen[~mask])
    envs.reset(seed=5)
    envs.step(np.zeros((4, 2)))


def test_a_seed_for_each_table_and_tables_that_differ():
    envs = BalancingTables(3, randomise=GAP)
    same, _ = envs.reset(seed=[4, 9, 4])
    np.testing.assert_array_equal(same[0], same[2])
    assert not np.array_equal(same[0], same[1])
    assert envs.true_rigs[0] == envs.true_rigs[2] != envs.true_rigs[1]


def test_what_is_returned_is_not_written_again():
    envs = BalancingTables(4)
    kept = envs.reset(seed=1)[0]
    copy = kept.copy()
    out = envs.step(np.full((4, 2), 0.5))
    copies = [np.copy(part) for part in out[:4]]
    balls = out[4]["true_ball_m"].copy()
    envs.step(np.full((4, 2), -0.5))
    np.testing.assert_array_equal(kept, copy)
    for part, before in zip(out[:4], copies, strict=True):
        np.testing.assert_array_equal(part, before)
    np.testing.assert_array_equal(out[4]["true_ball_m"], balls)


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: BalancingTables(0), "num_envs = 0: must be 1 or more"),
        (lambda: BalancingTables(2).reset(seed=[1]), "1 seeds for 2 tables"),
        (lambda: BalancingTables(2).reset(options={"reset_mask": np.ones(2)}), "must be bool"),
        (lambda: BalancingTables(2).step(np.zeros(2)), r"must be \(2, 2\)"),
        (lambda: BalancingTables(2, autoreset_mode="never"), "not a valid AutoresetMode"),
    ],
)
def test_bad_calls_are_one_line(call, said: str):
    with pytest.raises(ValueError, match=said) as error:
        call()
    assert "\n" not in str(error.value)
    with pytest.raises(gymnasium.error.ResetNeeded):
        BalancingTables(2).step(np.zeros((2, 2)))
