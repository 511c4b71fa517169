"""Effects of a lab's own (`rig.own_effects`) in the plant's record, and what they add.

The record holds the address of each compiled equation, so that no kernel is compiled anew for a new
effect. An address holds in the process that made it: a record is packed where it is used.
"""

from collections.abc import Mapping
from math import isfinite

import numpy as np
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

from rig.compiled import compiled
from rig.own_effects import KEYS, SLOTS, OwnEffect

OWN = np.dtype(
    [
        ("servo", np.int64),  # is there one on this side?
        ("ball", np.int64),
        ("address", np.int64, (2, SLOTS)),  # by side, 0: none
        ("null", np.float64, (SLOTS,)),  # of the first number
        ("failed", np.int64),  # number, from 1, of the one that gave no finite number; 0: none
        ("values", np.float64, (2, SLOTS, KEYS)),  # by axis
    ]
)
SERVO, BALL = 0, 1


class DivergedError(OSError):
    """The simulated motion has left all bounds: no table moves like this."""

    outcome = "diverged"


def pack(own: tuple[OwnEffect, ...], values: Mapping[str, np.ndarray]) -> np.record:
    """Return the record (dtype OWN) of effects of one's own.

    values: field name (`Effect.field`) -> values of both axes (2,), as `rig.effects.values` gives
    them.
    """
    record = np.zeros(1, OWN)[0]
    for slot, one in enumerate(own):
        effect = one.effect
        record[effect.side] = 1
        record["address"][SERVO if effect.side == "servo" else BALL, slot] = one.address
        record["null"][slot] = effect.parameters[0].null
        for i, parameter in enumerate(effect.parameters):
            record["values"][:, slot, i] = values[effect.field(parameter.key)]
    return record


def acts(own: np.record) -> bool:
    """Whether an effect of the record (dtype OWN) departs from its null value on an axis."""
    there = np.any(own["address"] != 0, axis=0)
    return bool(np.any(there & (own["values"][:, :, 0] != own["null"])))


def check(record: np.record, own: tuple[OwnEffect, ...]) -> None:
    """Raise DivergedError where the effects `own` of a record (dtype OWN) gave no finite number."""
    if record["failed"]:
        file = own[int(record["failed"]) - 1].file
        raise DivergedError(
            f"effect file {file}: equation gave no finite number as the table moved: it must give "
            "one wherever the table goes and at every time"
        )


@intrinsic
def _call(typingctx, address, u, v, t, a, b, c, d):
    """The answer of the C function at `address`, of 3 + KEYS numbers."""
    signature = types.float64(types.int64, *[types.float64] * (3 + KEYS))

    def generate(context, builder, signature, arguments):
        double = ir.DoubleType()
        function = ir.FunctionType(double, [double] * (3 + KEYS)).as_pointer()
        return builder.call(builder.inttoptr(arguments[0], function), arguments[1:])

    return signature, generate


@compiled
def with_own(own, side, a, total, u, v, t):
    """`total` [V or m/s2] and what the effects of one's own on a side and axis `a` (0: x, 1: y) add
    to it; at their null values it is returned unchanged.

    own: record of `pack`; side: SERVO or BALL; u, v: angle [rad] and rate [rad/s], or place [m] and
    speed [m/s]; t: the run's time [s]. An answer that is not finite is noted for `check`.
    """
    for i in range(SLOTS):
        n = own.values[a, i]
        if own.address[side, i] != 0 and n[0] != own.null[i]:
            address = own.address[side, i]
            answer = _call(address, u, v, t, n[0], n[1], n[2], n[3])  # pyright: ignore[reportCallIssue]
            if not isfinite(answer):
                own.failed = i + 1
            total += answer
    return total
