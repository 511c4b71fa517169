"""Fits that were made, kept for whoever asks for the same one again.

Selection goes on in one output at a time: an effect that is added to the ball, or removed from it,
leaves both servos as they were, and every effect of theirs is tried again. A fit depends on nothing
but what its key holds, so a kept one is the same to the last bit.
"""

from collections import OrderedDict
from collections.abc import Callable
from threading import Lock
from typing import TYPE_CHECKING, Any

import numpy as np

from calibration.gap.model.parameters import BALL, SERVO, NominalModel

if TYPE_CHECKING:
    from calibration.gap.model.data import Evidence
    from calibration.gap.model.fit import Bounds, ParameterFit

MOST_BYTES = 1 << 28  # chosen: some fifty fits of a minute's log


class KeptFits:
    """The fits made last, as many as MOST_BYTES hold. Several threads may ask."""

    def __init__(self) -> None:
        self._fits: OrderedDict[tuple, tuple[Any, ParameterFit]] = OrderedDict()
        self._bytes = 0
        self._lock = Lock()

    def of(self, key: tuple[tuple, tuple], make: "Callable[[], ParameterFit]") -> "ParameterFit":
        """The fit of this key (`key_of`), made by `make` where it is not kept."""
        values, held = key
        with self._lock:
            if values in self._fits:
                self._fits.move_to_end(values)
                return self._fits[values][1]
        made = make()
        with self._lock:
            if values in self._fits:  # another thread made it meanwhile
                return self._fits[values][1]
            self._fits[values] = held, made
            self._bytes += _bytes(made)
            while self._bytes > MOST_BYTES:
                _, (_, oldest) = self._fits.popitem(last=False)
                self._bytes -= _bytes(oldest)
        return made


def _bytes(fit: "ParameterFit") -> int:
    arrays = [array for roll in fit.rolls.values() for array in (roll.z, roll.log_std)]
    return sum(array.nbytes for array in (*arrays, *fit.columns.values()))


def key_of(
    evidence: "Evidence",
    nominal: NominalModel,
    start: "ParameterFit",
    bounds: "Bounds",
    options: tuple[float, ...],
) -> tuple[tuple, tuple]:
    """All that a fit of the outputs of `start.rolls` depends on: values, arrays by their identity,
    and the objects identified, which have to live as long as the key."""
    outputs = tuple(sorted(start.rolls))
    felt = {
        name: value
        for name, value in start.setting.items()
        if set(nominal.parameters[name].outputs) & set(outputs)
    }
    held = (
        nominal,
        evidence.runs,
        *(evidence.masks[output] for output in outputs),
        *(start.columns[key] for key in sorted(start.columns)),
    )
    values = (
        outputs,
        tuple(sorted(felt.items())),
        tuple(bounds.items()),
        options,
        *(_levels(evidence.levels, output) for output in outputs),
        tuple(sorted(start.columns)),
        tuple(map(id, held)),
    )
    return values, held


def _levels(levels: np.record, output: str) -> tuple[float, ...]:
    """The noise levels (dtype NOISE) that the filter of an output uses."""
    names = levels.dtype.names or ()
    if output == BALL:
        return tuple(float(levels[name]) for name in names if name.startswith(BALL))
    a = SERVO.index(output)
    return tuple(float(levels[name][a]) for name in names if not name.startswith(BALL))
