"""The C rival: `speed.c` built on the spot, fed with a plant's numbers."""

import ctypes
import subprocess
from pathlib import Path
from shutil import which

import numpy as np

AXIS = (
    "torque_per_volt motor_damping motor_inertia gear_k gear_c gear_decay gear_1 gear_2 joint_k "
    "joint_c joint_decay joint_1 joint_2 saturation_limit_V supply_sag_drop_1_V "
    "dead_zone_positive_V dead_zone_negative_V gain_asymmetry_fraction gain_drift_rate_1_s "
    "voltage_offset_offset_V cogging_amplitude_V cogging_phase_rad cogging_periods_per_turn "
    "coulomb_friction_friction_V stribeck_friction_extra_V stribeck_friction_speed_rad_s "
    "transmission_ripple_amplitude_rad transmission_ripple_phase_rad "
    "transmission_ripple_periods_per_turn linkage_quadratic_coefficient_1_rad "
    "linkage_cubic_coefficient_1_rad2 cross_coupling_fraction level_offset_slope_rad "
    "level_drift_rate_rad_s"
).split()
TABLE = (
    "step_s arm_inertia plate_inertia arm_friction joint_friction stop_rad ratio radius mass "
    "factor half_side"
).split()
BALL = "plate_bowl_stiffness_1_s2 rolling_resistance_deceleration_m_s2 viscous_drag_rate_1_s"
BUILDS = {
    "C -O3 -march=native -ffast-math": ("-O3", "-march=native", "-ffast-math"),
    "C -O3": ("-O3",),
}
_Numbers = ctypes.POINTER(ctypes.c_double)


def _numbers(a: np.ndarray):
    return a.ctypes.data_as(_Numbers)


def _one(value: np.ndarray) -> float:
    """A number of a plant's record; of a pair that is alike on both axes the first."""
    return float(np.ravel(value)[0])


class C:
    """One build of `speed.c`."""

    def __init__(self, folder: Path, flags: tuple[str, ...]) -> None:
        library = folder / ("speed" + "".join(flags) + ".so")
        source = Path(__file__).with_name("speed.c")
        command = ["gcc", *flags, "-shared", "-fPIC", str(source), "-o", str(library), "-lm"]
        subprocess.run(command, check=True)
        self._c = ctypes.CDLL(str(library))
        self._c.multiply_adds.restype = ctypes.c_double
        self._c.multiply_adds.argtypes = (ctypes.c_long, ctypes.c_double)

    def run(self, p: np.record, state: np.ndarray, volts: np.ndarray, steps: int) -> int:
        """Move `state` (of `pack_state`) on; ticks done before the ball fell."""
        parts = [[p[name][a] for name in AXIS] for a in (0, 1)]
        table = np.concatenate([*parts, [_one(p[n]) for n in TABLE + BALL.split()]])
        return self._c.run(_numbers(table), _numbers(state), _numbers(volts), len(volts), steps)

    def multiply_adds(self, rounds: int) -> float:
        """Do 16 vectors of 8 multiply-adds `rounds` times; returns their number."""
        self._c.multiply_adds(rounds, 0.999999)
        return 128.0 * rounds


def pack_state(s: np.ndarray) -> np.ndarray:
    """The product's state (11, 2) in C's order."""
    return np.concatenate([s[:8, 0], s[:8, 1], s[8], s[9], [s[10, 0]]])


def builds(folder: Path) -> dict[str, C]:
    """Every build by name; none without gcc."""
    if which("gcc") is None:
        return {}
    return {name: C(folder, flags) for name, flags in BUILDS.items()}
