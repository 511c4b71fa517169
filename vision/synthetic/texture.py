"""What do the plate with its markers and the desk below it look like, before lens and light?"""

import cv2
import numpy as np

from vision.plate.markers import MarkerLayout, dictionary_of

TEXELS = 1100  # along the plate's side: about 2.7 a pixel, so bilinear sampling adds no steps
PADDING = 10  # transparent texels around the plate
_FINER = 4


def _grain(rng: np.random.Generator, size: int, scales: tuple[tuple[int, float], ...]):
    """Sum of smooth random fields (size, size): pairs of (feature in texels, amplitude)."""
    field = np.zeros((size, size), np.float32)
    for feature, amplitude in scales:
        coarse = rng.standard_normal((size // feature + 4,) * 2).astype(np.float32)
        field += amplitude * cv2.resize(coarse, (size, size), interpolation=cv2.INTER_CUBIC)
    return field


def plate_from_texel(plate_side_m: float) -> np.ndarray:
    """Homography (3, 3): texel centre (column, row, 1) -> plate (x, y, 1) [m]; row 0 lies at +y."""
    texel = plate_side_m / TEXELS
    middle = (TEXELS + 2 * PADDING - 1) / 2
    return np.array([[texel, 0, -texel * middle], [0, -texel, texel * middle], [0, 0, 1.0]])


def _ink(layout: MarkerLayout, plate_side_m: float) -> np.ndarray:
    """Share of each texel that is printed black, exact to a quarter texel at any angle."""
    size = TEXELS + 2 * PADDING
    dictionary = dictionary_of(layout.dictionary)
    modules = dictionary.markerSize + 2
    cell = 32
    to_texel = np.linalg.inv(plate_from_texel(plate_side_m))
    ink = np.zeros((size, size), np.float32)
    square = cell * modules * np.array([(0, 0), (1, 0), (1, 1), (0, 1)], np.float32) - 0.5
    for marker, corners in zip(layout.ids, layout.corners_m, strict=True):
        printed = 255 - cv2.aruco.generateImageMarker(dictionary, int(marker), cell * modules)
        texels = np.column_stack((corners, np.ones(4))) @ to_texel.T
        low = np.floor(texels[:, :2].min(0)).astype(int) - 2
        high = np.ceil(texels[:, :2].max(0)).astype(int) + 3
        if low.min() < 0 or high.max() > size:
            raise ValueError(f"marker {marker} lies outside the plate of {plate_side_m} m")
        fine = _FINER * (texels[:, :2] - low + 0.5) - 0.5
        warp = cv2.getPerspectiveTransform(square, fine.astype(np.float32))
        width, height = ((high - low) * _FINER).tolist()
        drawn = cv2.warpPerspective(printed, warp, (width, height), flags=cv2.INTER_LINEAR)
        patch = cv2.resize(drawn, (width // _FINER, height // _FINER), interpolation=cv2.INTER_AREA)
        ink[low[1] : high[1], low[0] : high[0]] += patch.astype(np.float32) / 255
    return ink


def plate_texture(
    layout: MarkerLayout,
    plate_side_m: float,
    plate_bgr: tuple[float, float, float],
    blur_texels: float,
    rng: np.random.Generator,
) -> np.ndarray:
    """The plate as premultiplied BGRA (n, n, 4) uint8, n = TEXELS + 2 PADDING, blurred by the lens
    and a pixel's area (standard deviation `blur_texels`).

    `plate_bgr`: colour of the plate, 0..255; `rng`: for the grain. `ValueError`: a marker lies off
    the plate.
    """
    size = TEXELS + 2 * PADDING
    shade = 1.0 + _grain(rng, size, ((280, 0.008), (40, 0.004), (3, 0.006)))
    colour = shade[..., None] * np.asarray(plate_bgr, np.float32)
    _print_target(colour, plate_side_m)
    ink = _ink(layout, plate_side_m)[..., None]
    colour = colour * (1 - ink) + np.array((38, 36, 36), np.float32) * ink
    alpha = np.zeros((size, size, 1), np.float32)
    alpha[PADDING:-PADDING, PADDING:-PADDING] = 255
    rim = cv2.erode(alpha, np.ones((9, 9)))[..., None]  # a bevel: the edge catches less light
    colour *= np.where(rim > 0, 1.0, 0.86).astype(np.float32)
    texture = np.concatenate((colour * (alpha / 255), alpha), axis=2)
    texture = cv2.GaussianBlur(texture, (0, 0), blur_texels)
    return np.clip(np.rint(texture), 0, 255).astype(np.uint8)


def _print_target(colour: np.ndarray, plate_side_m: float) -> None:
    """A pale cross and two rings, as a lab would print them (in place)."""
    middle, scale = (colour.shape[0] - 1) / 2, TEXELS / plate_side_m
    faint = np.ones(colour.shape[:2], np.float32)
    centre = (round(16 * middle), round(16 * middle))
    for radius_m in (0.05, 0.1):
        cv2.circle(faint, centre, round(16 * radius_m * scale), (0.93,), 3, cv2.LINE_AA, 4)
    arm, c = round(0.1 * scale), round(middle)
    cv2.line(faint, (c - arm, c), (c + arm, c), (0.93,), 3)
    cv2.line(faint, (c, c - arm), (c, c + arm), (0.93,), 3)
    colour *= faint[..., None]


def desk_picture(
    points_m: np.ndarray,
    plate_side_m: float,
    desk_bgr: tuple[float, float, float],
    light: np.ndarray,
    drop_m: float,
    rng: np.random.Generator,
) -> np.ndarray:
    """The desk's colours BGR (h, w, 3) float32 at its places `points_m` (h, w, 2): wood grain along
    x and the plate's soft shadow.

    `desk_bgr`: mean colour, 0..255; `light` (3,) points to the lamp; `drop_m`: how far the desk
    lies below the plate; `rng`: for the grain.
    """
    x, y = points_m[..., 0].astype(np.float32), points_m[..., 1].astype(np.float32)
    h, w = x.shape
    wobble = cv2.resize(
        rng.standard_normal((6, 8)).astype(np.float32), (w, h), interpolation=cv2.INTER_CUBIC
    )
    rings = np.sin(2 * np.pi * (y * 55 + 0.6 * wobble + 0.8 * np.sin(x * 9)))
    fibres = cv2.GaussianBlur(
        rng.standard_normal((h, w)).astype(np.float32), (0, 0), 14, sigmaY=0.8
    )
    shade = 1 + 0.05 * rings + 0.35 * fibres + 0.03 * wobble
    fall = drop_m / light[2]
    away = [np.abs(x + light[0] * fall), np.abs(y + light[1] * fall)]
    over = [np.clip((plate_side_m / 2 + 0.02 - a) / 0.04, 0, 1) for a in away]
    shadow = over[0] * over[1]
    shade = shade * (1 - 0.45 * shadow * (2 - shadow))
    return shade[..., None] * np.asarray(desk_bgr, np.float32)
