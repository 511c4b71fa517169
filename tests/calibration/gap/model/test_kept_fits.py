"""Fits that are kept are those that would be made, bit for bit, and no other setting's."""

from dataclasses import replace

import numpy as np
import pytest

from calibration.gap import investigate
from calibration.gap.model import kept_fits, state
from calibration.gap.model.kept_fits import KeptFits
from calibration.gap.model.state import refit, with_levels
from tests.support.gap.tables import RIG, evidence_of, foreign, released

SERVOS = ["servo_x", "servo_y"]


@pytest.fixture(scope="module")
def begun():
    log = foreign("steps", seed=5, effects={}, duration_s=6.0)
    return released(evidence_of(log))


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """Outputs of each fit that is really made."""
    fits, fit = [], state.fit

    def counted(evidence, nominal, start, bounds, **options):
        fits.append(sorted(start.rolls))
        return fit(evidence, nominal, start, bounds, **options)

    monkeypatch.setattr(state, "fit", counted)
    return fits


def anew(begun):
    return replace(begun, evidence=replace(begun.evidence, fits=KeptFits()))


def test_a_servo_is_not_fitted_again_because_the_ball_has_changed(begun, made):
    first = anew(begun)
    once = refit(first, first.bounds(SERVOS))
    ball = refit(first, first.bounds(["ball"]))
    assert ball.fit.setting != first.fit.setting
    moved = with_levels(ball, louder(ball, "ball_measured"), ["ball"])
    again = refit(moved, moved.bounds(SERVOS))
    assert made == [SERVOS, ["ball"]]
    for name in first.bounds(SERVOS):
        assert again.fit.setting[name] == once.fit.setting[name]
    for output in SERVOS:
        np.testing.assert_array_equal(again.fit.z(output), once.fit.z(output))
    assert again.fit.rolls["ball"] is moved.fit.rolls["ball"]


def louder(begun, name: str) -> np.record:
    levels = begun.evidence.levels.copy()
    levels[name] *= 2.0
    return levels


def test_what_changes_a_servo_makes_its_fit_anew(begun, made):
    first = anew(begun)
    refit(first, first.bounds(SERVOS))
    noisy = with_levels(first, louder(first, "servo_process"), SERVOS)
    refit(noisy, noisy.bounds(SERVOS))
    refit(first, first.bounds(SERVOS), iterations=1)
    masks = {name: mask.copy() for name, mask in first.evidence.masks.items()}
    masked = replace(first, evidence=replace(first.evidence, masks=masks))
    refit(masked, masked.bounds(SERVOS))
    assert len(made) == 4
    refit(first, first.bounds(SERVOS))
    assert len(made) == 4


def test_the_fits_that_nobody_asked_for_longest_are_forgotten(begun, made, monkeypatch):
    first = anew(begun)
    x, y = (first.bounds([output]) for output in SERVOS)
    refit(first, x)
    refit(first, y)
    most = first.evidence.fits._bytes
    monkeypatch.setattr(kept_fits, "MOST_BYTES", most)
    refit(first, x)
    assert len(made) == 2
    refit(first, x, iterations=2)  # no room beside both: y was not asked for since
    refit(first, x)
    assert len(made) == 3
    refit(first, y)
    assert made == [["servo_x"], ["servo_y"], ["servo_x"], ["servo_y"]]
    assert first.evidence.fits._bytes <= most


@pytest.mark.slow
def test_an_answer_is_the_same_without_them(monkeypatch: pytest.MonkeyPatch):
    hidden = {"joint_backlash": {"x": {"play_rad": 0.03}, "y": {"play_rad": 0.03}}}
    log = foreign("steps", seed=6, effects=hidden, duration_s=15.0)
    kept = investigate([log], RIG, quick=True).findings
    monkeypatch.setattr(KeptFits, "of", lambda self, key, make: make())
    assert repr(investigate([log], RIG, quick=True).findings) == repr(kept)
