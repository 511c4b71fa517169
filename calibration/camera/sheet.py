"""The printed ChArUco sheet, and where its corners are seen in pictures."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from math import inf, nan

import cv2
import numpy as np

from calibration.camera.sharpness import edge_blur_px
from vision.plate.markers import dictionary_of

MIN_CORNERS = 12


class CalibrationError(ValueError):
    """The measurements do not determine the numbers well enough; the message says what to do."""


@dataclass(frozen=True)
class Sheet:
    """A printed ChArUco board of `columns` x `rows` squares. The default fits on A4.

    `ValueError`: markers not smaller than the squares, under 3x3 squares, an unknown dictionary, or
    one that holds too few markers.
    """

    columns: int = 11
    rows: int = 8
    square_m: float = 0.024
    marker_m: float = 0.018
    dictionary: str = "DICT_5X5_50"

    def __post_init__(self) -> None:
        if not 0 < self.marker_m < self.square_m < inf:
            raise ValueError(
                f"the sheet's markers ({1e3 * self.marker_m:g} mm) must be smaller than its "
                f"squares ({1e3 * self.square_m:g} mm) and larger than 0"
            )
        if min(self.columns, self.rows) < 3:
            raise ValueError(f"a sheet of {self.columns}x{self.rows} squares: 3x3 is the smallest")
        markers = self.columns * self.rows // 2
        held = len(dictionary_of(self.dictionary).bytesList)
        if markers > held:
            raise ValueError(
                f"{self.columns}x{self.rows} squares need {markers} markers, {self.dictionary} "
                f"holds {held}: take a larger dictionary"
            )

    @property
    def size_m(self) -> tuple[float, float]:
        """Width and height [m] of the printed area."""
        return self.columns * self.square_m, self.rows * self.square_m

    @cached_property
    def board(self) -> cv2.aruco.CharucoBoard:
        """OpenCV's ChArUco board of this sheet, in metres."""
        book = dictionary_of(self.dictionary)
        size = (self.columns, self.rows)
        return cv2.aruco.CharucoBoard(size, self.square_m, self.marker_m, book)

    def image(self, px_per_square: int = 140) -> np.ndarray:
        """The print (h, w) uint8 without margin, `px_per_square` pixels for each square."""
        size = (self.columns * px_per_square, self.rows * px_per_square)
        return np.asarray(self.board.generateImage(size, marginSize=0, borderBits=1))


@dataclass(frozen=True, eq=False)
class SheetView:
    """Corners of the sheet seen in picture `index`: `points_m` (n, 3) on the sheet [m],
    `corners_px` (n, 2).

    `blur_px`: standard deviation of the edges' blur [px]; `marker_share`: the markers' side over
    the squares' side as seen. NaN: not measured.
    """

    index: int
    points_m: np.ndarray
    corners_px: np.ndarray
    blur_px: float = nan
    marker_share: float = nan


def find_sheet(images: Iterable[np.ndarray], sheet: Sheet) -> list[SheetView]:
    """The sheet in each picture (h, w[, 3]) uint8, with the picture's index; pictures with under 12
    corners are left out."""
    views = (sheet_view(image, sheet, index) for index, image in enumerate(images))
    return [view for view in views if view is not None]


def sheet_view(image: np.ndarray, sheet: Sheet, index: int = 0) -> SheetView | None:
    """The sheet in one picture `image` (h, w[, 3]) uint8, with the blur of its edges and the share
    of its markers; None with under 12 corners. `index`: the picture's number, kept in the view.
    """
    grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    detector = cv2.aruco.CharucoDetector(sheet.board)
    corners, ids, marker_corners, marker_ids = detector.detectBoard(grey)
    if ids is None or np.size(ids) < MIN_CORNERS:
        return None
    corners = np.asarray(corners, np.float32).reshape(-1, 2)
    points, pixels = sheet.board.matchImagePoints(  # type: ignore[call-overload]
        corners,  # pyright: ignore (the stub knows marker lists only)
        np.asarray(ids).reshape(-1),
    )
    points = np.asarray(points, np.float32).reshape(-1, 3)
    pixels = np.asarray(pixels, np.float32).reshape(-1, 2)
    share = _marker_share(points, pixels, _refined(grey, marker_corners), marker_ids, sheet)
    blur = edge_blur_px(grey, np.rint(points[:, :2] / sheet.square_m).astype(int), pixels)
    return SheetView(index, points, pixels, blur, share)


def _refined(grey: np.ndarray, marker_corners) -> np.ndarray:
    """The markers' corners (k, 4, 2) px to a fraction of a pixel: their outlines lie inside."""
    corners = np.asarray(marker_corners, np.float32).reshape(-1, 1, 2)
    if len(corners):
        criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 20, 0.02)
        corners = cv2.cornerSubPix(grey, corners.copy(), (3, 3), (-1, -1), criteria)
    return np.asarray(corners).reshape(-1, 4, 2)


def _marker_share(points, pixels, marker_corners, marker_ids, sheet: Sheet) -> float:
    """Median side of the markers over the side of a square, both as printed: the plane is seen
    through the four chessboard corners around each marker, so the lens hardly matters."""
    place = {tuple(np.rint(p[:2] / sheet.square_m).astype(int)): i for i, p in enumerate(points)}
    ids = [] if marker_ids is None else np.asarray(marker_ids).reshape(-1)
    board_ids = np.asarray(sheet.board.getIds()).reshape(-1).tolist()
    objects = sheet.board.getObjPoints()
    shares = []
    for number, corners in zip(ids, marker_corners, strict=True):
        if number not in board_ids:
            continue
        centre = np.asarray(objects[board_ids.index(int(number))]).reshape(-1, 3).mean(axis=0)
        column, row = np.floor(centre[:2] / sheet.square_m).astype(int).tolist()
        around = [(column, row), (column + 1, row), (column + 1, row + 1), (column, row + 1)]
        if not all(key in place for key in around):
            continue
        seen = pixels[[place[key] for key in around]]
        square = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], np.float32)
        to_square = cv2.getPerspectiveTransform(seen.astype(np.float32), square)
        flat = cv2.perspectiveTransform(np.asarray(corners, np.float32).reshape(1, 4, 2), to_square)
        sides = np.linalg.norm(np.diff(flat[0], axis=0, append=flat[0, :1]), axis=1)
        shares.append(float(sides.mean()))
    return float(np.median(shares)) if shares else nan
