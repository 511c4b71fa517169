"""The video of a run in somebody else's folder."""

from pathlib import Path

import numpy as np
import pytest

from experiments.dashboard.session import video
from experiments.gap.closed_loop_replay import table_motion
from rig.log import Log
from rig.parameters import Rig
from rig.rigfile import to_record


class Silent:
    """Progress that nobody looks at."""

    def show(self, result: object) -> None:
        """Nothing."""

    def __call__(self, stage: str, done: int, total: int) -> None:
        """Nothing."""


def test_a_link_in_the_place_of_the_unfinished_video_leads_nowhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Showing a colleague's run must not write over a file of one's own."""
    mine, run = tmp_path / "precious", tmp_path / "run"
    mine.write_text("mine")
    run.mkdir()
    (run / "part-video.mkv").symlink_to(mine)
    (run / "video.mkv").symlink_to(tmp_path / "nothing")
    t_s = np.arange(100) / 100
    names = ("theta_x_rad", "theta_y_rad", "ball_x_m", "ball_y_m")
    log = Log.from_columns({"t_s": t_s, "ball_exposed_s": t_s, **dict.fromkeys(names, 0 * t_s)})
    monkeypatch.setattr(video, "STEP_S", 0.5)
    meta = {"source": "simulated", "rig": to_record(Rig())}
    made = video.render_video(run / video.VIDEO, meta, table_motion(log), Silent())
    assert mine.read_text() == "mine"
    assert made.read_bytes()[:4] == b"\x1aE\xdf\xa3"  # as a Matroska file begins
    assert not made.is_symlink()
