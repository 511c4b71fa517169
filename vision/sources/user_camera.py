"""How is a camera read that no common interface knows? By a class in a user's own file.

The address is "mine.py:MyCamera". The class needs no base class, only this:

    class MyCamera:
        def __init__(self): ...         # without arguments; nothing is opened yet
        def open(self): ...             # optional (or __enter__): connect, arm, start
        def read(self):                 # wait for the next frame
            return image, t_s           # None: the camera has ended
        def close(self): ...            # optional (or __exit__): always called once after open

`image` is a numpy array of uint8, (h, w, 3) in BGR order or (h, w) grey; it is copied, the class
may use its buffer again. `t_s` is the middle of the exposure on the clock of `time.monotonic()`,
and increases from frame to frame. `read` may block: it runs in a thread of its own, and so does
`close`. What it raises stops the frames until a new object of the class could be opened.
"""

from __future__ import annotations

import importlib.util
import math
import os
import sys
import threading
import time
import traceback
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from vision.sources.clock import AHEAD_S
from vision.sources.live import Feed
from vision.sources.source_errors import UserCameraError

NEAR_S = 10.0  # between a stamp and its arrival; beyond, it is of another clock
MOST_PIXELS = 1 << 26  # chosen: more than any camera over a plate has, 200 MB in colour
LONGEST_WORDS = 500  # characters of an error's; chosen: a sentence with a path


def split_address(address: str) -> tuple[Path, str] | None:
    """File and class of "mine.py:MyCamera" (or C:\\dir\\mine.py:MyCamera), None for all else."""
    file, colon, name = address.rpartition(":")
    if not colon or not file.endswith(".py") or not name.isidentifier():
        return None
    return Path(file), name


def load_class(file: Path, name: str) -> Callable[[], Any]:
    """The class `name` of a Python file, which is executed for it.

    `FileNotFoundError`: there is no such file; `UserCameraError`: it fails to load or has no such
    class (the message lists those that it has).
    """
    if not file.is_file():
        raise FileNotFoundError(f"{file}:{name}: no such file; check the camera's address")
    module_name = f"user_camera_{file.stem}"
    spec = importlib.util.spec_from_file_location(module_name, file)
    if spec is None or spec.loader is None:
        raise UserCameraError(f"{file}: not a file that Python can load")
    module = importlib.util.module_from_spec(spec)
    sys.modules[module_name] = module  # dataclasses and pickle look there
    try:
        spec.loader.exec_module(module)
        found = getattr(module, name, None)
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        raise _named(f"{file}:{name}", "loading the file", error, file) from error
    if not isinstance(found, type):
        classes = [
            k
            for k, v in vars(module).items()
            if isinstance(v, type) and v.__module__ == module_name
        ]
        raise UserCameraError(
            f"{file}:{name}: no such class in that file; it has {', '.join(classes) or 'none'}"
        )
    return found


def _named(address: str, where: str, error: BaseException, file: Path) -> UserCameraError:
    """The user's error in one line, with its place in the user's file."""
    lines = [
        frame.lineno
        for frame in traceback.extract_tb(error.__traceback__)
        if Path(frame.filename).name == file.name
    ]
    place = f" (line {lines[-1]})" if lines else ""
    try:
        text = " ".join(str(error).split())[:LONGEST_WORDS]
    except BaseException:
        text = "its words cannot be read"
    return UserCameraError(f"{address}: {where}: {type(error).__name__}: {text}{place}")


class UserFeed(Feed):
    """One object of a user's camera class, opened.

    `file`, `name`: of the class, for messages; `make` makes the object.
    """

    def __init__(self, file: Path, name: str, make: Callable[[], Any]) -> None:
        """Make and open. Raises `UserCameraError` with file and class for whatever fails."""
        self._file, self._address = file, f"{file}:{name}"
        self.stamped_by = "camera"
        self._last_s = -math.inf
        self._camera = self._call("__init__", make)
        self._closing, reading = "close", self._camera
        for opening in ("open", "__enter__"):
            method = self._method(self._camera, opening)
            if method is not None:
                given = self._call(opening, method)
                if opening == "__enter__":  # as in a `with` statement, what it returns is meant
                    self._closing = "__exit__"
                    reading = self._camera if given is None else given
                break
        try:
            self._read = self._method(reading, "read")
            if not callable(self._read):
                raise UserCameraError(f"{self._address}: the class needs a method read()")
        except BaseException:
            with suppress(UserCameraError):  # what came first is said
                self.close()
            raise

    def _call(self, what: str, method: Callable[..., Any], *args: Any) -> Any:
        """What a method of the class returns. Threads that it starts, as a maker's library does, do
        not keep the program from its end, unless they ask for it (`daemon=False`)."""
        here = os.getpid()
        thread: Any = threading.current_thread()  # new threads take after it
        daemonic, thread._daemonic = thread.daemon, True
        try:
            return method(*args)
        except (KeyboardInterrupt, UserCameraError):
            raise
        except BaseException as error:  # CancelledError, say, is no Exception
            raise _named(self._address, what, error, self._file) from error
        finally:
            thread._daemonic = daemonic
            if os.getpid() != here:  # forked: a second rig would read the same camera, for ever
                os._exit(1)

    def _method(self, of: Any, name: str) -> Any:
        """A method of the class, None where it has none; looking for it may run code of it."""
        return self._call(name, getattr, of, name, None)

    def read(self) -> tuple[np.ndarray, float] | None:
        """The next image, copied, (h, w, 3) or (h, w) uint8, and its time [s, `time.monotonic`];
        None where the camera has ended.

        `UserCameraError`: the class fails or breaks its contract (the module's docstring).
        """
        return self._call("read", self._checked)

    def _checked(self) -> tuple[np.ndarray, float] | None:
        pair = self._read()
        if pair is None:
            return None
        if not isinstance(pair, tuple) or len(pair) != 2:
            raise self._breach(f"returned {type(pair).__name__}, not a tuple (image, t_s) or None")
        image, t_s = pair
        self._check_image(image)
        return np.array(image), self._checked_time(t_s, time.monotonic())

    def _check_image(self, image: Any) -> None:
        if not isinstance(image, np.ndarray):
            raise self._breach(f"the image is a {type(image).__name__}, not a numpy array")
        shape = image.shape
        good = image.ndim == 2 or (image.ndim == 3 and shape[2] == 3)
        if not good or image.dtype != np.uint8 or image.size == 0:
            raise self._breach(
                f"the image is {image.dtype} of shape {shape}, not uint8 of (h, w, 3) or (h, w)"
            )
        if shape[0] * shape[1] > MOST_PIXELS:
            raise self._breach(f"the image has {shape[1]} x {shape[0]} pixels, over {MOST_PIXELS}")

    def _checked_time(self, t_s: Any, now_s: float) -> float:
        try:
            taken_s = float(t_s)
        except (TypeError, ValueError):
            short = t_s is None or (type(t_s) is str and len(t_s) < LONGEST_WORDS)
            told = repr(t_s) if short else f"a {type(t_s).__name__}"
            raise self._breach(f"t_s is {told}, not a number of seconds") from None
        except Exception:
            raise self._breach(f"t_s is a {type(t_s).__name__} without a number") from None
        # What is said to be seen later than it arrived would be left out as of the future.
        if not -AHEAD_S <= now_s - taken_s <= NEAR_S:
            raise self._breach(
                f"t_s is {taken_s:g} s where time.monotonic() is {now_s:g}; use that clock"
            )
        taken_s = min(taken_s, now_s)
        if taken_s <= self._last_s:
            raise self._breach(f"t_s does not increase ({self._last_s:.6f}, then {taken_s:.6f})")
        self._last_s = taken_s
        return taken_s

    def _breach(self, text: str) -> UserCameraError:
        return UserCameraError(f"{self._address}: read: {text}")

    def decode(self, raw: np.ndarray) -> np.ndarray:
        """The image (h, w, 3) uint8 BGR; a grey one (h, w) becomes three equal channels."""
        return cv2.cvtColor(raw, cv2.COLOR_GRAY2BGR) if raw.ndim == 2 else raw

    def close(self) -> None:
        """Close the user's camera by its `close` or `__exit__`, if it has one. `UserCameraError`:
        that fails."""
        method = self._method(self._camera, self._closing)
        if method is not None:
            self._call(self._closing, method, *([None] * 3 if self._closing == "__exit__" else []))
