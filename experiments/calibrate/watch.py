"""A lens in the making: what is covered and how it would fit, drawn anew as pictures come."""

import time
from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np

from calibration.camera.lens_fit import solve
from calibration.camera.sheet import CalibrationError, Sheet, SheetView, sheet_view
from experiments.calibrate.pictures import coverage_picture
from experiments.picture_files import write_image

FIT_FROM = 6  # pictures
EVERY_S = 0.4
WIDE, HIGH = 640, 260
_BAR, _WORST, _INK, _PAPER = (216, 79, 31), (60, 60, 200), (60, 60, 60), (250, 250, 250)
COVERED, RESIDUALS = "coverage.png", "residuals.png"


class Growing:
    """Pictures of a lens calibration in the making, drawn at most every EVERY_S seconds.

    coverage.png: the newest frame with the cells that are covered; residuals.png: rms of each
    picture kept with a lens fitted to those so far. `shown` is called with the paths of both in
    `folder`.
    """

    def __init__(self, folder: Path, sheet: Sheet, shown: Callable[[list[Path]], None]) -> None:
        self._folder, self._sheet, self._shown = folder, sheet, shown
        self._views: list[SheetView] = []
        self._drawn_s, self._fitted = 0.0, 0
        (folder / RESIDUALS).unlink(missing_ok=True)  # of another set

    def add(self, image: np.ndarray) -> None:
        """Add the picture `image` (h, w[, 3]) uint8 to the set, if it shows the sheet, and draw.
        OSError: as of `look`.
        """
        view = sheet_view(image, self._sheet, len(self._views))
        if view is not None:
            self._views.append(view)
        self.look(image, self._views)

    def look(self, image: np.ndarray, views: Sequence[SheetView]) -> None:
        """Draw the newest frame `image` (h, w[, 3]) uint8 with the views kept so far, and tell
        `shown`; nothing within EVERY_S of the last time. OSError: a picture cannot be written.
        """
        now_s = time.monotonic()
        if now_s - self._drawn_s < EVERY_S:
            return
        self._drawn_s = now_s
        size = image.shape[1], image.shape[0]
        pictures = [coverage_picture(views, size, self._folder / COVERED, over=image)]
        if len(views) >= FIT_FROM and len(views) != self._fitted:
            self._fitted = len(views)
            pictures += self._fit(views, size)
        elif (self._folder / RESIDUALS).is_file():
            pictures.append(self._folder / RESIDUALS)
        self._shown(pictures)

    def _fit(self, views: Sequence[SheetView], size: tuple[int, int]) -> list[Path]:
        try:
            fit = solve(views, size)
        except CalibrationError:  # too much alike yet
            return []
        focal_px = fit.camera.pinhole[0]
        words = f"{len(views)} pictures: rms {fit.rms_px:.3f} px, focal length {focal_px:.1f} px"
        return [residual_picture(fit.view_rms_px, words, self._folder / RESIDUALS)]


def residual_picture(rms_px: np.ndarray, words: str, path: Path) -> Path:
    """Draw the rms rms_px (n,) of each picture as a bar, the largest in red: PNG.

    words: the title. Returns `path`. OSError: it cannot be written.
    """
    image = np.full((HIGH, WIDE, 3), _PAPER, np.uint8)
    top = max(0.1, 1.25 * float(rms_px.max()))
    base, left, wide = HIGH - 34, 52, (WIDE - 64) / max(len(rms_px), 10)
    for i, value in enumerate(rms_px):
        low = round(left + i * wide), base - round((base - 40) * float(value) / top)
        colour = _WORST if value == rms_px.max() else _BAR
        cv2.rectangle(image, low, (round(left + (i + 0.8) * wide), base), colour, -1)
    for share in (0.0, 0.5, 1.0):
        at = base - round((base - 40) * share)
        cv2.line(image, (left - 4, at), (WIDE - 8, at), (220, 220, 220), 1)
        _write(image, f"{share * top:.2f}", (6, at + 4))
    _write(image, words, (left, 22))
    _write(image, "rms of each picture [px]", (left, HIGH - 10))
    return write_image(image, path)


def _write(image: np.ndarray, text: str, at: tuple[int, int]) -> None:
    cv2.putText(image, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.48, _INK, 1, cv2.LINE_AA)
