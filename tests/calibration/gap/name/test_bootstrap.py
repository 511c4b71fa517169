"""What chance alone scores: against the chi-squared law, and as the threshold of a name."""

import numpy as np
import pytest
from scipy.stats import chi2

from calibration.gap.decision_rule import MISFIT_SHARE, PENALTY_PER_PARAMETER
from calibration.gap.investigation import investigate
from calibration.gap.name import decide
from calibration.gap.name.bootstrap import BOOTSTRAP_DRAWS, ChanceScores, _best, chance_scores
from calibration.gap.name.load_friction import choose_friction_model
from calibration.gap.name.screen import Candidate, Candidates, screen
from calibration.gap.name.stepwise import settled_baseline
from tests.support.gap.tables import RIG, evidence_of, foreign

OFFSET = {"voltage_offset": {"y": {"offset_V": 0.1}}}


@pytest.mark.parametrize(("name", "key"), [("voltage_offset", "offset_V"),
                                           ("coulomb_friction", "friction_V")])  # fmt: skip
def test_a_single_effect_in_white_noise_follows_chi_squared(name: str, key: str):
    """Twice the gain of one released parameter is chi-squared with one degree of freedom; of one
    that cannot be negative, half the draws gain nothing."""
    rng = np.random.default_rng(4)
    blocks, draws = 400, 40_000
    column = rng.standard_normal(blocks)
    one = Candidate(name, "x", [{f"{name}.{key}.x": 0.05}], np.array([0]), 6.0)
    nominal = choose_friction_model(
        evidence_of(foreign("steps", seed=3, duration_s=3.0)), RIG, None
    )
    turned = rng.choice([-1.0, 1.0], (draws, blocks)) @ column[:, None]
    none = Candidates([], {}, column[:, None], [one])
    found = _best(none, nominal, np.array([[column @ column]]), turned)
    tail = 0.01 if one.two_sided(nominal) else 0.02
    expected = max(0.5 * chi2.isf(tail, 1) * (1 - MISFIT_SHARE) - PENALTY_PER_PARAMETER, 0.0)
    assert np.quantile(found, 0.99) == pytest.approx(expected, abs=0.25)


def test_nothing_that_a_healthy_log_promises_is_beyond_chance():
    evidence = evidence_of(foreign("steps", seed=3, duration_s=20.0))
    state = settled_baseline(evidence, choose_friction_model(evidence, RIG, None))
    chance = chance_scores(state, state.evidence.outputs)
    assert chance == chance_scores(state, state.evidence.outputs)
    assert set(chance.scores) == {"servo_x", "servo_y", "ball"}
    assert all(0.0 < score < 10.0 for score in chance.scores.values())
    assert chance.draws == BOOTSTRAP_DRAWS
    best = screen(state, state.evidence.outputs)[0]
    assert best.worth < max(chance.of(state.evidence.outputs), 5.0)


@pytest.mark.slow
def test_a_name_needs_more_than_chance_and_says_how_much(monkeypatch: pytest.MonkeyPatch):
    log = foreign("steps", seed=3, effects=OFFSET, duration_s=12.0)
    found = investigate([log], RIG, until="name", quick=True).findings
    assert [effect.name for effect in found.effects] == ["voltage_offset"]
    assert any("by chance alone" in note for note in found.notes)
    elsewhere = ChanceScores({"servo_y": 1.0, "ball": 1e9}, BOOTSTRAP_DRAWS)
    monkeypatch.setattr(decide, "chance_scores", lambda state, outputs: elsewhere)
    kept = investigate([log], RIG, until="name", quick=True).findings
    assert [effect.name for effect in kept.effects] == ["voltage_offset"]
    there = ChanceScores({"servo_y": 1e9, "ball": 1.0}, BOOTSTRAP_DRAWS)
    monkeypatch.setattr(decide, "chance_scores", lambda state, outputs: there)
    lost = investigate([log], RIG, until="name", quick=True).findings
    assert lost.effects == ()
    assert lost.verdict == "unknown-effect"  # what is there is still seen, but has no name
