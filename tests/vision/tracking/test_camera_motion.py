"""The camera's own motion is told from that of what it sees."""

import cv2
import numpy as np
import pytest

from vision.frames import Frame
from vision.tracking import camera_motion
from vision.tracking.camera_motion import CameraMotion
from vision.tracking.tracker import Tracker
from vision.tracking.whole_film import WholeFilm

DESK, SEEN = (720, 540), (480, 360)  # px; the camera sees its middle
MIDDLE = np.array(((1.0, 0.0, 360.0), (0.0, 1.0, 270.0), (0.0, 0.0, 1.0)))
TO_SEEN = np.array(((1.0, 0.0, -120.0), (0.0, 1.0, -90.0), (0.0, 0.0, 1.0)))


def desk(rng):
    """A desk with a grain and straight marks all over it."""
    grain = rng.uniform(110, 130, (27, 36, 3)).astype(np.float32)
    image = cv2.resize(grain, DESK, interpolation=cv2.INTER_CUBIC).clip(0, 255).astype(np.uint8)
    for u, v in rng.uniform((20, 20), (700, 520), (40, 2)).round().astype(int):
        cv2.line(image, (u, v), (u + 40, v + 9), (60, 70, 60), 3)
    return image


def view(image, zoom=1.0, turn_rad=0.0, shift=(0.0, 0.0)):
    """What the camera sees of a desk, and the matrix (3, 3) from the desk to the image."""
    c, s = zoom * np.cos(turn_rad), zoom * np.sin(turn_rad)
    moved = np.array(((c, -s, shift[0]), (s, c, shift[1]), (0.0, 0.0, 1.0)))
    matrix = TO_SEEN @ MIDDLE @ moved @ np.linalg.inv(MIDDLE)
    return cv2.warpAffine(image, matrix[:2], SEEN, flags=cv2.INTER_AREA), matrix


@pytest.mark.parametrize(
    "step", [{"zoom": 0.985}, {"turn_rad": 0.01, "shift": (3.0, -2.0)}, {"shift": (0.0, 4.0)}]
)
def test_places_are_told_as_if_the_camera_had_stayed(step):
    image, camera, place = desk(np.random.default_rng(1)), CameraMotion(), (300.0, 290.0, 1.0)
    for k in range(12):
        now = {"zoom": step.get("zoom", 1.0) ** k, "turn_rad": k * step.get("turn_rad", 0.0)}
        seen, matrix = view(image, **now, shift=k * np.array(step.get("shift", (0.0, 0.0))))
        camera.add(seen)
        u, v, _ = matrix @ place
        assert camera.home((u, v)) == pytest.approx((180.0, 200.0), abs=2.0)


def test_a_hand_before_a_still_camera_moves_nothing():
    rng, camera = np.random.default_rng(2), CameraMotion()
    still, _ = view(desk(rng))
    hand = cv2.GaussianBlur(rng.integers(0, 255, (220, 200, 3), np.uint8), (0, 0), 2.0)
    for k in range(12):
        image = still.copy()
        image[40 + 6 * k : 260 + 6 * k, 200:400] = hand
        camera.add(image)
    assert camera.home((123.0, 45.0)) == (pytest.approx(123.0), pytest.approx(45.0))


@pytest.mark.parametrize("size", [(90, 120), (1, 1), (5, 320), (161, 7)])
def test_without_a_corner_nothing_is_known_to_move(size):
    camera = CameraMotion()
    for k in range(3):
        camera.add(np.full((*size, 3), 128 + k, np.uint8))
    assert camera.home((10.0, 20.0)) == (pytest.approx(10.0), pytest.approx(20.0))


@pytest.mark.parametrize("zoom", [0.9, 1.1, float("nan")])
def test_errors_of_a_zoom_do_not_add_up_without_end(zoom, monkeypatch):
    monkeypatch.setattr(camera_motion, "_motion", lambda now, before: np.diag((zoom, zoom, 1.0)))
    camera = CameraMotion()
    for _ in range(200):
        camera.add(np.zeros((240, 320, 3), np.uint8))
        assert 20.0 < camera.home((100.0, 100.0))[0] < 410.0


@pytest.mark.parametrize("whole", [False, True])
def test_in_a_zoom_a_disc_beside_the_plate_does_not_travel(whole):
    image, ball = desk(np.random.default_rng(3)), (320, 280)
    cv2.rectangle(image, (280, 200), (460, 340), (215, 215, 215), -1)
    for place, bgr in (((160, 160), (180, 60, 30)), ((560, 300), (30, 40, 200))):
        cv2.circle(image, place, 12, bgr, -1, cv2.LINE_AA)
    cv2.circle(image, ball, 11, (20, 200, 230), -1, cv2.LINE_AA)
    frames, truth = [], []
    for k in range(75):
        seen, matrix = view(image, zoom=1.0 - 0.25 * np.sin(k / 40.0))
        frames.append(Frame(seen, k / 30.0, k))
        truth.append(matrix @ (*ball, 1.0))
    tracker = WholeFilm(lambda: frames) if whole else Tracker()
    tracks = [tracker.step(frame) for frame in frames]
    off = [np.hypot(t.u_px - p[0], t.v_px - p[1]) for t, p in zip(tracks, truth, strict=True)]
    assert all(t.state != "track" or far < 5.0 for t, far in zip(tracks, off, strict=True))
