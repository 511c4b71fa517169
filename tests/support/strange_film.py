"""What a generated film of a world that shares no code with the product gives its benchmark."""

from __future__ import annotations

from dataclasses import dataclass, field

from vision.frames import Frame


@dataclass
class StrangeFilm:
    """Frames with truth by frame: `truth[k]` is (u, v, radius) px, and `shown[k]` the share of the
    ball's disc that is not hidden or outside the image. `words` say what it is, `kind` what is
    difficult in it, where one thing is."""

    seed: int
    words: str
    kind: str = ""
    frames: list[Frame] = field(default_factory=list)
    truth: list[tuple[float, float, float]] = field(default_factory=list)
    shown: list[float] = field(default_factory=list)
