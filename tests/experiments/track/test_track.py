"""`track_video` end to end: the table, the film, the sheet and the summary agree with the truth."""

import csv
import errno
import json
import os
from fractions import Fraction
from pathlib import Path
from types import SimpleNamespace

import av
import cv2
import numpy as np
import pytest

from experiments.track.track import MADE, METRIC_COLUMNS, PIXEL_COLUMNS, place_of, track_video
from tests.support.footage import rolling
from tests.support.parts import FOOTAGE, needs
from vision.plate.markers import default_layout
from vision.view import Camera, View


def write(path, film, *, repeat=1):
    """The film as H.264; truth by index in the file."""
    with av.open(str(path), "w") as file:
        stream = file.add_stream("libx264", rate=30 * repeat)
        stream.height, stream.width = film.frames[0].image.shape[:2]
        stream.pix_fmt = "yuv420p"
        stream.options = {"crf": "28", "preset": "ultrafast"}
        stream.codec_context.time_base = Fraction(1, 30 * repeat)
        for k, frame in enumerate(f for f in film.frames for _ in range(repeat)):
            picture = av.VideoFrame.from_ndarray(frame.image, format="bgr24")
            picture.pts, picture.time_base = k, Fraction(1, 30 * repeat)
            file.mux(stream.encode(picture))
        file.mux(stream.encode(None))
    return path


def rows_of(out):
    with (out / "track.csv").open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def film():
    return rolling("orange", on="white", radius=14, decoys=True, hidden=(1.2, 1.6), seconds=2.2)


@pytest.mark.parametrize("colour", [None, "orange"])
def test_results_agree_with_the_truth_and_each_other(tmp_path, film, colour):
    video = write(tmp_path / "v.mp4", film)
    seen = []
    summary = track_video(
        video, tmp_path / "out", ball_colour=colour, progress=lambda k, n: seen.append((k, n))
    )
    rows = rows_of(tmp_path / "out")
    assert tuple(rows[0]) == PIXEL_COLUMNS + METRIC_COLUMNS
    assert summary == json.loads((tmp_path / "out/results.json").read_text())
    assert summary["frames"] == len(rows) == sum(summary["states"].values())
    assert seen[0] == (0, 66)  # before the whole film is looked at
    assert seen[-1] == (66, 66)
    tracked = 0
    for row in rows:
        place = film.truth[int(row["frame"])]
        assert float(row["t_s"]) == pytest.approx(int(row["frame"]) / 30, abs=1e-3)
        if row["state"] == "track":
            tracked += 1
            assert place is not None
            assert np.hypot(float(row["u_px"]) - place[0], float(row["v_px"]) - place[1]) < 1
        assert (row["u_px"] == "") == (row["state"] in ("search", "lost"))
        assert all(row[name] == "" for name in METRIC_COLUMNS)
    visible = sum(p is not None for p in film.truth)
    assert tracked >= visible - 20
    if colour is None:
        assert abs(summary["ball"]["radius_px"] - 14) < 0.5


def test_film_and_sheet_show_the_distinct_frames_only(tmp_path, film):
    video = write(tmp_path / "v.mp4", film, repeat=3)
    summary = track_video(video, tmp_path / "out", ball_colour="orange")
    assert summary["duplicates"] > len(film.frames)
    assert summary["notes"] == [
        "pixels only: x_m and y_m are blank without --calibration",
        f"{summary['duplicates']} frames repeat the one before them and were skipped",
    ]
    capture = cv2.VideoCapture(str(tmp_path / "out/overlay.mp4"))
    count = 0
    while capture.read()[0]:
        count += 1
    assert count == summary["frames"]
    sheet = cv2.imread(str(tmp_path / "out/contact_sheet.png"))
    assert sheet is not None
    assert sheet.shape[1] == 6 * 320


def test_calibration_gives_metres(tmp_path, film):
    pose = np.eye(4)
    pose[:3, :3] = np.diag([1.0, -1.0, -1.0])  # the camera looks down, plate +y is up in the image
    pose[2, 3] = 0.75
    camera = Camera(np.array([[750.0, 0, 320], [0, 750.0, 240], [0, 0, 1]]), np.zeros(5), 640, 480)
    sizes = []
    bundle = SimpleNamespace(
        view=View(camera, pose),
        ball_radius_m=0.0137,
        layout=default_layout(0.275),  # not in these pictures: the stored pose is taken
        check_size=lambda *size: sizes.append(size),
    )
    track_video(
        write(tmp_path / "v.mp4", film), tmp_path / "out", calibration=bundle, ball_colour="orange"
    )
    assert sizes == [(640, 480)]
    rows = [row for row in rows_of(tmp_path / "out") if row["state"] == "track"]
    assert len(rows) > 20
    for row in rows:
        place = film.truth[int(row["frame"])]
        assert place is not None
        true_m = (np.array([place[0] - 320, 240 - place[1]])) * (0.75 - 0.0137) / 750
        found_m = np.array([float(row["x_m"]), float(row["y_m"])])
        assert np.abs(found_m - true_m).max() < 0.0005
        xx, cross, yy = (float(row[f"cov_{k}_m2"]) for k in ("xx", "xy", "yy"))
        assert xx > 0
        assert xx * yy > cross**2


def test_ball_at_rest_is_found_and_said_not_to_have_moved(tmp_path):
    still = rolling("green", seconds=0.7, rest_s=9.0, size=(320, 240))
    summary = track_video(write(tmp_path / "v.mp4", still), tmp_path / "out")
    assert summary["states"]["track"] == summary["frames"]
    assert "never moved" in summary["notes"][0]
    assert abs(summary["ball"]["radius_px"] - 16) < 0.5
    for frame in still.frames:
        cv2.imwrite(str(tmp_path / f"{frame.index}.png"), frame.image)
    told = track_video(tmp_path, tmp_path / "told", ball_colour="green")
    assert told["frames"] == len(still.frames)
    assert told["states"]["track"] == told["frames"]


def test_film_without_a_ball_says_what_to_do(tmp_path):
    empty = rolling("green", seconds=0.4, hidden=(0.0, 9.0), size=(320, 240), leaves_s=-99.0)
    summary = track_video(write(tmp_path / "v.mp4", empty), tmp_path / "out")
    assert summary["states"]["track"] == 0
    assert "--ball-at" in summary["notes"][0]


def test_ball_is_followed_from_the_place_that_was_told(tmp_path):
    film = rolling("orange", on="white", radius=14, decoys=True, rest_s=9.0, seconds=0.5)
    decoy, ball = (0.8 * 640, 0.25 * 480), film.truth[0]
    assert ball is not None
    for place in (decoy, ball, (*ball, 12.0)):
        summary = track_video(write(tmp_path / "v.mp4", film), tmp_path / "out", ball_at=place)
        assert summary["states"]["track"] == summary["frames"]
        row = rows_of(tmp_path / "out")[-1]
        assert np.hypot(float(row["u_px"]) - place[0], float(row["v_px"]) - place[1]) < 1.0


@pytest.mark.parametrize("text", ["", "12", "1,2,3,4", "a,b", "nan,3"])
def test_a_place_that_is_none_is_refused(text):
    with pytest.raises(ValueError, match="--ball-at"):
        place_of(text)


@pytest.mark.parametrize("place", [(700.0, 20.0), (-1.0, 20.0), (20.0, 20.0, 0.0)])
def test_a_place_outside_the_image_is_refused(tmp_path, film, place):
    with pytest.raises(ValueError, match="640 x 480"):
        track_video(write(tmp_path / "v.mp4", film), tmp_path / "out", ball_at=place)


@pytest.mark.parametrize(
    ("name", "error"), [("none.mp4", FileNotFoundError), ("bad.mp4", ValueError)]
)
def test_bad_input_makes_no_results(tmp_path, name, error):
    (tmp_path / "bad.mp4").write_bytes(b"nonsense")
    with pytest.raises(error, match=name):
        track_video(tmp_path / name, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_unknown_colour_is_refused_before_anything_is_read(tmp_path):
    with pytest.raises(ValueError, match="octarine"):
        track_video("does-not-matter.mp4", tmp_path / "out", ball_colour="octarine")


@needs("footage")
@pytest.mark.slow
def test_real_footage_without_being_told_the_colour(tmp_path):
    summary = track_video(FOOTAGE, tmp_path)
    assert summary["states"]["track"] > 0.97 * summary["frames"]
    assert 600 < summary["frames"] < 760
    assert summary["frames"] + summary["duplicates"] == 6016
    assert 23.5 < summary["end_s"] - summary["start_s"] < 24.1
    blue, green, red = summary["ball"]["bgr"]
    assert green > 2 * max(blue, red)


def test_the_film_itself_and_what_a_link_leads_to_are_not_written_over(tmp_path):
    film, notes = tmp_path / "overlay.mp4", tmp_path / "notes.txt"
    film.write_bytes(b"a film")
    notes.write_text("my notes")
    with pytest.raises(ValueError, match="is the recording itself"):
        track_video(film, tmp_path)
    assert film.read_bytes() == b"a film"
    other = film.rename(tmp_path / "film.mp4")
    (tmp_path / "track.csv").symlink_to(notes)
    with pytest.raises((OSError, ValueError)):
        track_video(other, tmp_path)  # no film
    assert notes.read_text() == "my notes"


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="the system has no pipes with a name")
def test_what_lies_where_the_results_go_is_neither_written_through_nor_waited_for(tmp_path):
    """A second name of the user's own file was written through; a pipe was waited for."""
    film = write(tmp_path / "v.mp4", rolling("green", seconds=0.4, size=(320, 240)))
    for name, other in (("track.csv", "overlay.mp4"), ("overlay.mp4", "track.csv")):
        out, mine = tmp_path / f"out-{name}", tmp_path / f"mine-{name}"
        out.mkdir()
        mine.write_text("mine")
        (out / name).hardlink_to(mine)
        os.mkfifo(out / other)
        summary = track_video(film, out)
        assert mine.read_text() == "mine"
        assert not [note for note in summary["notes"] if "no film" in note]
        assert all((out / one).is_file() for one in summary["files"])


@pytest.mark.parametrize("name", MADE)
def test_a_folder_where_a_file_is_to_be_made_is_refused_before_the_film_is_read(tmp_path, name):
    """Of a sheet's or of the results' it was told after the last frame."""
    (tmp_path / "out" / name).mkdir(parents=True)
    with pytest.raises(OSError, match=name):
        track_video(tmp_path / "no_such_film.mp4", tmp_path / "out")
    assert [one.name for one in (tmp_path / "out").iterdir()] == [name]


def test_a_camera_by_number_is_no_folder_of_that_name(tmp_path, monkeypatch):
    """Camera 0 was taken for the folder in which its results were to be written."""
    (tmp_path / "90").mkdir()
    monkeypatch.chdir(tmp_path)
    with pytest.raises(OSError, match="90: the camera"):
        track_video("90", "90")


def test_a_folder_of_pictures_is_not_written_into(tmp_path):
    """Its own track.csv and a picture called contact_sheet.png were overwritten."""
    pictures = tmp_path / "pictures"
    pictures.mkdir()
    mine = {"track.csv": b"my labels", "results.json": b"{}", "contact_sheet.png": b"a picture"}
    for name, content in mine.items():
        (pictures / name).write_bytes(content)
    (tmp_path / "link").symlink_to(pictures)
    for place in (pictures, tmp_path / "link", pictures / ".." / "pictures"):
        with pytest.raises(ValueError, match="lies in the recording") as caught:
            track_video(pictures, place)
        assert "\n" not in str(caught.value)
    assert {name: (pictures / name).read_bytes() for name in mine} == mine
    for name in mine:  # nor are files of such names made there
        (pictures / name).unlink()
    with pytest.raises(ValueError, match="lies in the recording"):
        track_video(pictures, pictures)
    with pytest.raises(ValueError, match="no images in this folder"):
        track_video(pictures, pictures / "tracked")


def test_what_was_not_written_is_not_listed(tmp_path, monkeypatch):
    """On a full disk a contact sheet was listed that is not there, or is another film's."""

    def full(path: Path, content: bytes) -> None:
        raise OSError(errno.ENOSPC, "No space left on device", str(path))

    monkeypatch.setattr("experiments.picture_files.write_whole", full)
    film = write(tmp_path / "v.mp4", rolling("green", seconds=0.4, size=(320, 240)))
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "contact_sheet.png").write_bytes(b"of another film")
    summary = track_video(film, tmp_path / "out")
    assert summary["files"] == ["track.csv", "overlay.mp4", "results.json"]
    assert summary["notes"][-1] == "no contact sheet: No space left on device"
    assert not (tmp_path / "out" / "contact_sheet.png").exists()


def test_an_earlier_result_stays_until_there_is_a_whole_new_one(tmp_path: Path):
    """A second film, left before its end, took the first one's rows and film with it."""
    film = write(tmp_path / "v.mp4", rolling("green", seconds=0.4, size=(320, 240)))
    out = tmp_path / "out"
    track_video(film, out)
    whole = {name: (out / name).read_bytes() for name in MADE}

    def left(done: int, total: int | None) -> None:
        if done:
            raise KeyboardInterrupt

    for _ in range(2):
        with pytest.raises(KeyboardInterrupt):
            track_video(film, out, progress=left)
        assert {name: (out / f"earlier-{name}").read_bytes() for name in MADE} == whole
        assert not (out / "results.json").exists()  # it would speak of other rows
    track_video(film, out)
    assert {path.name for path in out.iterdir()} == set(MADE)


def test_somebodys_own_files_of_these_names_are_kept_beside(tmp_path: Path):
    film = write(tmp_path / "v.mp4", rolling("green", seconds=0.4, size=(320, 240)))
    (tmp_path / "out").mkdir()
    for name in ("track.csv", "overlay.mp4"):
        (tmp_path / "out" / name).write_text("mine")
    track_video(film, tmp_path / "out")
    for name in ("track.csv.1", "overlay.mp4.1"):
        assert (tmp_path / "out" / name).read_text() == "mine"
