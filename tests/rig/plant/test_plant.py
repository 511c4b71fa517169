"""The whole table under given volts: convergence, energy, play and friction, symmetry, endings."""

from dataclasses import replace

import numpy as np
import pytest

from rig.parameters import Ball, Drive, Rig, Servo, Walls, torque_per_volt
from rig.plant import plant, plant_record
from rig.plant.ball import velocity
from rig.plant.plant import (
    ARM,
    ARM_RATE,
    BALL,
    BALL_W,
    GEAR_LOST,
    JOINT_LOST,
    MOTOR,
    MOTOR_RATE,
    PLATE,
    PLATE_RATE,
    SPIN,
)
from tests.support.simulated import (
    DEGREE,
    SMOOTH,
    TICK_S,
    ball_state,
    constant_volts,
    moved,
    smooth_rig,
    tilted,
)


def play(gear_deg=0.0, joint_deg=0.0):
    return {
        "gear_backlash": {a: {"play_rad": gear_deg * DEGREE} for a in "xy"},
        "joint_backlash": {a: {"play_rad": joint_deg * DEGREE} for a in "xy"},
    }


def swinging_volts(seconds=1.0, size=1.0):
    t = TICK_S * np.arange(round(seconds / TICK_S))
    return size * np.column_stack([np.sin(2 * np.pi * 2 * t), np.cos(2 * np.pi * 1.5 * t)])


# --- convergence -----------------------------------------------------------------------------


def gaps_to_fine(rig, rows, steps, **more):
    """Largest distance to a run with 2.5 us steps, for each of `steps`."""
    volts = swinging_volts(0.5)
    fine = moved(rig, volts, step_s=2.5e-6, **more)[:, rows]
    return [np.abs(moved(rig, volts, step_s=h, **more)[:, rows] - fine).max() for h in steps]


def test_first_order_in_the_step_where_motion_is_smooth():
    gaps = gaps_to_fine(smooth_rig(), [MOTOR, ARM, PLATE, BALL], (2e-4, 1e-4, 5e-5))
    assert gaps[1] < 2e-4
    for coarse, half in zip(gaps[:-1], gaps[1:], strict=True):  # noqa: RUF007
        assert 1.7 < coarse / half < 2.4


@pytest.mark.parametrize("effects", [play(gear_deg=1), play(joint_deg=1), play(1, 1.5)])
def test_still_converging_with_play_and_friction(effects):
    gaps = gaps_to_fine(Rig(effects=effects), [MOTOR, ARM, PLATE, BALL], (2e-4, 5e-5, 1.25e-5))
    assert gaps[0] > gaps[1] > gaps[2]
    assert gaps[2] < 0.25 * gaps[0]
    assert gaps[1] < 5e-4


# --- energy ----------------------------------------------------------------------------------

# A motor without back EMF to speak of (gain 1e4 rad/s/V) and its usual inertia.
UNDAMPED = Servo(gain_rad_s_V=1e4, time_constant_s=0.025 * 1e4 / 1.53)


def drive_energy(states, rig, a):
    """Kinetic and spring energy of one axis [J]; the spring is theta_d - theta_b (Eq. 2)."""
    p = plant_record.pack(rig)
    s = states[:, :, a]
    kinetic = 0.5 * (
        p["motor_inertia"][a] * s[:, MOTOR_RATE] ** 2
        + p["arm_inertia"] * s[:, ARM_RATE] ** 2
        + p["plate_inertia"] * s[:, PLATE_RATE] ** 2
    )
    gear = s[:, MOTOR] - s[:, ARM] - s[:, GEAR_LOST]
    joint = s[:, ARM] - s[:, PLATE] - s[:, JOINT_LOST]
    return kinetic + 0.5 * (p["gear_k"][a] * gear**2 + p["joint_k"][a] * joint**2)


@pytest.mark.parametrize("play_deg", [(0, 0), (2, 0), (0, 2), (1, 1.5)])
@pytest.mark.parametrize("damping", [0.02, 0.002])
def test_energy_of_an_unforced_drive_never_grows(play_deg, damping):
    drive = replace(SMOOTH, gear_damping_nm_s=damping, joint_damping_nm_s=damping)
    rig = smooth_rig(drive=drive, servo=UNDAMPED, effects=play(*play_deg))
    state = plant.rest()
    state[MOTOR_RATE], state[PLATE_RATE] = (0.5, -0.4), (-6.0, 2.0)
    excess = []
    for h in (1e-4, 2.5e-5):
        states = moved(rig, constant_volts(0, 0, 0.4), state=state, step_s=h, held=True)
        # The end stop would hide an error: it is never reached.
        assert np.abs(states[:, MOTOR]).max() < 0.6
        energy = np.array([drive_energy(states, rig, a) for a in (0, 1)])
        growth = np.maximum.accumulate(energy[:, ::-1], axis=1)[:, ::-1] - energy
        excess.append(growth.max() / energy[:, 0].max())
        assert np.all(energy[:, -1] < energy[:, 0])
    # Symplectic Euler lets energy swing about its true value, in proportion to the step.
    assert excess[0] < 0.02
    assert excess[1] < 0.4 * excess[0] + 1e-6


def test_undamped_shaft_keeps_its_energy():
    """Dead-zone shafts have no damping (Eq. 7): energy stays, neither lost nor made."""
    drive = replace(SMOOTH, shaft_model="dead_zone")
    rig = smooth_rig(drive=drive, servo=UNDAMPED, effects=play(1, 1))
    state = plant.rest()
    state[PLATE_RATE] = 3.0, -3.0
    states = moved(rig, constant_volts(0, 0, 1.0), state=state, held=True)
    s, p = states[:, :, 0], plant_record.pack(rig)
    half = 0.5 * DEGREE

    def spring(twist):
        return np.maximum(np.abs(twist) - half, 0.0)

    energy = 0.5 * (
        p["motor_inertia"][0] * s[:, MOTOR_RATE] ** 2
        + p["arm_inertia"] * s[:, ARM_RATE] ** 2
        + p["plate_inertia"] * s[:, PLATE_RATE] ** 2
        + 30.0 * spring(s[:, MOTOR] - s[:, ARM]) ** 2
        + 30.0 * spring(s[:, ARM] - s[:, PLATE]) ** 2
    )
    assert np.abs(energy / energy[0] - 1).max() < 0.12
    assert energy[-50:].mean() == pytest.approx(energy[:50].mean(), rel=0.05)


def test_exact_shaft_comes_to_the_dead_zone_in_the_whole_drive():
    """Before undamped ringing makes differences grow, the gap falls in proportion to c."""
    volts, ends = constant_volts(1.0, -0.5, 0.04), []
    for model, c in (("dead_zone", 0.0), ("exact", 2e-3), ("exact", 2e-4), ("exact", 2e-5)):
        drive = replace(SMOOTH, shaft_model=model, gear_damping_nm_s=c, joint_damping_nm_s=c)
        rig = smooth_rig(drive=drive, effects=play(gear_deg=1))
        ends.append(moved(rig, volts, step_s=1e-5, held=True)[:, MOTOR])
    gaps = [np.abs(end - ends[0]).max() for end in ends[1:]]
    assert gaps[0] < 1e-4
    assert 6 < gaps[0] / gaps[1] < 15
    assert 6 < gaps[1] / gaps[2] < 15


def test_exact_shaft_without_play_is_no_play_at_all():
    volts, none = swinging_volts(), Rig(drive=replace(Drive(), shaft_model="none"))
    np.testing.assert_allclose(moved(Rig(), volts), moved(none, volts), rtol=0, atol=1e-13)


# --- play and friction -----------------------------------------------------------------------

BALL_TORQUE_NM = 0.003 * 9.81 * 2 * 0.0254 / 0.275 * 0.1  # 3 g at 10 cm, felt at the arm


def test_the_balls_torque_is_small_against_joint_friction():
    assert Drive().joint_friction_nm > 5 * BALL_TORQUE_NM


@pytest.mark.parametrize("place", [0.1, -0.1])
def test_plate_keeps_its_place_in_the_play_while_friction_holds_it(place):
    rig = Rig(effects=play(joint_deg=2))
    states = moved(rig, constant_volts(0, 0, 0.3), state=ball_state((place, place)))
    assert np.all(states[:, PLATE] == 0.0)


@pytest.mark.parametrize("place", [0.1, -0.1])
def test_plate_without_friction_drops_to_the_balls_side(place):
    drive = replace(Drive(), joint_friction_nm=0.0)
    rig = Rig(drive=drive, effects=play(joint_deg=2))
    states = moved(rig, constant_volts(0, 0, 0.3), state=ball_state((place, place)))
    # Half the play, and the spring's give under the ball.
    expected = np.sign(place) * (1 * DEGREE + BALL_TORQUE_NM / 30)
    np.testing.assert_allclose(states[150, PLATE], expected, rtol=0.1)
    assert np.all(np.sign(place) * states[150, BALL] > 0.1)  # and the ball rolls after it


@pytest.mark.parametrize("row", ["gear", "joint"])
def test_reversal_loses_the_full_play(row):
    """Slow swing: behind the play the angle follows half the width late, on either way."""
    drive = replace(Drive(), arm_friction_nm=0.01)
    rig = Rig(drive=drive, effects=play(**{f"{row}_deg": 2.0}))
    before, behind = (MOTOR, ARM) if row == "gear" else (ARM, PLATE)
    states = moved(rig, swinging_volts(1.0, 1.0), held=True)[100:]
    twist = (states[:, before] - states[:, behind])[:, 0]
    moving = np.abs(states[:, PLATE_RATE, 0]) > 0.3
    side = np.sign(states[:, PLATE_RATE, 0])
    np.testing.assert_allclose(twist[moving] * side[moving], 1 * DEGREE, atol=0.15 * DEGREE)
    assert {-1.0, 1.0} <= set(side[moving])


@pytest.mark.parametrize("row", ["gear", "joint"])
def test_offset_moves_both_break_points(row):
    """beta_1 = offset + half, beta_2 = offset - half: which side pushes shows which one."""
    pair = {"play_rad": 2 * DEGREE, "offset_rad": 0.6 * DEGREE}
    rig = Rig(effects={f"{row}_backlash": {"x": pair}})
    before, behind = (MOTOR, ARM) if row == "gear" else (ARM, PLATE)
    for volts, point in ((1.0, 1.6 * DEGREE), (-1.0, -0.4 * DEGREE)):
        state = moved(rig, constant_volts(volts, 0.0, 0.2), held=True)[-1]
        wound = np.sign(volts) * 0.03 * DEGREE  # the shaft winds up under friction
        assert state[before, 0] - state[behind, 0] == pytest.approx(
            point + wound, abs=0.03 * DEGREE
        )


def test_end_stop_holds_the_motor_and_lets_it_go_again():
    rig = smooth_rig()
    volts = np.concatenate([constant_volts(6, -6, 0.4), constant_volts(-1, 1, 0.2)])
    states = moved(rig, volts, held=True)
    stop = rig.servo.stop_rad
    assert np.abs(states[:, MOTOR]).max() == pytest.approx(stop, abs=1e-12)
    np.testing.assert_allclose(states[200, MOTOR], [stop, -stop])
    assert np.all(states[200, MOTOR_RATE] == 0.0)
    assert np.all(np.abs(states[-1, MOTOR]) < stop - 0.1)


def test_dry_friction_stops_a_plate_and_does_not_reverse_it():
    drive = replace(Drive(), gear_stiffness_nm_rad=1e-9, joint_stiffness_nm_rad=1e-9)
    drive = replace(drive, gear_damping_nm_s=0.0, joint_damping_nm_s=0.0)
    state = plant.rest()
    state[PLATE_RATE] = 0.5, -0.5
    states = moved(Rig(drive=drive), constant_volts(0, 0, 0.01), state=state, step_s=1e-5)
    slowing = drive.joint_friction_nm / drive.plate_inertia_kg_m2
    t = TICK_S * np.arange(len(states))
    expected = np.maximum(0.5 - slowing * t, 0.0)
    np.testing.assert_allclose(states[:, PLATE_RATE, 0], expected, atol=1e-6)
    np.testing.assert_allclose(states[:, PLATE_RATE, 1], -expected, atol=1e-6)


# --- input delay, endings --------------------------------------------------------------------


def test_input_delay_of_whole_ticks_shifts_the_response_exactly():
    volts, ticks = swinging_volts(0.4), 7
    delayed = Rig(effects={"input_delay": {a: {"delay_s": ticks * TICK_S} for a in "xy"}})
    late = moved(delayed, volts, held=True)[:, : GEAR_LOST + 2]
    prompt = moved(Rig(), volts, held=True)[:, : GEAR_LOST + 2]
    assert np.all(late[: ticks + 1] == 0.0)
    np.testing.assert_array_equal(late[ticks:], prompt[:-ticks])


def test_input_delay_within_a_tick_shifts_by_that_part():
    """0.7 ms late: the response at t is that of an undelayed plant with volts moved by 7 steps."""
    volts = swinging_volts(0.2)
    delayed = smooth_rig(effects={"input_delay": {"x": {"delay_s": 0.0007}}})
    late = moved(delayed, volts, held=True)[:, MOTOR, 0]
    fine = np.repeat(volts, 20, axis=0)
    shifted = np.concatenate([np.zeros((7, 2)), fine])[: len(fine)]
    p, axis, expected = plant_record.pack(smooth_rig()), plant.axis_of(plant.rest(), 0), [0.0]
    for k, pair in enumerate(shifted):
        axis = plant.drive_step(p, 0, pair[0], 0.0, axis)
        if k % 20 == 19:
            expected.append(axis[0])
    np.testing.assert_allclose(late, expected, atol=1e-13)


def test_delay_on_one_axis_leaves_the_other_alone():
    volts = swinging_volts(0.2)
    rig = Rig(effects={"input_delay": {"y": {"delay_s": 0.01}}})
    one, none = moved(rig, volts, held=True), moved(Rig(), volts, held=True)
    np.testing.assert_array_equal(one[:, :GEAR_LOST, 0], none[:, :GEAR_LOST, 0])
    assert np.abs(one[:, MOTOR, 1] - none[:, MOTOR, 1]).max() > 1e-3


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("way", [1, -1])
def test_ball_is_lost_when_its_contact_point_leaves_the_plate(axis, way):
    place, speed = [0.0, 0.0], [0.0, 0.0]
    place[axis], speed[axis] = way * 0.13, way * 0.1
    states = moved(smooth_rig(), constant_volts(0, 0, 1.0), state=ball_state(place, speed))
    ticks = len(states) - 1
    assert ticks == int(np.floor(0.0075 / 0.1 / TICK_S)) + 1  # 75 ms to the edge at 0.1375 m
    assert abs(states[-1, BALL, axis]) > 0.1375 > abs(states[-2, BALL, axis])


def test_walls_keep_the_ball_and_take_energy():
    rig = smooth_rig(walls=Walls(present=True, restitution=0.5))
    states = moved(rig, constant_volts(0, 0, 4.0), state=ball_state((0, 0), (0.2, -0.1)))
    assert len(states) == 2001
    assert np.abs(states[:, BALL]).max() <= 0.1375 - rig.ball.radius_m + 1e-12
    speeds = np.unique(np.round(np.abs(states[:, BALL_W, 0]), 9))
    np.testing.assert_allclose(speeds[::-1][:3], [0.2, 0.1, 0.05])


def test_held_ball_keeps_its_place_and_does_not_load_the_plate():
    rig = Rig(drive=replace(Drive(), joint_friction_nm=0.0), effects=play(joint_deg=2))
    states = moved(rig, swinging_volts(0.3), state=ball_state((0.1, -0.1)), held=True)
    assert np.all(states[:, BALL] == [0.1, -0.1])
    still = moved(rig, constant_volts(0, 0, 0.1), state=ball_state((0.1, -0.1)), held=True)
    assert np.all(still[:, PLATE] == 0.0)


def test_a_ball_let_go_on_a_moving_plate_starts_at_rest_on_it():
    rig = smooth_rig()
    state = moved(rig, swinging_volts(0.1), state=ball_state((0.1, -0.1)), held=True)[-1]
    _, _, o1, o2 = plant.plate_motion(state, plant_record.pack(rig))
    assert min(abs(o1), abs(o2)) > 0.01
    w_x, w_y = state[BALL_W]
    np.testing.assert_allclose(velocity(w_x, w_y, o1, o2, rig.ball.radius_m), 0.0, atol=1e-15)


def test_push_is_an_acceleration_of_the_ball():
    pushes = np.tile([0.4, -0.2], (250, 1))
    states = moved(smooth_rig(), np.zeros((250, 2)), pushes=pushes)
    np.testing.assert_allclose(states[-1, BALL], [0.05, -0.025], rtol=1e-3)


# --- symmetry --------------------------------------------------------------------------------

LOADED = Rig(effects=play(1, 1.5) | {"coulomb_friction": {a: {"friction_V": 0.05} for a in "xy"}})


def test_swapping_the_axes_swaps_the_answer():
    """A reflection: the spin turns its sign. To rounding (1 - s_x^2 - s_y^2 is not associative)."""
    volts = swinging_volts(0.6)
    start = ball_state((0.03, -0.02), (0.05, 0.02))
    straight = moved(LOADED, volts, state=start)
    swapped = moved(LOADED, volts[:, ::-1], state=start[:, ::-1])
    rows = [i for i in range(plant.STATE_ROWS) if i != SPIN]
    np.testing.assert_allclose(swapped[:, rows, ::-1], straight[:, rows], rtol=0, atol=1e-12)
    np.testing.assert_allclose(swapped[:, SPIN, 0], -straight[:, SPIN, 0], rtol=0, atol=1e-12)
    assert np.abs(straight[:, SPIN, 0]).max() > 1e-3


@pytest.mark.parametrize("mirror", [(-1, 1), (1, -1), (-1, -1)])
def test_mirrored_table_gives_the_mirrored_answer_bit_for_bit(mirror):
    volts, sign = swinging_volts(0.6), np.array(mirror, float)
    start = ball_state((0.03, -0.02), (0.05, 0.02))
    straight = moved(LOADED, volts, state=start)
    turned = moved(LOADED, volts * sign, state=start * sign)
    rows = [i for i in range(plant.STATE_ROWS) if i != SPIN]
    np.testing.assert_array_equal(turned[:, rows] * sign, straight[:, rows])
    np.testing.assert_array_equal(turned[:, SPIN, 0] * sign.prod(), straight[:, SPIN, 0])


def test_signs_by_effect():
    """Positive volts raise the servo angle; a positive angle accelerates the ball towards +."""
    states = moved(Rig(), constant_volts(1.0, -1.0, 0.3))
    assert np.all(states[-1, ARM] * [1, -1] > 0.1)
    assert np.all(states[-1, PLATE] * [1, -1] > 0.1)
    assert np.all(states[-1, BALL] * [1, -1] > 0.0)


def test_a_steady_tilt_holds_against_the_weight_of_the_ball():
    """Motor at rest without volts and friction: the ball pushes its side down, never up."""
    rig = Rig(drive=SMOOTH, ball=Ball(mass_kg=0.3))
    states = moved(rig, constant_volts(0, 0, 0.2), state=ball_state((0.05, 0.0)))
    assert states[-1, MOTOR, 0] > 1e-3
    assert np.all(states[:, MOTOR, 1] == 0.0)


def test_stalled_motor_gives_the_manuals_torque():
    """Arm held by huge friction: the gear shaft winds up by torque_per_volt V / k."""
    rig = smooth_rig(drive=replace(SMOOTH, arm_friction_nm=10.0))
    states = moved(rig, constant_volts(2.0, 0.0, 0.3), state=tilted(plant.rest(), 0.0, 0.0))
    assert states[-1, MOTOR, 0] == pytest.approx(2.0 * torque_per_volt() / 30.0, rel=1e-4)
    assert torque_per_volt() == pytest.approx(0.9 * 70 * 0.69 * 7.68e-3 / 2.6)
