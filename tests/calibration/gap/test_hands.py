"""Hands at the ball that nobody recorded: what they did is left out, the rest is asked anew."""

from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from calibration.gap import hands, investigate
from calibration.gap.held_out import Prediction
from calibration.gap.name.stepwise import Accepted
from calibration.gap.unnamed.term import UnnamedTerm
from rig.log import Log
from rig.prediction.innovations import Signals
from rig.rigfile import read_rig
from tests.support.worlds import WORLDS

T_S = 0.05 * np.arange(400)  # 20 s


def run(**more) -> Signals:
    none = np.zeros((0, 2))
    ball = np.column_stack([np.sin(T_S), np.cos(T_S)])
    return Signals(np.zeros(0), none, none, T_S, ball, **more)


def pushes(windows_s, runs=None, kind: str = "pushes") -> UnnamedTerm:
    of = tuple(runs or (0,) * len(windows_s))
    return UnnamedTerm("ball", kind, 99.0, None, None, tuple(windows_s), of)  # pyright: ignore


def decision(term: UnnamedTerm | None) -> Any:
    return SimpleNamespace(unnamed=term)


def test_short_pushes_are_a_hands():
    term = pushes([(1.0, 1.5), (4.0, 14.0), (15.0, 17.0)])
    found = hands.touches(decision(term))
    assert found is not None
    assert found.windows_s == ((1.0, 1.5), (15.0, 17.0))
    assert found.runs == (0, 0)


@pytest.mark.parametrize(
    "term", [None, pushes([(4.0, 14.0)]), pushes([(1.0, 1.5)], kind="turning"), pushes([])]
)
def test_what_lasts_or_is_no_push_is_no_hand(term):
    assert hands.touches(decision(term)) is None


def test_what_was_seen_during_the_pushes_is_left_out_and_the_filter_starts_anew_behind_them():
    (left,) = hands.let_go([run()], pushes([(5.02, 6.02), (12.02, 12.52)]))
    kept = (T_S < 4.72) | ((T_S > 6.32) & (T_S < 11.72)) | (T_S > 12.82)
    np.testing.assert_allclose(left.exposed_s, T_S[kept])
    assert left.fresh is not None
    np.testing.assert_allclose(left.exposed_s[left.fresh], [6.35, 12.85])
    np.testing.assert_array_equal(left.ball_m[:, 0], np.sin(left.exposed_s))
    assert len(left.fresh) == len(left.exposed_s)


def test_a_push_is_of_its_run_alone():
    fresh = np.zeros(400, bool)
    fresh[100] = True
    one, other = hands.let_go([run(), run(fresh=fresh)], pushes([(5.0, 6.0)], [1]))
    assert len(one.exposed_s) == 400
    assert len(other.exposed_s) < 400
    assert other.fresh is not None
    np.testing.assert_allclose(other.exposed_s[other.fresh], [6.3])


def test_a_ball_that_is_pushed_most_of_the_time_is_not_let_go():
    windows = [(3.0 * k, 3.0 * k + 1.5) for k in range(6)]
    assert hands.let_go([run()], pushes(windows)) == []
    assert hands.let_go([run(), run()], pushes(windows, [1] * 6)) == []


@dataclass(frozen=True)
class Told:
    """A decision as far as `agreed` looks at it."""

    accepted: tuple[Accepted, ...]
    unnamed: None = None
    verdict: str = "named"
    naming: Any = None
    state: Any = None


KNOWN, NEW = (Accepted(name, ("x",), 9.0, ()) for name in ("level_offset", "joint_backlash"))


def test_a_name_is_certain_where_the_whole_tells_it_or_the_half_farthest_from_the_hand(
    monkeypatch: pytest.MonkeyPatch,
):
    """A play of two degrees was certain on a part of a recording of a table that shows none."""
    whole: Any = Told((), naming=SimpleNamespace(accepted=(KNOWN,)))
    both: Any = Told((KNOWN, NEW))
    monkeypatch.setattr(hands, "_holds_far_away", lambda *_: False)
    found, reasons = hands.agreed(both, whole, pushes([(1.0, 2.0)]))
    assert [one.explained for one in found.accepted] == [1.0, 0.5]
    assert found.verdict == "named"
    assert [reason.split(":")[1] for reason in reasons] == [" joint_backlash"]
    alone: Any = Told((NEW,))
    assert hands.agreed(alone, whole, pushes([(1.0, 2.0)]))[0].verdict == "undecided"
    none: Any = Told((), verdict="nothing-missing")
    assert hands.agreed(none, whole, pushes([(1.0, 2.0)])) == (none, ())
    monkeypatch.setattr(hands, "_holds_far_away", lambda *_: True)
    assert hands.agreed(both, whole, pushes([(1.0, 2.0)])) == (both, ())


@pytest.mark.parametrize(
    ("gain", "largest", "holds"), [(0.5, 9.0, True), (0.0, 9.0, False), (0.5, 20.0, False)]
)
def test_far_from_the_hand_a_name_predicts_better_and_nothing_errs_more_than_noise(
    gain: float, largest: float, holds: bool, monkeypatch: pytest.MonkeyPatch
):
    """Of 100 errors noise gives one beyond 4 deviations, or 16 of their squares, in 1 of 158."""

    @dataclass(frozen=True)
    class At:
        evidence: Any
        named: bool

    errors = np.random.default_rng(2).normal(size=100)
    squares = np.append(np.zeros(99), largest)
    monkeypatch.setattr(hands, "far_away", lambda evidence, _: evidence)
    monkeypatch.setattr(hands, "drop_effects", lambda at, _: At(at.evidence, named=False))
    monkeypatch.setattr(hands, "model_of", lambda at: at)
    monkeypatch.setattr(hands, "unexpected", lambda *_: squares)
    monkeypatch.setattr(
        hands,
        "held_out",
        lambda at, _: {"ball": Prediction(errors * (1.0 - gain * at.named), np.zeros(9))},
    )
    state: Any = At(None, named=True)
    assert hands._holds_far_away(state, NEW, pushes([(1.0, 2.0)])) == holds


@dataclass(frozen=True)
class Seen:
    """Evidence of a ball alone."""

    t_s: np.ndarray
    run: np.ndarray
    masks: dict[str, np.ndarray]

    def times(self, _: str) -> tuple[np.ndarray, np.ndarray]:
        return self.t_s, self.run


def test_the_half_farthest_from_any_push_is_of_what_has_weight():
    t_s, run = np.tile(np.arange(10.0), 2), np.repeat([0, 1], 10)
    weights = np.ones(20)
    weights[:4] = 0.0
    seen: Any = Seen(t_s, run, {"ball": weights, "servo_x": np.ones(3)})
    far = hands.far_away(seen, pushes([(4.0, 6.0), (0.0, 1.0)], [0, 1]))
    np.testing.assert_array_equal(np.flatnonzero(far.masks["ball"]), [8, 9, *range(13, 20)])
    np.testing.assert_array_equal(far.masks["servo_x"], np.ones(3))
    untouched = hands.far_away(seen, pushes([(4.0, 6.0)], [0]))
    np.testing.assert_array_equal(np.flatnonzero(untouched.masks["ball"]), np.arange(10, 20))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("world", "seed", "name"),
    [
        ("touched_bowl", 3803, "plate_bowl"),
        ("touched_crooked", 3803, "level_offset"),
        ("touched_far_servo", 3968, "angle_scale"),
    ],
)
def test_an_effect_is_found_though_a_hand_pushes_the_ball(
    world: str, seed: int, name: str, tmp_path: Path
):
    """Beside the pushes nothing could be proved, and they were all that was told. They are told
    where the part without them says no more than the whole, too."""
    columns, rig, _ = WORLDS[world](seed)
    (tmp_path / "rig.toml").write_text(rig, "utf-8")
    found = investigate([Log.from_columns(columns)], read_rig(tmp_path / "rig.toml")).findings
    assert found.verdict == "named", found.sentence
    assert [one.name for one in found.effects] == [name]
    told = [*found.notes, found.unknown.shape if found.unknown is not None else ""]
    assert any(text.startswith(("the ball was pushed from ", "pushes from ")) for text in told)
    assert found.gap.ahead_1s_mm["after"] < 0.7 * found.gap.ahead_1s_mm["before"]
