"""`rig gap` on recordings of real tables of other people, each half by itself.

What is known of them stands in the README of their folders: a table whose servos take an angle (a
delay of 0.09 to 0.13 s, the y axis 0.006 to 0.009 rad off level) and a positioning axis with
published parameters (Coulomb friction of 0.58 V, viscous friction that differs by direction).
"""

from pathlib import Path

import pytest

from calibration.gap.findings import Findings
from experiments.gap.gap import investigate
from experiments.gap.input import read_evidence
from tests.support.parts import RECORDINGS, needs

TABLE, AXIS = RECORDINGS / "position_table", RECORDINGS / "positioning_axis"
# The owners know of the delay and the level; a ball that rolls on a film over a plate of 30 cm may
# well be slowed, and the plate be crowned: nobody has measured it.
POSSIBLE = {"camera_delay", "level_offset", "rolling_resistance", "plate_bowl"}
CERTAIN = 0.9  # probability from which a name is told as certain


def half_of_table(which: int, folder: Path) -> Path:
    """One half of the table's recording; the commanded angle is taken for the angle."""
    head, *rows = (TABLE / "run.csv").read_text(encoding="utf-8").splitlines()
    middle = len(rows) // 2
    part = rows[:middle] if which == 1 else rows[middle:]
    path = folder / f"half_{which}.csv"
    path.write_text("\n".join([head.replace("command", "theta"), *part]), encoding="utf-8")
    return path


def certain(found: Findings) -> set[str]:
    return {one.name for one in found.effects if one.probability >= CERTAIN}


@needs("recordings")
def test_the_recordings_are_read_and_what_is_odd_in_them_is_told(tmp_path: Path):
    table = read_evidence([half_of_table(1, tmp_path), half_of_table(2, tmp_path)])
    assert any("beyond the rig's stop" in note for note in table.notes)
    assert all(log.has("ball_x_m") and not log.has("voltage_x_V") for log in table.logs)
    axis = read_evidence([AXIS / "run_a.csv", AXIS / "run_b.csv"])
    assert all(log.has("theta_x_rad") and not log.has("ball_x_m") for log in axis.logs)


@pytest.mark.slow
@needs("recordings")
@pytest.mark.parametrize("which", [1, 2])
def test_a_table_with_position_servos_is_late_and_nothing_that_cannot_be_is_certain(
    which: int, tmp_path: Path, request: pytest.FixtureRequest
):
    found = investigate([half_of_table(which, tmp_path)], TABLE / "rig.toml", until="prove")
    assert found.verdict == "named", found.sentence
    sizes = {one.name: one.parameters for one in found.effects}
    assert 0.09 < sizes["camera_delay"]["xy"]["extra_s"].value < 0.13
    assert certain(found) <= POSSIBLE
    if "level_offset" in sizes:
        assert {a for a, keys in sizes["level_offset"].items() if keys} == {"y"}
    ahead = found.gap.ahead_1s_mm
    assert ahead["after"] < 0.75 * ahead["before"]
    if "level_offset" in sizes:
        if which == 1:
            low = "level y of 0.00498 rad, told at 50 %: commands that are taken for angles"
            request.applymarker(pytest.mark.xfail(reason=low))
        assert 0.005 < sizes["level_offset"]["y"]["slope_rad"].value < 0.009


ITS_RIG = """[servo]
kind = "position"
lag_s = 0.0
[linkage]
arm_radius_m = 0.025
plate_side_m = 0.368
y.plate_side_m = 0.286
rod_length_m = 0.072
[ball]
hollow = false
radius_m = 0.02
mass_kg = 0.265
[camera]
rate_hz = 100.0
delay_s = 0.0
"""


def half_as_told(which: int, folder: Path) -> tuple[Path, Path]:
    """One half of the table's recording as it is, and a rig file that says that angles are told."""
    log = half_of_table(which, folder)
    log.write_text(log.read_text(encoding="utf-8").replace("theta", "command"), encoding="utf-8")
    rig = folder / "rig.toml"
    rig.write_text(ITS_RIG, encoding="utf-8")
    return log, rig


@needs("recordings")
def test_commanded_angles_need_a_rig_file_that_says_so(tmp_path: Path):
    log, rig = half_as_told(1, tmp_path)
    assert read_evidence([log], rig).logs[0].has("command_x_rad", "ball_x_m")
    with pytest.raises(ValueError, match=r'say so in a rig file, .*kind = "position"'):
        read_evidence([log])


@pytest.mark.slow
@needs("recordings")
@pytest.mark.parametrize("which", [1, 2])
def test_commanded_angles_give_the_lateness_of_both_axes(which: int, tmp_path: Path):
    """Lag and dead time together 0.09 to 0.13 s, by axis; the level of y where it is named.

    Hands push the ball in the first half: what was seen meanwhile is left out
    (`calibration.gap.hands`), and the rest tells what the other half does.
    """
    found = investigate([*half_as_told(which, tmp_path)[:1]], tmp_path / "rig.toml", until="prove")
    assert found.verdict in ("named", "undecided"), found.sentence
    sizes = {one.name: one.parameters for one in found.effects}
    late = dict.fromkeys("xy", 0.0)
    for name, key in (("servo_lag", "lag_s"), ("servo_dead_time", "delay_s")):
        for axis, pairs in sizes.get(name, {}).items():
            late[axis] += pairs[key].value
    assert all(0.09 < seconds < 0.13 for seconds in late.values()), late
    twins = {twin for one in found.effects for twin in one.twins}
    assert {"camera_delay", "delay_servo_to_plate"} <= twins or "servo_dead_time" not in sizes
    if "level_offset" in sizes:
        assert 0.005 < sizes["level_offset"]["y"]["slope_rad"].value < 0.009
    ahead = found.gap.ahead_1s_mm
    assert ahead["after"] < 0.5 * ahead["before"]
    resistance = sizes.get("rolling_resistance", {}).get("xy", {}).get("deceleration_m_s2")
    assert resistance is None or resistance.value < 0.03


@pytest.mark.slow
@needs("recordings")
@pytest.mark.parametrize("which", ["a", "b"])
def test_a_positioning_axis_has_its_published_frictions(which: str, tmp_path: Path):
    rig = tmp_path / "rig.toml"
    rig.write_text("[servo]\ngain_rad_s_V = 0.691\ntime_constant_s = 0.467\n", encoding="utf-8")
    found = investigate([AXIS / f"run_{which}.csv"], rig, until="prove")
    assert certain(found) == {"coulomb_friction", "viscous_asymmetry"}, found.sentence
    sizes = {one.name: one.parameters["x"] for one in found.effects}
    friction, viscous = sizes["coulomb_friction"]["friction_V"], sizes["viscous_asymmetry"]
    assert friction.low < 0.580 < friction.high
    assert friction.value == pytest.approx(0.580, rel=0.03)
    # Published: 166.7 N s/m forwards, 240.3 backwards.
    published = (166.7 - 240.3) / (166.7 + 240.3)
    assert viscous["fraction_1"].low < published < viscous["fraction_1"].high
    assert viscous["fraction_1"].value == pytest.approx(published, rel=0.1)
    ahead = found.gap.ahead_1s_deg["servo_x"]
    assert ahead["after"] < 0.5 * ahead["before"]
