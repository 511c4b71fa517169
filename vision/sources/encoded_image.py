"""How are the bytes of one encoded image (JPEG, PNG, ...) decoded? Its head first: a few hundred
bytes may unpack to gigabytes."""

from __future__ import annotations

import warnings
from io import BytesIO

import cv2
import numpy as np
from PIL import Image

MOST_PX = 1 << 25  # of an image or of a film's frame; chosen: four times 4K, 100 MB as colours


class TooLargeError(ValueError):
    """It has more than MOST_PX pixels."""


def check_size(width: float, height: float) -> None:
    """TooLargeError: an image of that size [px] is not decoded."""
    if width * height > MOST_PX:
        raise TooLargeError(f"{width:g} x {height:g} px are more than {MOST_PX:,}: make it smaller")


def decoded(data: bytes) -> np.ndarray:
    """The image (h, w, 3) uint8 BGR of an image file's bytes. `ValueError` (words without the
    name): damaged, no image, or of more than MOST_PX.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            with Image.open(BytesIO(data)) as head:
                check_size(*head.size)
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    except (TooLargeError, Image.DecompressionBombWarning, Image.DecompressionBombError):
        raise TooLargeError(f"it has more than {MOST_PX:,} pixels: make it smaller") from None
    except (OSError, ValueError, SyntaxError, cv2.error) as error:
        why = " ".join(str(error).split())
        raise ValueError(f"not an image that can be read ({why})") from None
    if image is None:
        raise ValueError("not an image that can be decoded; remove or replace it")
    return image
