"""Pick the pictures that a lens needs out of a video or a live camera."""

from collections.abc import Callable, Iterable
from time import monotonic

import cv2
import numpy as np

from calibration.camera.lens import MIN_COVERAGE, coverage
from calibration.camera.pictures import MAX_BLUR_PX
from calibration.camera.sheet import Sheet, SheetView, sheet_view
from vision.frames import Frame

NEW_SHARE = 0.06  # of the picture's width: so far the sheet must have moved since any picture kept
ENOUGH = 24
SAMPLES = 12


class ViewPicker:
    """Picks the frames in which the sheet is sharp and lies elsewhere than in those kept before.

    views: of the sheet in the frames kept, at most `most`; samples: a few frames (h, w[, 3]) with
    and without a sheet, for messages on what is wrong; size: (width, height) [px]; seen: frames
    looked at.
    """

    def __init__(self, sheet: Sheet, most: int) -> None:
        self.views: list[SheetView] = []
        self.samples: list[np.ndarray] = []
        self.size: tuple[int, int] = (0, 0)
        self.seen = 0
        self._sheet, self._most = sheet, most
        self._places: list[np.ndarray] = []
        self._every = 1

    @property
    def complete(self) -> bool:
        """True if `most` pictures were kept."""
        return len(self.views) >= self._most

    @property
    def enough(self) -> bool:
        """True if a calibration may be tried: at least ENOUGH pictures that cover the image."""
        return len(self.views) >= ENOUGH and coverage(self.views, self.size) >= MIN_COVERAGE

    def look(self, frame: Frame) -> bool:
        """Look at one frame; True if it was kept: the sheet is sharp in it and lies elsewhere than
        before.
        """
        image = frame.image
        self.size = (image.shape[1], image.shape[0])
        self._sample(image)
        self.seen += 1
        view = sheet_view(image, self._sheet, frame.index)
        if view is None or view.blur_px > MAX_BLUR_PX:
            return False
        place = self._place(view)
        if any(np.abs(place - other).max() < NEW_SHARE * self.size[0] for other in self._places):
            return False
        self.views.append(view)
        self._places.append(place)
        return True

    def _place(self, view: SheetView) -> np.ndarray:
        """Where the sheet's four corners are (4, 2) px, seen or not."""
        width, height = self._sheet.size_m
        corners = np.array([[(0, 0), (width, 0), (width, height), (0, height)]], np.float64)
        to_image, _ = cv2.findHomography(view.points_m[:, :2], view.corners_px)
        return cv2.perspectiveTransform(corners, to_image)[0]

    def _sample(self, image: np.ndarray) -> None:
        """Keep frames at growing distances: about SAMPLES of any number."""
        if self.seen % self._every == 0:
            self.samples.append(image)
        if len(self.samples) >= 2 * SAMPLES:
            self.samples, self._every = self.samples[::2], 2 * self._every


def pick(
    frames: Iterable[Frame],
    sheet: Sheet,
    *,
    most: int,
    seconds: float | None = None,
    show: Callable[[ViewPicker, Frame, bool], None] = lambda picker, frame, kept: None,
) -> ViewPicker:
    """Pick pictures of the sheet from frames, and return the picker that holds them.

    Ends with `most` pictures, with the frames, or (live: seconds not None) when `seconds` have gone
    or enough was seen. show: called with picker, frame, and whether the frame was kept.
    """
    picker, start = ViewPicker(sheet, most), monotonic()
    for frame in frames:
        show(picker, frame, picker.look(frame))
        if picker.complete:
            break
        if seconds is not None and (picker.enough or monotonic() - start > seconds):
            break
    return picker
