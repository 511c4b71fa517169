"""What others do, written plainly from their public descriptions: each takes an image (h, w, 3)
uint8 BGR and the ball's radius in px and gives (u, v) or None. All look for an orange ball.
"""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec

import cv2
import numpy as np

LOW, HIGH = np.array((3, 110, 25), np.uint8), np.array((22, 255, 255), np.uint8)


def tutorial(image: np.ndarray, _radius_px: float) -> tuple[float, float] | None:
    """The usual tutorial: blur, HSV range, erode, dilate, largest contour, enclosing circle."""
    hsv = cv2.cvtColor(cv2.GaussianBlur(image, (11, 11), 0), cv2.COLOR_BGR2HSV)
    mask = cv2.inRange(hsv, LOW, HIGH)
    kernel = np.ones((3, 3), np.uint8)
    mask = cv2.dilate(cv2.erode(mask, kernel, iterations=2), kernel, iterations=2)
    contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    if not contours:
        return None
    (u, v), radius = cv2.minEnclosingCircle(max(contours, key=cv2.contourArea))
    return (u, v) if radius > 10 else None


def moments(image: np.ndarray, _radius_px: float) -> tuple[float, float] | None:
    """HSV range, largest contour, centre of its area."""
    mask = cv2.inRange(cv2.cvtColor(image, cv2.COLOR_BGR2HSV), LOW, HIGH)
    contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    if not contours:
        return None
    m = cv2.moments(max(contours, key=cv2.contourArea))
    return (m["m10"] / m["m00"], m["m01"] / m["m00"]) if m["m00"] > 100 else None


def hough(image: np.ndarray, radius_px: float) -> tuple[float, float] | None:
    """HoughCircles on the median-blurred grey image, told the radius to 20 %: the best circle."""
    grey = cv2.medianBlur(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), 5)
    found = cv2.HoughCircles(
        grey,
        cv2.HOUGH_GRADIENT,
        1.0,
        minDist=radius_px,
        param1=100,
        param2=20,
        minRadius=round(0.8 * radius_px),
        maxRadius=round(1.2 * radius_px),
    )
    if found is None:
        return None
    u, v = np.asarray(found).reshape(-1, np.asarray(found).shape[-1])[0, :2]
    return float(u), float(v)


def trackpy(image: np.ndarray, radius_px: float) -> tuple[float, float] | None:
    """trackpy.locate of the brightest feature of the inverted blue channel above what is usual in
    it, diameter 2.8 R: as kind to it as we could be."""
    dark = 255 - image[:, :, 0].astype(int)
    seen = np.clip(dark - np.median(dark[dark > 0]) - 15, 0, 255).astype(np.uint8)
    size = 2 * round(1.4 * radius_px) + 1
    found = import_module("trackpy").locate(seen, size, topn=1, preprocess=False, max_iterations=60)
    return (float(found.x.iloc[0]), float(found.y.iloc[0])) if len(found) else None


PEERS = {
    "tutorial: HSV, blur, contour, enclosing circle": tutorial,
    "HSV, contour moments": moments,
    "HoughCircles": hough,
}
if find_spec("trackpy"):
    PEERS["trackpy"] = trackpy
