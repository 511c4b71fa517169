"""Sources: the right frames at the right times, and one clear line where there are none."""

from fractions import Fraction

import av
import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.footage import rolling
from vision.noise import noise_level
from vision.sources.repeats import RepeatFilter, has_repeats
from vision.sources.sources import open_source


def write_video(path, images, *, codec="libx264", fps=30, times=None, crf="18"):
    """A video of images at `fps`, or at `times` (s)."""
    with av.open(str(path), "w") as file:
        stream = file.add_stream(codec, rate=fps)
        stream.height, stream.width = images[0].shape[:2]
        stream.pix_fmt = "yuv420p"
        if codec == "libx264":
            stream.options = {"crf": crf, "preset": "ultrafast"}
        stream.codec_context.time_base = Fraction(1, 1000)
        for k, image in enumerate(images):
            frame = av.VideoFrame.from_ndarray(image, format="bgr24")
            t = k / fps if times is None else times[k]
            frame.pts, frame.time_base = round(1000 * t), Fraction(1, 1000)
            file.mux(stream.encode(frame))
        file.mux(stream.encode(None))
    return path


@pytest.fixture(scope="module")
def images():
    return [f.image for f in rolling("green", seconds=1.0, size=(320, 240), rest_s=0.0).frames]


def test_file_gives_every_frame_at_its_time(tmp_path, images):
    times = [0.04 * k + 0.01 * (k % 3) for k in range(len(images))]
    path = write_video(tmp_path / "v.mp4", images, times=times)
    with open_source(path) as source:
        frames = list(source)
        assert source.size == (320, 240)
        assert (source.live, source.dropped, source.stamped_by) == (False, 0, "container")
    assert [f.index for f in frames] == list(range(len(images)))
    assert np.allclose([f.t_s for f in frames], times, atol=0.0015)
    assert (source.duplicates, source.missing) == (0, 0)
    assert np.abs(frames[7].image.astype(int) - images[7]).mean() < 6


@pytest.mark.parametrize("codec", ["libx264", "mpeg4"])
def test_repeats_of_the_container_are_skipped_and_counted(tmp_path, images, codec):
    repeated = [image for image in images for _ in range(4)]
    path = write_video(tmp_path / "v.mp4", repeated, fps=120, codec=codec, crf="28")
    with open_source(path) as source:
        found = list(source)
    # A coarse codec refines the same picture visibly: some repeats pass, no exposure is lost.
    assert len(images) <= len(found) <= 0.6 * len(repeated)
    assert {4 * k for k in range(len(images))} <= {f.index for f in found}
    assert source.duplicates + len(found) == len(repeated)


@pytest.mark.parametrize("crf", ["18", "28"])
def test_still_scene_of_a_normal_video_keeps_all_its_frames(tmp_path, crf):
    film = rolling("white", seconds=2.0, rest_s=1.0, noise=2.0)
    path = write_video(tmp_path / "v.mp4", [f.image for f in film.frames], crf=crf)
    with open_source(path) as source:
        count = len(list(source))
    assert count >= 0.9 * len(film.frames)


def test_a_single_repeat_in_motion_is_skipped(tmp_path, images):
    for k, image in enumerate([*images[:14], images[13], *images[14:]]):
        cv2.imwrite(str(tmp_path / f"{k}.png"), image)
    with open_source(tmp_path) as source:
        found = [f.index for f in source]
    assert found == [*range(14), *range(15, 31)]
    assert source.duplicates == 1


def test_repeats_are_told_by_motion(images):
    assert has_repeats(images) is False
    assert has_repeats([image for image in images for _ in range(2)]) is True
    assert has_repeats([images[0]] * 50) is None


@settings(max_examples=15)
@given(noise=st.floats(0.5, 8.0), seed=st.integers(0, 99))
def test_new_exposures_of_a_still_scene_are_kept(noise, seed):
    rng = np.random.default_rng(seed)
    scene = np.tile(np.linspace(40, 200, 160), (120, 1))[..., None].repeat(3, 2)
    keep = RepeatFilter()
    for _ in range(4):
        image = np.clip(np.rint(scene + rng.normal(0, noise, scene.shape)), 0, 255)
        assert not keep.is_repeat(image.astype(np.uint8))


def test_small_slow_ball_on_a_clean_plate_is_no_repeat():
    keep = RepeatFilter()
    shown = []
    for k in range(40):
        image = np.full((480, 640, 3), 180, np.uint8)
        cv2.circle(image, (round((200 + 0.5 * k) * 16), 240 * 16), 6 * 16, (0, 90, 230), -1, 16, 4)
        if not keep.is_repeat(image):
            shown.append(k)
    assert max(np.diff(shown)) <= 2


def test_noise_is_measured_beside_structure():
    rng = np.random.default_rng(0)
    ramp = np.tile(np.linspace(30, 220, 320), (240, 1))[..., None].repeat(3, 2)
    image = np.rint(ramp + rng.normal(0, 3.0, ramp.shape)).astype(np.uint8)
    assert 2.7 < noise_level(image) < 3.3


def test_folder_is_read_in_natural_order(tmp_path, images):
    for k, image in enumerate(images[:12]):
        cv2.imwrite(str(tmp_path / f"frame{k}.png"), image)
    with open_source(tmp_path, fps=20) as source:
        frames = list(source)
    assert [f.t_s for f in frames] == pytest.approx([k / 20 for k in range(12)])
    assert all(np.array_equal(f.image, images[f.index]) for f in frames)


def test_truncated_file_gives_what_decodes_and_says_what_is_missing(tmp_path, images):
    whole = write_video(tmp_path / "whole.mkv", images * 3, codec="mpeg4")
    data = whole.read_bytes()
    part = tmp_path / "part.mkv"
    part.write_bytes(data[: len(data) // 2])
    with open_source(part) as source:
        count = len(list(source)) + source.duplicates
    assert 0.3 * 90 < count < 0.7 * 90
    assert source.missing == 90 - count


@pytest.mark.parametrize(
    ("name", "content", "error", "words"),
    [
        ("gone.mp4", None, FileNotFoundError, "no such file"),
        ("empty.mp4", b"", ValueError, "empty"),
        ("text.mp4", b"hello" * 100, ValueError, "not a video"),
    ],
)
def test_bad_files_are_one_clear_line(tmp_path, capfd, name, content, error, words):
    path = tmp_path / name
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(error, match=words) as caught:
        open_source(path)
    assert "\n" not in str(caught.value)
    assert name in str(caught.value)
    assert capfd.readouterr().err == ""


def test_mp4_cut_before_its_index_is_refused(tmp_path, images):
    data = write_video(tmp_path / "v.mp4", images).read_bytes()
    (tmp_path / "cut.mp4").write_bytes(data[: len(data) // 2])
    with pytest.raises(ValueError, match=r"cut\.mp4"):
        open_source(tmp_path / "cut.mp4")


def test_folder_without_images_is_refused(tmp_path):
    (tmp_path / "notes.txt").write_text("no image")
    with pytest.raises(ValueError, match="no images"):
        open_source(tmp_path)
