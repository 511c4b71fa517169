"""The camera of a hardware table: frames are seen elsewhere, the loop picks up the newest word.

A thread (or better a process of its own: vision would hold the loop's interpreter) takes the
newest frame, lets the ball camera see it and puts what it saw into shared memory. Nothing waits
for the loop and the loop waits for nothing; what was seen once is never given again; troubles are
raised by name where the loop reads.
"""

import multiprocessing
import os
import threading
import time
from collections.abc import Callable, Iterable
from contextlib import ExitStack, suppress
from multiprocessing.process import BaseProcess
from typing import Protocol, Self

import numpy as np

from rig.hardware.camera.preview import Preview
from rig.loop.child_process import end_with_program, leave_ctrl_c, signals_held
from rig.plant.ball import plate_rotation, tilt_sines
from rig.shared_memory import SharedArray, SharedRing, encoded
from vision.frames import Frame, Observation, Track
from vision.sources.source_errors import GarbageError

STALL_S = 0.3  # the controller has levelled the plate by then (rig.control.tick.BLIND_S)
OPEN_S = 90.0  # a process has to import OpenCV, open a camera and, once, compile what sees
SIGHTS = 16
SIGHT = np.dtype([("frame_s", np.float64), ("seen", np.int64), ("numbers", np.float64, (5,))])
TEXT = 240  # bytes of UTF-8
TROUBLE = np.dtype([("text", f"S{TEXT}"), ("said", np.int64), ("over", np.int64)])


class CameraStopped(OSError):  # noqa: N818 - it names a camera state used as a run ending
    """The camera gives no more frames; the message says why. Outcome of the run: "camera stall"."""

    outcome = "camera stall"


class Sees(Protocol):
    """What is used of `vision.ball_camera.BallCamera`."""

    def step(
        self, frame: Frame, rotation_hint: np.ndarray
    ) -> "tuple[Observation | None, Track, object]":
        """Return observation, track and view of a frame; rotation_hint (3, 3): world from plate,
        a guess.
        """
        ...


# What makes the frames (times on `time.monotonic`, as of open_source(..., start_s=0.0); closed at
# the end where it is a context manager) and the ball camera, in the thread or process that sees.
Opener = Callable[[], tuple[Iterable[Frame], Sees]]


class CameraEye:
    """What the loop holds of a camera: `latest` for a table's `read`, `tell` for the encoders'
    hint.

    ratio: 2 R_d/L of the linkage; stall_s: longest time without a frame; frames: how many were
    taken. Times given out count from `begin`, else from the first `latest`. It can be pickled to
    the loop's process.
    """

    def __init__(self, ratio: float, *, stall_s: float = STALL_S) -> None:
        self.ratio, self.stall_s = ratio, stall_s
        self.sights = SharedRing(SIGHT, SIGHTS)
        self.theta = SharedArray((2,), np.dtype(np.float64))
        self.trouble = SharedArray((1,), TROUBLE)
        self.preview = Preview()
        self.zero_s: float | None = None
        self.frames = 0
        self._arrived_s: float | None = None

    def begin(self, zero_s: float) -> None:
        """Set the table's time zero, a time of `time.monotonic` [s]."""
        self.zero_s = zero_s

    def tell(self, theta_rad: tuple[float, float]) -> None:
        """Take the encoder angles now: they give the plate's pose where its markers are not
        seen.
        """
        self.theta.array[:] = theta_rad

    def latest(self, after_s: float) -> Observation | None:
        """Return the newest observation exposed after `after_s` [s], never one twice; else None.

        CameraStopped: no frame for `stall_s`, or the camera itself failed.
        """
        now_s = time.monotonic()
        if self.zero_s is None:
            self.zero_s = now_s
        found = None
        if self.sights.news:
            for sight in self.sights.read():
                self.frames += 1
                self._arrived_s = now_s
                if sight["seen"]:
                    x, y, *cov = (float(v) for v in sight["numbers"])
                    exposed_s = float(sight["frame_s"]) - self.zero_s
                    found = Observation((x, y), (cov[0], cov[1], cov[2]), exposed_s)
        self._check(now_s)
        return found if found is not None and found.exposed_s > after_s else None

    def _check(self, now_s: float) -> None:
        if self.trouble.array["said"][0]:
            raise CameraStopped(self.trouble.array["text"][0].decode())
        self._arrived_s = now_s if self._arrived_s is None else self._arrived_s
        if now_s - self._arrived_s > self.stall_s:
            silent = f"no frame for {now_s - self._arrived_s:.2f} s"
            raise CameraStopped(f"{silent}; has the camera lost its cable, or its program ended?")

    # --- who sees ---
    def put(self, frame_s: float, seen: Observation | None) -> None:
        """Send what was seen in the frame of time frame_s (`time.monotonic`), None for no ball,
        to the loop.
        """
        numbers = (np.nan,) * 5 if seen is None else (*seen.xy_m, *seen.cov_m2)
        self.sights.write((frame_s, seen is not None, numbers))

    def fail(self, error: BaseException) -> None:
        """Keep the error that ended the seeing, for the loop to raise; nothing once the eye is
        closed.
        """
        self._say(f"{type(error).__name__}: {error}")

    def ended(self, how: str) -> None:
        """Keep how the program that sees has ended, where it did not say why itself."""
        with suppress(IndexError):  # closed meanwhile
            if not self.trouble.array["said"][0]:
                self._say(f"the camera's program {how}")

    def _say(self, text: str) -> None:
        with suppress(IndexError):  # closed meanwhile
            if not self.over:
                self.trouble.array["text"][0] = encoded(text, TEXT)
                self.trouble.array["said"][0] = 1

    @property
    def over(self) -> bool:
        """Whether seeing is to end: the eye was closed."""
        trouble = self.trouble.array  # of which `close` makes an empty one
        return len(trouble) == 0 or bool(trouble["over"][0])

    def close(self) -> None:
        """Let go of the shared memory; the process that made it frees it, which ends the seeing."""
        for part in (self.sights, self.theta, self.trouble, self.preview):
            part.close()


def see(eye: CameraEye, opener: Opener) -> None:
    """See frame after frame until the eye is closed; whatever ends it before is kept for the loop.

    opener makes the frames and the ball camera here, in the thread or process that sees.
    """
    try:
        frames, camera = opener()
        with ExitStack() as stack:
            if hasattr(frames, "__exit__"):
                stack.enter_context(frames)  # pyright: ignore[reportArgumentType]
            source = iter(frames)
            while not eye.over:
                try:
                    frame = next(source)
                except GarbageError:  # the next one may be sound
                    continue
                theta = float(eye.theta.array[0]), float(eye.theta.array[1])
                hint = plate_rotation(tilt_sines(theta, eye.ratio))
                observation, track, _ = camera.step(frame, hint)
                eye.put(frame.t_s, observation)
                eye.preview.show(frame.image, track, observation)
    except StopIteration:
        eye.fail(EOFError("the source has no more frames"))
    except BaseException as error:  # raised again, by name, where the loop reads
        eye.fail(error)


def _process(eye: CameraEye, opener: Opener) -> None:
    leave_ctrl_c()
    with suppress(OSError):  # standard output is the program's: a camera class may print, too
        os.dup2(2, 1)
    end_with_program()
    see(eye, opener)
    eye.close()


class Watcher:
    """Context in which `see` runs beside the loop, in a spawned process or, without `process`, a
    thread.

    Entering it waits for the first frame, at most patience_s. CameraStopped: that did not come,
    with the camera's own reason.
    """

    def __init__(
        self, eye: CameraEye, opener: Opener, *, process: bool = True, patience_s: float = OPEN_S
    ) -> None:
        self.eye, self._patience_s = eye, patience_s
        if process:
            spawn = multiprocessing.get_context("spawn")
            self._worker = spawn.Process(target=_process, args=(eye, opener), daemon=True)
            self._kill = self._worker.kill
            self._witness = threading.Thread(
                target=self._tell_its_end, args=(self._worker,), daemon=True, name="camera's end"
            )
        else:
            self._worker = threading.Thread(target=see, args=(eye, opener), daemon=True)
            self._witness = None
            self._kill = lambda: None  # a driver that holds a thread lets go when it likes

    def __enter__(self) -> Self:
        with signals_held(ending=True):
            self._worker.start()
        until_s = time.monotonic() + self._patience_s
        try:
            if self._witness is not None:
                self._witness.start()
            while not self.eye.sights.news:
                if self.eye.trouble.array["said"][0]:
                    raise CameraStopped(self.eye.trouble.array["text"][0].decode())
                if time.monotonic() > until_s:
                    raise CameraStopped(f"no first frame within {self._patience_s:g} s")
                time.sleep(0.005)
        except BaseException:
            self.__exit__()
            raise
        return self

    def _tell_its_end(self, process: BaseProcess) -> None:
        """Wait for the end of the process that sees, and tell the loop how that was."""
        process.join()
        code = process.exitcode
        how = "ended" if code is None else f"left (exit code {code})"
        self.eye.ended(f"was ended by signal {-code}" if code and code < 0 else how)

    def __exit__(self, *_: object) -> None:
        with suppress(IndexError):  # closed already
            self.eye.trouble.array["over"][0] = 1
        self._worker.join(2.0)
        if self._worker.is_alive():
            self._kill()
            self._worker.join(1.0)
