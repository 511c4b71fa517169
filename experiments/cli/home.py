"""`rig home`: show the encoders where level is, and see that every cable goes where it should."""

from math import degrees
from pathlib import Path
from typing import Annotated

import typer

from experiments.cli.say import say

ANGLES = (
    "The arms will move slowly to level, then a little to both sides. Take the ball off, keep "
    "hands away, one hand at the switch that cuts the servos' power."
)
WARNING = (
    "Both arms will move slowly to their stops. Take the ball off, keep hands away, one hand at "
    "the switch that cuts the motors' power."
)


def home(
    rig: Annotated[
        Path | None, typer.Option("--rig", help="rig.toml; none: try it on the virtual table.")
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", help="Do not ask before the arms move.")] = False,
) -> None:
    """Find where the plate is level, check cables and signs. At low volts, or by small angles.

    What is found is kept beside the rig file until the table is switched off.
    """
    from experiments.runs.assemble import load_rig
    from experiments.runs.hardware import consent, home_table, is_hardware, rehearse_home

    known = load_rig(rig)
    if rig is None or not is_hardware(known):
        found, kept = rehearse_home(known), None
    else:
        consent(ANGLES if known.servo.takes_angle else WARNING, yes)
        found, kept = home_table(known, rig)
    wiring = found.wiring
    names = known.linkage.servo_names
    way = "from end to end" if known.servo.takes_angle else "between the stops"
    for name, travel, volts in zip(names, found.travel_rad, found.moving_V, strict=True):
        moves = f", moves at {volts:.2f} V" if volts else ""
        say(f"{name}: {degrees(travel):.1f} degrees {way}{moves}")
    named = wiring.order == tuple(range(len(wiring.order)))
    order = "swapped" if wiring.swap else ", ".join(names[servo] for servo in wiring.order)
    said = [word for word, so in {order: not named, "motors crossed": wiring.crossed}.items() if so]
    angle = known.servo.takes_angle
    signs = "" if angle else f"volts {list(wiring.sign_volts)}, of "
    say(
        f"channels: {', '.join(said) or 'as named'}; signs of {signs}angles "
        f"{list(wiring.sign_angle)}; level at {'steps' if angle else 'counts'} "
        f"{list(wiring.zero_counts)}"
    )
    if found.level is not None:
        x, y = (degrees(s) for s in found.level)
        say(f"the markers see the plate level to {x:+.2f}, {y:+.2f} degrees")
    else:
        say(
            "no markers were seen: which axis is which, and which way is down, is as the rig file "
            "says; see with a ball and a hand at the switch"
        )
    say(f"kept in {kept}" if kept else "this was the virtual table: nothing is kept")
