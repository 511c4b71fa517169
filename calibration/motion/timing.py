"""The delay of the camera's time stamps from a plate that wiggles: markers against encoders.

The markers give the plate's tilt in every frame, the encoders the servo's angle in every tick. A
joint with backlash makes the plate lag by an angle that does not depend on the speed, a delay by a
time. A wiggle of several frequencies tells them apart, so both are fitted by least squares:

    sin(phi)(t_frame) = offset + scale ratio sin(theta_p(t_frame - delay)),

theta_p the angle behind the backlash. Offset and scale (a cross-talk of the mounting) are linear.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from calibration.camera.plate import of_camera
from calibration.camera.sheet import CalibrationError
from calibration.motion.readout import ReadoutRecorder
from calibration.motion.rolling import behind_backlash
from calibration.records import TimingRecord, Value
from calibration.statistics import jackknife_std, student_quantile
from rig.hardware.camera.plate_tilt import MarkerTilt
from rig.parameters import Rig
from vision.frames import Frame
from vision.plate.markers import MarkerLayout
from vision.view import View

MIN_FRAMES, MIN_SPEED_RAD_S = 60, 0.5
_MOST_BACKLASH_RAD, _LONGEST_S = 0.12, 0.3
_GROUPS = 10
# What the rigid joint leaves out (its shaft's damping, the tick in which the gap closes), on
# simulated tables: it repeats, so that the jackknife does not see it.
_MODEL_S = 0.0002


@dataclass(frozen=True, eq=False)
class Wiggle:
    """Recording of a wiggle: encoder times `t_s` (n,) and servo angles `theta_rad` (n, 2); the
    frames' time stamps `stamp_s` (m,), of the rows that show the plate, and the sines of its tilt
    about x and y seen in them, `sines` (m, 2); `readout_s` of the camera, if the frames tell it."""

    t_s: np.ndarray
    theta_rad: np.ndarray
    stamp_s: np.ndarray
    sines: np.ndarray
    readout_s: Value | None = None


def camera_delay(wiggle: Wiggle, rig: Rig) -> TimingRecord:
    """The camera's delay with its 95 % interval (jackknife over tenths of the wiggle) and the
    joints' backlash, both fitted by the module's equation.

    `CalibrationError`: under 60 frames with markers, a wiggle slower than 0.5 rad/s rms, or a plate
    that does not follow its servos.
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

        bounds = ([-0.05, 0.0, 0.0], [_LONGEST_S, _MOST_BACKLASH_RAD, _MOST_BACKLASH_RAD])
        scale = (0.003, 0.01, 0.01)
        return least_squares(left, start, bounds=bounds, x_scale=scale, diff_step=1e-3).x

    whole = np.arange(len(stamp))
    starts = [
        np.array((late, width, width)) for late in (0.005, 0.05, 0.12) for width in (0.003, 0.03)
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
    without_one = np.array([fit(whole[groups != k], best) for k in range(_GROUPS)])
    half_s = student_quantile(_GROUPS - 1) * float(jackknife_std(without_one)[0]) + _MODEL_S
    return TimingRecord(
        delay_s=Value.around(float(best[0]), half_s),
        play_rad={"x": float(best[1]), "y": float(best[2])},
        frames=len(stamp),
        source="markers",
        readout_s=wiggle.readout_s,
    )


def _residual(wiggle: Wiggle, rig: Rig, stamp, sines, p: np.ndarray) -> np.ndarray:
    """Seen minus expected sines (m, 2) at `p` = (delay, widths x, y); offset and scale fitted."""
    left = np.empty_like(sines)
    for a in range(2):
        behind = behind_backlash(wiggle.theta_rad[:, a], p[1 + a])
        told = rig.linkage.ratio * np.sin(np.interp(stamp - p[0], wiggle.t_s, behind))
        columns = np.column_stack((np.ones_like(told), told))
        left[:, a] = sines[:, a] - columns @ np.linalg.lstsq(columns, sines[:, a])[0]
    return left


def expected_sines(wiggle: Wiggle, record: TimingRecord, rig: Rig) -> np.ndarray:
    """Sines (m, 2) of the tilt that the encoders and the record's delay and widths give for each
    frame of the wiggle; offset and scale are fitted to the seen sines."""
    p = np.array((record.delay_s.value, record.play_rad["x"], record.play_rad["y"]))
    return wiggle.sines - _residual(wiggle, rig, wiggle.stamp_s, wiggle.sines, p)


class TiltRecorder:
    """Collects the plate's tilt relative to `level`, the view of the level plate, from the frames
    in which its markers are seen (`rig.hardware.camera.plate_tilt.MarkerTilt`), and how long the
    camera takes from row to row."""

    def __init__(self, level: View, layout: MarkerLayout) -> None:
        global_shutter = replace(level, camera=replace(level.camera, readout_s=0.0))
        self._markers = MarkerTilt(global_shutter, layout)
        self._readout = ReadoutRecorder(layout)
        self._row = float(level.pixel_from_plate(np.zeros(3))[0, 1])
        self._camera = level.camera
        self._rows: list[tuple[float, float, float]] = []

    def add(self, frame: Frame) -> None:
        """Measure the tilt in one frame; a frame with too few markers is skipped.

        `CalibrationError`: the frame is not of the camera's size.
        """
        of_camera(frame.image, self._camera)
        tilt, _, view = self._markers.step(frame, np.eye(3))
        self._readout.add(frame.t_s, view if tilt is not None else None, frame.image)
        if tilt is not None:
            self._rows.append((tilt.exposed_s, *tilt.xy_m))

    def wiggle(self, t_s: np.ndarray, theta_rad: np.ndarray) -> Wiggle:
        """What the frames showed of the plate up to the last of the encoders' times `t_s` (n,),
        with their angles (n, 2).

        The plate is seen where its centre is in the picture, whose row is late or early.
        """
        rows = np.array(self._rows).reshape(-1, 3)
        rows = rows[rows[:, 0] <= t_s[-1]]
        readout = self._readout.readout_s()
        late = ((self._row + 0.5) / self._camera.height_px - 0.5) * (
            readout.value if readout else 0.0
        )
        return Wiggle(t_s, theta_rad, rows[:, 0] + late, rows[:, 1:], readout)
