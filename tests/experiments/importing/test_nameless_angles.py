"""Angles that no name explains, and their units: what the ball follows, where it is level."""

import numpy as np
import pytest

from experiments.importing.draft import Proposal
from experiments.importing.proposal import propose
from experiments.importing.recording import BadFileError, Stream
from tests.support.strangers.bench import Run, run

DEGREE = np.pi / 180
LINKED = run(1, duration_s=24.0, grid_rad=DEGREE)
TILTED = run(2, duration_s=24.0, lever=1.0)
RNG = np.random.default_rng(1)


def proposed(
    angles: dict[str, np.ndarray], it: Run = LINKED, ball: str = "ball_{}_mm", scale: float = 1e3
) -> Proposal:
    place = {ball.format(axis): scale * it.ball_m[:, k] for k, axis in enumerate("xy")}
    return propose(Stream({"t_sec": it.t_s, **place, **angles}))


def in_degrees(middle: float = 90.0, *names: str) -> dict[str, np.ndarray]:
    angle = np.round(LINKED.command_rad / DEGREE) * [1, -1] + middle
    return dict(zip(names or ("sx", "sy"), angle.T, strict=True))


def options(found: Proposal) -> list[str]:
    return [doubt.option for doubt in found.doubts]


def test_columns_that_the_ball_follows_are_the_angles_and_90_is_the_middle_of_degrees():
    noise = {"inner": RNG.normal(size=len(LINKED.t_s))}
    signals = proposed(in_degrees() | noise).map().signals
    for axis, column, sign in (("x", "sx", 1), ("y", "sy", -1)):
        one = signals[f"command_{axis}_rad"]  # whole degrees that the ball answers late
        assert (one.column, one.unit, one.offset, one.sign) == (column, "deg", 90.0, sign)


def test_what_the_ball_does_not_follow_is_asked_for():
    still = {"a": RNG.normal(size=len(LINKED.t_s)), "b": RNG.normal(size=len(LINKED.t_s))}
    assert any("command_x_rad.column=" in one for one in options(proposed(still)))


def test_two_columns_that_the_ball_follows_alike_are_asked_for():
    twins = in_degrees(90.0, "a", "b") | in_degrees(90.0, "c", "d")
    assert any("command_x_rad.column=" in one for one in options(proposed(twins)))


@pytest.mark.parametrize("names", [("sx", "sy"), ("servo_x", "servo_y")])
def test_another_middle_tells_no_unit(names: tuple[str, str]):
    found = options(proposed(in_degrees(40.0, *names)))
    assert any("unit=" in one for one in found)


@pytest.mark.parametrize(("grid", "middle"), [(0.1, 90.0), (1.0, 0.0)])
def test_whole_degrees_about_90_alone_tell_a_command(grid: float, middle: float):
    angle = np.round(LINKED.command_rad / DEGREE / grid) * grid + middle
    angle[0] += 0.1 if grid < 1 else 0.0
    found = options(proposed({"servo_x_deg": angle[:, 0], "servo_y_deg": angle[:, 1]}))
    assert found == ["--set angle.kind=commanded or measured"]


def test_pulses_about_1500_lack_their_scale_alone():
    pulse = np.round(LINKED.command_rad / DEGREE * 10) + np.array([1470, 1540])
    found = proposed({"pulse1": pulse[:, 0], "pulse2": pulse[:, 1]})
    assert options(found) == ["--set command.scale=NUMBER"]
    assert found.draft["signals"]["command_x_rad"]["unit"] == "us"


@pytest.mark.parametrize(("scale", "sure"), [(1.0, True), (0.7, False), (1e3, False)])
def test_metres_are_sure_where_the_ball_rolls_as_on_the_plates_own_tilt(scale: float, sure: bool):
    tilt = {"roll_meas": -TILTED.theta_rad[:, 1], "pitch_meas": TILTED.theta_rad[:, 0]}
    found = options(proposed(tilt, TILTED, "ball_{}", scale))
    assert found == [] if sure else any("ball.unit=" in one for one in found)


def test_a_share_of_the_plate_is_no_metre_where_a_linkage_makes_it_roll_as_on_its_own_tilt():
    it = run(2, duration_s=24.0, lever=0.138)
    tilt = {f"servo_{axis}_meas_deg": it.theta_rad[:, k] / DEGREE for k, axis in enumerate("xy")}
    found = options(proposed(tilt, it, "ball_{}", 1 / 0.1375))
    assert any("ball.unit=" in one for one in found)


def test_days_of_a_spreadsheet_are_a_clock():
    it = TILTED
    tilt = {"pitch_meas_deg": it.theta_rad[:, 0] / DEGREE, "roll_meas_deg": it.theta_rad[:, 1]}
    stream = {"stamp": 44210.5 + it.t_s / 86400, "x_m": it.ball_m[:, 0], "y_m": it.ball_m[:, 1]}
    assert propose(Stream({**stream, **tilt})).draft["time"]["unit"] == "day"


def test_what_is_open_is_asked_once():
    """Two balls were asked about twice in one line, each time among other columns."""
    second = {f"ball2_{axis}_mm": RNG.normal(size=len(LINKED.t_s)) for axis in "xy"}
    asked = proposed(in_degrees(90.0, "cmd_x_deg", "cmd_y_deg") | second, ball="ball1_{}_mm").doubts
    places = [(doubt.place, doubt.key) for doubt in asked]
    assert ("ball_x_m", "column") in places
    assert len({*places}) == len(places)


def shared(whole_m: float) -> dict[str, np.ndarray]:
    return {f"ball_{axis}": LINKED.ball_m[:, k] / whole_m + 0.5 for k, axis in enumerate("xy")}


@pytest.mark.parametrize("named", ["ball_{}_norm", "ball_{}"])
def test_shares_of_a_picture_are_not_metres_though_a_linkage_could_do_that(named: str):
    """Metres from a corner, with a gain like a linkage's: only the centre was asked for."""
    columns = {named.format(k[-1]): v for k, v in shared(0.4).items()}
    angles = in_degrees(0.0, "servo_x_cmd_deg", "servo_y_cmd_deg")
    asked = options(propose(Stream({"t_sec": LINKED.t_s, **columns, **angles})))
    if "norm" in named:
        assert "--set ball.scale=NUMBER" in asked
    else:
        assert any(one.startswith("--set ball.unit=m") and one.endswith("or 1") for one in asked)


def test_errors_and_targets_are_not_offered_as_the_balls_place():
    error = {f"error_{axis}_mm": -1e3 * LINKED.ball_m[:, k] for k, axis in enumerate("xy")}
    angles = in_degrees(0.0, "servo_x_cmd_deg", "servo_y_cmd_deg")
    with pytest.raises(BadFileError, match="error_x_mm, error_y_mm are none by their names"):
        propose(Stream({"t_sec": LINKED.t_s, **error, **angles}))
