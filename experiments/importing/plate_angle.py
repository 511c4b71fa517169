"""What is no axis' servo angle although it looks like one: the plate's own tilt, a servo of a plate
that is turned against the recorded axes, one of three arms."""

from collections.abc import Mapping
from math import atan, degrees

from experiments.importing.draft import Draft
from experiments.importing.names import words_of
from experiments.importing.relations import Response
from experiments.importing.roles import NAMES
from experiments.importing.signs import clear_answer
from experiments.importing.units import factor, family

SAME_ANGLE = (0.5, 2.0)  # chosen: a servo's scale is off by less; a linkage divides by 3 and more
COUPLED = 0.3  # the most that `rig gap` may name; a lag on a circle looks like half of it
ARMS = ({"1", "2", "3"}, {"0", "1", "2"}, {"a", "b", "c"})  # how three that are alike are told


def without_arms(draft: Draft, named: Mapping[str, list[str]]) -> dict[str, list[str]]:
    """Columns of angles by role, without those of three arms, which tilt the plate together: none
    is an axis'. What was stated of them wins."""
    kept = {}
    for role, columns in named.items():
        kept[role] = columns
        if _are_arms(columns):
            kept[role] = []
            why = f"{', '.join(columns)} tilt the plate together, and a log has two axes"
            both = [NAMES["command"].format(axis) for axis in "xy"]
            draft.doubt(both, "column", f"{why}: only the ball can be kept", "none")
    return kept


def _are_arms(columns: list[str]) -> bool:
    """Whether these are three columns whose names are alike but for a number or a letter."""
    words = [words_of(column) for column in columns]
    if len(words) != 3 or len({*map(len, words)}) > 1:
        return False
    apart = [each for each in map(set, zip(*words, strict=True)) if len(each) > 1]
    return len(apart) == 1 and apart[0] in ARMS


def doubt_plate_angle(
    draft: Draft,
    followed: Mapping[str, Mapping[str, Response]],
    theta: Mapping[str, str],
    command: Mapping[str, str],
) -> None:
    """Doubt the lesser of a measured and a commanded angle (axis -> column) that are not of one
    thing: one log has one angle an axis. followed: axis -> command's column -> response (of
    `signs.followed`)."""
    for axis, column in theta.items():
        names = NAMES["theta"].format(axis), NAMES["command"].format(axis)
        one = followed.get(axis, {}).get(command.get(axis, ""))
        own, told = (_size(draft, name) for name in names)
        if one is None or own is None or told is None:
            continue
        ratio = abs(one.gain) * own / told
        if SAME_ANGLE[0] <= ratio <= SAME_ANGLE[1]:
            continue
        name, tilt = (names[0], column) if ratio < 1 else (names[1], command[axis])
        why = f"{column} turns {ratio:.2g} rad for each radian of {command[axis]}: {tilt} "
        draft.doubt(
            [name], "column", f"{why}is the plate's own tilt, say: leave it out", "none", tilt
        )


def _size(draft: Draft, name: str) -> float | None:
    """Radians in one unit of a signal that is settled; None where that is open."""
    keys = draft.signals.get(name, {})
    open_ = {"unit", "scale"} & {d.key for d in draft.doubts if d.place in (name, family(name))}
    if open_ or "unit" not in keys:
        return None
    return factor(keys["unit"], name) or keys.get("scale")


def refuse_turned(
    draft: Draft, found: Mapping[str, Mapping[str, Response]], columns: Mapping[str, str]
) -> None:
    """Refuse a plate that is turned against the ball's axes (axis -> column -> response), of which
    none is one servo's; tell one that is turned a little, or coupled. ValueError: two angles surely
    move the ball along one axis alike."""
    for axis, each in found.items():
        own = [c for c in columns.values() if c in each and each[c].low * each[c].high > 0]
        both = sorted(own, key=lambda c: -each[c].share)
        if len(both) != 2:
            continue
        gains = [abs(each[c].gain) for c in both]
        about = f"{degrees(atan(gains[1] / gains[0])):.0f} degrees"
        if clear_answer(each) is None and all(each[c].sure for c in both):
            raise ValueError(
                f"{both[0]} and {both[1]} both move the ball along {axis}, by {gains[0]:.3g} and "
                f"{gains[1]:.3g} for each unit: the servos' axes are turned by about {about} "
                "against the ball's columns; turn these (x cos a + y sin a, y cos a - x sin a) and "
                "import again"
            )
        if gains[1] > COUPLED * gains[0]:
            told = (
                f"{both[1]} moves the ball along {axis}, too: coupled, or turned by about {about}"
            )
            draft.because("angle", told)
