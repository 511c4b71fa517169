"""One table as a Gymnasium environment: the interface, what is seen, and a law of physics."""

import importlib
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from experiments.runs.assemble import load_rig
from rig.parameters import CameraTiming, Rig, Walls
from rig.rigfile import write_rig
from tests.support import ROOT
from tests.support.parts import need

need("gymnasium")

gymnasium: Any = importlib.import_module("gymnasium")
check_env: Any = importlib.import_module("gymnasium.utils.env_checker").check_env
gym: Any = importlib.import_module("rig.gym")
BalancingTable: Any = gym.BalancingTable
DEFAULT = load_rig(None)
GAP = ROOT / "experiments/own_controllers/gap.json"
BUS = load_rig(Path("bus-servos"))


@pytest.mark.parametrize(
    "words",
    [{}, {"play": True, "randomise": GAP}, {"rig": BUS}, {"rig": DEFAULT, "seconds": 0.1}],
    ids=["default", "randomised", "angles", "short"],
)
def test_gymnasium_finds_no_fault(words: dict):
    env = gymnasium.make(gym.ID, **words).unwrapped
    check_env(env)  # a warning is an error here
    assert env.observation_space.shape == (16 if words.get("play") else 12,)


def test_a_ball_rolls_down_a_slope_by_its_equation():
    """x(t) = k g s t^2/2 on a plate that leans by s, k = 3/5 for a hollow ball."""
    slope, camera = 0.01, CameraTiming(noise_m=0.0)
    leaning = Rig(effects={"level_offset": {"x": {"slope_rad": slope}}}, camera=camera)
    env = BalancingTable(leaning, seconds=1.0)
    seen, info = env.reset(seed=0, options={"start_m": (0.0, 0.0)})
    truncated = False
    while not truncated:
        seen, _, terminated, truncated, info = env.step(np.zeros(2))
        want = 0.5 * 0.6 * 9.81 * slope * info["t_s"] ** 2
        assert info["true_ball_m"][0] == pytest.approx(want, abs=1e-5)
        assert info["true_ball_m"][1] == pytest.approx(0.0, abs=1e-6)
        assert not terminated
    assert info["outcome"] == "completed"
    assert info["t_s"] == pytest.approx(1.03, abs=1e-9)  # 30 ms until the ball is first seen
    assert seen[0] == pytest.approx(want, abs=2e-3)  # the filter's, of a ball that accelerates


def test_the_reward_is_its_equation():
    env = BalancingTable(
        DEFAULT, seconds=0.2, reference=lambda t_s, rng: np.full((len(t_s), 2), 0.02)
    )
    env.reset(seed=1)
    for _ in range(50):
        seen, reward, *_, info = env.step(np.array([0.1, -0.05]))
        off = np.hypot(*(info["true_ball_m"] - 0.02)) / (np.sqrt(2) * 0.275)
        used = np.square(seen[10:12] / 6.0).sum() / 2
        assert reward == pytest.approx(1 - off - 0.05 * used, abs=1e-6)
    assert used == pytest.approx((0.1**2 + 0.05**2) / 2, rel=1e-3)
    assert seen[4] == seen[5] == np.float32(0.02)


def test_nothing_hidden_is_seen():
    """Tables that differ in friction, play and drive alone look alike until they are moved."""
    hidden = {"friction_V": 0.3}
    other = replace(
        DEFAULT, effects=DEFAULT.effects | {"coulomb_friction": {"x": hidden, "y": hidden}}
    )
    seen = [BalancingTable(one, play=True).reset(seed=3)[0] for one in (DEFAULT, other)]
    np.testing.assert_array_equal(*seen)
    env = BalancingTable(DEFAULT, randomise={"effects.coulomb_friction.x.friction_V": (0.1, 0.4)})
    drawn = []
    for _ in range(2):
        drawn.append(env.true_rig.effects["coulomb_friction"]["x"]["friction_V"])
        first, _ = env.reset(seed=3)
        np.testing.assert_array_equal(first, seen[0][:12])
    assert drawn[0] != drawn[1]
    _, info = env.reset(seed=3)
    assert not set(first.tolist()) & set(info["true_ball_m"].astype(np.float32).tolist())


def test_one_seed_is_one_episode_and_the_next_is_another():
    env = BalancingTable(DEFAULT, randomise=GAP, seconds=0.5)

    def episode(seed: int | None) -> np.ndarray:
        rows = [env.reset(seed=seed)[0]]
        rows += [env.step(np.array([0.2, -0.1]))[0] for _ in range(100)]
        return np.array(rows)

    a, b, again = episode(7), episode(None), episode(7)
    np.testing.assert_array_equal(a, again)
    np.testing.assert_array_equal(b, episode(None))
    assert not np.array_equal(a, b)
    assert env.true_rig.effects != DEFAULT.effects


def test_the_ball_that_falls_terminates_and_asks_for_a_reset():
    env = BalancingTable(Rig(), seconds=20.0)
    env.reset(seed=0)
    for _ in range(2000):
        _, _, terminated, truncated, info = env.step(np.array([0.1, 0.1]))
        if terminated:
            break
    assert terminated
    assert not truncated
    assert info["outcome"] == "ball lost"
    with pytest.raises(gymnasium.error.ResetNeeded, match="call reset"):
        env.step(np.zeros(2))


def test_a_command_that_is_no_number_is_no_volts():
    env = BalancingTable(DEFAULT)
    env.reset(seed=0)
    for action in ([np.nan, 1e9], [np.inf, -1e9]):
        seen, *_ = env.step(np.array(action))
        assert np.all(np.isfinite(seen))
    assert abs(seen[10]) <= 6.0


def test_a_rig_file_is_taken_by_its_path(tmp_path: Path):
    write_rig(DEFAULT, tmp_path / "mein ü.toml")
    seen = [BalancingTable(one).reset(seed=2)[0] for one in (tmp_path / "mein ü.toml", DEFAULT)]
    np.testing.assert_array_equal(*seen)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ({"seconds": 0.0}, "seconds = 0: must be from one tick"),
        ({"seconds": np.nan}, "seconds = nan"),
        ({"start_m": 0.2}, r"start_m = 0.2: must be from 0 to below 0.1375"),
        ({"start_m": 0.12, "rig": Rig(walls=Walls(present=True))}, "to below 0.117875"),
        ({"rig": Rig(camera=CameraTiming(dropout=1.0))}, "no frame shows the ball"),
        ({"randomise": {"ball.mass_kg": (1, 2)}}, "no number that can be drawn"),
        ({"randomise": {"servo.gain_rad_s_V": (-1e308, 1e308)}}, "must be finite and rise"),
        ({"randomise": {"servo.gain_rad_s_V": (0, 10**400)}}, r"must be \{NAME: \(low, high\)\}"),
        ({"randomise": {"servo.gain_rad_s_V": (1, 2, 3)}}, r"must be \{NAME: \(low, high\)\}"),
        ({"randomise": {5: (1, 2)}}, "no number that can be drawn"),
        ({"reference": lambda t_s, rng: np.ones(3)}, r"reference gave \(3,\), up to 1 m"),
        ({"reference": lambda t_s, rng: np.ones((len(t_s), 2))}, "within \\+-0.1375 m"),
        ({"render_mode": "human"}, "nothing is drawn"),
    ],
)
def test_bad_arguments_are_one_line(words: dict, said: str):
    with pytest.raises(ValueError, match=said) as error:
        BalancingTable(**words)
    assert "\n" not in str(error.value)


def test_bad_calls_are_one_line():
    env = BalancingTable(Rig())
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(np.zeros(2))
    for options, said in [
        ({"start": 1}, "known: start_m"),
        ({"start_m": (0.2, 0)}, "off the plate"),
    ]:
        with pytest.raises(ValueError, match=said):
            env.reset(options=options)
    env.reset(seed=0)
    with pytest.raises(ValueError, match=r"action of shape \(3,\): must be \(2,\)"):
        env.step(np.zeros(3))


def test_open_intervals_are_warned_of(tmp_path: Path):
    open_ended = GAP.read_text().replace('"low": 0.0315', '"low": null, "was": 0.0315', 1)
    assert "null, " in open_ended
    (tmp_path / "gap.json").write_text(open_ended)
    with pytest.warns(
        UserWarning, match="coulomb_friction.x.friction_V is open and not in it. It stays"
    ):
        BalancingTable(Rig(), randomise=tmp_path / "gap.json")


def test_the_example_of_the_page_runs():
    text = (ROOT / "rig/gym/README.md").read_text(encoding="utf-8")
    [example] = re.findall(r"```python\n(.*?)```", text, flags=re.S)
    names: dict = {"__name__": "example"}
    exec(compile(example, "rig/gym/README.md", "exec"), names)
    assert names["info"]["outcome"] == "completed"
    assert np.hypot(*names["info"]["true_ball_m"]) < 0.02
    assert names["seen"].shape == (16, 12)
