"""Write a video whose frames have time stamps of their own."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

TICKS_PER_S = 1000


class Film:
    """An mp4 (or mkv) of frames (h, w, 3) uint8 BGR with time stamps; a context manager.

    size: (width, height) [px]. H.264 where the encoder is there, else MPEG-4. Odd sizes lose their
    last row or column, which the colour subsampling of both cannot hold. quick: H.264 takes a third
    of the time to write and to read, and three times the bytes, for as good a picture. OSError: the
    file cannot be written.
    """

    def __init__(self, path: Path, size: tuple[int, int], *, quick: bool = False) -> None:
        import av
        import av.logging

        av.logging.set_level(av.logging.ERROR)
        self._av = av
        self._size = (max(2, size[0] // 2 * 2), max(2, size[1] // 2 * 2))
        self._file: Any = av.open(str(path), "w")
        codec = "libx264" if "libx264" in av.codecs_available else "mpeg4"
        self._stream: Any = self._file.add_stream(codec, rate=30)
        self._stream.width, self._stream.height = self._size
        self._stream.pix_fmt = "yuv420p"
        self._stream.codec_context.time_base = Fraction(1, TICKS_PER_S)
        self._stream.codec_context.gop_size = 30  # who scrubs decodes a second at most
        if codec == "libx264":
            self._stream.options = {"crf": "20", "preset": "ultrafast" if quick else "veryfast"}
        else:
            self._stream.bit_rate = 4_000_000
        self._start_s: float | None = None
        self._last = -1

    def __enter__(self) -> Film:
        return self

    def add(self, image: np.ndarray, t_s: float) -> None:
        """Add the next frame `image` (h, w, 3) uint8 BGR, shown from t_s [s] on.

        A time not later than the frame before is moved 1 ms after it. OSError: it cannot be
        written.
        """
        if self._start_s is None:
            self._start_s = t_s
        w, h = self._size
        frame = self._av.VideoFrame.from_ndarray(
            np.ascontiguousarray(image[:h, :w]), format="bgr24"
        )
        self._last = max(self._last + 1, round((t_s - self._start_s) * TICKS_PER_S))
        frame.pts, frame.time_base = self._last, Fraction(1, TICKS_PER_S)
        self._file.mux(self._stream.encode(frame))

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._last >= 0:
            self._file.mux(self._stream.encode(None))
        self._file.close()


class Overlay:
    """A film whose failure does not end the tracking: the first OSError ends the film alone.

    path, size: as of `Film`. `trouble` then says why in one line, and the unfinished file is
    removed.
    """

    def __init__(self, path: Path, size: tuple[int, int]) -> None:
        self._path, self.trouble = path, ""
        self._film: Film | None = None
        self._try(lambda: setattr(self, "_film", Film(path, size)))

    def __enter__(self) -> Overlay:
        return self

    def add(self, image: np.ndarray, t_s: float) -> None:
        """Add the next frame, as `Film.add`; does nothing after the first error."""
        film = self._film
        if film is not None:
            self._try(lambda: film.add(image, t_s))

    def __exit__(self, *error: object) -> None:
        film = self._film
        if film is not None:
            self._try(lambda: film.__exit__(None, None, None))

    def _try(self, work: Callable[[], object]) -> None:
        try:
            work()
        except OSError as error:
            self._film = None
            self.trouble = f"no film: {self._path.name}: {error.strerror or error}"
            self._path.unlink(missing_ok=True)
