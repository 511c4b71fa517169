"""The play of the virtual table, set by hand: another table, between runs alone."""

from math import degrees, radians
from typing import TYPE_CHECKING

from experiments.dashboard.server.controls import Controls
from experiments.dashboard.server.input_limits import BACKLASH_DEG
from experiments.dashboard.session.session import Session
from experiments.dashboard.tabs.sliders import SliderGroup
from experiments.dashboard.view.pose import backlash_widths
from experiments.runs.assemble import with_play

if TYPE_CHECKING:
    from viser import ViserServer

PLAYS = {
    "none": (0.0, 0.0),
    "gear alone": (2.0, 0.0),
    "joint alone": (0.0, 2.0),
    "worn": (2.0, 3.0),
}


def play_sliders(server: "ViserServer", controls: Controls, session: Session) -> SliderGroup:
    """Build the sliders in the GUI container of viser that is open; they start a new table."""
    widths = backlash_widths(session.rig)
    start = [round(degrees(float(play.mean())), 1) for play in widths]
    labels = ("Gear play [deg]", "Joint play [deg]")

    def check() -> None:
        """Raise ValueError while runs are made: all of them are to be of one table."""
        if session.status.run is not None:
            raise ValueError("runs are being made, all on one table: change its play when they end")

    def set_play(wanted: list[float]) -> None:
        check()
        words = "a new virtual table: play of gear {:.1f}, of joint {:.1f} degrees"
        session.note(words.format(*wanted))
        gear, joint = map(radians, wanted)
        session.set_plant(with_play(session.rig, gear_rad=gear, joint_rad=joint))

    return SliderGroup(
        server,
        controls,
        [(label, BACKLASH_DEG, value) for label, value in zip(labels, start, strict=True)],
        set_play,
        hint="a new virtual table starts",
        presets={"this table's": start, **PLAYS},
        check=lambda page: check(),
    )
