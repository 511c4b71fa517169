"""The comparison's grid as data: the shipped one, what it refuses, and what its cells are."""

from math import radians

import pytest

from experiments.compare.compare import plan, sizes
from experiments.compare.grid import Cell, cells, read_grid, retuned_names, run_requests, table_of
from experiments.runs.assemble import load_rig, play_rad
from tests.support import ROOT

GRID = read_grid(None)
RIG = load_rig(None)


def test_the_shipped_grid_has_what_was_asked_for():
    count, _, runs = sizes(GRID)
    assert GRID.seeds >= 20
    assert count >= 40
    assert runs == GRID.seeds * len(plan(GRID))
    plays = GRID.plays.values()
    assert {p.gear_deg for p in plays} >= {0.0, 1.0, 3.0}
    assert {p.joint_deg for p in plays} >= {0.0, 1.0, 3.0}
    assert any(p.gear_offset_deg for p in plays)
    assert any(p.joint_offset_deg for p in plays)


def test_every_cell_is_a_table_that_can_be_built():
    for cell in cells(GRID):
        rig = table_of(RIG, GRID, cell)
        play = GRID.plays[cell.play]
        width = rig.effects["joint_backlash"]["x"]["play_rad"]
        assert width == pytest.approx(radians(play.joint_deg))


def test_arms_of_a_cell_get_the_same_units_and_draws():
    cell = cells(GRID)[0]
    one, other = (run_requests(RIG, GRID, cell, arm) for arm in ("without", "neural"))
    for a, b in zip(one, other, strict=True):
        assert a.rig == b.rig
        assert a.seed == b.seed
        assert a.believed == b.believed
        assert not a.believed.effects


def test_faults_reach_the_right_side():
    def first(fault: str):
        return run_requests(RIG, GRID, Cell("joint 3", "as measured", "hold", fault), "with")[0]

    assert first("play taken for half").believed.play.factor == 0.5
    late = first("camera 30 ms later")
    assert late.rig.effects["camera_delay"]["xy"]["extra_s"] == 0.03
    assert late.believed.camera.delay_s == RIG.camera.delay_s
    slow = first("half the camera rate")
    assert slow.rig.camera.rate_hz == slow.believed.camera.rate_hz == RIG.camera.rate_hz / 2


def test_retuned_is_the_arm_without_and_other_gains():
    name = retuned_names(GRID)[-1]
    request = run_requests(RIG, GRID, cells(GRID)[0], name)[0]
    assert request.arm == "without"
    assert request.believed.gains.proportional_rad_m == GRID.retuned[-1].proportional_rad_m


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ('seeds = 20', "seeds = 3"), ('"sham"', '"shame"'), ('measure = "settled_error"',
         'measure = "luck"'), ('play = "gear 1, joint 1.5"', 'play = "gear 9"'),
        ('title =', 'titel ='), ('arms = ["without", ', 'arms = ['),
        # Each of these ended in a TypeError or KeyError, counted twice, or was not heeded.
        ('measure = "settled_error"', 'measure = "settling"'), ('"sham"', '"with"'),
        ('{ joint_friction_nm', '{ joint_fricton_nm'), ('"half the camera rate"', '""'),
        ('protocol = "circle"', 'protocol = "hold"'),
        ('protocol = "circle"', 'protocol = "servo-squares"'),
        ('protocol = "free-release"\n\n', 'protocol = "free-relase"\n\n'),
        ('= 3.45\nderivative_rad_s_m = 3.0', '= 2.5\nderivative_rad_s_m = 2.11'),
    ],
)  # fmt: skip
def test_a_mistake_in_a_grid_is_one_line(tmp_path, change, said):
    from importlib.resources import files

    text = (files("experiments") / "grids" / "default.toml").read_text(encoding="utf-8")
    assert change in text
    path = tmp_path / "grid.toml"
    path.write_text(text.replace(change, said), encoding="utf-8")
    with pytest.raises(ValueError, match=r"grid\.toml") as error:
        read_grid(path)
    assert "\n" not in str(error.value)
    assert str(path) in str(error.value)


def test_plays_of_three_arms_are_those_that_the_plate_would_feel():
    """Their angle is the plate's tilt: 3 degrees of a servo on two rods are 0.55 of the plate."""
    grid = read_grid(None, takes_angle=True)
    arms, rods = (
        load_rig(ROOT / "experiments" / "rigs" / f"{name}.toml")
        for name in ("three-arms", "bus-servos")
    )
    cell = Cell("joint 3", "as measured", "hold")
    wide, narrow = (
        table_of(rig, grid, cell).effects["joint_backlash"]["x"]["play_rad"] for rig in (rods, arms)
    )
    assert wide == pytest.approx(radians(3))
    assert narrow == pytest.approx(radians(3) * rods.linkage.ratio)
    assert play_rad(rods, 1.0) == pytest.approx(radians(1))


def test_an_effect_that_is_taken_away_under_a_wrong_name_is_told():
    """It stayed, and the cell's numbers were those of a table with it."""
    friction = GRID.frictions["little, no breakaway"].model_copy(update={"without": ["colomb"]})
    grid = GRID.model_copy(update={"frictions": {"little": friction}})
    with pytest.raises(ValueError, match="unknown effect 'colomb'"):
        table_of(RIG, grid, Cell("none", "little", "hold"))
