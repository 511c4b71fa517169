"""The frequencies at which the residuals of an output swing most."""

from collections.abc import Sequence

import numpy as np

from calibration.gap.model.parameters import BALL
from calibration.gap.model.state import State

LONGEST_STEP_S = 0.005  # of the times between which residuals are taken as straight; chosen
HIGHEST_HZ = 25.0  # chosen: what shakes a table faster hardly moves a ball
FINENESS = 16  # frequencies for each that the log's length resolves: phases are right within pi/16
APART_HZ = 0.3  # of two peaks; chosen


def peaks(state: State, output: str, axes: Sequence[int] = (0, 1)) -> list[float]:
    """The two frequencies [Hz] with the largest periodogram over the mean of their neighbours, of
    the longest run; of the ball that on `axes`."""
    z = state.fit.z(output) * state.evidence.masks[output]
    t, run = state.evidence.times(output)
    chosen = run == np.bincount(run).argmax()
    t, z = t[chosen], z[chosen]
    columns = [z[a::2] for a in axes] if output == BALL else [z]
    t = t[0::2] if output == BALL else t
    step = max(float(np.median(np.diff(t))), LONGEST_STEP_S)
    even = np.arange(t[0], t[-1], step)
    swings = [np.fft.rfft(np.interp(even, t, c), FINENESS * len(even)) for c in columns]
    power = np.sum(np.abs(swings) ** 2, axis=0)
    hz = np.fft.rfftfreq(FINENESS * len(even), step)
    band = (hz > 2.0 / (t[-1] - t[0])) & (hz < min(HIGHEST_HZ, 0.45 / step))
    hz, power = hz[band], power[band]
    if not power.any():
        return []
    width = max(len(hz) // 12, 5)
    floor = np.convolve(np.pad(power, width, mode="reflect"), np.ones(2 * width + 1), "valid")
    ratio = np.divide(power, floor, out=np.zeros_like(power), where=floor > 0.0)
    first = int(ratio.argmax())
    far = np.abs(hz - hz[first]) > APART_HZ
    second = [float(hz[far][ratio[far].argmax()])] if far.any() else []
    return [float(hz[first]), *second]
