"""Two pages in a real browser: a film on one of them leaves the live table on the other."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from experiments.dashboard.session.video import VIDEO
from experiments.records.recording import write_run
from experiments.track.film import Film
from rig.log import Log
from tests.support.in_browser.page import Hand, expect
from tests.support.in_browser.program import PATIENCE_S, Program, pixels, sees_table
from tests.support.waiting import wait_for

FILM = "A replay is shown on this page"


CORNER: Any = {"x": 470, "y": 262, "width": 60, "height": 60}  # [px] of a page; a ball in CORNER_M
CORNER_M = (-0.13, 0.13)


def run_in_the_corner(folder: Path) -> None:
    """Record a run whose ball rests in a corner of the plate for a minute, and a grey video."""
    t_s = np.arange(6000) / 100
    columns = {f"ball_{axis}_m": 0 * t_s + at for axis, at in zip("xy", CORNER_M, strict=True)}
    columns |= {"theta_x_rad": 0 * t_s, "theta_y_rad": 0 * t_s, "ball_exposed_s": t_s}
    log = Log.from_columns({"t_s": t_s, "phase": 2 + 0 * t_s, **columns})
    start = {"source": "measured", "arm": "with", "seed": 1, "protocol": {"name": "hold"}}
    write_run(folder, start, log, [], outcome="completed")
    with Film(folder / VIDEO, (64, 48)) as video:
        for t in t_s[::50]:
            video.add(np.full((48, 64, 3), 128, np.uint8), float(t))


def ball_in_corner(page: Hand) -> bool:
    """Whether the film's ball is seen: the live one, that is balanced, never lies there."""
    return sees_table(pixels(page.page.screenshot(clip=CORNER)))[1] > 50


@pytest.mark.slow
@pytest.mark.timeout(1800)  # chosen: a loaded machine takes ten times as long as a quiet one
def test_a_watchers_film_leaves_the_live_table_to_the_others(
    chromium, artefacts: Path, tmp_path: Path
):
    run_in_the_corner(tmp_path / "runs" / "20260101T000000-hold-with")
    program = Program(tmp_path)
    try:
        holder = Hand(chromium, program.link, artefacts)
        holder.see("ball in sight")
        watcher = Hand(chromium, program.link, artefacts)
        watcher.see("You are watching")
        watcher.tab("Replay")
        watcher.press("Show")
        watcher.see(FILM)
        watcher.see("the run's video")  # below the newest frame
        watcher.see("what the camera saw, is shown left")
        expect(holder.page.get_by_text("the run's video")).to_be_hidden()
        wait_for("the film", lambda: ball_in_corner(watcher), PATIENCE_S)
        watcher.see("Replay of")
        watcher.shot("own-film-watcher")
        holder.shot("own-film-holder")
        assert not ball_in_corner(holder)
        expect(holder.page.get_by_text(FILM)).to_be_hidden()
        holder.tab("Replay")
        holder.see("The live table is shown")

        holder.tab("Run")
        holder.press("▶ Start")  # takes nobody's film away
        holder.see("run 1 of 2")
        watcher.see(FILM)
        assert ball_in_corner(watcher)
        holder.press("■ STOP")
        holder.see("Stopped, motors at 0 V")
        holder.press("Balance again")
        holder.see("ball in sight")

        watcher.press("Back to the live table")
        watcher.see("The live table is shown")
        expect(watcher.page.get_by_text(FILM)).to_be_hidden()
        wait_for("the live table", lambda: not ball_in_corner(watcher), PATIENCE_S)
        watcher.tab("Curves")
        watcher.see("volts applied")
        watcher.shot("own-film-back")
        assert (tmp_path / "program.log").read_text().count("Traceback") == 0
    finally:
        program.kill()
