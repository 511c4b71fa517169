"""A camera of the operating system, as far as it can be judged without one."""

import math
import time

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vision.sources.camera_device import (
    DSHOW,
    MSMF,
    V4L2,
    CameraFeed,
    CameraSettings,
    apply_settings,
    backends,
    open_camera,
)
from vision.sources.clock import wall_minus_monotonic
from vision.sources.live import LiveReader
from vision.sources.source_errors import GarbageError, GoneError, SettingsError
from vision.sources.sources import open_source

MJPG = float(cv2.VideoWriter.fourcc(*"MJPG"))
WANTED = CameraSettings("MJPG", 640, 480, 60.0, 0.004)


class Device:
    """A capture that does what it is told, but for the properties in `stubborn`."""

    def __init__(self, *, stubborn=None, opened=True, stamp_ms=lambda: 0.0, images=()):
        self.values = {cv2.CAP_PROP_FPS: 30.0, **(stubborn or {})}
        self.stubborn, self.opened, self.stamp_ms = stubborn or {}, opened, stamp_ms
        self.images = list(images)
        self.order, self.released = [], False

    def isOpened(self):
        return self.opened

    def set(self, prop, value):
        self.order.append(prop)
        if prop not in self.stubborn:
            self.values[prop] = value
        return True  # which says nothing: drivers return it for values that they bend

    def get(self, prop):
        return self.stamp_ms() if prop == cv2.CAP_PROP_POS_MSEC else self.values.get(prop, 0.0)

    def read(self):
        if not self.images:
            return False, None
        return True, self.images.pop(0)

    def release(self):
        self.released = True


IMAGE = np.zeros((48, 64, 3), np.uint8)


def feed(device, settings=None, backend=V4L2):
    return CameraFeed(device, backend, "0", settings or CameraSettings())


def test_settings_are_made_in_the_drivers_order_and_give_the_exposure():
    device = Device()
    assert apply_settings(device, V4L2, WANTED, "0") == pytest.approx(0.004)
    assert device.order == [
        cv2.CAP_PROP_FOURCC,
        cv2.CAP_PROP_FRAME_WIDTH,
        cv2.CAP_PROP_FRAME_HEIGHT,
        cv2.CAP_PROP_FPS,
        cv2.CAP_PROP_AUTO_EXPOSURE,
        cv2.CAP_PROP_EXPOSURE,
    ]
    assert device.values[cv2.CAP_PROP_FOURCC] == MJPG
    assert device.values[cv2.CAP_PROP_AUTO_EXPOSURE] == 1.0  # V4L2's menu value for manual
    assert device.values[cv2.CAP_PROP_EXPOSURE] == 40.0  # of 100 us


def test_what_is_not_asked_for_is_left_alone():
    device = Device()
    assert apply_settings(device, V4L2, CameraSettings(), "0") is None
    assert device.order == []


@pytest.mark.parametrize(
    ("stubborn", "words"),
    [
        ({cv2.CAP_PROP_FPS: 30.0}, "fps 30, not 60"),
        ({cv2.CAP_PROP_FOURCC: float(cv2.VideoWriter.fourcc(*"YUYV"))}, "fourcc YUYV, not MJPG"),
        ({cv2.CAP_PROP_FOURCC: 0.0}, r"fourcc \?\?\?\?, not MJPG"),
        ({cv2.CAP_PROP_FRAME_HEIGHT: 360.0}, "height 360, not 480"),
        ({cv2.CAP_PROP_AUTO_EXPOSURE: 3.0}, "manual exposure 3, not 1"),
        ({cv2.CAP_PROP_EXPOSURE: 156.0}, "exposure 15.6 ms, not 4 ms"),
        ({cv2.CAP_PROP_FPS: math.nan}, "fps nan, not 60"),
    ],
)
def test_a_difference_is_refused_by_name(stubborn, words):
    device = Device(stubborn=stubborn)
    with pytest.raises(SettingsError, match=words) as caught:
        open_camera("0", WANTED, candidates=(V4L2,), opener=lambda target, api: device)
    assert "\n" not in str(caught.value)
    assert device.released


def test_all_differences_stand_in_one_line():
    device = Device(stubborn={cv2.CAP_PROP_FPS: 15.0, cv2.CAP_PROP_FRAME_WIDTH: 320.0})
    with pytest.raises(OSError, match="width 320, not 640, fps 15, not 60"):
        apply_settings(device, V4L2, WANTED, "0")


def test_a_television_rate_is_no_difference():
    device = Device(stubborn={cv2.CAP_PROP_FPS: 60000 / 1001})
    assert apply_settings(device, V4L2, WANTED, "0") == WANTED.exposure_s


@given(st.floats(1e-4, 1.0))
def test_exposures_are_the_nearest_that_the_interface_can_say(exposure_s):
    assert V4L2.to_exposure(V4L2.of_exposure(exposure_s)) == pytest.approx(exposure_s, abs=5.1e-5)
    ratio = MSMF.to_exposure(MSMF.of_exposure(exposure_s)) / exposure_s
    assert 2**-0.51 < ratio < 2**0.51


@pytest.mark.parametrize(
    "wrong",
    [
        {"fourcc": "MJPEG"},
        {"width_px": 640},
        {"fps": 0.0},
        {"exposure_s": math.nan},
        {"stamp": "middle"},
    ],
)
def test_wrong_settings_are_refused(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        CameraSettings(**wrong)


@pytest.mark.parametrize(("stamp", "shift_s"), [("start", 0.002), ("end", -0.002)])
@pytest.mark.parametrize("zero", [lambda: 0.0, wall_minus_monotonic], ids=["monotonic", "wall"])
def test_kernel_stamps_become_mid_exposure_on_the_rigs_clock(stamp, shift_s, zero):
    zero_s = zero()
    taken_s = time.monotonic() - 0.030
    device = Device(stamp_ms=lambda: 1e3 * (taken_s + zero_s), images=[IMAGE])
    camera = feed(device, CameraSettings(exposure_s=0.004, stamp=stamp))
    image, t_s = camera.read()
    assert image is IMAGE
    assert t_s == pytest.approx(taken_s + shift_s, abs=1e-4)
    assert camera.stamped_by == "kernel"


@pytest.mark.parametrize("stamp_ms", [0.0, -1.0, math.nan, 40.0, 1e15])
def test_a_stamp_of_no_known_clock_gives_way_to_the_arrival(stamp_ms):
    camera = feed(Device(stamp_ms=lambda: stamp_ms, images=[IMAGE]))
    before_s = time.monotonic()
    _, t_s = camera.read()
    assert before_s <= t_s <= time.monotonic()
    assert camera.stamped_by == "arrival"


def test_stamps_from_the_streams_start_keep_their_distances():
    now_s, stamps_ms = iter((100.0, 100.05, 100.09)), iter((1000.0, 1020.0, 1040.0))
    device = Device(stamp_ms=lambda: next(stamps_ms), images=[IMAGE] * 3)
    camera = CameraFeed(device, MSMF, "0", CameraSettings(), now=lambda: next(now_s))
    assert [camera.read()[1] for _ in range(3)] == pytest.approx([100.0, 100.02, 100.04])
    assert camera.stamped_by == "stream"


def test_an_unplugged_camera_is_gone_and_no_image_is_garbage():
    with pytest.raises(GoneError, match="unplugged"):
        feed(Device()).read()
    with pytest.raises(GarbageError):
        feed(Device()).decode(np.zeros((0, 0, 3), np.uint8))


def test_each_system_has_its_interfaces_and_the_first_that_opens_is_taken():
    assert backends("linux") == (V4L2,)
    assert backends("win32") == (MSMF, DSHOW)
    tried = []

    def opener(target, api):
        tried.append((target, api))
        return Device(opened=api == cv2.CAP_DSHOW)

    camera = open_camera("1", candidates=backends("win32"), opener=opener)
    assert tried == [(1, cv2.CAP_MSMF), (1, cv2.CAP_DSHOW)]
    assert camera.fps == 30.0


@pytest.mark.parametrize("address", [77, "77", "/dev/video77", "/dev/v4l/by-id/none"])
def test_no_camera_is_one_clear_line(address, capfd):
    with pytest.raises(GoneError, match="camera") as caught:
        open_source(address)
    assert "\n" not in str(caught.value)
    assert capfd.readouterr().err == ""


def test_settings_are_for_cameras_only(tmp_path):
    with pytest.raises(ValueError, match="only a camera"):
        open_source(tmp_path, settings=WANTED)


def test_a_camera_plugged_in_again_is_set_again():
    devices = [
        Device(images=[IMAGE]),
        Device(opened=False),
        Device(stubborn={cv2.CAP_PROP_FPS: 30.0}),  # not ready yet: refused, tried again
        Device(images=[IMAGE + 1]),
    ]
    opened = iter(devices)
    reader = LiveReader(
        lambda: open_camera("0", WANTED, candidates=(V4L2,), opener=lambda *_: next(opened)), "0"
    )
    assert reader.read() is not None
    with pytest.raises(GoneError, match="unplugged"):
        reader.read()
    got = reader.read()
    assert got is not None
    assert got[0].max() == 1
    assert devices[3].order == devices[0].order
    reader.close()
    assert all(d.released for d in devices)
