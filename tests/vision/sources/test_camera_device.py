"""A camera of the operating system, as far as it can be judged without one."""

import math
import time

import cv2
import numpy as np
import pytest

from vision.sources.camera_device import (
    DSHOW,
    MSMF,
    V4L2,
    CameraFeed,
    backends,
    open_camera,
)
from vision.sources.clock import wall_minus_monotonic
from vision.sources.live import LiveReader
from vision.sources.source_errors import GarbageError, GoneError
from vision.sources.sources import open_source


class Device:
    """A capture of given images."""

    def __init__(self, *, opened=True, stamp_ms=lambda: 0.0, images=()):
        self.opened, self.stamp_ms = opened, stamp_ms
        self.images = list(images)
        self.released = False

    def isOpened(self):
        return self.opened

    def get(self, prop):
        return self.stamp_ms() if prop == cv2.CAP_PROP_POS_MSEC else 30.0

    def read(self):
        if not self.images:
            return False, None
        return True, self.images.pop(0)

    def release(self):
        self.released = True


IMAGE = np.zeros((48, 64, 3), np.uint8)


def feed(device):
    return CameraFeed(device, V4L2, "0")


@pytest.mark.parametrize("zero", [lambda: 0.0, wall_minus_monotonic], ids=["monotonic", "wall"])
def test_kernel_stamps_are_on_the_rigs_clock(zero):
    zero_s = zero()
    taken_s = time.monotonic() - 0.030
    device = Device(stamp_ms=lambda: 1e3 * (taken_s + zero_s), images=[IMAGE])
    camera = feed(device)
    image, t_s = camera.read()
    assert image is IMAGE
    assert t_s == pytest.approx(taken_s, abs=1e-4)
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
    camera = CameraFeed(device, MSMF, "0", now=lambda: next(now_s))
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


def test_a_camera_plugged_in_again_is_read_again():
    devices = [
        Device(images=[IMAGE]),
        Device(opened=False),  # not ready yet: tried again
        Device(images=[IMAGE + 1]),
    ]
    opened = iter(devices)
    reader = LiveReader(
        lambda: open_camera("0", candidates=(V4L2,), opener=lambda *_: next(opened)), "0"
    )
    assert reader.read() is not None
    with pytest.raises(GoneError, match="unplugged"):
        reader.read()
    got = reader.read()
    assert got is not None
    assert got[0].max() == 1
    reader.close()
    assert all(d.released for d in devices)
