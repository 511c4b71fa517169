"""Calibration pictures with a known camera, good ones and ones with a fault planted in them."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import cv2
import numpy as np

from calibration.camera.lens import CameraCalibration, calibrate_camera, calibrate_images
from calibration.camera.plate import level_pose
from calibration.camera.sheet import Sheet, SheetView
from calibration.camera.virtual import sheet_poses
from vision.plate.markers import default_layout
from vision.synthetic.synthetic import Renderer, Scene, virtual_camera, virtual_view
from vision.view import Camera, View

SHEET, SIZE = Sheet(), (640, 480)
Project = Callable[[np.ndarray], np.ndarray]


def field_of(camera: Camera) -> tuple[float, float]:
    fx, fy, _, _ = camera.pinhole
    return camera.width_px / fx, camera.height_px / fy


def seen_views(
    camera: Camera,
    seed: int,
    *,
    sheet: Sheet = SHEET,
    count: int = 20,
    noise_px: float = 0.05,
    bow_m: float = 0.0,
    flat: bool = False,
    project: Project | None = None,
    distance_m: float = 0.75,
) -> list[SheetView]:
    """What a perfect finder would see: exact projections plus noise.

    `bow_m` lifts the sheet's left and right sides, `flat` holds it parallel to the sensor,
    `project` is another lens than the camera's: normalised (n, 2) -> px.
    """
    rng = np.random.default_rng([seed, 11])
    points = np.asarray(sheet.board.getChessboardCorners(), float).reshape(-1, 3)
    bent = points.copy()
    bent[:, 2] += bow_m * (2 * points[:, 0] / sheet.size_m[0] - 1) ** 2
    lens = project or camera.pixel_from_ray
    size, views = np.array([camera.width_px, camera.height_px]), []
    for index, pose in enumerate(sheet_poses(sheet, field_of(camera), distance_m, count, rng)):
        turn = np.eye(3) if flat else pose[:3, :3]
        place = bent @ turn.T + pose[:3, 3]
        uv = lens(place[:, :2] / place[:, 2:]) + rng.normal(0, noise_px, (len(points), 2))
        inside = np.all((uv > 3) & (uv < size - 4), axis=1)
        if inside.sum() >= 12:
            views.append(SheetView(index, points[inside].astype("f4"), uv[inside].astype("f4")))
    return views


def random_camera(seed: int) -> Camera:
    """640x480 or 1280x720, 25 to 60 degrees wide, barrel or pincushion."""
    rng = np.random.default_rng([seed, 12])
    width, height = ((640, 480), (1280, 720))[int(rng.integers(2))]
    focal = width / 2 / np.tan(np.radians(rng.uniform(25, 60)) / 2)
    middle = np.array([width, height]) / 2 - 0.5 + rng.uniform(-12, 12, 2)
    matrix = np.array([[focal, 0, middle[0]], [0, focal * rng.uniform(0.997, 1.003), middle[1]],
                       [0, 0, 1]])  # fmt: skip
    k1 = rng.uniform(-0.25, 0.1)
    lens = (k1, rng.uniform(-0.02, 0.1), *rng.uniform(-8e-4, 8e-4, 2), 0.0)
    return Camera(matrix, np.array(lens), width, height)


def distance_for(camera: Camera, side_m: float = 0.29) -> float:
    """How far away the plate fills the picture's height."""
    return side_m * camera.pinhole[1] / camera.height_px


def good_set(seed: int) -> CameraCalibration:
    """A careful set with any camera of `random_camera`."""
    camera = random_camera(seed)
    rng = np.random.default_rng([seed, 13])
    noise_px, count = rng.uniform(0.03, 0.12), int(rng.integers(18, 32))
    distance_m = distance_for(camera)
    views = seen_views(camera, seed, count=count, noise_px=noise_px, distance_m=distance_m)
    return calibrate_camera(views, (camera.width_px, camera.height_px), distance_m=distance_m)


def shoot(renderer: Renderer, sheet: Sheet, pose: np.ndarray) -> np.ndarray:
    """One picture of the printed sheet with its white margin."""
    px, margin = 60, 60
    paper = np.pad(sheet.image(px), margin, constant_values=255)
    edge = sheet.square_m * margin / px
    corner = pose.copy()
    corner[:3, 3] -= pose[:3, :2] @ (edge, edge)
    size = (sheet.size_m[0] + 2 * edge, sheet.size_m[1] + 2 * edge)
    return renderer.render_sheet(paper, size, corner)


@cache
def renderer(seed: int = 0, blur_px: float = 0.45) -> Renderer:
    scene = Scene(lens_blur_px=blur_px)
    return Renderer(scene, virtual_view(), np.random.default_rng(seed))


@cache
def pictures(seed: int, sheet: Sheet = SHEET, count: int = 20, blur_px: float = 0.45) -> tuple:
    """Rendered pictures (480, 640, 3) of the sheet, held all over the image."""
    poses = sheet_poses(
        sheet, field_of(virtual_camera()), 0.75, count, np.random.default_rng([seed, 14])
    )
    return tuple(shoot(renderer(seed, blur_px), sheet, pose) for pose in poses)


def sheet_on_plate(seed: int, scale: float = 1.0) -> list[np.ndarray]:
    """Frames of the level plate with the sheet, printed `scale` times too large, lying on it."""
    truth, made = virtual_view(), renderer(seed)
    size = np.array(SHEET.size_m) * scale
    flip = np.diag([1.0, -1.0, -1.0, 1.0])
    flip[:2, 3] = -size[0] / 2, size[1] / 2
    pose = truth.camera_from_plate @ flip
    sheet = SHEET.image(60)
    return [made.render_sheet(sheet, (size[0], size[1]), pose) for _ in range(4)]


def fisheye(camera: Camera, focal_px: float) -> Project:
    """Equidistant: r = f theta."""

    def project(xy: np.ndarray) -> np.ndarray:
        r = np.linalg.norm(xy, axis=1, keepdims=True)
        _, _, cx, cy = camera.pinhole
        return focal_px * xy / r * np.arctan(r) + (cx, cy)

    return project


@dataclass(frozen=True)
class Fault:
    """A planted fault: `name` must stand in the refusal or warning of `make(seed)`."""

    title: str
    name: str
    make: Callable[[int], CameraCalibration | object]


def _calibrated(views: list[SheetView]) -> CameraCalibration:
    return calibrate_camera(views, SIZE)


def wrong_square_ratio(seed: int):
    return calibrate_images(pictures(seed), replace(SHEET, square_m=0.026))


def wrong_square_scale(seed: int):
    """Printed 3 % too small ("fit to page"): the lens cannot know, the plate under it does."""
    return level_pose(
        sheet_on_plate(seed, 0.97), virtual_camera(), default_layout(0.275), sheet=SHEET
    )


def wrong_square_in_set(seed: int):
    """A whole set with a print 3 % small, one picture of it lying on the plate."""
    shots = [*pictures(seed), sheet_on_plate(seed, 0.97)[0]]
    return calibrate_images(shots, SHEET, layout=default_layout(0.275))


def swapped_board(seed: int):
    return calibrate_images(pictures(seed, Sheet(8, 11)), SHEET)


def three_views(seed: int):
    return calibrate_images(pictures(seed)[:3], SHEET)


def no_tilt(seed: int):
    return _calibrated(seen_views(virtual_camera(), seed, flat=True, count=24))


def blur(seed: int):
    return calibrate_images(pictures(seed, SHEET, 20, 2.4), SHEET)


def shake(seed: int):
    """Every other picture smeared by 8 px along one direction."""
    kernel = np.full((1, 8), 1 / 8)
    images = [
        cv2.filter2D(image, -1, kernel) if i % 2 else image
        for i, image in enumerate(pictures(seed))
    ]
    return calibrate_images(images, SHEET)


def wrong_resolution(seed: int):
    """Half of the pictures at another size."""
    images = [cv2.resize(im, (320, 240)) if i % 2 else im for i, im in enumerate(pictures(seed))]
    return calibrate_images(images, SHEET)


def stretched(seed: int):
    """640x480 pictures stretched to 640x360, as a driver does for a wide format."""
    return calibrate_images([cv2.resize(image, (640, 360)) for image in pictures(seed)], SHEET)


def false_corners(seed: int):
    rng = np.random.default_rng([seed, 15])
    views = []
    for view in seen_views(virtual_camera(), seed):
        pixels = view.corners_px.copy()
        wrong = rng.random(len(pixels)) < 0.1
        pixels[wrong] += rng.uniform(3, 12, (wrong.sum(), 2)) * rng.choice(
            [-1, 1], (wrong.sum(), 2)
        )
        views.append(replace(view, corners_px=pixels))
    return _calibrated(views)


def moved_camera(seed: int):
    """The camera is knocked while the level plate is being looked at."""
    rng = np.random.default_rng([seed, 16])
    frames, layout = [], default_layout(0.275)
    for moved in (False, True):
        pose = virtual_view().camera_from_plate.copy()
        if moved:
            pose[:3, 3] += rng.choice([-1, 1], 3) * rng.uniform(0.0006, 0.002, 3)
        made = Renderer(Scene(), View(virtual_camera(), pose), rng)
        frames += [made.render(np.eye(3), None) for _ in range(3)]
    return level_pose(frames, virtual_camera(), layout)


def curled_board(seed: int):
    bow = np.random.default_rng([seed, 17]).uniform(0.0008, 0.003)
    return _calibrated(seen_views(virtual_camera(), seed, bow_m=bow))


def wrong_dictionary(seed: int):
    printed = replace(SHEET, dictionary="DICT_6X6_50")
    return calibrate_images(pictures(seed, printed), SHEET)


def mirrored_image(seed: int):
    images = [np.ascontiguousarray(image[:, ::-1]) for image in pictures(seed)]
    return calibrate_images(images, SHEET)


def wrong_lens_model(seed: int):
    """An equidistant fisheye of 110 to 130 degrees, taken for a lens with k1 and k2."""
    rng = np.random.default_rng([seed, 18])
    half = np.radians(rng.uniform(110, 130)) / 2
    focal = 320 / half
    pinhole = 320 / np.tan(half)  # the field that the poses must fill
    matrix = np.array([[pinhole, 0, 319.5], [0, pinhole, 239.5], [0, 0, 1]])
    camera = Camera(matrix, np.zeros(5), *SIZE)
    views = seen_views(
        camera, seed, project=fisheye(camera, focal), distance_m=0.2, sheet=SHEET, count=30
    )
    return calibrate_camera(views, SIZE, distance_m=0.2)


FAULTS = (
    Fault("wrong square size (ratio to the markers)", "wrong square size", wrong_square_ratio),
    Fault("wrong square size (whole print 3 % small)", "wrong square size", wrong_square_scale),
    Fault("wrong square size (the same in the set)", "wrong square size", wrong_square_in_set),
    Fault("swapped board", "swapped board", swapped_board),
    Fault("three views", "too few views", three_views),
    Fault("no tilt", "no tilt", no_tilt),
    Fault("blur (out of focus)", "blur", blur),
    Fault("blur (shaken, every other picture)", "blur", shake),
    Fault("wrong resolution (mixed)", "wrong resolution", wrong_resolution),
    Fault("wrong resolution (stretched)", "wrong resolution", stretched),
    Fault("10 % false corners", "false corners", false_corners),
    Fault("moved camera", "moved camera", moved_camera),
    Fault("curled board", "curled board", curled_board),
    Fault("wrong dictionary", "wrong dictionary", wrong_dictionary),
    Fault("mirrored image", "mirrored image", mirrored_image),
    Fault("wrong lens model", "wrong lens model", wrong_lens_model),
)


def verdict(fault: Fault, seed: int) -> tuple[str, str]:
    """("refused" | "warned" | "passed", what was said)."""
    try:
        found = fault.make(seed)
    except ValueError as error:
        return "refused", str(error)
    said = " / ".join(getattr(found, "warnings", ()))
    return ("warned" if said else "passed"), said
