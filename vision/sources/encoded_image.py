"""How are the bytes of one encoded image (JPEG, PNG, ...) decoded? Its head first: a few hundred
bytes may unpack to gigabytes."""

from __future__ import annotations

import warnings
from io import BytesIO

import cv2
import numpy as np
from PIL import Image


def decoded(data: bytes) -> np.ndarray:
    """The image (h, w, 3) uint8 BGR of an image file's bytes. `ValueError` (words without the
    name): damaged, no image, or of more pixels than Pillow's own limit.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            Image.open(BytesIO(data)).close()
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    except (Image.DecompressionBombWarning, Image.DecompressionBombError):
        most = f"{Image.MAX_IMAGE_PIXELS or 0:,}"
        raise ValueError(f"it has more than {most} pixels: make it smaller") from None
    except (OSError, ValueError, SyntaxError, cv2.error) as error:
        why = " ".join(str(error).split())
        raise ValueError(f"not an image that can be read ({why})") from None
    if image is None:
        raise ValueError("not an image that can be decoded; remove or replace it")
    return image
