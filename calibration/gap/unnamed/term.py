"""What is left without a name, fitted: one family of terms on one output."""

from dataclasses import dataclass

import numpy as np

from calibration.gap.model.parameters import BALL
from calibration.gap.model.state import State
from rig.discrepancy import Discrepancy


@dataclass(frozen=True, eq=False)
class UnnamedTerm:
    """An unnamed term: its output, its kind (map, speed, rhythm, segment, turning, slipping,
    swinging, swaying or pushes), score, coefficients (`unknown`), and the state with it in its
    model, not yet predicted with it (`plain` is without). The model cannot hold the last five:
    their `unknown` and state are those without, and `felt_m_s2` is their RMS by axis. `windows_s`:
    of pushes, when, and `runs`: in which run; `rhythms_hz`: of what sways or swings, by axis; 0 of
    one that does not."""

    output: str
    kind: str
    score: float
    unknown: Discrepancy
    state: State
    windows_s: tuple[tuple[float, float], ...] = ()
    runs: tuple[int, ...] = ()
    felt_m_s2: tuple[float, float] = (0.0, 0.0)
    rhythms_hz: tuple[float, float] = (0.0, 0.0)

    @property
    def channel(self) -> str:
        """The channel that the term moves most."""
        if self.output != BALL:
            return self.output
        size = [
            sum(
                float(np.sum(np.square(value)))
                for name, value in vars(self.unknown).items()
                if name.startswith("ball") and name.endswith(axis) and isinstance(value, tuple)
            )
            + (self.unknown.ball_segment["xy".index(axis)] ** 2)
            + felt**2
            for axis, felt in zip("xy", self.felt_m_s2, strict=True)
        ]
        return "ball_x" if size[0] >= size[1] else "ball_y"
