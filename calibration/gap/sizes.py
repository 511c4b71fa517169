"""Whether the size of a name is one: rules 3 and 9 of `calibration.gap.veto`, in words."""

from collections.abc import Mapping

import numpy as np

from calibration.gap.decision_rule import FAMILY_P, RANGE_END_STEPS
from calibration.gap.model.intervals import FIXED, Spread, interval
from calibration.gap.model.parameters import PERIODIC
from calibration.gap.model.state import State
from calibration.gap.name.stepwise import Accepted
from calibration.statistics import student_quantile


def not_a_size(state: State, one: Accepted, spread: Mapping[str, Spread]) -> str:
    """The reason of rule 3 in words; "" if no axis is at the end of its range, and the name stands
    on one of its axes."""
    if any(_size_of(state, one, axis, spread)[2] for axis in one.axes):
        return "its size is at the end of its range, so it stands for something else"
    if axes_with_size(state, one, spread):
        return ""
    return "the interval of its size holds its nominal value, or 0 of a limit"


def axes_with_size(state: State, one: Accepted, spread: Mapping[str, Spread]) -> tuple[str, ...]:
    """The axes on which the interval of the size excludes the nominal value."""
    sizes = {axis: _size_of(state, one, axis, spread) for axis in one.axes}
    return tuple(a for a, (size, own, _) in sizes.items() if not size < interval(0.0, own).high)


def faint(state: State, one: Accepted, spread: Mapping[str, Spread]) -> str:
    """The reason of rule 9 in words; "" if the size on one of the axes is beyond chance."""
    for axis in one.axes:
        size, own, _ = _size_of(state, one, axis, spread)
        if not size <= student_quantile(max(own.blocks - 1, 2), FAMILY_P) * own.std:
            return ""
    return "its size is not beyond what so many tests reach by chance"


def _size_of(
    state: State, one: Accepted, axis: str, spread: Mapping[str, Spread]
) -> tuple[float, Spread, bool]:
    """Distance of a name's size on an axis from its nominal value, its spread, and whether it is at
    the end of its range. Of a limit, whose nominal value is infinite, the distance is that from 0:
    it has to be known as well as that."""
    first, *more = state.nominal.of(one.name, axis)
    free = [first, more[0]] if one.name in PERIODIC else [first]
    values = [state.fit.setting.get(k.name, k.nominal) for k in free]
    origins = [k.nominal if np.isfinite(k.nominal) else 0.0 for k in free]
    sizes, value = np.subtract(values, origins), values[0]
    at_end = any(e and abs(value - e) < RANGE_END_STEPS * first.step for e in first.range)
    own = max(spread.get(k.name, FIXED) for k in free)
    return float(np.linalg.norm(sizes)), own, at_end
