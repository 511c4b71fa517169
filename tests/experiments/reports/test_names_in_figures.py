"""Names of runs in figures are shown as they are, whatever they would mean as mathematics."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest
from matplotlib.text import Text

from experiments.picture_files import our_style, subplots
from experiments.reports.figures import (
    ARMS,
    WITH,
    WITHOUT,
    ball_over_time,
    eight_runs,
    play_map,
    pushed_scatter,
    release_scatter,
    save,
    servo_over_time,
)
from rig.log import Log


@pytest.mark.parametrize("name", ["$\\frac{$", "5 $ or $x^$", "a_b^{c"])
def test_no_name_breaks_a_figure(tmp_path: Path, name: str):
    with our_style():
        figure, axes = subplots(figsize=(4, 3))
        axes.set_title(name)
        axes.plot([0, 1], label=name)
        axes.legend()
    assert name in Path(save(figure, tmp_path, "x", "simulated")).with_suffix(".svg").read_text()


def words_of(figure) -> list[str]:
    found = [one.get_text() for one in figure.findobj(lambda one: hasattr(one, "get_text"))]
    return found


def test_the_eight_runs_are_named_as_the_paper_does_and_say_which_controller():
    t = np.arange(60) / 60
    log = Log.from_columns({"t_s": t, "ball_x_m": 0 * t, "ball_y_m": 0 * t, "phase": 2 + 0 * t})
    words = words_of(eight_runs([log] * 4, [log] * 4))
    assert [w for w in words if w[:1] in ("a", "b")] == [
        "a₁",
        "a₂",
        "a₃",
        "a₄",
        "b₁",
        "b₂",
        "b₃",
        "b₄",
    ]
    assert set(ARMS.values()) <= set(words)
    assert not any("$" in word for word in words)
    # Letters of panels make the axes narrower.
    in_panels = partial(servo_over_time, panels=("(a)", "(b)"))
    for over_time in (ball_over_time, servo_over_time, in_panels):
        figure = over_time(log, log)
        (legend,) = [axis.get_legend() for axis in figure.axes if axis.get_legend()]
        figure.canvas.draw()
        box = legend.get_window_extent()
        assert box.x0 > 0
        assert box.x1 < figure.bbox.x1
        assert set(ARMS.values()) <= set(words_of(figure))


def test_centroids_on_one_point_are_told_apart_by_colour_and_shape():
    t = np.arange(60) / 60
    log = Log.from_columns({"t_s": t, "ball_x_m": 0 * t, "ball_y_m": 0 * t, "phase": 2 + 0 * t})
    centres = {"with": np.zeros(2), "without": np.zeros(2)}
    figure = release_scatter(log, log, centres)
    drawn = [
        {one.get_label(): one for one in axis.lines if f"{one.get_label()}".startswith("centroid")}
        for axis in (figure.axes[0], *figure.axes[0].child_axes)
    ]
    assert len(drawn) == 2  # the inset, too
    for marks in drawn:
        with_, without = marks["centroid, with"], marks["centroid, without"]
        assert (with_.get_color(), without.get_color()) == (WITH, WITHOUT)
        assert with_.get_marker() != without.get_marker()
        assert with_.get_markersize() < without.get_markersize()  # and drawn last
        assert list(marks) == ["centroid, without", "centroid, with"]


def test_letters_are_read_at_half_a_sheets_width():
    t = np.arange(60) / 60
    log = Log.from_columns({"t_s": t, "ball_x_m": 0 * t, "ball_y_m": 0 * t, "phase": 2 + 0 * t})
    figures = ball_over_time(log, log), servo_over_time(log, log), pushed_scatter(log, None, "with")
    for figure, most_mm in zip(figures, (48, 48, 90), strict=True):  # heights of style.css
        width_in, height_in = figure.get_size_inches()
        shrunk = min(91 / width_in, most_mm / height_in) / 25.4
        sizes = [one.get_fontsize() for one in figure.findobj(Text) if one.get_text()]
        assert min(sizes) * shrunk > 5.9  # points


def test_the_maps_letters_have_9_points_on_a_sheet():
    sizes = {"effect": 0.4, "low": 0.35, "high": 0.45, "relevant": 0.0015}
    cells = [{"gear_deg": g, "joint_deg": j, "error": sizes} for g in range(4) for j in range(4)]
    figure = play_map(cells, "error", "distance", "cm")
    width_in, height_in = figure.get_size_inches()
    shrunk = min(1.0, 186 / 25.4 / width_in, 85 / 25.4 / height_in)  # a sheet's, of style.css
    letters = [one for one in figure.findobj(Text) if one.get_text() and one.get_visible()]
    assert min(one.get_fontsize() for one in letters) * shrunk >= 9.0
    figure.canvas.draw()
    cell = figure.axes[0].get_window_extent()
    for one in figure.axes[0].texts:
        box = one.get_window_extent()
        assert box.width < cell.width / 4
        assert box.height < cell.height / 4


def test_a_map_of_angles_is_in_degrees_with_as_many_digits_as_the_verdict_needs():
    found = {"effect": 0.031, "low": 0.0302, "high": 0.0308, "relevant": 0.0015}  # rad
    none = {"effect": 6.6e-5, "low": -1e-6, "high": 1.7e-4, "relevant": 0.0015}
    cells = [
        {"gear_deg": g, "joint_deg": 0.0, "activity": one} for g, one in ((0.0, none), (1.0, found))
    ]
    words = words_of(play_map(cells, "activity", "servo activity", "rad"))
    assert "+1.776\n[+1.730, +1.765]\nhelps" in words
    assert "+0.004\n[+0.000, +0.010]\nneutral" in words
    assert "without - with [deg]\nabove 0: better with" in words
