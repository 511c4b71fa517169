"""What the page of a comparison says of its cells, in tables and on the map."""

import matplotlib.colors
import numpy as np
import pytest
from matplotlib.text import Text

from experiments.compare import figures, report
from experiments.compare.case import Case, Traced
from experiments.compare.grid import cells as cells_of
from experiments.compare.grid import read_grid, retuned_names
from experiments.compare.statistics import EVEN, HARMS, HELPS, OPEN
from experiments.compare.words import _winners, paper_words, too_few_words, words
from rig.log import Log


def cell(play: str, verdicts: dict[str, str], effect: float = 0.3) -> dict:
    arms: dict = {"without": {"means": {"settled_error": 1.0}}}
    for name, verdict in verdicts.items():
        test = {"verdict": verdict, "effect": effect, "low": 0.1, "high": 0.5, "unit": "cm"}
        equal = {**test, "verdict": HARMS}
        means = {"settled_error": 0.5}
        arms[name] = {"against_without": test, "at_equal_activity": equal, "means": means}
    place = {"play": play, "friction": "own", "protocol": "hold", "fault": ""}
    return {**place, "key": f"{play} | own | hold", "arms": arms}


RESULTS = {
    "cells": [
        cell("none", {"with": OPEN, "neural": HELPS}),
        cell("joint 2", {"with": HELPS, "neural": HELPS}, 1.2),
        cell("joint 2", {"with": HARMS, "neural": EVEN}, -0.8),
        {**cell("joint 2", {"with": HARMS, "neural": HELPS}), "fault": "late"},
    ],
    "grid": {
        "paper": {"play": "joint 2", "friction": "own", "protocol": "hold"},
        "robustness": {"faults": {"late": {}}},
    },
    "measure": "settled_error",
    "seeds": 14,
}


def test_the_tables_count_the_cells_without_a_fault():
    found = report._by_condition(RESULTS)
    assert found.rows == [
        ["with", "1", "1", "0", "1", "0", "3"],
        ["neural", "2", "0", "1", "0", "0", "3"],
    ]
    found = report._by_play(RESULTS)
    assert found.head == ("play", "cells", "with", "neural")
    assert found.rows == [["none", "1", "0", "1"], ["joint 2", "2", "1", "1"]]


def test_no_name_of_a_cell_is_cut_off_in_the_map(tmp_path):
    import cv2

    names = [f"gear 1, joint 1.5 | as measured | hold | play taken for {n} times" for n in range(9)]
    cells = [cell(name, {"with": HELPS, "neural": OPEN}, 0.1) for name in names]
    image = cv2.imread(str(figures.map_figure({**RESULTS, "cells": cells}, tmp_path)))
    assert image is not None
    assert image[:, :2].min() == 255  # nothing reaches the left edge
    assert image[-2:].min() == 255


def test_cells_that_agree_with_the_paper_are_counted_by_their_play():
    own, agree = paper_words(RESULTS)
    assert "(joint 2 · own · hold): there its model helps, +1.200 [+0.100, +0.500] cm." in own
    assert agree.startswith("1 of 3 cells agree")
    assert agree.endswith("«joint 2» 1 of 2. 1 contradict it.")
    assert words(RESULTS)[-1] == "With late: «joint 2» still helped by neural; harmed by with."


def linear(colour: np.ndarray) -> np.ndarray:
    """sRGB to light, as WCAG has it."""
    return np.where(colour <= 0.03928, colour / 12.92, ((colour + 0.055) / 1.055) ** 2.4)


def test_too_few_seeds_for_any_certainty_are_told():
    """16 tests: 2/2^n 16 <= 0.05 first at n = 10."""
    assert too_few_words({**RESULTS, "seeds": 10}) == []
    (said,) = too_few_words({**RESULTS, "seeds": 9})
    assert "With 9 seeds a cell no difference can be certain among 16 tests" in said
    assert "p is 0.0039 at least" in said
    assert "It takes 10 seeds" in said


def test_the_map_tells_help_from_harm_without_red_and_green_and_can_be_read(tmp_path, monkeypatch):
    gains, kept = np.linspace(-1.2, 1.2, 25), {}
    gains[12] = -0.001
    cells = [cell(f"joint 2, one-sided {i}", {"with": HELPS, "neural": OPEN}, gain)
             for i, gain in enumerate(gains)]  # fmt: skip
    cells.append(cell("lost", {"with": OPEN, "neural": OPEN}, float("nan")))
    monkeypatch.setattr(figures, "save", lambda figure, *_: kept.update(figure=figure))
    figures.map_figure({**RESULTS, "cells": cells}, tmp_path)
    axes = kept["figure"].axes[0]
    kept["figure"].canvas.draw()
    image = axes.images[0]
    shown = np.asarray(image.to_rgba(image.get_array()))[..., :3]
    assert (shown[:-1][gains > 0.2, :, 2] > shown[:-1][gains > 0.2, :, 0]).all()  # helps: blue
    assert (shown[:-1][gains < -0.2, :, 0] > shown[:-1][gains < -0.2, :, 2]).all()  # harms: red
    for text in axes.texts[: 2 * len(gains)]:
        x, y = map(round, text.get_position())
        pair = shown[y, x], np.array(matplotlib.colors.to_rgb(text.get_color()))
        dark, light = sorted(float(np.dot([0.2126, 0.7152, 0.0722], linear(c))) for c in pair)
        assert (light + 0.05) / (dark + 0.05) > 4.5, (text.get_text(), x)
    assert [text.get_text() for text in axes.texts].count("+0.00") == 2  # and none is -0.00
    lost = [text for text in axes.texts if text.get_text() == "lost"]
    assert [text.get_color() for text in lost] == ["black", "black"]  # on white
    assert min(label.get_window_extent().x0 for label in axes.get_yticklabels()) >= 0.0


def test_where_nothing_completed_nothing_has_the_smallest_error():
    """Of cells without a completed run "without" was told to have the smallest."""
    none, one = ({"arms": {"with": {"means": {"distance": x}}}} for x in (float("nan"), 1.0))
    assert _winners([none], "distance") == [
        "In 1 of 1 cells no condition has one: too few runs completed."
    ]
    assert _winners([none, one], "distance")[0].endswith("of 2 cells: with in 1.")


def test_letters_are_printed_as_large_as_they_are(tmp_path):
    """A figure that is no wider than a sheet (186 mm) nor higher than 85 mm (style.css) is not
    shrunk; its letters have 9 points."""
    import cv2

    t_s = np.arange(0.0, 20.0, 0.01)
    wave = np.sin(t_s)
    names = ("ball_x_m", "ball_y_m", "desired_theta_x_rad", "theta_x_rad", "theta_y_rad")
    log = Log.from_columns({"t_s": t_s} | dict.fromkeys(names, wave))
    run = Traced(log, wave, wave, np.zeros((len(t_s), 2)))
    most = ("without", "lqg", "neural", "with", "adaptive", "adaptive-asymmetric")  # as of `_shown`
    case = Case("a cell", 0.03, 0.0, dict.fromkeys(most, run))
    judged = {"verdict": OPEN, "effect": 0.5, "low": 0.1, "high": 0.9, "relevant": 0.1}
    grid = read_grid(None)
    tested = [*grid.arms[1:], *retuned_names(grid)]
    arms = {"without": {}} | {name: {"against_without": judged} for name in tested}
    place = {"friction": "own", "fault": "", "protocol": "hold", "arms": arms}
    cells = [{**place, "play": play} for play in grid.plays]
    results = {"cells": cells, "grid": {"frictions": {"own": {}}}}
    files = [draw(case, tmp_path) for draw in (figures.case_figure, figures.crossing_figure)]
    for file in (*files, figures.effect_figure(results, tmp_path)):
        picture = cv2.imread(str(file))
        assert picture is not None
        high_in, wide_in = (pixels / 150 for pixels in picture.shape[:2])
        assert wide_in <= 186 / 25.4
        assert high_in <= 85 / 25.4


@pytest.mark.parametrize("cells", [1, 8, 10])
def test_the_words_of_a_map_are_inside_however_few_its_cells(tmp_path, monkeypatch, cells):
    grid, drawn = read_grid(None), []
    monkeypatch.setattr(figures, "save", lambda figure, *_: drawn.append(figure))
    verdicts = dict.fromkeys([*grid.arms[1:], *retuned_names(grid)], OPEN)
    places = [cell(f"gear {i}", verdicts) | {"key": f"gear {i} | own | hold"} for i in range(cells)]
    figures.map_figure({"cells": places}, tmp_path)
    (figure,) = drawn
    figure.canvas.draw()
    high, wide = figure.bbox.height, figure.bbox.width
    for text in figure.findobj(Text):
        box = text.get_window_extent()
        assert not text.get_text() or (box.x0 >= 0 and box.x1 <= wide), text
        assert not text.get_text() or (box.y0 >= 0 and box.y1 <= high), text


def test_the_map_of_the_shipped_grid_has_letters_of_five_points_on_a_sheet(tmp_path, monkeypatch):
    grid, drawn = read_grid(None), []
    monkeypatch.setattr(figures, "save", lambda figure, *_: drawn.append(figure))
    verdicts = dict.fromkeys([*grid.arms[1:], *retuned_names(grid)], OPEN)
    places = [cell(one.key, verdicts) | {"key": one.key} for one in cells_of(grid) if not one.fault]
    figures.map_figure({"cells": places}, tmp_path)
    sheet_in = (186 / 25.4, 240 / 25.4)
    assert 9 * min(sheet_in / drawn[0].get_size_inches()) > 5
