"""What can go wrong with a live source?

Each error is also the built-in one that fits, so that callers may catch either. After each of them
the next frame may be asked for: the source reconnects by itself when the camera is back.
"""

from __future__ import annotations


class SourceError(Exception):
    """Any failure of a source that may be over at a later attempt."""


class StalledError(SourceError, TimeoutError):
    """Connected, but no new frame came within the source's `patience_s`."""


class GoneError(SourceError, ConnectionError):
    """The camera or stream does not answer, broke off or was unplugged."""


class SizeChangedError(SourceError, ValueError):
    """A frame has another size than the source was opened with; no calibration holds for it."""


class GarbageError(SourceError, ValueError):
    """What arrived is no image: a corrupt JPEG, a broken header. Later frames may be sound."""


class UserCameraError(SourceError, OSError):
    """A camera class from a user's file failed or breaks its contract."""
