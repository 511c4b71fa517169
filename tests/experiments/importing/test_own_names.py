"""A table in the log's own names: which column is which needs no question; a sign still may."""

import numpy as np
import pytest

from experiments.importing.import_map import stated
from experiments.importing.proposal import propose
from experiments.importing.recording import Stream
from rig.log import COMMANDS, INDEX, NAMES
from tests.support.worlds import WORLDS

# What our own runs record besides, and looks like angles, volts and places.
BESIDE = [n for n in NAMES[INDEX["ball_exposed_s"] + 1 :] if n not in ("phase", *COMMANDS)]


def exported(name: str, *, sign: int = 1) -> Stream:
    """A world's log as our own export writes it; sign: of the angles' columns."""
    made, _, _ = WORLDS[name](3)
    rng = np.random.default_rng(3)
    columns = {key: np.asarray(values, float) for key, values in made.items()}
    angle = "command" if COMMANDS[0] in columns else "theta"
    columns |= {key: sign * columns[key] for key in columns if key.startswith(angle)}
    for beside in BESIDE:
        near = columns[f"{angle}_{'y' if '_y_' in beside else 'x'}_rad"]
        columns[beside] = near + 0.01 * rng.normal(size=near.shape)
    return Stream(columns)


@pytest.mark.parametrize("name", ["plain", "bowl", "late_servo", "home_made_table"])
def test_each_column_is_what_its_name_says(name: str):
    stream = exported(name)
    found = propose(stream)
    assert not [doubt for doubt in found.doubts if doubt.key == "column"]
    columns = {key: one["column"] for key, one in found.draft["signals"].items()}
    assert columns
    assert all(key == column for key, column in columns.items())
    assert not {*BESIDE} & {*found.left}
    assert {key for key in columns if key.startswith(("ball", "theta", "command"))} == {
        key for key in stream.columns if key.startswith(("ball_x", "ball_y", "theta", "command"))
    }


@pytest.mark.parametrize("sign", [1, -1])
def test_a_sign_that_contradicts_the_ball_is_found_all_the_same(sign: int):
    found = propose(exported("plain", sign=sign))
    assert found.doubts == ()
    for axis in "xy":
        angle = found.draft["signals"][f"theta_{axis}_rad"]["sign"]
        others = [
            found.draft["signals"][n]["sign"] for n in (f"ball_{axis}_m", f"voltage_{axis}_V")
        ]
        assert [angle * other for other in others] == [sign, sign]


def test_what_is_stated_wins_over_a_name():
    said = stated(["theta_x_rad.column=desired_theta_x_rad", "target.column=none"])
    stream = exported("plain")
    found = propose(Stream({**stream.columns, "mine": stream.columns["theta_x_rad"]}), said)
    assert "target_x_m" not in found.draft["signals"]
    said = stated(["theta_x_rad.column=mine"])
    found = propose(Stream({**stream.columns, "mine": stream.columns["theta_x_rad"]}), said)
    assert found.draft["signals"]["theta_x_rad"]["column"] == "mine"
    with pytest.raises(ValueError, match="no column 'nope'"):
        propose(stream, stated(["theta_x_rad.column=nope"]))
