"""Of the round things that were seen, which is the ball?"""

import numpy as np
import pytest

from vision.detection.appearance import Appearance
from vision.detection.detector import Detection
from vision.tracking.sightings import Sighting
from vision.tracking.things import Things

REACH = 0.03 * 640


def sighting(u, v, radius=12.0, *, bgr=(30.0, 110.0, 230.0), evidence=1.5):
    seen = Detection(u, v, radius, 0.1, 1.0, 1.0, 1.0, 0.1, 0.0, 0.0)
    none = np.zeros(3)
    look = Appearance(np.array(bgr), none, none, 9.0, np.zeros(1, np.uint8), 0.0, learned=True)
    return Sighting(seen, look, evidence)


def watched(*paths, looks=10):
    """Things after `looks` images of `paths`, functions of the look that give what is seen."""
    things = Things()
    for k in range(looks):
        things.add(float(k), [s for path in paths if (s := path(k)) is not None])
    return things


def test_a_mover_outranks_a_surer_still_thing():
    still = lambda k: sighting(100, 100, 25, evidence=2.0)  # noqa: E731
    ball = lambda k: sighting(200 + 15 * k, 300, evidence=1.0)  # noqa: E731
    best, other = watched(still, ball).ranked(REACH)
    assert best.last.place == (335, 300)
    assert best.travel(REACH) > 1.0
    assert other.travel(REACH) == 0.0


def test_equal_marks_stay_apart_and_do_not_travel():
    places = [(50.0 * i, 60.0) for i in range(1, 5)]
    marks = [lambda k, p=p: sighting(p[0] + 0.3 * (k % 2), p[1], 5) for p in places]
    things = watched(*marks, looks=12)
    assert len(things.all) == 4
    assert all(len(t.times) == 12 and t.travel(REACH) < 0.2 for t in things.all)


def test_plate_marks_that_tilt_travel_less_than_the_ball():
    mark = lambda k: sighting(100 + 5 * np.sin(k), 100, 20, bgr=(0, 0, 0), evidence=2.0)  # noqa: E731
    ball = lambda k: sighting(300 + 40 * np.sin(0.4 * k), 200)  # noqa: E731
    assert watched(mark, ball).ranked(REACH)[0].last.place[1] == 200


def test_a_highlight_is_a_part_of_its_ball_but_a_ball_on_a_printed_disc_is_none():
    ball = lambda k: sighting(200 + 10 * k, 200, 40)  # noqa: E731
    glint = lambda k: sighting(190 + 10 * k, 190, 6, bgr=(250, 250, 250))  # noqa: E731
    disc = lambda k: sighting(240, 200, 90, bgr=(200, 30, 30))  # noqa: E731
    things = watched(ball, glint, disc)
    parts = {t.last.seen.radius_px: things.is_part(t) for t in things.all}
    assert parts == {40: False, 6: True, 90: False}


def test_a_thing_that_was_hidden_for_long_is_the_same_thing():
    ball = lambda k: sighting(200 + 12 * k, 200) if not 3 < k < 15 else None  # noqa: E731
    things = watched(ball, looks=20)
    assert len(things.all) == 1
    assert things.all[0].looks == 20


def test_what_stays_while_the_ball_is_elsewhere_is_not_the_ball_until_it_moves():
    still = lambda k: sighting(100, 100, evidence=2.0)  # noqa: E731
    things = watched(still)
    things.ball_is(sighting(400, 300, evidence=1.0))
    mark = things.all[0]
    assert mark.other
    before = mark.score(REACH)
    for k in range(10, 16):
        things.add(float(k), [sighting(100 + 15 * (k - 9), 100, evidence=2.0)])
    assert things.all[0].score(REACH) > 20 * before


def test_old_sightings_are_forgotten_but_other_things_are_not():
    things = Things(window_s=2.0)
    things.add(0.0, [sighting(100, 100), sighting(300, 300)])
    things.add(0.5, [sighting(100, 100), sighting(300, 300)])
    things.ball_is(sighting(300, 300))
    things.add(9.0, [])
    assert [t.last.place for t in things.all] == [(100, 100)]


@pytest.mark.parametrize("change", [{"radius": 30.0}, {"bgr": (230.0, 30.0, 30.0)}])
def test_unlike_things_far_apart_are_two(change):
    things = watched(lambda k: sighting(100, 100) if k < 5 else sighting(400, 300, **change))
    assert len(things.all) == 2
