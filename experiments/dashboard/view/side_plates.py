"""The map of disagreement on the plate, and the plates of two models behind the table."""

from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.dashboard.view.grid import LETTERS
from experiments.dashboard.view.scene import PlateModel
from experiments.gap.closed_loop_replay import TableMotion
from rig.parameters import Rig

if TYPE_CHECKING:
    from viser import ClientHandle, ViserServer

BEHIND = {"before": (-0.225, 0.37, 0.03), "after": (0.075, 0.37, 0.03)}
WORDS = {"before": "model before", "after": "model after"}
LOW, HIGH = np.array([255.0, 245.0, 200.0]), np.array([150.0, 0.0, 60.0])
CELL_PX = 8
MAP, MAP_LEGEND = "/table/plate/map", "/table/plate/map_legend"  # nodes of the scene


def map_image(plate_map: tuple[np.ndarray, np.ndarray, np.ndarray]) -> np.ndarray:
    """Map of disagreement as an image (CELL_PX m, CELL_PX n, 4) uint8 RGBA, seen from above, x to
    the right, y up.

    plate_map: as `GapAnswer.plate_map`, sizes (m, n) in noise floors; the largest is darkest, a
    cell without data transparent.
    """
    size = plate_map[2][::-1]  # rows of an image go down
    known = np.isfinite(size)
    top = max(1.0, float(size[known].max())) if known.any() else 1.0
    part = np.where(known, size, 0.0)[..., None] / top
    image = np.zeros((*size.shape, 4), np.uint8)
    image[..., :3] = LOW + part * (HIGH - LOW)
    image[..., 3] = np.where(known, 215, 0)
    return np.kron(image, np.ones((CELL_PX, CELL_PX, 1), np.uint8))


def off_words(seen_m: np.ndarray, told_m: np.ndarray) -> str:
    """Distance [mm] of a model's ball told_m (2,) from the recorded one seen_m (2,), in words."""
    far_mm = 1e3 * float(np.hypot(*(np.asarray(told_m) - np.asarray(seen_m))))
    return f"{far_mm:.0f} mm from the ball" if np.isfinite(far_mm) else "no ball"


class PlateMap:
    """The map of disagreement on the table's plate, for all pages (`server`) or one of them."""

    def __init__(self, server: "ViserServer | ClientHandle") -> None:
        self._scene = server.scene
        self._parts: list[Any] = []

    def show(self, plate_map: tuple[np.ndarray, np.ndarray, np.ndarray] | None) -> None:
        """Lay a map (`GapAnswer.plate_map`) on the plate; None takes it away."""
        for old in self._parts:
            old.remove()
        self._parts = []
        if plate_map is None or not np.isfinite(plate_map[2]).any():
            return
        x, y, size = plate_map
        at = (float(x[0] + x[-1]) / 2, float(y[0] + y[-1]) / 2, 0.0004)
        image = self._scene.add_image(
            MAP,
            map_image(plate_map),
            float(np.ptp(x)),
            float(np.ptp(y)),
            format="png",
            position=at,
            wxyz=(0.0, 1.0, 0.0, 0.0),
            cast_shadow=False,
        )
        legend = self._scene.add_label(
            MAP_LEGEND,
            f"model's error, at the darkest {float(np.nanmax(size)):.1f} x the noise",
            position=(0, -float(np.ptp(y)) / 2 - 0.02, 0.0),
            font_screen_scale=LETTERS,
            anchor="top-center",
        )
        self._parts = [image, legend]


class SidePlates:
    """Two small plates behind the table, with the models before and after naming, on one page."""

    def __init__(self, client: "ClientHandle", rig: Rig) -> None:
        self._plates = {
            name: PlateModel(client, f"/{name}", rig, at=at, ghost=True)
            for name, at in BEHIND.items()
        }
        self._labels: list[Any] = []
        for name in BEHIND:
            self._labels.append(
                client.scene.add_label(
                    f"/{name}/label", WORDS[name], position=(0, 0.16, 0.03), anchor="bottom-center"
                )
            )

    @property
    def names(self) -> list[str]:
        """The plates' nodes of the scene."""
        return [plate.name for plate in self._plates.values()]

    def draw(self, seen: np.ndarray, models: tuple[TableMotion, TableMotion], t_s: float) -> None:
        """Pose both models as they were at `t_s` of the film, beside the ball that was `seen` (2,)
        [m]."""
        for (name, plate), label, motion in zip(
            self._plates.items(), self._labels, models, strict=True
        ):
            theta, ball, _ = motion.at(t_s)
            plate.pose(theta, ball)
            text = f"{WORDS[name]}: {off_words(seen, ball)}"
            if label.text != text:
                label.text = text
