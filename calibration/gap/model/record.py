"""The plant's record with other parameters: a copy, written as plain numbers.

A field of a numpy record takes 1 us to write, a number of its memory 0.05 us, and a fit asks for
thousands of records of some sixty numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from math import atan2, hypot

import numpy as np

from rig.plant.derived import held_share

PERIODIC = {"cogging": "amplitude_V", "transmission_ripple": "amplitude_rad"}
# Gear backlash has an inner shape: how far arm and plate coast in the gap (rig.plant.plant_record).
COAST_KEY = "coast_s2_rad"
# So has a camera scale: a ball higher than assumed seems larger, and shifted as the plate tilts.
HEIGHT_KEY = "height_m"
# And the play of a joint: whether the plate stays where its arm left it (0), coasts on in the play,
# braked (0.5), or falls in it to the side of the ball (1). It is tried, and never free.
FALL_KEY = "fall_1"
# not in the catalogue
IN_RECORD = {COAST_KEY: "gear_coast", FALL_KEY: "joint_fall", HEIGHT_KEY: "camera_height"}
Places = Mapping[str, tuple[int, int]]


def places(record: np.dtype) -> dict[str, tuple[int, int]]:
    """Where the numbers of the axes x and y stand in a record, by field: counts of doubles. They
    share one where the field has one number."""
    double = np.dtype(float)
    return {
        name: (at // double.itemsize, at // double.itemsize + (kind.shape == (2,)))
        for name, (kind, at, *_) in (record.fields or {}).items()
        if kind.base == double and kind.shape in ((), (2,))
    }


def copied(record: np.record) -> tuple[np.record, memoryview[float]]:
    """A copy of a record, and its memory as doubles: what is written to one stands in the other."""
    # `copy` of a record goes through its fields one by one.
    buffer = bytearray(record.tobytes())
    return np.frombuffer(buffer, record.dtype)[0], memoryview(buffer).cast("d")


def fields_of(
    effect: str, given: Mapping[str, float], nominal: Callable[[str], float]
) -> Iterator[tuple[str, float]]:
    """The fields that an effect's parameters on one axis set, and to what.

    `given`: key -> value; `nominal`: the value of a key that is not given.
    """
    if effect in PERIODIC:
        sine, cosine = (given[k] if k in given else nominal(k) for k in ("sine", "cosine"))
        yield f"{effect}_{PERIODIC[effect]}", hypot(sine, cosine)
        yield f"{effect}_phase_rad", atan2(cosine, sine)
        if "periods_per_turn" in given:
            yield f"{effect}_periods_per_turn", given["periods_per_turn"]
        return
    if effect == "dead_zone":
        both, plus, minus = (
            given[k] if k in given else nominal(k)
            for k in ("half_width_V", "positive_V", "negative_V")
        )
        yield "dead_zone_positive_V", both + plus
        yield "dead_zone_negative_V", both + minus
        return
    for key, value in given.items():
        yield IN_RECORD.get(key, f"{effect}_{key}"), value


def derive(numbers: memoryview[float], places: Places, wound_rad: float) -> None:
    """Write what follows from the effects: how much of its speed a stopping motor keeps a step, and
    where the plays end; `wound_rad`: what a shaft's winding adds to the joint's on either side."""
    step_s = numbers[places["step_s"][0]]
    for a in range(2):
        settling_s = numbers[places["coulomb_friction_settling_s"][a]]
        numbers[places["friction_held"][a]] = held_share(settling_s, step_s)
        for shaft, wound in (("gear", 0.0), ("joint", wound_rad)):
            half = numbers[places[f"{shaft}_backlash_play_rad"][a]] / 2 + wound
            centre = numbers[places[f"{shaft}_backlash_offset_rad"][a]]
            numbers[places[f"{shaft}_1"][a]] = centre + half
            numbers[places[f"{shaft}_2"][a]] = centre - half
