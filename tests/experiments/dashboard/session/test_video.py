"""The video of a run in somebody else's folder."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import av
import cv2
import numpy as np
import pytest

from experiments.dashboard.session import video
from experiments.gap.closed_loop_replay import table_motion
from experiments.track.film import Film
from rig.log import Log
from rig.parameters import Rig
from rig.rigfile import to_record

pytestmark = pytest.mark.realtime


def film(path: Path, seconds: int, keyframes: int) -> Path:
    """A film of 10 frames a second that grow lighter, a key frame every `keyframes`."""
    with av.open(str(path), "w") as file:
        stream: Any = file.add_stream("mpeg4", rate=10, options={"g": str(keyframes)})
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for i in range(10 * seconds):
            grey = np.full((48, 64, 3), min(i, 255), np.uint8)
            file.mux(stream.encode(av.VideoFrame.from_ndarray(grey, format="rgb24")))
        file.mux(stream.encode())
    return path


def test_a_jump_is_decoded_in_pieces_and_arrives(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Who draws the film draws everybody's live table, too: no film may hold it up."""
    monkeypatch.setattr(video, "DECODE_S", 0.0)  # a frame a call
    shown = video.Video(film(tmp_path / "a.mkv", 20, 10_000))
    shown.at(0.0)
    grey = [image.mean() for i in range(190) if (image := shown.at(18.0 + 0.001 * i)) is not None]
    assert 100 < len(grey) <= 184  # one after the other, from the only key frame on
    assert grey[-1] == pytest.approx(180, abs=4)
    image = None
    for i in range(60):
        new = shown.at(5.0 + 0.001 * i)
        image = image if new is None else new
    assert image is not None
    assert image.mean() == pytest.approx(50, abs=4)


def test_frames_are_found_by_their_time(tmp_path: Path):
    shown = video.Video(film(tmp_path / "a.mkv", 20, 10))
    for t_s in (0.0, 0.5, 1.0, 15.0, 15.1, 3.0, 30.0, 2.0, 19.9):
        image = shown.at(t_s)
        assert image is not None
        assert image.mean() == pytest.approx(min(10 * t_s, 199), abs=4), t_s
        assert shown.at(t_s) is None
    shown.close()
    assert shown.at(1.0) is None


def test_a_damaged_film_is_shown_as_far_as_it_goes(tmp_path: Path):
    """As a camera's, picture by picture: a decoder's error must not end what draws every table."""
    rng, path = np.random.default_rng(0), tmp_path / "a.mkv"
    with av.open(str(path), "w") as file:
        stream: Any = file.add_stream("mjpeg", rate=10)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuvj420p"
        for _ in range(60):
            noise = rng.integers(0, 255, (48, 64, 3), dtype=np.uint8)
            file.mux(stream.encode(av.VideoFrame.from_ndarray(noise, format="rgb24")))
        file.mux(stream.encode())
    whole = path.read_bytes()
    for _ in range(20):
        place = int(rng.integers(400, len(whole) - 3000))
        path.write_bytes(whole[:place] + rng.bytes(2500) + whole[place + 2500 :])
        shown = video.Video(path)
        for t_s in np.arange(0.0, 6.0, 0.1):
            shown.at(float(t_s))
        shown.close()


def test_frames_beyond_measure_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(video, "MOST_PX", 64 * 48 - 1)
    with pytest.raises(OSError, match="frames of more than 3071 pixels"):
        video.Video(film(tmp_path / "a.mkv", 1, 10))


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
    if "libx264" in av.codecs_available:
        assert b"cabac=0" in made.read_bytes()


@pytest.mark.skipif("libx264" not in av.codecs_available, reason="needs the encoder libx264")
def test_a_film_that_somebody_waits_for_is_as_good_and_written_the_quick_way(tmp_path: Path):
    rng = np.random.default_rng(0)
    rough = cv2.resize(rng.integers(0, 255, (12, 16, 3), dtype=np.uint8), (640, 480))
    images = [np.roll(rough, 3 * i, axis=1) for i in range(20)]
    off = {}
    for quick in (False, True):
        path = tmp_path / f"{quick}.mkv"
        with Film(path, (640, 480), quick=quick) as made:
            for i, image in enumerate(images):
                made.add(image, i / 30)
        assert (b"cabac=0" in path.read_bytes()) == quick  # x264 writes its settings into the file
        with av.open(str(path)) as file:
            shown = [frame.to_ndarray(format="bgr24") for frame in file.decode(video=0)]
        off[quick] = np.abs(np.array(shown, float) - images).mean()
    assert off[True] < 1.1 * off[False]


def test_a_list_of_files_is_no_video(tmp_path: Path):
    """A decoder that guesses takes it for one, and opens a pipe that nobody writes to."""
    path = tmp_path / "video.mkv"
    path.write_text("ffconcat version 1.0\nfile 'video.mkv'\n")
    with pytest.raises(av.FFmpegError):
        video.Video(path)


def test_a_run_whose_clock_jumped_is_not_rendered_for_years(tmp_path: Path):
    meta = {"source": "simulated", "rig": to_record(Rig())}
    motion = SimpleNamespace(end_s=2e7)
    with pytest.raises(ValueError, match=r"lasts 2e\+07 s.*did the clock jump"):
        video.render_video(tmp_path / "video.mkv", meta, motion, lambda *step: None)  # pyright: ignore
    assert not list(tmp_path.iterdir())
