"""A table's first reading is held against its homing before anything is armed."""

import pytest

from experiments.runs.hardware import Checked
from rig.hardware.homing.home import Homing
from rig.hardware.homing.homed import Homed, NotHomed
from rig.hardware.wiring import Wiring
from rig.parameters import Rig, TableChoice
from rig.table import Reading

RIG = Rig(table=TableChoice(kind="quanser"))  # its card cannot tell a power-up


class Card:
    """What `Checked` uses of a table; notes what is done to it."""

    period_s, voltage_limit_V = 0.002, 6.0

    def __init__(self, theta_rad: tuple[float, float]) -> None:
        self.theta_rad, self.done = theta_rad, []

    def read(self) -> Reading:
        self.done.append("read")
        return Reading(0.0, self.theta_rad)

    def close(self) -> None:
        self.done.append("closed")

    def __enter__(self) -> "Card":
        self.done.append("armed")
        return self

    def __exit__(self, *error: object) -> None:
        self.done.append("left")


def test_angles_that_no_homed_arm_can_have_are_refused_before_arming():
    homed = Homed.of(Homing(Wiring(), (1.2, 1.2), (0.4, 0.4)), RIG, None)
    right, lost = Card((0.1, 0.0)), Card((0.1, -14.0))
    with Checked(right, RIG, homed):  # pyright: ignore[reportArgumentType]
        pass
    assert right.done == ["read", "armed", "left"]
    with pytest.raises(NotHomed, match="beyond its stops"), Checked(lost, RIG, homed):  # pyright: ignore[reportArgumentType]
        pass
    assert lost.done == ["read", "closed"]
