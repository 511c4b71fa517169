"""A parameter that is no constant, though the model takes it for one."""

from dataclasses import dataclass

from calibration.gap.model.parameters import BALL, Parameter


@dataclass(frozen=True)
class Change:
    """A parameter that goes from `begin` to `end` [its SI unit] over the run, or over `runs` of
    them, and the output that shows it; `others` would explain the same by changing.
    """

    output: str
    parameter: Parameter
    begin: float
    end: float
    runs: int
    others: tuple[Parameter, ...] = ()

    @property
    def channel(self) -> str:
        """The channel that shows it."""
        if self.output != BALL:
            return self.output
        return f"ball_{'y' if self.parameter.axis == 'y' else 'x'}"
