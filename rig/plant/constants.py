"""What one step of the plant needs of its record, as plain numbers that live in registers.

A record lies in memory and could change with every store; a tuple of numbers cannot. The fields
bear the record's names, so an equation takes either. `constants_of` reads one lane's out of a
block in which the lanes of a number lie side by side (`vectorized_plants.py`).
"""

from collections import namedtuple

import numpy as np

from rig.compiled import inlined
from rig.plant.plant_record import PLANT

PAIRS = (  # per axis
    "torque_per_volt motor_damping motor_per_torque motor_per_volt "
    "gear_k gear_c gear_decay gear_1 gear_2 joint_k joint_c joint_decay joint_1 joint_2 "
    "saturation_limit_V supply_sag_drop_1_V dead_zone_positive_V dead_zone_negative_V "
    "gain_asymmetry_fraction gain_drift_rate_1_s voltage_offset_offset_V "
    "cogging_amplitude_V cogging_phase_rad cogging_periods_per_turn "
    "viscous_asymmetry_fraction_1 "
    "coulomb_friction_friction_V friction_held coulomb_friction_softness_rad_s "
    "stribeck_friction_extra_V stribeck_friction_speed_rad_s "
    "transmission_ripple_amplitude_rad transmission_ripple_phase_rad "
    "transmission_ripple_periods_per_turn linkage_quadratic_coefficient_1_rad "
    "linkage_cubic_coefficient_1_rad2 cross_coupling_fraction level_offset_slope_rad "
    "level_drift_rate_rad_s plate_bowl_stiffness_1_s2 rolling_resistance_deceleration_m_s2 "
    "viscous_drag_rate_1_s ratio weight half_side"
).split()
SINGLES = (
    "arm_per_torque plate_per_torque arm_stick plate_stick stop_rad radius factor wall_restitution"
).split()
UNIFORM = ("step_s", "shaft_model", "walls")  # the same in all lanes of a block
# Effects that cost a sine, an exponential or a root a step; in a block without them all the
# compiler sees their nulls as literals and drops the work.
COSTLY = (
    "cogging_amplitude_V",
    "coulomb_friction_softness_rad_s",
    "stribeck_friction_extra_V",
    "transmission_ripple_amplitude_rad",
    "rolling_resistance_deceleration_m_s2",
)
LANES = 8
Constants = namedtuple("Constants", (*PAIRS, *SINGLES, *UNIFORM))
ROWS = 2 * len(PAIRS) + len(SINGLES)


def _reader(nulls: tuple[str, ...] = ()):
    """A compiled function (block, lane, step, shaft model, walls) -> Constants of that lane."""
    values, row = [], 0
    for name in PAIRS:
        pair = f"(b[{row * LANES} + lane], b[{(row + 1) * LANES} + lane])"
        values.append("(0.0, 0.0)" if name in nulls else pair)
        row += 2
    for _ in SINGLES:
        values.append(f"b[{row * LANES} + lane]")
        row += 1
    made: dict = {}
    arguments = ", ".join(UNIFORM)
    source = f"def read(b, lane, {arguments}):\n return Constants({', '.join([*values, *UNIFORM])})"
    exec(source, {"Constants": Constants}, made)
    return inlined(made["read"])


constants_of = _reader()
cheap_constants_of = _reader(COSTLY)


_OFFSETS = [(PLANT.fields or {})[name][1] // 8 for name in (*PAIRS, *SINGLES)]
_PLACES = np.array([o + a for o in _OFFSETS[: len(PAIRS)] for a in (0, 1)] + _OFFSETS[len(PAIRS) :])


def rows_of(plants: np.ndarray) -> np.ndarray:
    """Return the numbers of plants (n,), dtype PLANT, by the rows of a block, (ROWS, n)."""
    return plants.view(np.float64).reshape(len(plants), -1)[:, _PLACES].T
