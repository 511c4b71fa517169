"""The pictures of how the ball swings: what they show of a motion that is known."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from experiments.analysis.metrics import run_metrics
from experiments.dashboard.view.portrait import (
    GREY,
    HEIGHT,
    MARGIN,
    WAIT,
    Portrait,
    distance_cm,
    distance_words,
    histogram_picture,
    phase_picture,
    pictures,
)
from rig.log import COLUMNS, INDEX, Log
from rig.parameters import Servo

SERVO = Servo()
N, PERIOD_S = 250, 2.0


def swinging(**columns) -> np.ndarray:
    """Rows of a ball that goes round its target at 1 cm, in 2 s."""
    rows = np.full((N, len(COLUMNS)), np.nan)
    t_s = rows[:, 0] = np.linspace(0.0, 20.0, N)
    angle = 2 * np.pi * t_s / PERIOD_S
    known = {
        "ball_x_m": 0.03 + 0.01 * np.cos(angle),
        "ball_y_m": 0.01 * np.sin(angle),
        "target_x_m": 0.03,
        "target_y_m": 0.0,
        "theta_x_rad": 0.1 * np.cos(angle),
        "theta_y_rad": 0.1 * np.sin(angle),
        "estimated_torque_x_Nm": 0.02 * np.sin(angle),
        "estimated_torque_y_Nm": 0.02 * np.cos(angle),
    }
    for name, values in {**known, **columns}.items():
        rows[:, INDEX[name]] = values
    return rows


def test_a_circle_about_the_target_has_one_distance_and_is_a_ring():
    rows = swinging()
    assert distance_cm(rows) == pytest.approx(np.ones(N))
    page = pictures(rows, SERVO)
    assert "RMS after settling: <b>1.0 cm</b>" in page
    assert page.count("<svg") == 3
    assert page.count("<polyline") == 4
    x_cm, speed = 100 * rows[:, INDEX["ball_x_m"]], np.pi * np.ones(N)
    ring = phase_picture("", "", "", [("red", x_cm - 3.0, speed * rows[:, INDEX["ball_y_m"]])])
    points = np.array(re.findall(r"(\d+),(\d+)", ring), float)
    centre = (points.max(axis=0) + points.min(axis=0)) / 2
    half = (points.max(axis=0) - points.min(axis=0)) / 2
    assert np.hypot(*((points - centre) / half).T) == pytest.approx(np.ones(N), abs=0.05)


def test_the_release_is_not_counted_and_the_number_is_that_of_results():
    """From 20 cm away, then 1 cm: of the way there nothing is told but that it is none yet."""
    t_s = np.linspace(0.0, 20.0, N)
    near = 0.03 + 0.01 * np.cos(2 * np.pi * t_s / PERIOD_S)
    rows = swinging(ball_x_m=near + 0.2 * np.exp(-t_s / 1.5))
    early = distance_words(rows[t_s < 3.0])
    assert early == "RMS after settling: <b>not settled yet</b>"
    settled = run_metrics(Log(rows)).settled.error_rms_m
    assert distance_words(rows) == f"RMS after settling: <b>{100 * settled:.1f} cm</b>"
    assert settled < 0.013
    moving = swinging(target_x_m=0.03 + 0.001 * t_s, ball_x_m=0.08 + 0.001 * t_s)
    assert distance_words(moving).startswith("RMS of the last half: <b>5.")


def test_what_nobody_measured_is_left_out():
    blank = np.nan
    rows = swinging(estimated_torque_x_Nm=blank, estimated_torque_y_Nm=blank)
    assert pictures(rows, SERVO).count("<svg") == 2
    unseen = swinging(ball_x_m=blank, ball_y_m=blank)
    page = pictures(unseen, SERVO)
    assert "not seen" in page
    assert page.count("<svg") == 1
    assert "nan" not in page
    assert pictures(rows[:2], SERVO) == WAIT
    assert histogram_picture("", "", np.full(3, np.nan)) == ""


def test_servos_that_take_an_angle_show_their_command():
    servo = replace(SERVO, kind="position", angle_measured=False)
    turn = np.linspace(-0.1, 0.1, N)
    names = ("command_x_rad", "command_y_rad", "desired_theta_x_rad", "desired_theta_y_rad")
    page = pictures(swinging(**dict.fromkeys(names, turn)), servo)
    assert "command [deg]" in page
    assert page.count("<polyline") == 4


def test_the_bars_of_the_histogram_hold_every_sample_once():
    values = np.array([0.0, 0.1, 0.1, 2.0])
    picture = histogram_picture("far", "cm", values)
    heights = np.array(re.findall(r'height="([\d.]+)"/>', picture), float)
    assert np.count_nonzero(heights) == 3
    assert sorted(heights[heights > 0] / heights.max()) == pytest.approx([0.5, 0.5, 1.0])
    assert "50 %" in picture


def test_another_run_is_a_line_over_the_bars_at_the_same_scale():
    near, far = np.full(8, 0.5), np.array([0.0, 0.0, 0.0, 4.0])
    alone, both = histogram_picture("", "", near), histogram_picture("", "", near, far)
    assert "<path" not in alone
    assert alone.count("<rect") == both.count("<rect")
    assert ">4<" in both  # the largest of the two ends the axis
    assert "100 %" in both  # and the highest the other one
    feet = [float(y) for y in re.findall(r"V([\d.]+)h", both)]
    rise = HEIGHT - MARGIN - np.array(feet)
    assert rise[rise > 0] / (HEIGHT - 2 * MARGIN) == pytest.approx([0.75, 0.25], abs=0.01)


def test_the_last_run_stays_grey_in_the_same_axes(monkeypatch):
    monkeypatch.setattr("experiments.dashboard.view.portrait.EVERY_S", 0.0)
    portrait = Portrait(SimpleNamespace(gui=Gui()), SERVO)  # pyright: ignore[reportArgumentType]
    (html,) = portrait.handles
    large, small = swinging(), swinging(ball_x_m=0.03, ball_y_m=0.0)
    small[:, INDEX["ball_x_m"]] += 1e-3 * np.cos(small[:, 0])
    portrait.draw(small, "balancing")
    assert GREY not in html.content
    portrait.draw(large, "hold, without")
    assert GREY not in html.content  # what balanced before was no run
    portrait.draw(small, "hold, with")
    assert f'{GREY}">Grey</b>, in every picture: hold, without<' in html.content
    alone, both = pictures(small, SERVO), html.content
    assert both.count(f'stroke="{GREY}"') == 5  # both axes in two pictures, and the distances
    assert GREY not in alone
    assert alone.count("<polyline") == 4
    right = r'text-anchor="end" font-size="11" fill="currentColor">([-\d.]+)<'
    assert re.findall(right, both)[0] == re.findall(right, pictures(large, SERVO))[0]
    portrait.draw(small, "balancing")
    assert "in every picture: hold, with<" in html.content


def test_the_last_run_is_seen_as_it_was_until_the_next_one(monkeypatch):
    monkeypatch.setattr("experiments.dashboard.view.portrait.EVERY_S", 0.0)
    portrait = Portrait(SimpleNamespace(gui=Gui()), SERVO)  # pyright: ignore[reportArgumentType]
    (html,) = portrait.handles
    ring, still = swinging(), swinging(ball_x_m=0.03, ball_y_m=0.0)
    portrait.draw(still, "balancing, without")
    portrait.draw(ring, "hold, with")
    assert "The last run" not in html.content
    for _ in range(2):  # it goes on balancing
        portrait.draw(still, "balancing, without")
        head, _, rest = html.content.partition("<hr>")
        assert "<b>The last run</b>: hold, with<" in head
        assert pictures(ring, SERVO) in head
        assert "balancing, without" in rest
    portrait.draw(still, "hold, without")
    assert "The last run" not in html.content


def test_the_run_beside_a_replay_is_its_shadow():
    portrait = Portrait(SimpleNamespace(gui=Gui()), SERVO)  # pyright: ignore[reportArgumentType]
    portrait.draw(swinging(), "the run with", ("the run without", swinging()))
    (html,) = portrait.handles
    assert "in every picture: the run without" in html.content
    assert html.content.count(f'stroke="{GREY}"') == 5


class Gui:
    def add_html(self, content: str):
        return SimpleNamespace(content=content)


def test_it_says_what_it_draws():
    portrait = Portrait(SimpleNamespace(gui=Gui()), SERVO)  # pyright: ignore[reportArgumentType]
    portrait.draw(swinging(), "a <b> run, without play compensation")
    (html,) = portrait.handles
    assert "<p>a &lt;b&gt; run, without play compensation</p>" in html.content
