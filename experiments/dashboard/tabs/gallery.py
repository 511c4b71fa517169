"""Pictures in a tab: the newest set replaces the last."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.dashboard.session.tasks import CaptionedPicture
from rig.files import file_bytes

if TYPE_CHECKING:
    from viser import ViserServer

WIDEST_PX = 900  # chosen: a panel is narrower


def pixels(shown: CaptionedPicture) -> np.ndarray:
    """The picture as RGB (h, w, 3) uint8, at most `WIDEST_PX` wide. OSError: it cannot be read."""
    import cv2

    from vision.sources.encoded_image import decoded

    try:
        image = decoded(file_bytes(shown.path))
    except ValueError as error:
        raise OSError(f"{shown.path} is not readable as a picture: {error}") from None
    if image.shape[1] > WIDEST_PX:
        height = round(image.shape[0] * WIDEST_PX / image.shape[1])
        image = cv2.resize(image, (WIDEST_PX, height), interpolation=cv2.INTER_AREA)
    return np.ascontiguousarray(image[:, :, ::-1])


class Gallery:
    """A folding group of captioned pictures under `label`, built in the GUI container of viser that
    is open; hidden while it is empty.
    """

    def __init__(self, server: "ViserServer", label: str) -> None:
        self._gui = server.gui
        self._folder: Any = server.gui.add_folder(label, visible=False)
        self._images: list[Any] = []

    def show(self, pictures: Sequence[CaptionedPicture]) -> None:
        """Replace the pictures by these. To be called in the thread of the control panel queue
        alone. OSError: a picture cannot be read.
        """
        images = [(pixels(one), one.caption) for one in pictures]
        if [one.label for one in self._images] == [caption for _, caption in images]:
            for old, (image, _) in zip(self._images, images, strict=True):
                old.image = image  # in its place: no flicker
            return
        for old in self._images:
            old.remove()
        with self._folder:
            self._images = [
                self._gui.add_image(image, label=caption, format="jpeg", jpeg_quality=88)
                for image, caption in images
            ]
        self._folder.visible = bool(images)
