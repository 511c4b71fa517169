"""The panels beside the 3-D view: narrow on a page in a small window, and on that one alone."""

import pytest

from experiments.dashboard.view.panels import SMALL_VIEW_PX, SPARE_PX, WIDE_PX, Panels
from tests.support.shell_alone import ShellAlone, opened

WIDTHS = '() => [...document.querySelectorAll("[data-dock-region]")].map(one => one.clientWidth)'
SIDE_BY_SIDE_PX = 20  # at most for the edge of a panel; chosen


@pytest.mark.slow
def test_a_small_window_leaves_the_table_room(chromium, program: ShellAlone):
    gui = program.server.gui
    left = gui.add_panel()
    with left.add_tab("Curves"):
        gui.add_markdown("curves")
    left.dock_left()
    gui.main_panel.dock_right()
    panels = Panels(left, gui.main_panel)
    panels.widen()
    program.server.on_client_connect(panels.fit)
    small, wide = opened(chromium, program), opened(chromium, program)
    small.set_viewport_size({"width": 1024, "height": 768})
    wide.set_viewport_size({"width": 1280, "height": 800})
    for page, expected in ((small, SPARE_PX), (wide, WIDE_PX)):
        page.bring_to_front()
        page.wait_for_function(
            f"({WIDTHS})().every((px, i) => Math.abs(px - {list(expected)}[i]) < {SIDE_BY_SIDE_PX})"
            f" && ({WIDTHS})().length == 2"
        )
    assert 1024 - sum(WIDE_PX) < SMALL_VIEW_PX < 1280 - sum(WIDE_PX)
    assert small.locator("#rig-view").evaluate("one => getComputedStyle(one, '::before').content")
    small.context.close()
    wide.context.close()
