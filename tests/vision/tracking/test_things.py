"""Of the round things that were seen, which is the ball?"""

import numpy as np
import pytest

from vision.detection.appearance import Appearance
from vision.detection.detector import Detection
from vision.tracking.sightings import Sighting
from vision.tracking.things import Things

REACH = 0.03 * 640


def sighting(u, v, radius=12.0, *, bgr=(30.0, 110.0, 230.0), evidence=1.5, company=0.0, uneven=0.2):
    seen = Detection(u, v, radius, 0.1, 1.0, 1.0, 1.0, 0.1, 0.0, 0.0)
    plate, none = np.full(3, 200.0), np.zeros(3)
    look = Appearance(np.array(bgr), plate, none, 9.0, np.zeros(1, np.uint8), 0.0, learned=True)
    return Sighting(seen, look, evidence, company=company, uneven=uneven)


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


def test_a_cell_of_a_printed_marker_is_no_ball_until_it_travels():
    still = watched(lambda k: sighting(100, 100, 5, company=0.4))
    ball = watched(lambda k: sighting(100, 100, 5, company=0.1))
    mover = watched(lambda k: sighting(100 + 15 * k, 100, 5, company=0.4))
    told = [things.may_be_ball(things.all[0], REACH) for things in (still, ball, mover)]
    assert told == [False, True, True]


def test_what_leapt_since_the_look_before_may_be_another_thing():
    """As a ball's shadow, which other light shows; a ball that starts from rest does not leap."""
    leaps = watched(lambda k: sighting(100 + 15 * (k == 9), 100))
    starts = watched(lambda k: sighting(100 + 5 * (k == 9), 100))
    once = watched(lambda k: sighting(100, 100), looks=1)
    assert [things.all[0].leapt for things in (leaps, starts, once)] == [True, False, False]


def test_screws_are_twins_and_a_ball_among_them_has_none():
    screws = [lambda k, u=u: sighting(u, 60, 5, bgr=(40, 40, 40)) for u in (50, 590)]
    ball = lambda k: sighting(300, 200, 5, bgr=(40, 120, 200))  # noqa: E731
    things = watched(*screws, ball)
    assert [things.has_twin(t, REACH) for t in things.all] == [True, True, False]


def test_a_mover_is_no_twin_of_what_stays_but_of_what_moves_as_far():
    still = lambda k: sighting(100, 100)  # noqa: E731
    movers = [lambda k, v=v: sighting(200 + 15 * k, v) for v in (200, 300)]
    things = watched(still, movers[0])
    assert [things.has_twin(t, REACH) for t in things.all] == [True, False]
    both = watched(*movers)
    assert all(both.has_twin(t, REACH) for t in both.all)


def test_its_image_in_a_glossy_plate_is_no_twin():
    ball = lambda k: sighting(200 + 15 * k, 300)  # noqa: E731
    image = lambda k: sighting(200 + 15 * k, 322)  # noqa: E731
    things = watched(ball, image)
    assert not any(things.has_twin(t, REACH) for t in things.all)


def test_what_was_seen_once_or_is_gone_is_no_twin():
    there = lambda k: sighting(100, 100)  # noqa: E731
    once = lambda k: sighting(400, 300) if k == 9 else None  # noqa: E731
    gone = lambda k: sighting(400, 300) if k < 6 else None  # noqa: E731
    for other in (once, gone):
        things = watched(there, other)
        assert not things.has_twin(things.all[0], REACH)


def test_plate_marks_that_tilt_travel_less_than_the_ball():
    mark = lambda k: sighting(100 + 5 * np.sin(k), 100, 20, bgr=(0, 0, 0), evidence=2.0)  # noqa: E731
    ball = lambda k: sighting(300 + 40 * np.sin(0.4 * k), 200)  # noqa: E731
    assert watched(mark, ball).ranked(REACH)[0].last.place[1] == 200


def test_a_leaf_that_is_blown_far_does_not_outrank_a_ball_that_is_seen_steadily():
    leaf = lambda k: sighting(40 + 25 * k, 80, bgr=(40, 60, 160)) if k % 2 else None  # noqa: E731
    ball = lambda k: sighting(300 + 16 * np.sin(0.5 * k), 250, evidence=1.6)  # noqa: E731
    best, other = watched(leaf, ball, looks=20).ranked(REACH)
    assert best.last.place[1] == 250
    assert other.travel(REACH) > 5.0 * best.travel(REACH)


def test_a_highlight_is_a_part_of_its_ball_but_a_ball_on_a_printed_disc_is_none():
    ball = lambda k: sighting(200 + 10 * k, 200, 40)  # noqa: E731
    glint = lambda k: sighting(190 + 10 * k, 190, 6, bgr=(250, 250, 250))  # noqa: E731
    disc = lambda k: sighting(240, 200, 90, bgr=(200, 30, 30))  # noqa: E731
    things = watched(ball, glint, disc)
    parts = {t.last.seen.radius_px: things.is_part(t, REACH) for t in things.all}
    assert parts == {40: False, 6: True, 90: False}


SHADE, GLINT = (80.0, 80.0, 80.0), (250.0, 250.0, 250.0)


def test_a_shadow_that_moves_with_its_ball_is_not_the_ball_whichever_is_surer():
    ball = lambda k: sighting(200 + 15 * k, 200, 12, evidence=1.0)  # noqa: E731
    shadow = lambda k: sighting(215 + 15 * k, 212, 13, bgr=SHADE, evidence=2.0)  # noqa: E731
    things = watched(ball, shadow)
    assert {t.radius_px: things.is_part(t, REACH) for t in things.all} == {12: False, 13: True}


def test_a_black_ball_is_no_shadow_and_neither_is_a_still_dark_mark():
    ball = lambda k: sighting(200 + 15 * k, 200, 12, bgr=(20.0, 20.0, 20.0))  # noqa: E731
    shadow = lambda k: sighting(215 + 15 * k, 212, 13, bgr=SHADE)  # noqa: E731
    mark = lambda k: sighting(240, 225, 14, bgr=SHADE)  # noqa: E731
    things = watched(ball, shadow, mark)
    assert not any(things.is_part(t, REACH) for t in things.all)


@pytest.mark.parametrize("step", [0.0, 15.0])
def test_an_even_darker_copy_of_its_surround_is_a_shadow_where_what_casts_it_was_seen(step):
    shades = {"shadow": (SHADE, 0.02), "steel": (SHADE, 0.2), "tinted": ((30, 110, 230), 0.02)}
    shades["black"] = (20.0, 20.0, 20.0), 0.02
    told = {}
    for name, (bgr, uneven) in shades.items():
        path = lambda k, bgr=bgr, uneven=uneven: sighting(  # noqa: E731
            200 + step * k, 200, bgr=bgr, uneven=uneven
        )
        once = lambda k: sighting(220 + step * k, 200) if k == 3 else None  # noqa: E731
        things = watched(path, once)
        told[name] = things.may_be_ball(things.all[0], REACH)
        alone = watched(path)
        assert alone.may_be_ball(alone.all[0], REACH), name
    assert told == {"shadow": False, "steel": True, "tinted": True, "black": True}


def test_a_matt_grey_ball_in_light_from_all_round_is_no_shadow_of_a_mark_that_it_passes():
    grey = lambda k: sighting(200 + 15 * k, 200, bgr=SHADE, uneven=0.02)  # noqa: E731
    mark = lambda k: sighting(275, 225)  # noqa: E731
    things = watched(grey, mark)
    assert things.may_be_ball(things.all[0], REACH)


def test_a_highlight_that_moves_with_a_shadow_belongs_to_a_ball_that_is_not_seen():
    glint = lambda k: sighting(200 + 15 * k, 200, 5, bgr=GLINT, evidence=0.7)  # noqa: E731
    shadow = lambda k: sighting(250 + 15 * k, 230, 30, bgr=SHADE, evidence=0.9)  # noqa: E731
    things = watched(glint, shadow)
    assert all(things.is_part(t, REACH) for t in things.all)


def test_a_fingertip_taken_for_the_ball_once_does_not_part_the_ball_from_its_past():
    def ball(k):
        if k == 4:
            return sighting(210, 200, 9.5, bgr=(130.0, 150.0, 190.0), evidence=0.4)
        return sighting(200, 200) if k < 4 else sighting(400, 100)

    things = watched(ball)
    assert [len(t.times) for t in things.all] == [10]


def test_equal_marks_that_show_in_turn_do_not_travel():
    left = lambda k: sighting(50, 60, 5) if k % 2 else None  # noqa: E731
    right = lambda k: None if k % 2 else sighting(350, 60, 5)  # noqa: E731
    things = Things()
    for k in range(12):
        things.add(0.08 * k, [s for path in (left, right) if (s := path(k)) is not None])
    assert all(t.travel(REACH) == 0.0 for t in things.all)


def test_what_was_elsewhere_during_a_mistake_may_be_the_ball():
    things = watched(lambda k: sighting(300, 300))
    things.ball_is(sighting(50, 50))
    assert things.all[0].other
    things.ball_was_not()
    assert not things.all[0].other


def test_what_stayed_with_a_mark_that_was_taken_for_the_ball_is_not_the_ball_either():
    things = watched(lambda k: sighting(300, 300), lambda k: sighting(50, 50))
    things.ball_is(sighting(50, 50))
    things.add(10.5, [sighting(300, 300), sighting(400, 100, 30.0)])  # one is new
    things.ball_is_not(11.0, sighting(50, 50))
    assert [t.last.place for t in things.all] == [(300, 300), (400, 100), (50, 50)]
    assert all(t.other for t in things.all)


def test_a_thing_seen_twice_elsewhere_drifts_before_it_is_known_to_travel():
    things = watched(lambda k: sighting(200 + 30 * k, 200), lambda k: sighting(50, 50), looks=2)
    assert [t.drifts(REACH) for t in things.all] == [True, False]
    assert all(t.travel(REACH) == 0.0 for t in things.all)


def test_a_thing_that_was_hidden_for_long_is_the_same_thing():
    ball = lambda k: sighting(200 + 12 * k, 200) if not 3 < k < 15 else None  # noqa: E731
    things = watched(ball, looks=20)
    assert len(things.all) == 1
    once = watched(lambda k: sighting(200 + 12 * k, 200), looks=9).all[0]
    assert things.all[0].proof > 0.8 * once.proof


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


def test_a_ball_on_a_disc_that_shows_now_and_then_is_no_part_of_it():
    ball = lambda k: sighting(200, 200, 13, evidence=1.3)  # noqa: E731
    disc = lambda k: sighting(240, 200, 90, evidence=1.3) if k % 3 else None  # noqa: E731
    things = watched(ball, disc)
    assert not any(things.is_part(thing, REACH) for thing in things.all)


def test_old_sightings_are_forgotten_but_other_things_are_not():
    things = Things(window_s=2.0)
    things.add(0.0, [sighting(100, 100), sighting(300, 300)])
    things.add(0.5, [sighting(100, 100), sighting(300, 300)])
    things.ball_is(sighting(300, 300))
    things.add(9.0, [])
    assert [t.last.place for t in things.all] == [(100, 100)]


def test_a_glance_tells_where_a_thing_is_but_neither_proves_it_nor_lets_it_travel():
    things = watched(lambda k: sighting(100, 100, evidence=1.0), looks=2)
    (thing,) = things.all
    before = thing.proof, thing.travel(REACH), thing.evidence
    things.glance(1.5, [sighting(110, 100, evidence=2.0), sighting(400, 300)])
    assert (thing.last.place, thing.last_s, thing.glances) == ((110, 100), 1.5, 1)
    assert (thing.proof, thing.travel(REACH), thing.evidence) == before
    assert things.all == [thing]


@pytest.mark.parametrize("change", [{"radius": 30.0}, {"bgr": (230.0, 30.0, 30.0)}])
def test_unlike_things_far_apart_are_two(change):
    things = watched(lambda k: sighting(100, 100) if k < 5 else sighting(400, 300, **change))
    assert len(things.all) == 2


def test_a_thing_comes_only_to_where_something_can_have_arrived():
    things = Things()
    for k in range(4):
        place = sighting(100.0 + 30.0 * (k > 1), 60.0)
        things.add(0.1 * k, [place], lambda thing, s: thing.last.place == s.place)
    assert [len(thing.times) for thing in things.all] == [2, 2]
    assert all(thing.travel(REACH) == 0.0 for thing in things.all)
