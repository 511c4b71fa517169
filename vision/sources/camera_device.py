"""How is a camera of the operating system opened, set and read? V4L2, MSMF or DSHOW.

Settings are made in the order format, size, rate, exposure, since a driver resets the later ones
with the earlier ones, then read back and refused where they differ: half the rate, or an exposure
that adapts to the light, shows on no screen and makes every time stamp wrong.
"""

from __future__ import annotations

import os
import re
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import cv2
import numpy as np

from vision.sources.clock import ForeignClock, own_clock, wall_minus_monotonic
from vision.sources.live import Feed
from vision.sources.source_errors import GarbageError, GoneError, SettingsError

DEVICE = re.compile(r"^(\d+|/dev/(video\d+|v4l/.+))$")


class Capture(Protocol):
    """The methods of `cv2.VideoCapture` that are used here."""

    def isOpened(self) -> bool:
        """Whether the camera or file could be opened."""
        ...

    def read(self) -> tuple[bool, np.ndarray]:
        """Wait for the next frame: whether there is one, and its image (h, w, 3) uint8 BGR."""
        ...

    def get(self, propId: int, /) -> float:
        """The value of a property cv2.CAP_PROP_*, in the driver's unit; 0 where it has none."""
        ...

    def set(self, propId: int, value: float, /) -> bool:
        """Ask the driver to set a property cv2.CAP_PROP_*; whether it took the call."""
        ...

    def release(self) -> None:
        """Free the camera or file."""
        ...


@dataclass(frozen=True)
class CameraSettings:
    """Settings of a camera; None leaves one as it is. `fourcc`: a format such as "MJPG"; `fps`
    [1/s].

    `stamp` says which moment of a V4L2 camera's exposure the driver stamps: "start" (USB cameras)
    or "end" (most others); the frame's time is moved from there to the exposure's middle.

    `ValueError`: values that no camera has, or a width without a height.
    """

    fourcc: str | None = None
    width_px: int | None = None
    height_px: int | None = None
    fps: float | None = None
    exposure_s: float | None = None
    stamp: str = "start"

    def __post_init__(self) -> None:
        if self.fourcc is not None and len(self.fourcc) != 4:
            raise ValueError(f"fourcc {self.fourcc!r}: four letters are needed, such as MJPG")
        if (self.width_px is None) != (self.height_px is None):
            raise ValueError("width_px and height_px are set together or not at all")
        numbers = (self.width_px, self.height_px, self.fps, self.exposure_s)
        if any(n is not None and not 0 < n < 1e6 for n in numbers):
            raise ValueError(f"camera settings must be above 0 and finite: {self}")
        if self.stamp not in ("start", "end"):
            raise ValueError(f'stamp {self.stamp!r}: must be "start" or "end"')


@dataclass(frozen=True)
class Backend:
    """One system's camera interface and its units.

    `api`: OpenCV's number of it; `manual`: the value of CAP_PROP_AUTO_EXPOSURE for a manual
    exposure; `powers`: whether exposures are powers of two of a second, else units of 100 us;
    `stamps`: which clock dates the frames, "kernel", "stream" (with a zero of its own) or "none".
    """

    name: str
    api: int
    manual: float  # CAP_PROP_AUTO_EXPOSURE's value for a manual exposure
    powers: bool  # exposure as a power of two of seconds, else in units of 100 us
    stamps: str

    def of_exposure(self, exposure_s: float) -> float:
        """The property's value nearest to an exposure [s]."""
        return float(round(np.log2(exposure_s) if self.powers else exposure_s / 1e-4))

    def to_exposure(self, value: float) -> float:
        """The exposure [s] that a value of the property means."""
        return 2.0**value if self.powers else value * 1e-4


V4L2 = Backend("V4L2", cv2.CAP_V4L2, manual=1.0, powers=False, stamps="kernel")
MSMF = Backend("MSMF", cv2.CAP_MSMF, manual=0.0, powers=True, stamps="stream")
DSHOW = Backend("DSHOW", cv2.CAP_DSHOW, manual=0.0, powers=True, stamps="none")
ANY = Backend("OpenCV", cv2.CAP_ANY, manual=0.0, powers=True, stamps="none")


def backends(platform: str = sys.platform) -> tuple[Backend, ...]:
    """The camera interfaces to try on a system (`sys.platform`'s name), best first."""
    if platform.startswith("linux"):
        return (V4L2,)
    return (MSMF, DSHOW) if platform == "win32" else (ANY,)


def capture(target: str | int, api: int = cv2.CAP_ANY, params: list[int] | None = None) -> Capture:
    """OpenCV's capture of `target`, a file, address or camera index; its libraries are kept from
    printing.

    `api`: OpenCV's number of the interface; `params`: properties and their values in turn. The
    capture may have failed to open: ask `isOpened`.
    """
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    return cv2.VideoCapture(target, api, params or [])


def apply_settings(
    device: Capture, backend: Backend, settings: CameraSettings, address: str
) -> float | None:
    """Set a camera and read it back; returns its exposure [s], None where it was not set.

    `address` names the camera in messages. `SettingsError`: the camera reads back other values; the
    message has every difference in one line.
    """
    wanted: list[tuple[str, int, float, float]] = []  # name, property, value, tolerance
    if settings.fourcc is not None:
        value = float(sum(ord(c) << 8 * i for i, c in enumerate(settings.fourcc)))
        wanted.append(("fourcc", cv2.CAP_PROP_FOURCC, value, 0.0))
    if settings.width_px is not None and settings.height_px is not None:
        wanted.append(("width", cv2.CAP_PROP_FRAME_WIDTH, settings.width_px, 0.0))
        wanted.append(("height", cv2.CAP_PROP_FRAME_HEIGHT, settings.height_px, 0.0))
    if settings.fps is not None:  # 30 may be 30000/1001
        wanted.append(("fps", cv2.CAP_PROP_FPS, settings.fps, 0.002 * settings.fps))
    if settings.exposure_s is not None:
        value = backend.of_exposure(settings.exposure_s)
        wanted.append(("manual exposure", cv2.CAP_PROP_AUTO_EXPOSURE, backend.manual, 0.0))
        wanted.append(("exposure", cv2.CAP_PROP_EXPOSURE, value, 0.0))
    for _, prop, value, _ in wanted:
        device.set(prop, value)
    differences = []
    for name, prop, value, tolerance in wanted:
        got = device.get(prop)
        if not abs(got - value) <= tolerance:
            differences.append(
                f"{name} {_say(name, got, backend)}, not {_say(name, value, backend)}"
            )
    if differences:
        raise SettingsError(
            f"{address}: the camera gives {', '.join(differences)}; "
            "ask for what it can do (Linux: v4l2-ctl --list-formats-ext --list-ctrls)"
        )
    if settings.exposure_s is None:
        return None
    return backend.to_exposure(device.get(cv2.CAP_PROP_EXPOSURE))


def _say(name: str, value: float, backend: Backend) -> str:
    if name == "fourcc":
        return "".join(
            chr(c) if 32 < (c := int(value) >> s & 255) < 127 else "?" for s in (0, 8, 16, 24)
        )
    if name == "exposure":
        return f"{1e3 * backend.to_exposure(value):g} ms"
    return f"{value:g}"


class CameraFeed(Feed):
    """An open camera. `fps` is the rate that it claims [1/s].

    `address` names it in messages; `now` is the clock of arrivals [s]. `stamped_by` is "kernel"
    where the frames carry the driver's stamps, "stream" where these count from the stream's start,
    else "arrival". `SettingsError`: a setting is not taken.
    """

    def __init__(
        self,
        device: Capture,
        backend: Backend,
        address: str,
        settings: CameraSettings,
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        self._device, self._backend, self._address, self._now = device, backend, address, now
        exposure_s = apply_settings(device, backend, settings, address)
        half_s = 0.5 * (exposure_s or 0.0)
        self._to_middle_s = half_s if settings.stamp == "start" else -half_s
        self._foreign = ForeignClock()
        self.fps = device.get(cv2.CAP_PROP_FPS)

    def read(self) -> tuple[np.ndarray, float]:
        """The next image (h, w, 3) and the middle of its exposure [s, `time.monotonic`].

        `GoneError`: the camera fails or is unplugged.
        """
        try:
            ok, image = self._device.read()
        except cv2.error as error:
            raise GoneError(f"{self._address}: the camera failed ({error.err})") from error
        arrived_s = self._now()
        if not ok:
            raise GoneError(f"{self._address}: the camera gives no more frames; is it unplugged?")
        return image, self._date(self._device.get(cv2.CAP_PROP_POS_MSEC) / 1e3, arrived_s)

    def _date(self, stamp_s: float, arrived_s: float) -> float:
        self.stamped_by = "arrival"
        if not np.isfinite(stamp_s) or stamp_s <= 0.0:
            return arrived_s
        if self._backend.stamps == "kernel":
            taken_s = own_clock(stamp_s, arrived_s, wall_minus_monotonic())
        elif self._backend.stamps == "stream":
            taken_s = self._foreign.to_rig(stamp_s, arrived_s)
        else:
            taken_s = None
        if taken_s is None:
            return arrived_s
        self.stamped_by = self._backend.stamps
        # Of a stream's own zero, the exposure is one more constant that a calibration finds.
        shift_s = self._to_middle_s if self.stamped_by == "kernel" else 0.0
        return min(taken_s + shift_s, arrived_s)

    def decode(self, raw: np.ndarray) -> np.ndarray:
        """The image (h, w, 3) uint8 BGR, as `read` gave it. `GarbageError`: it is no colour
        image.
        """
        if not isinstance(raw, np.ndarray) or raw.ndim != 3 or raw.size == 0:
            raise GarbageError("the camera gave something that is no colour image")
        return raw

    def close(self) -> None:
        """Free the camera."""
        self._device.release()


def open_camera(
    address: str,
    settings: CameraSettings | None = None,
    *,
    candidates: tuple[Backend, ...] | None = None,
    opener: Callable[[str | int, int], Capture] = capture,
) -> CameraFeed:
    """Open the camera `address`, an index or device path, with the first of the `candidates`
    (default: `backends()`) that answers; `opener` makes the capture.

    `GoneError`: no camera there, or none answers; `SettingsError`: a setting is not taken.
    """
    target = int(address) if address.isdigit() else address
    if isinstance(target, str) and not Path(target).exists():
        raise GoneError(f"{address}: no such camera; {_present()}")
    if isinstance(target, str):  # names such as /dev/v4l/by-id/... lead to /dev/videoN
        target = str(Path(target).resolve())
    for backend in candidates or backends():
        device = opener(target, backend.api)
        if device.isOpened():
            try:
                return CameraFeed(device, backend, address, settings or CameraSettings())
            except BaseException:
                device.release()
                raise
        device.release()
    raise GoneError(
        f"{address}: the camera does not answer; is it plugged in and free? ({_present()})"
    )


def _present() -> str:
    found = sorted(str(p) for p in Path("/dev").glob("video*"))
    return "cameras here: " + (", ".join(found) if found else "none")
