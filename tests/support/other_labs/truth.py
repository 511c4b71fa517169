"""What a lab's recording really is, and whether a log says the same."""

from dataclasses import dataclass

import numpy as np

from tests.support.other_labs.bench import Axis


@dataclass(frozen=True)
class Truth:
    """The two axes of the bench in SI, and which columns of the log the lab recorded.

    kinds: of theta, command, voltage; start_s: time of the first recorded row. Which way a lab
    counts an axis of the plate, and which one it calls x, is its own choice: a log is right if
    every signal of an axis made the same choice.
    """

    axes: tuple[Axis, Axis]
    kinds: tuple[str, ...] = ("command",)
    start_s: float = 0.0

    def faults(self, log) -> list[str]:
        """What is wrong in a log (anything that gives columns by name), tried with both choices."""
        best: list[str] | None = None
        for order in ((0, 1), (1, 0)):
            found: list[str] = []
            for own, theirs in zip("xy", order, strict=True):
                wrong = [self._axis(log, own, theirs, sign) for sign in (1, -1)]
                found += min(wrong, key=len)
            if best is None or len(found) < len(best):
                best = found
        return best or []

    def _axis(self, log, own: str, theirs: int, sign: int) -> list[str]:
        axis = self.axes[theirs]
        wrong = []
        signals = {f"ball_{own}_m": axis.seen}
        if "command" in self.kinds:
            signals[f"command_{own}_rad"] = axis.command
        if "theta" in self.kinds:
            signals[f"theta_{own}_rad"] = axis.angle
        if "voltage" in self.kinds:
            signals[f"voltage_{own}_V"] = axis.volts
        for name, true in signals.items():
            t_s, said = log["t_s"], np.asarray(log[name], float)
            true = sign * np.interp(t_s + self.start_s, axis.t, _held(true))
            good = np.isfinite(true) & np.isfinite(said)
            if good.sum() < 100:
                wrong.append(f"{name} is missing")
                continue
            true, said = true[good], said[good]
            alike = float(np.corrcoef(true, said)[0, 1])
            times = float(said.std() / true.std()) * np.sign(alike)
            if abs(times - 1) > 0.06 or alike < 0.9:
                wrong.append(f"{name}: {times:.3g} of the truth (correlation {alike:.2f})")
            elif not name.startswith("voltage"):
                away = abs(float(np.median(said - true)))
                if away > 0.03 + 0.1 * np.ptp(true):
                    wrong.append(f"{name}: off by {away:.3g}")
        return wrong


def _held(values: np.ndarray) -> np.ndarray:
    values = np.asarray(values, float)
    at = np.maximum.accumulate(np.where(np.isfinite(values), np.arange(len(values)), 0))
    return values[at]
