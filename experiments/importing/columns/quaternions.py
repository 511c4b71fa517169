"""A body's attitude as a quaternion: the tilt of a plate about its two level axes."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from math import cos, radians, sin

import numpy as np

from experiments.importing.names import hint, words_of
from experiments.importing.recording import Stream

LETTERS = "wxyz"
LENGTH = 0.02  # how far from their usual one; chosen: three decimals of each part
STEEPEST = cos(radians(45))  # chosen: no ball stays on a plate that is steeper
MOSTLY = 0.99  # chosen: of the rows
# Of the length; a first part that is less is a tilt's. Chosen: a plate tilts by less than 30
# degrees as a rule, and seldom stands turned by more than 150
MIN_W = sin(radians(15))
_NUMBERED = {"q", "quat", "quaternion", "orientation", "rotation", "attitude"}


def with_tilts(stream: Stream) -> Stream:
    """The stream with two angles [rad] in place of four columns that are a quaternion of one
    length, by which a body tilts about level; told by its notes.

    Which of the body's axes stands upright is that about which it turns least. A ball is no plate.
    """
    for stem, names in _fours(stream):
        parts = np.array([stream.columns[name] for name in names])
        found = _tilts(parts)
        one = hint(stem)
        if not found or one.explicit:
            continue
        asked = one.role in ("command", "target") or hint(f"{stem} angle").role == "command"
        front = f"{stem} tilt along" if asked else f"{stem} measured tilt along"
        new = {f"{front} {letter}".strip(): values for letter, values in found.items()}
        kept = {name: v for name, v in stream.columns.items() if name not in names}
        units = {**stream.units, **dict.fromkeys(new, "rad")}
        note = f"{', '.join(names)} are a quaternion: {' and '.join(new)}"
        stream = replace(stream, columns=kept | new, units=units, notes=(*stream.notes, note))
    return stream


def _fours(stream: Stream) -> Iterator[tuple[str, list[str]]]:
    """Yield the stem, and columns by LETTERS, of names that are alike but for a last w, x, y, z; or
    of a quaternion's numbers, of which the first is w, or the last where the first is a tilt's."""
    groups: dict[tuple[str, ...], dict[str, str]] = {}
    for name in stream.columns:
        *stem, last = words_of(name) or [""]
        if last in ("qw", "qx", "qy", "qz"):
            stem, last = [*stem, "q"], last[1]
        groups.setdefault(tuple(stem), {})[last] = name
    for words, names in groups.items():
        stem = " ".join(words[:-1] if words[-1:] == ("q",) else words)
        if {*LETTERS} <= names.keys():
            yield stem, [names[letter] for letter in LETTERS]
        for start in (0, 1) if _NUMBERED & {*words[-1:]} else ():
            each = [names.get(str(start + i), "") for i in range(4)]
            if all(each):
                parts = np.array([stream.columns[name] for name in each])
                w_first = np.nanmedian(np.abs(parts[0]) / np.linalg.norm(parts, axis=0)) >= MIN_W
                yield stem, each if w_first else [each[3], *each[:3]]


def _tilts(parts: np.ndarray) -> Mapping[str, np.ndarray]:
    """Tilts [rad] (n,) by which a ball rolls along two axes of the body, x, y or z, by its
    quaternion (4, n) in the order of LETTERS; none where it is none, stands still, or is not near
    level."""
    known = np.isfinite(parts).all(axis=0)
    lengths = np.linalg.norm(parts[:, known], axis=0)
    whole = float(np.median(lengths)) if known.any() else 0.0  # 16384 of a sensor's whole numbers
    if whole <= 0 or np.mean(np.abs(lengths / whole - 1) < LENGTH) < MOSTLY:
        return {}
    w, *xyz = parts = parts / whole
    turns: dict[int, float] = {}
    ups = {}
    for up in range(3):
        a, b, c = (xyz[(up + i) % 3] for i in (1, 2, 0))
        # the vertical as the body sees it, along its axes a and b, and along the upright c
        ups[up] = 2 * (a * c - w * b), 2 * (b * c + w * a), 1 - 2 * (a * a + b * b)
        if np.mean(ups[up][2][known] > STEEPEST) >= MOSTLY:
            turns[up] = float(np.std(np.unwrap(2 * np.arctan2(c[known], w[known]))))
    if not turns or np.ptp(parts[:, known], axis=1).max() == 0:
        return {}
    up = min(turns, key=lambda axis: turns[axis])
    along_a, along_b, along_c = ups[up]
    # About one axis a ball rolls along the other; where y stands upright, the second is z
    letters = [LETTERS[1 + (up if i == 2 else i)] for i in ((up + 2) % 3, (up + 1) % 3)]
    tilts = (np.arctan2(along_b, along_c), np.arctan2(-along_a, along_c))
    return dict(sorted(zip(letters, tilts, strict=True)))
