"""The camera in the scene and beside the curves: its frustum over the plate, the newest image."""

from base64 import b64encode
from contextlib import suppress
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.dashboard.server.controls import Controls
from experiments.dashboard.server.input_limits import flag
from experiments.dashboard.view.elapsed import Elapsed
from experiments.dashboard.view.pose import quaternion
from rig.log import INDEX, shown_angles
from rig.parameters import Rig

if TYPE_CHECKING:
    from viser import ClientHandle, ViserServer

    from vision.view import View

_BALL = INDEX["ball_x_m"]
CAMERA_WORDS = "What the table's camera sees, and what the tracker makes of it."
NO_FILM = "This replay has no video."
NO_VIDEO = "This run's video is not there yet: the tab Replay says how far it is."
RESTS = "The camera is off while the table rests."
NO_CAMERA_WORDS = (
    "The rig file names no camera (table.camera): what is shown is drawn at the measured pose."
)


def view_of(rig: Rig, *, real: bool) -> "View":
    """View of the camera that is drawn: as calibrated, where a real table's rig names a readable
    calibration, else that of the virtual camera over the rig's plate.
    """
    from calibration.bundle import load
    from vision.synthetic.synthetic import virtual_view

    if real and rig.table.calibration:
        with suppress(OSError, ValueError):
            return load(rig.table.calibration).view
    return virtual_view(plate_side_m=rig.linkage.side_m)


class CameraPicture:
    """A camera in the 3-D view and its newest image, hidden until one is shown; for all pages
    (`server`), or one of them.

    real: the camera is that of the real table `rig`, else the virtual one over such a plate.
    """

    def __init__(self, server: "ViserServer | ClientHandle", rig: Rig, *, real: bool) -> None:
        self._server, view = server, view_of(rig, real=real)
        world_from_camera = np.linalg.inv(view.camera_from_plate)
        height, f = view.camera.height_px, float(view.camera.matrix[1, 1])
        self._frustum: Any = server.scene.add_camera_frustum(
            "/camera",
            2 * np.arctan(0.5 * height / f),
            view.camera.width_px / height,
            scale=0.035,
            thickness=0.0015,
            color=(90, 98, 110),
            wxyz=quaternion(world_from_camera[:3, :3]),
            position=tuple(0.55 * world_from_camera[:3, 3]),
            visible=False,
            cast_shadow=False,
        )
        self.jpeg = b""  # the image that is shown, for the big view
        self._waits: Elapsed | None = None
        self._picture: Any = None  # image and words: one widget, so that they are of one frame

    @property
    def handles(self) -> list[Any]:
        """The widgets in the panel."""
        return [self._picture]

    def add_picture(self) -> None:
        """Build the image and its words in the GUI container of viser that is open."""
        self._picture = self._server.gui.add_html("")

    def show(self, image: np.ndarray, words: str) -> None:
        """Show an image (h, w, 3) uint8 RGB and below it `words`, of the same frame."""
        import cv2

        self._waits = None
        if not self._frustum.visible:
            self._frustum.visible = True
        self._frustum.image = image
        coded = cv2.imencode(".jpg", np.ascontiguousarray(image[:, :, ::-1]))[1]
        self.jpeg = coded.tobytes()
        data = b64encode(self.jpeg).decode()
        self._picture.content = (
            f'<div class="rig-live" style="padding: 0 0.6em; font-size: 0.9em">'
            f'<img style="width: 100%" alt="" src="data:image/jpeg;base64,{data}">'
            f"<p>{escape(words)}</p></div>"
        )

    def wait(self) -> None:
        """Say that the camera starts, where nothing was shown yet."""
        if self._frustum.visible or (self._picture.content and self._waits is None):
            return
        self._waits = self._waits or Elapsed()
        self._write(
            f"The camera starts, {self._waits.seconds} s so far: some seconds, the first time on "
            "this machine some minutes."
        )

    def hide(self, words: str = "") -> None:
        """Take the image away and show `words`, the reason, in its place."""
        self._waits = None
        self._write(words)

    def _write(self, words: str) -> None:
        text = f'<p style="padding: 0 0.6em; font-size: 0.9em">{escape(words)}</p>' if words else ""
        self.jpeg = b""
        if self._picture.content != text:
            self._frustum.visible = False
            self._picture.content = text


class CameraView(CameraPicture):
    """The live table's camera: its image is shown once a page asks for it by the box *Look through
    the camera*; arguments as of `CameraPicture`.
    """

    def __init__(self, server: "ViserServer", rig: Rig, *, real: bool) -> None:
        super().__init__(server, rig, real=real)
        self._real, self._own = real, real and bool(rig.table.camera)
        self._box: Any = None

    def add_widgets(self, controls: Controls) -> None:
        """Build the box, the image and its words in the GUI container of viser that is open."""
        gui = self._server.gui
        kind = "table's" if self._own else "virtual"
        gui.add_markdown(
            "What the camera sees at the measured pose, and what the tracker makes of it."
            if not self._real
            else CAMERA_WORDS
            if self._own
            else NO_CAMERA_WORDS
        )
        self._box = gui.add_checkbox(f"Look through the {kind} camera", False)
        self._wanted = controls.value(self._box, "camera", flag, everybody=True)
        self.add_picture()

    @property
    def wanted(self) -> bool:
        """Whether the box *Look through the camera* is ticked."""
        return self._wanted.now

    def set_wanted(self, wanted: bool) -> None:
        """Tick or clear the box *Look through the camera*."""
        self._box.value = self._wanted.now = wanted

    def follow(self, source: Any, row: np.ndarray | None, fresh: bool, *, ask: bool) -> None:
        """Show the newest image of `source`, a `VirtualCamera` or `RealCamera`, if the box is
        ticked.

        row (len(COLUMNS),): the loop's newest, None before the first; fresh: its ball was observed
        just now; ask: ask the source for another image.
        """
        if not self.wanted:
            source.release()
            self.hide()
            return
        if ask:
            ball = row[_BALL : _BALL + 2] if row is not None and fresh else None
            theta = None if row is None else shown_angles(row)
            source.request(theta, ball, 0.0 if row is None else float(row[0]))
        try:
            sight = source.newest()
        except OSError as error:
            self.hide(f"The camera cannot be looked through: {error}")
            return
        if sight is not None:
            self.show(*sight)
        else:
            self.wait()
