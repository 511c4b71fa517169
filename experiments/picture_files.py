"""Figures in one style, and pictures as files: written whole or not at all, and over no link that
leads elsewhere.
"""

import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rig.files import write_whole

if TYPE_CHECKING:
    import numpy as np
    from matplotlib.figure import Figure

STYLE: dict[Any, Any] = {
    "font.size": 10,
    "axes.grid": True,
    "grid.alpha": 0.25,
    "savefig.dpi": 150,
    "figure.constrained_layout.use": True,
    "svg.hashsalt": "rig",
    "legend.framealpha": 0.9,
    "text.parse_math": False,  # names of runs and files are shown as they are
}

# Inches: as wide as a printed sheet, and no higher than style.css allows a figure there, so that
# letters are printed as large as they are.
SHEET_WIDE_IN, SHEET_HIGH_IN = 7.1, 3.3


@contextmanager
def our_style() -> Iterator[None]:
    """What is drawn or written meanwhile has this style, whatever the user's is, which comes back:
    a matplotlibrc or a notebook's settings are for figures of theirs. Decorates functions, too.
    """
    import matplotlib

    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(STYLE)
        yield


def subplots(
    rows: int = 1, columns: int = 1, *, figsize: tuple[float, float], **how: Any
) -> tuple["Figure", Any]:
    """A figure of figsize [inches] and its axes, as of matplotlib's `Figure.subplots`. It is none
    of pyplot's, so a notebook does not show it and nobody has to close it.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=figsize)
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, columns, **how)


def style_trouble(error: Exception) -> str:
    """The file for which matplotlib raised this as it was imported, and the cure, as nothing can be
    drawn with it; "" of any other error.
    """
    if not isinstance(error, UnicodeDecodeError):
        return ""
    for frame, _ in traceback.walk_tb(error.__traceback__):
        if frame.f_code.co_name == "_rc_params_in_file":
            file = Path(frame.f_locals["fname"]).expanduser().resolve()
            return f"{file}, matplotlib's own settings, is no UTF-8 text ({error}): mend or move it"
    return ""


@our_style()
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
