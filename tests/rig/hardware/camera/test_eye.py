"""The eye: newest wins, nothing twice, times on the loop's clock, troubles by name."""

import os
import signal
import time
from collections.abc import Iterator
from functools import partial

import numpy as np
import pytest

from rig.hardware.camera.eye import CameraEye, CameraStopped, Watcher, see
from rig.parameters import Rig
from vision.frames import Frame, Observation, Track
from vision.sources.source_errors import GarbageError, GoneError

pytestmark = pytest.mark.realtime

RATIO = Rig().linkage.ratio
BLANK = np.zeros((4, 4, 3), np.uint8)
COV = (1e-8, 0.0, 2e-8)


class FakeCamera:
    """Sees the ball at x = the frame's index in mm, unless that is a multiple of `blind`."""

    def __init__(self, blind: int = 0) -> None:
        self.blind, self.hints = blind, []

    def step(self, frame: Frame, rotation_hint: np.ndarray):
        self.hints.append(rotation_hint)
        if self.blind and frame.index % self.blind == 0:
            return None, Track("lost"), None
        return Observation((1e-3 * frame.index, 0.0), COV, frame.t_s), Track("track"), None


def live(count: int, gap_s: float = 0.005, end: Exception | None = None) -> Iterator[Frame]:
    for index in range(count):
        time.sleep(gap_s)
        yield Frame(BLANK, time.monotonic(), index)
    if end is not None:
        raise end
    time.sleep(60)


def fake(count: int = 10**6, blind: int = 0, end: Exception | None = None):
    return live(count, end=end), FakeCamera(blind)


def read(eye: CameraEye, seconds: float) -> None:
    """As a table's ticks do."""
    until_s = time.monotonic() + seconds
    while time.monotonic() < until_s:
        eye.latest(-np.inf)
        time.sleep(0.002)


@pytest.fixture
def eye():
    one = CameraEye(RATIO)
    yield one
    one.close()


def test_the_newest_wins_and_none_is_given_twice(eye: CameraEye):
    eye.begin(100.0)
    for k in range(5):
        eye.put(100.0 + k, Observation((0.01 * k, -0.01), COV, 0.0))
    got = eye.latest(-np.inf)
    assert got is not None
    assert got.exposed_s == pytest.approx(4.0)
    assert got.xy_m == (0.04, -0.01)
    assert got.cov_m2 == COV
    assert eye.latest(-np.inf) is None
    eye.put(103.0, Observation((0.0, 0.0), COV, 0.0))
    assert eye.latest(4.0) is None  # older than what the table has
    eye.put(106.0, None)  # a frame without a ball
    assert eye.latest(4.0) is None
    assert eye.frames == 7


def test_time_counts_from_the_first_look_unless_told(eye: CameraEye):
    before_s = time.monotonic()
    assert eye.latest(-1.0) is None
    eye.put(before_s + 1.0, Observation((0.0, 0.0), COV, 0.0))
    got = eye.latest(-1.0)
    assert got is not None
    assert got.exposed_s == pytest.approx(1.0, abs=0.1)


def test_a_thread_sees_and_the_loop_reads_on_the_monotonic_clock(eye: CameraEye):
    eye.begin(time.monotonic())
    eye.tell((0.1, -0.2))
    with Watcher(eye, partial(fake, blind=3), process=False):
        last_s, seen = -1.0, []
        until_s = time.monotonic() + 0.3
        while time.monotonic() < until_s:
            ball = eye.latest(last_s)
            if ball is not None:
                assert last_s < ball.exposed_s <= time.monotonic() - (eye.zero_s or 0.0)
                last_s = ball.exposed_s
                seen.append(round(1e3 * ball.xy_m[0]))
            time.sleep(0.002)
    assert len(seen) > 10
    assert all(index % 3 for index in seen)
    assert seen == sorted(set(seen))


def test_the_encoders_are_the_hint_of_the_plates_pose(eye: CameraEye):
    eye.tell((0.3, 0.0))
    camera = FakeCamera()
    see(eye, lambda: (live(1, end=GoneError("gone")), camera))
    x_axis = camera.hints[0][:, 0]
    assert x_axis[2] == pytest.approx(-RATIO * np.sin(0.3))


@pytest.mark.parametrize(
    ("opener", "words"),
    [
        (partial(fake, 5, end=GoneError("cam: unplugged")), "GoneError: cam: unplugged"),
        (partial(fake, 5, end=ValueError("a mistake")), "ValueError: a mistake"),
        (lambda: (iter([Frame(BLANK, 0.0, 0)]), FakeCamera()), "no more frames"),
        (partial(fake, 5), r"no frame for 0\.\d\d s"),
    ],
)
def test_troubles_are_raised_by_name_where_the_loop_reads(eye: CameraEye, opener, words: str):
    with Watcher(eye, opener, process=False) as watcher:
        watcher._worker.join(0.2)
        begin_s = time.monotonic()
        with pytest.raises(CameraStopped, match=words) as caught:
            read(eye, 3.0)
        assert time.monotonic() - begin_s < eye.stall_s + 0.3
    assert caught.value.outcome == "camera stall"


class Garbled:
    """Every second frame is garbage."""

    def __init__(self) -> None:
        self.count = 0

    def __iter__(self):
        return self

    def __next__(self) -> Frame:
        self.count += 1
        if self.count > 10:
            raise GoneError("gone")
        if self.count % 2:
            raise GarbageError("half a JPEG")
        return Frame(BLANK, float(self.count), self.count)


def test_garbage_between_sound_frames_is_passed_over(eye: CameraEye):
    see(eye, lambda: (Garbled(), FakeCamera()))
    assert len(eye.sights.read()) == 5


def never():
    raise GoneError("/dev/video0: no such camera")


def test_a_camera_that_cannot_be_opened_is_said_before_anything_moves(eye: CameraEye):
    with pytest.raises(CameraStopped, match="no such camera"), Watcher(eye, never, process=False):
        pass


def test_a_process_sees_too_and_says_its_troubles(eye: CameraEye):
    eye.begin(0.0)
    eye.stall_s = 5.0  # of a busy machine
    opener = partial(fake, 400, end=GoneError("cam: unplugged"))
    with Watcher(eye, opener):
        ball = eye.latest(-np.inf)
        assert ball is not None
        assert abs(ball.exposed_s - time.monotonic()) < 5.0
        with pytest.raises(CameraStopped, match="unplugged"):
            read(eye, 20.0)


class Leaving(FakeCamera):
    """Prints at every frame; leaves or crashes the program at the fifth, or as it opens."""

    def __init__(self, how: str, at: int = 5) -> None:
        super().__init__()
        self.how, self.at = how, at

    def step(self, frame: Frame, rotation_hint: np.ndarray):
        print("loud")
        if frame.index == self.at:
            os._exit(0) if self.how == "exit" else os.kill(os.getpid(), signal.SIGKILL)
        return super().step(frame, rotation_hint)


def leaving(how: str, at: int):
    return live(10**6), Leaving(how, at)


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
@pytest.mark.parametrize(
    ("how", "words"), [("exit", r"left \(exit code 0\)"), ("kill", "was ended by signal 9")]
)
@pytest.mark.parametrize("at", [0, 5])
def test_a_process_that_dies_is_told_by_how_it_ended(eye: CameraEye, capfd, how, words, at):
    eye.begin(0.0)
    eye.stall_s = 20.0  # of a busy machine: what is told is the end, not the silence
    with (
        pytest.raises(CameraStopped, match=f"the camera's program {words}"),
        Watcher(eye, partial(leaving, how, at)),
    ):
        read(eye, 30.0)
    assert "loud" not in capfd.readouterr().out


@pytest.mark.slow
def test_the_real_ball_camera_sees_rendered_frames_through_it(eye: CameraEye):
    from rig.plant.ball import plate_rotation, tilt_sines
    from vision.ball_camera import BallCamera
    from vision.detection.appearance import Appearance
    from vision.plate.markers import default_layout
    from vision.synthetic.synthetic import Renderer, Scene, virtual_view

    layout, radius_m, theta = default_layout(0.275), 0.019625, (0.1, -0.05)
    scene = Scene(plate_side_m=0.275, layout=layout, ball_radius_m=radius_m)
    renderer = Renderer(scene, virtual_view(), np.random.default_rng(0))
    turn = plate_rotation(tilt_sines(theta, RATIO))
    frames = [Frame(renderer.render(turn, (0.03, -0.04)), 10.0 + k / 60, k) for k in range(4)]
    orange = Appearance.of_colour("orange")
    camera = BallCamera.over_plate(
        virtual_view(), layout, radius_m, 0.275, 0.105, appearance=orange
    )
    eye.tell(theta)
    see(eye, lambda: (frames, camera))
    sights = eye.sights.read()
    assert len(sights) == 4
    assert sights["seen"][-1]
    assert sights["frame_s"][-1] == 10.0 + 3 / 60
    assert sights["numbers"][-1][:2] == pytest.approx((0.03, -0.04), abs=3e-4)
