"""Odd films are followed, or refused in one clear line with exit code 2."""

import subprocess
import sys
from fractions import Fraction

import av
import cv2
import numpy as np
import pytest

from experiments.track.track import track_video
from tests.support.footage import rolling

SIZE = (320, 240)


@pytest.fixture(scope="module")
def images():
    film = rolling("orange", on="white", radius=14, seconds=1.0, rest_s=0.1, size=SIZE)
    return [frame.image for frame in film.frames]


def encode(path, images, *, codec="libx264", stamps=None, pixels="yuv420p", source="bgr24"):
    """A film of these images, shown at `stamps` (ms; every 33 without)."""
    with av.open(str(path), "w") as file:
        stream = file.add_stream(codec, rate=30)
        stream.height, stream.width = images[0].shape[:2]
        stream.pix_fmt = pixels
        stream.codec_context.time_base = Fraction(1, 1000)
        for k, image in enumerate(images):
            picture = av.VideoFrame.from_ndarray(np.ascontiguousarray(image), format=source)
            picture.pts = stamps[k] if stamps else 33 * k
            picture.time_base = Fraction(1, 1000)
            file.mux(stream.encode(picture))
        file.mux(stream.encode(None))
    return path


def gif(path, images, delays):
    """A GIF whose frames last for `delays` (1/100 s), which many writers leave 0 or broken."""
    pillow = pytest.importorskip("PIL.Image")
    frames = [pillow.fromarray(image[:, :, ::-1]).quantize(64) for image in images]
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=10, optimize=False)
    data = bytearray(path.read_bytes())
    found = [i for i in range(len(data) - 8) if data[i : i + 3] == b"\x21\xf9\x04"]
    for k, at in enumerate(found):
        data[at + 4 : at + 6] = int(delays[k % len(delays)]).to_bytes(2, "little")
    path.write_bytes(bytes(data))
    return path


def tracked(address, out, least):
    summary = track_video(address, out)
    assert summary["states"]["track"] >= least, summary["states"]
    assert abs(summary["ball"]["radius_px"] - 14) < 1.5
    return summary


def test_one_frame(tmp_path, images):
    tracked(encode(tmp_path / "one.mp4", images[:1]), tmp_path / "out", 1)


def test_variable_rate_is_followed_by_its_stamps(tmp_path, images):
    stamps = np.cumsum(np.random.default_rng(1).integers(10, 90, len(images))).tolist()
    summary = tracked(encode(tmp_path / "v.mkv", images, stamps=stamps), tmp_path / "out", 28)
    assert summary["end_s"] - summary["start_s"] == pytest.approx(
        (stamps[-1] - stamps[0]) / 1000, abs=0.1
    )


def test_stream_without_time_stamps(tmp_path, images):
    path = tmp_path / "raw.h264"
    with av.open(str(path), "w", format="h264") as file:
        stream = file.add_stream("libx264", rate=30)
        stream.height, stream.width, stream.pix_fmt = *images[0].shape[:2], "yuv420p"
        for image in images:
            picture = av.VideoFrame.from_ndarray(np.ascontiguousarray(image), format="bgr24")
            file.mux(stream.encode(picture))
        file.mux(stream.encode(None))
    tracked(path, tmp_path / "out", 28)


def test_grey_film(tmp_path, images):
    grey = [cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) for image in images]
    path = encode(tmp_path / "g.mkv", grey, codec="ffv1", pixels="gray", source="gray")
    tracked(path, tmp_path / "out", 28)


def test_alpha_film(tmp_path, images):
    clear = [np.dstack((image, np.full(image.shape[:2], 255, np.uint8))) for image in images]
    path = encode(tmp_path / "a.mkv", clear, codec="ffv1", pixels="bgra", source="bgra")
    tracked(path, tmp_path / "out", 28)


@pytest.mark.parametrize("delays", [(0,), (65535, 0, 1)])
def test_gif_with_broken_delays(tmp_path, images, delays):
    tracked(gif(tmp_path / "b.gif", images, delays), tmp_path / "out", 25)


def test_pictures_of_changing_size_are_followed(tmp_path, images):
    for k, image in enumerate(images):
        some = image if k % 10 < 5 else image[:200, :300]
        cv2.imwrite(str(tmp_path / f"{k}.png"), some)
    tracked(tmp_path, tmp_path / "out", 20)


@pytest.mark.slow
def test_4k_film(tmp_path, images):
    large = [cv2.resize(image, (3840, 2160), interpolation=cv2.INTER_CUBIC) for image in images[:8]]
    summary = track_video(encode(tmp_path / "4k.mp4", large), tmp_path / "out")
    assert summary["states"]["track"] >= 7


def test_what_is_no_film_ends_with_one_line(tmp_path):
    (tmp_path / "bad.mp4").write_bytes(b"\x00\x00\x00\x18ftypmp42 and no more")
    command = [sys.executable, "-m", "experiments.cli", "track", str(tmp_path / "bad.mp4")]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 2
    assert len(done.stderr.strip().splitlines()) == 1
    assert "bad.mp4" in done.stderr
