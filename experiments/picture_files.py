"""Pictures as files: written whole or not at all, and over no link that leads elsewhere."""

from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rig.files import write_whole

if TYPE_CHECKING:
    import numpy as np
    from matplotlib.figure import Figure


def write_figure(figure: "Figure", path: Path, **how: Any) -> Path:
    """Write a figure in the format that the file's suffix names, and return the path; how: as of
    matplotlib's `savefig`. OSError: it cannot be written.
    """
    drawn = BytesIO()
    figure.savefig(drawn, format=path.suffix.removeprefix("."), **how)
    write_whole(path, drawn.getvalue())
    return path


def write_image(image: "np.ndarray", path: Path) -> Path:
    """Write an image (h, w, 3) uint8 BGR in the format that the file's suffix names, and return the
    path. OSError: it cannot be written.
    """
    import cv2

    write_whole(path, cv2.imencode(path.suffix, image)[1].tobytes())
    return path
