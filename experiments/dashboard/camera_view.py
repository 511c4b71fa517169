"""The camera in the scene and beside the curves: its frustum over the plate, the newest image."""

from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.dashboard.pose import quaternion

if TYPE_CHECKING:
    from viser import ViserServer

SMALL = (320, 240)


class CameraView:
    """Hidden until the box is ticked or a run's video is there. Images are RGB (h, w, 3)."""

    def __init__(self, server: "ViserServer") -> None:
        from vision.synthetic import virtual_view

        self._server, view = server, virtual_view()
        world_from_camera = np.linalg.inv(view.camera_from_plate)
        height, f = view.camera.height_px, float(view.camera.matrix[1, 1])
        self._frustum: Any = server.scene.add_camera_frustum(
            "/camera", 2 * np.arctan(0.5 * height / f), view.camera.width_px / height, scale=0.035,
            thickness=0.0015, color=(90, 98, 110), wxyz=quaternion(world_from_camera[:3, :3]),
            position=tuple(0.55 * world_from_camera[:3, 3]), visible=False, cast_shadow=False,
        )  # fmt: skip
        self._box: Any = None
        self._image: Any = None
        self._words: Any = None

    def add_widgets(self) -> None:
        """The box and the image, in the container that is open."""
        gui = self._server.gui
        gui.add_markdown(
            "What the camera sees at the measured pose, and what the tracker makes of it."
        )
        self._box = gui.add_checkbox("Look through the virtual camera", False)
        self._words = gui.add_markdown("")
        blank = np.full((*SMALL[::-1], 3), 128, np.uint8)
        self._image = gui.add_image(blank, format="jpeg", visible=False)

    @property
    def wanted(self) -> bool:
        return self._box.value is True

    def look(self, wanted: bool) -> None:
        """Tick the box."""
        self._box.value = wanted

    def show(self, image: np.ndarray, words: str) -> None:
        """The newest image and what is said of it."""
        if not self._frustum.visible:
            self._frustum.visible = self._image.visible = True
        self._frustum.image = image
        self._image.image = image
        self._words.content = words

    def wait(self) -> None:
        """Nothing has been seen yet."""
        if not self._frustum.visible and not self._words.content:
            self._words.content = "*The camera starts: a few seconds.*"

    def hide(self) -> None:
        """There is nothing to be seen."""
        if self._words.content:
            self._frustum.visible = self._image.visible = False
            self._words.content = ""
