"""Wrong units, signs and axes are found by what they do; odd but possible logs get a note."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from experiments.gap.checks import check, step_of
from experiments.gap.input import released
from experiments.gap.physics import ball_response, servo_response
from experiments.runs.protocol import read_protocol
from experiments.runs.runner import RunRequest, simulate_run
from rig.parameters import Linkage, Servo
from tests.support.gap.logs import RIG, log_of, table_log


def scaled(**factors):
    """The usual log with columns multiplied: `theta=57.3` scales both axes."""
    columns = table_log()
    for name in columns:
        for start, factor in factors.items():
            if name.startswith(start):
                columns[name] = columns[name] * factor
    return columns


def refused(columns, words, rig=RIG):
    with pytest.raises(ValueError, match=words) as caught:
        check(log_of(columns), rig)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 300


def test_a_good_log_gets_no_note():
    for seed in range(5):
        assert check(log_of(table_log(seed=seed)), RIG) == []


def test_missing_rows_are_told_with_their_place_and_length():
    columns = {name: np.delete(values, slice(400, 450)) for name, values in table_log().items()}
    (note,) = check(log_of(columns), RIG)
    gap_s = columns["t_s"][400] - columns["t_s"][399]
    assert f"a hole {gap_s:.3g} s after {columns['t_s'][399]:.6g} s" in note


def test_the_answers_have_the_believed_gains():
    log = log_of(table_log())
    servo, ball = servo_response(log, "x", "x"), ball_response(log, "y", "y", 0.0)
    assert servo is not None
    assert ball is not None
    assert servo.rank > 0.9
    assert servo.gain == pytest.approx(RIG.servo.gain_rad_s_V, rel=0.1)
    assert ball.rank > 0.9
    assert ball.gain == pytest.approx(RIG.ball_gain_m_s2, rel=0.1)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_ball_on_circles_in_a_bowl_answers_the_right_way_round(sign: float):
    """Slow circles need less than the bowl's pull: the plate tilts against the acceleration."""
    t_s, gain, bowl = np.arange(0.0, 30.0, 0.01), RIG.ball_gain_m_s2, 2.5
    columns = {"t_s": t_s}
    for axis, period_s in (("x", 5.3), ("y", 4.7)):
        size_m, rate = np.array([[0.06], [0.0005]]), 2 * np.pi / np.array([[period_s], [1.1]])
        swings = size_m * np.sin(rate * t_s)
        columns[f"ball_{axis}_m"] = swings.sum(axis=0)
        columns[f"theta_{axis}_rad"] = sign * ((bowl - rate**2) * swings).sum(axis=0) / gain
    if sign > 0:
        check(log_of(columns), RIG)
    else:
        assert all(
            (ball := ball_response(log_of(columns), axis, axis, 0.0)) is not None and ball.rank <= 0
            for axis in "xy"
        )


@pytest.mark.parametrize("protocol", ["steps", "free-release", "servo-squares"])
def test_a_table_with_faults_is_not_refused(protocol):
    """Play, friction, a turned and late camera, a weak drive: all that is for the workflow."""
    effects = {
        "joint_backlash": {"x": {"play_rad": 0.06}, "y": {"play_rad": 0.06}},
        "coulomb_friction": {"x": {"friction_V": 0.1}},
        "gear_backlash": {"x": {"play_rad": 0.04}},
        "camera_yaw": {"xy": {"angle_rad": 0.15}},
        "camera_delay": {"xy": {"extra_s": 0.04}},
        "cross_coupling": {"x": {"fraction": 0.15}},
    }
    rig = replace(RIG, effects=effects, servo=Servo(gain_rad_s_V=2.9, time_constant_s=0.05))
    order = RunRequest(rig, read_protocol(protocol), "without", 3, Path(), kind=RIG)
    assert check(released(simulate_run(order).log, RIG.camera.delay_s), RIG) == []


@pytest.mark.parametrize(
    ("factors", "words"),
    [
        ({"theta": 57.29578}, "theta_x_rad reaches 6.* degrees .*times 0.01745"),
        ({"ball": 1000.0}, "ball_x_m reaches .* like millimetres; give metres .times 0.001"),
        ({"ball": 100.0}, "ball_x_m reaches .* like centimetres; give metres .times 0.01"),
        ({"ball": 1000.0, "theta": 0.0}, "like millimetres, centimetres or pixels; give metres$"),
        ({"t_s": 1000.0}, "rows come every 2 s, at 0.5 Hz .limit: 10 to 5000 Hz.* milliseconds"),
        ({"t_s": 0.01}, "50000 Hz .limit.* resample"),
        ({"voltage": 2048 / 6}, "voltage_x_V reaches .*limit: 100 V.*counts"),
        ({"theta_x": -1.0}, "theta_x_rad answers voltage_x_V the wrong way round .correlation -"),
        ({"voltage_y": -1.0}, "theta_y_rad answers voltage_y_V the wrong way round"),
        ({"ball_y": -1.0}, "ball_y_m answers theta_y_rad the wrong way round"),
    ],
)
def test_wrong_units_and_signs_are_refused(factors, words):
    refused(scaled(**factors), words)


def test_degrees_without_a_ball_are_refused_too():
    columns = {k: v for k, v in scaled(theta=57.29578).items() if not k.startswith("ball")}
    refused(columns, "degrees")
    for axis in "xy":  # nor is the encoder's step needed
        columns[f"theta_{axis}_rad"] = columns[f"theta_{axis}_rad"] + 1e-4 * np.sin(
            np.arange(len(columns["t_s"]))
        )
    refused(columns, "degrees")


@pytest.mark.parametrize("name", ["voltage_{}_V", "ball_{}_m"])
def test_swapped_axes_are_refused(name):
    columns = table_log()
    x, y = name.format("x"), name.format("y")
    columns[x], columns[y] = columns[y], columns[x]
    refused(columns, "swap the axes")


def test_swapped_axes_of_mirrored_motion_are_refused():
    """A release from a corner moves both axes alike but for the sign."""
    columns = table_log()
    for name in ("voltage_{}_V", "theta_{}_rad", "ball_{}_m"):
        columns[name.format("y")] = -columns[name.format("x")]
    assert check(log_of(columns), RIG) == []
    columns["voltage_x_V"], columns["voltage_y_V"] = columns["voltage_y_V"], columns["voltage_x_V"]
    refused(columns, "theta_x_rad follows voltage_y_V")


def test_suspicions_are_notes():
    assert "voltage_x_V reaches" in check(log_of(scaled(voltage=30.0)), RIG)[0]
    far = check(
        log_of(scaled(ball=10.0)),
        replace(RIG, linkage=Linkage(arm_radius_m=0.0254 * 10, plate_side_m=0.6)),
    )
    assert len(far) == 0
    servo = {k: v for k, v in scaled(theta=10.0).items() if not k.startswith("ball")}
    notes = check(log_of(servo), RIG)
    assert any("beyond the rig's stop" in note for note in notes)
    assert any("encoder_counts_per_rev = 4096" in note for note in notes)
    other = replace(RIG, servo=Servo(encoder_counts_per_rev=2048))
    notes = check(log_of(table_log()), other)
    assert notes[0].startswith("theta_x_rad moves in steps of 0.00153 rad (4096 a turn)")


def test_no_motion_is_a_note_not_an_error():
    columns = {name: np.zeros(3000) for name in table_log()}
    columns["t_s"] = np.arange(3000) / 500
    notes = check(log_of(columns), RIG)
    assert sum("never changes" in note for note in notes) == 6
    assert notes[-1] == "the ball was seen only 1 times"


@pytest.mark.parametrize(
    ("rows", "words"),
    [(1, "too short: 1 row .limit: 20"), (19, "19 rows"), (400, "too short: 0.798 s .limit: 1 s")],
)
def test_short_logs_are_refused(rows, words):
    refused({name: values[:rows] for name, values in table_log().items()}, words)


@pytest.mark.parametrize(("jump_s", "words"), [(61.0, "61 s"), (1e8, r"1e\+08 s")])
def test_a_clock_that_was_set_during_the_log_is_refused(jump_s, words):
    columns = table_log()
    columns["t_s"] = columns["t_s"] + np.where(np.arange(len(columns["t_s"])) < 700, 0.0, jump_s)
    refused(columns, rf"t_s jumps by {words} after row 700 .*cut the log there")


def test_nothing_to_compare_is_refused():
    columns = table_log()
    refused({k: columns[k] for k in ("t_s", "theta_x_rad", "ball_y_m")}, "nothing to compare")
    refused({k: columns[k] for k in ("t_s", "ball_x_m", "voltage_x_V")}, "there are voltage_x_V")


def test_exposures_of_another_clock_are_refused():
    columns = table_log()
    columns["ball_exposed_s"] = np.where(np.isnan(columns["ball_x_m"]), np.nan, 1.7e9)
    refused(columns, "ball_exposed_s lies -1.7e.* clock of t_s")


@settings(max_examples=30)
@given(counts=st.integers(200, 20000), seed=st.integers(0, 999))
@example(counts=628, seed=0)  # 0.010005 rad, and 0.00100003: all but a power of ten
@example(counts=6283, seed=0)
def test_the_encoders_step_is_told(counts, seed):
    step = 2 * np.pi / counts
    theta = np.cumsum(np.random.default_rng(seed).normal(0, step / 2, 4000))
    assert step_of(step * np.round(theta / step)) == pytest.approx(step, rel=1e-6)
    assert step_of(np.round(step * np.round(theta / step), 6)) == pytest.approx(step, rel=0.02)


def test_no_step_is_told_where_there_is_none():
    theta = 0.1 * np.sin(np.arange(3000) / 50)
    assert step_of(theta) is None  # smooth
    assert step_of(np.round(theta, 3)) is None  # rounded in writing
    assert step_of(np.zeros(3000)) is None
    assert step_of(np.full(3000, np.nan)) is None


@pytest.mark.parametrize("decimals", [2, 3, 4])
def test_the_rounding_of_written_angles_is_no_encoders_step(decimals):
    theta = np.cumsum(np.random.default_rng(1).normal(0, 10.0**-decimals, 4000))
    assert step_of(np.round(theta, decimals)) is None
    assert step_of(np.round(theta, decimals).astype(np.float32).astype(float)) is None


def test_a_ball_on_a_beam_whose_servo_takes_an_angle_can_be_compared():
    columns = table_log()
    told = {"t_s": columns["t_s"], "command_x_rad": columns["theta_x_rad"]}
    told["ball_x_m"] = columns["ball_x_m"]
    beam = replace(RIG, servo=replace(RIG.servo, kind="position"))
    assert check(log_of(told), beam) == []
    with pytest.raises(
        ValueError, match=r"^command_x_rad, and no theta: these servos take an angle"
    ):
        check(log_of(told), RIG)
    with pytest.raises(ValueError, match="nothing to compare"):
        check(log_of({"ball_y_m" if n == "ball_x_m" else n: v for n, v in told.items()}), beam)


def test_a_servo_alone_that_reads_its_angle_back_can_be_compared():
    columns = table_log()
    told = {"t_s": columns["t_s"], "theta_x_rad": columns["theta_x_rad"]}
    told["command_x_rad"] = columns["theta_x_rad"]
    bus = replace(RIG, servo=replace(RIG.servo, kind="position", angle_measured=True))
    assert check(log_of(told), bus) == []
    with pytest.raises(ValueError, match="nothing to compare: one axis needs its theta_rad and"):
        check(log_of(told), RIG)


def test_another_camera_and_larger_angles_than_the_rig_files_are_told():
    columns = table_log()
    told = {name: columns[name] for name in ("t_s", "ball_x_m", "ball_y_m")}
    told |= {f"command_{axis}_rad": columns[f"theta_{axis}_rad"] for axis in "xy"}
    most_rad = float(np.max(np.abs(columns["theta_x_rad"])))
    servo = replace(RIG.servo, kind="position", angle_limit_rad=0.9 * most_rad)
    slow = replace(RIG, servo=servo, camera=replace(RIG.camera, rate_hz=RIG.camera.rate_hz / 2))
    notes = check(log_of(told), slow)
    (frames,) = (note for note in notes if note.startswith("the ball is seen "))
    assert f"camera.rate_hz = {slow.camera.rate_hz:g}" in frames
    (angle,) = (note for note in notes if note.startswith("command_x_rad reaches "))
    assert f"servo.angle_limit_rad = {0.9 * most_rad:.3g}" in angle


def test_exposures_that_all_have_one_time_are_no_frame_rate():
    columns = table_log()
    seen = ~np.isnan(columns["ball_x_m"])
    middle_s = float(np.median(columns["t_s"]))
    columns["ball_exposed_s"] = np.where(seen, np.minimum(columns["t_s"], middle_s), np.nan)
    columns = {name: values[columns["t_s"] >= middle_s] for name, values in columns.items()}
    columns = {name: values[: round(1.9 / 0.002)] for name, values in columns.items()}
    assert not [note for note in check(log_of(columns), RIG) if "the ball is seen" in note]


@pytest.mark.parametrize(("batch", "is_told"), [(1, False), (2, True), (3, True)])
def test_frames_that_a_link_sends_several_at_once_are_told(batch: int, is_told: bool):
    columns = table_log()
    seen = np.flatnonzero(~np.isnan(columns["ball_x_m"]))
    taken_s = columns["t_s"][seen] - 0.03
    columns["ball_exposed_s"] = np.full(len(columns["t_s"]), np.nan)
    last = np.minimum(np.arange(len(seen)) // batch * batch + batch - 1, len(seen) - 1)
    within = np.arange(len(seen)) % batch
    columns["ball_exposed_s"][seen] = taken_s[last] - 0.001 * (batch - 1 - within)
    notes = check(log_of(columns), RIG)
    assert bool([n for n in notes if "come less than half a frame" in n]) == is_told
    assert not [n for n in notes if "the ball is seen" in n]


@pytest.mark.parametrize("exposed", [True, False])
def test_frames_that_are_lost_are_no_other_rate_and_no_bursts(exposed: bool):
    columns = table_log()
    seen = np.flatnonzero(~np.isnan(columns["ball_x_m"]))
    if exposed:
        columns["ball_exposed_s"] = np.full(len(columns["t_s"]), np.nan)
        columns["ball_exposed_s"][seen] = columns["t_s"][seen] - 0.03
    lost = seen[np.random.default_rng(3).random(len(seen)) < 0.3]
    for name in {"ball_x_m", "ball_y_m", "ball_exposed_s"} & set(columns):
        columns[name][lost] = np.nan
    assert check(log_of(columns), RIG) == []


def test_rows_that_date_the_frames_of_a_slower_camera_do_not_change_its_rate():
    columns, rate_Hz = table_log(), 0.75 * RIG.control_rate_hz
    t_s = np.arange(0.0, 20.0, 1.0 / RIG.control_rate_hz)
    columns = {n: np.resize(v, len(t_s)) for n, v in columns.items() if n != "ball_exposed_s"}
    columns["t_s"] = t_s
    fresh = np.diff(np.floor(t_s * rate_Hz), prepend=-1.0) > 0
    for name in ("ball_x_m", "ball_y_m"):
        columns[name] = np.where(fresh, 0.01 * np.sin(t_s + len(name)), np.nan)
    rig = replace(RIG, camera=replace(RIG.camera, rate_hz=rate_Hz))
    assert not [n for n in check(log_of(columns), rig) if "the ball is seen" in n]
