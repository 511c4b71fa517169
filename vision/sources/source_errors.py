"""What can go wrong with a live source, by name.

Each is also the built-in error that fits, so that a caller who knows none of these names gets one
clear line. After each of them the source may be asked for the next frame again: it comes back by
itself when the camera does.
"""

from __future__ import annotations


class SourceError(Exception):
    """Any trouble of a source that a later attempt may find gone."""


class StalledError(SourceError, TimeoutError):
    """Connected, but no new frame came for the source's patience."""


class GoneError(SourceError, ConnectionError):
    """The camera or stream does not answer, broke off or was unplugged."""


class SizeChangedError(SourceError, ValueError):
    """A frame has another size than the source was opened with; no calibration holds for it."""


class GarbageError(SourceError, ValueError):
    """What arrived is no image: a corrupt JPEG, a broken header. Later frames may be sound."""


class SettingsError(SourceError, OSError):
    """A camera does not do what it was set to, as its own read-back says."""


class UserCameraError(SourceError, OSError):
    """A camera class from a user's file failed or breaks its contract."""
