"""How late the camera's frames are stamped, from a plate that wiggles: markers against encoders.

The markers give the plate's tilt in every frame, the encoders the servo's angle in every tick. A
joint with play makes the plate late as well, by an angle that does not depend on the speed; a delay
is late by a time. A wiggle of several frequencies tells them apart, so both are fitted:

    sin(phi)(t_frame) = offset + scale ratio sin(theta_p(t_frame - delay)),

theta_p the angle behind the play. Offset and scale (a cross-talk of the mounting) are linear.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import t as student

from calibration.backlash import behind_play
from calibration.records import TimingRecord, Value
from calibration.sheet import CalibrationError
from rig.parameters import Rig
from vision.frames import Frame
from vision.markers import MarkerLayout, find_pose, track_pose
from vision.view import View

MIN_FRAMES, MIN_SPEED_RAD_S = 60, 0.5
_MOST_PLAY_RAD, _LONGEST_S = 0.12, 0.3
_GROUPS = 10
# What the rigid joint leaves out (its shaft's damping, the tick in which the play closes), on
# simulated tables: it repeats, so that the jackknife does not see it.
_MODEL_S = 0.0002


@dataclass(frozen=True, eq=False)
class Wiggle:
    """Encoders t_s (n,), theta (n, 2); frames' stamps (m,) and the plate's sines (m, 2)."""

    t_s: np.ndarray
    theta_rad: np.ndarray
    stamp_s: np.ndarray
    sines: np.ndarray


def plate_sines(seen: View, level: View) -> tuple[float, float]:
    """Sines of the plate's tilt (positive: the +x, +y side is down) in a view, against level."""
    turn = level.camera_from_plate[:3, :3].T @ seen.camera_from_plate[:3, :3]
    return float(-turn[2, 0]), float(-turn[2, 1])


def camera_delay(wiggle: Wiggle, rig: Rig) -> TimingRecord:
    """The delay with its 95 % interval and the plays that came with it.

    Raises `CalibrationError` for too few frames, too slow a wiggle, or a plate that does not follow
    its servos.
    """
    first, last = wiggle.t_s[0] + _LONGEST_S, wiggle.t_s[-1]
    used = (wiggle.stamp_s >= first) & (wiggle.stamp_s <= last)
    used &= np.isfinite(wiggle.sines).all(axis=1)
    stamp, sines = wiggle.stamp_s[used], wiggle.sines[used]
    if len(stamp) < MIN_FRAMES:
        raise CalibrationError(
            f"the plate's markers were seen in {len(stamp)} frames of the wiggle, {MIN_FRAMES} are "
            "needed: light, focus, a longer wiggle"
        )
    speed = np.sqrt(np.mean(np.gradient(wiggle.theta_rad, wiggle.t_s, axis=0) ** 2, axis=0))
    if speed.max() < MIN_SPEED_RAD_S:
        raise CalibrationError(
            f"the servos turned at {speed.max():.2f} rad/s rms, {MIN_SPEED_RAD_S} are needed for a "
            "delay: wiggle faster"
        )

    def fit(chosen: np.ndarray, start: np.ndarray) -> np.ndarray:
        def left(p: np.ndarray) -> np.ndarray:
            return 1e3 * _residual(wiggle, rig, stamp[chosen], sines[chosen], p).ravel()

        bounds = ([-0.05, 0.0, 0.0], [_LONGEST_S, _MOST_PLAY_RAD, _MOST_PLAY_RAD])
        scale = (0.003, 0.01, 0.01)
        return least_squares(left, start, bounds=bounds, x_scale=scale, diff_step=1e-3).x

    whole = np.arange(len(stamp))
    starts = [
        np.array((late, play, play)) for late in (0.005, 0.05, 0.12) for play in (0.003, 0.03)
    ]
    fits = [fit(whole, start) for start in starts]
    best = min(fits, key=lambda p: float(np.sum(_residual(wiggle, rig, stamp, sines, p) ** 2)))
    rms = float(np.sqrt(np.mean(_residual(wiggle, rig, stamp, sines, best) ** 2)))
    if rms > 0.3 * float(np.std(sines)):
        raise CalibrationError(
            f"the plate does not follow its servos: {rms:.4f} of tilt is left of "
            f"{float(np.std(sines)):.4f}: are the encoder's and the markers' axes the same?"
        )
    groups = whole * _GROUPS // len(whole)
    parts = np.array([fit(whole[groups != k], best) for k in range(_GROUPS)])[:, 0]
    std = float(np.sqrt((_GROUPS - 1) / _GROUPS * np.sum((parts - parts.mean()) ** 2)))
    wide = float(student.ppf(0.975, _GROUPS - 1)) * std + _MODEL_S
    delay = float(best[0])
    return TimingRecord(
        delay_s=Value(value=delay, low=delay - wide, high=delay + wide),
        play_rad={"x": float(best[1]), "y": float(best[2])},
        frames=len(stamp),
        source="markers",
    )


def _residual(wiggle: Wiggle, rig: Rig, stamp, sines, p: np.ndarray) -> np.ndarray:
    """Seen minus expected sines (m, 2) at delay and plays `p` (3,), offset and scale fitted."""
    left = np.empty_like(sines)
    for a in range(2):
        behind = behind_play(wiggle.theta_rad[:, a], p[1 + a])
        told = rig.linkage.ratio * np.sin(np.interp(stamp - p[0], wiggle.t_s, behind))
        columns = np.column_stack((np.ones_like(told), told))
        left[:, a] = sines[:, a] - columns @ np.linalg.lstsq(columns, sines[:, a])[0]
    return left


def expected_sines(wiggle: Wiggle, record: TimingRecord, rig: Rig) -> np.ndarray:
    """Sines (m, 2) that the encoders tell of each frame at the recorded delay and plays."""
    p = np.array((record.delay_s.value, record.play_rad["x"], record.play_rad["y"]))
    return wiggle.sines - _residual(wiggle, rig, wiggle.stamp_s, wiggle.sines, p)


class TiltWatch:
    """Follows the plate's markers from frame to frame and keeps its tilt against `level`."""

    def __init__(self, level: View, layout: MarkerLayout) -> None:
        self._level, self._layout, self._last = level, layout, level
        self._seen: list[tuple[float, float, float]] = []

    def look(self, frame: Frame) -> None:
        """Look at one frame; where the markers are not found it is passed over."""
        fit = track_pose(frame.image, self._layout, self._last)
        if not fit.accepted:
            fit = find_pose(frame.image, self._layout, self._level.camera)
        if fit is None or not fit.accepted:
            return
        self._last = fit.view
        self._seen.append((frame.t_s, *plate_sines(fit.view, self._level)))

    def seen(self) -> tuple[np.ndarray, np.ndarray]:
        """Stamps (m,) and sines (m, 2) of the frames in which the plate was seen."""
        found = np.array(self._seen).reshape(-1, 3)
        return found[:, 0], found[:, 1:]
