"""Which names stay beside what is left without one."""

from types import SimpleNamespace

import pytest

from calibration.gap.name import decide
from calibration.gap.name.stepwise import Accepted

OWN, LEFT = 2498.0, 338.0


def scored_by_its_gain(
    name: str, axes: tuple[str, ...], state: object, gain: float
) -> SimpleNamespace:
    """A refit of an effect whose parameters cost nothing."""
    return SimpleNamespace(score=gain)


@pytest.mark.parametrize(
    ("kind", "in_its_place", "stays"),
    [("rhythm", 3089.0, False), ("rhythm", 2400.0, True), ("map", 3089.0, True)],
)
def test_a_name_gives_way_to_a_term_that_holds_no_names_and_scores_more_in_its_place(
    monkeypatch: pytest.MonkeyPatch, kind: str, in_its_place: float, stays: bool
):
    """A rhythm that the controller answered was told as a camera delay of 0.1 s, for it scored 80 %
    of the rhythm. A level scores so much of a map of forces because it is one."""
    left, rival = (SimpleNamespace(kind=kind, score=score) for score in (LEFT, in_its_place))
    state = SimpleNamespace(fit=SimpleNamespace(cost=0.0))
    bare = SimpleNamespace(fit=SimpleNamespace(cost=OWN))
    monkeypatch.setattr(decide, "drop_effects", lambda at, keys: bare)
    monkeypatch.setattr(decide, "CandidateFit", scored_by_its_gain)
    monkeypatch.setattr(decide, "unnamed_terms", lambda at: [rival if at is bare else left])
    one = Accepted("camera_delay", ("xy",), OWN, ())
    kept, after = decide._names_beside(left, (one,), state)  # pyright: ignore[reportArgumentType]
    assert (kept == (one,)) == stays
    assert after is (state if stays else bare)
