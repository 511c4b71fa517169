"""What a section of the rig file is made of: its kinds of numbers, and values by axis."""

from dataclasses import replace
from typing import Annotated, Any, ClassVar, Self

from annotated_types import Ge, Gt, Interval
from pydantic import Strict

# What a number of the rig file may be; `rig.rigfile` holds a file against these types. Texts and
# truth values are none.
Finite = Annotated[float, Strict()]
NotNegative = Annotated[Finite, Ge(0)]
Positive = Annotated[Finite, Gt(0)]
Share = Annotated[Finite, Interval(ge=0, le=1)]
# What no such table exceeds or falls below, so that a number in millimetres, grams or milliseconds
# is refused: chosen, ten times what people build, and a tenth of the radius of a ball of 2 mm.
Length = Annotated[Finite, Interval(gt=1e-4, le=5)]  # m
Size = Annotated[Finite, Interval(ge=0, le=5)]  # m; 0: none
Mass = Annotated[Finite, Interval(gt=1e-6, le=10)]  # kg
Wait = Annotated[Finite, Interval(ge=0, le=10)]  # s; 0: none
Volts = Annotated[Finite, Interval(gt=0, le=100)]  # V
Turn = Annotated[Finite, Interval(gt=0, le=10)]  # rad; ten is a turn and a half
Lag = Annotated[Finite, Interval(gt=0, le=10)]  # s


class Section:
    """Base of the rig file's sections: infinite and undefined numbers are errors in a file.

    by_axis: keys that may differ between the axes. A section that has such keys has the fields `x`
    and `y`, {key: value}, which hold in place of the section's own value on that axis.
    """

    __pydantic_config__: ClassVar[Any] = {"allow_inf_nan": False}
    by_axis: ClassVar[tuple[str, ...]] = ()

    def on(self, axis: str) -> Self:
        """Return the section as it holds on the axis "x" or "y"."""
        return replace(self, **getattr(self, axis), x={}, y={})  # pyright: ignore[reportArgumentType]

    def pair(self, key: str) -> tuple[float, float]:
        """Return the value of `key` on x and on y."""
        own = getattr(self, key)
        return getattr(self, "x").get(key, own), getattr(self, "y").get(key, own)  # noqa: B009
