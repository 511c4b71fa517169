"""A table as MuJoCo's XML (MJCF): written as text, MuJoCo itself is not needed for it."""

from math import sqrt
from xml.etree.ElementTree import Element

from experiments.export.mjcf.left_out import left_out
from experiments.export.mjcf.parts import HARD, Document, add, effect
from experiments.export.mjcf.plates import add_ball, add_camera
from experiments.export.mjcf.three_arms import add_three_arms
from experiments.export.mjcf.two_rods import add_two_rods
from rig.linkage import THREE_ARMS
from rig.parameters import GRAVITY_M_S2, Rig
from rig.plant.plant_record import STEP_S

TESTED_WITH = "4.0"  # MuJoCo; 4.0 is the first that has all that is used here


def mjcf(rig: Rig, name: str) -> tuple[str, list[str]]:
    """Return the XML of a rig, effects included, and what it does not carry, one line each."""
    root = Element("mujoco", model=name)
    add(root, "compiler", angle="radian", inertiafromgeom="false", autolimits="false")
    _options(root, rig)
    document = Document(root)
    if rig.linkage.kind == THREE_ARMS:
        height = add_three_arms(document, rig)
    else:
        height = 0.0
        add_two_rods(document, rig)
    add_ball(document, rig, height)
    add_camera(document, rig)
    told = [*document.told, *left_out(rig)]
    return document.text(_header(rig, name, told)), told


def _options(root: Element, rig: Rig) -> None:
    """Step, solver and gravity, which leans by the level's offset."""
    slope = [effect(rig, "level_offset", "slope_rad", axis) for axis in "xy"]
    down = -sqrt(1 - slope[0] ** 2 - slope[1] ** 2)
    option = add(
        root,
        "option",
        timestep=STEP_S,
        gravity=tuple(GRAVITY_M_S2 * s for s in (*slope, down)),
        cone="elliptic",
        solver="Newton",
        integrator="Euler",
        iterations="60",
        tolerance=1e-14,
    )
    add(option, "flag", eulerdamp="disable")
    add(root, "statistic", extent=0.4, center=(0, 0, 0))
    default = add(root, "default")
    add(default, "geom", contype="0", conaffinity="0")
    add(default, "equality", **HARD)


def _header(rig: Rig, name: str, told: list[str]) -> list[str]:
    """The comment on top: what is driven and read, and what is missing."""
    if not rig.servo.takes_angle:
        driven = "data.ctrl: volts at the motors x, y (positive raises the arm, ball towards +)"
    elif rig.linkage.kind == THREE_ARMS:
        driven = "data.ctrl: angles of the three arms from level [rad]"
    else:
        driven = "data.ctrl: angles of the servos x, y [rad]"
    lines = [
        f"The table {name}: a ball on a plate that two axes tilt. SI units.",
        f"{driven}; one step is {STEP_S:g} s. MuJoCo {TESTED_WITH} or later.",
        "Sensors: theta_* arms; ball_position, ball_velocity in the plate's frame (true); camera:",
        "the position at the camera's rate and delay. Play: limits of tendons or hinges.",
    ]
    lines += ["What this file does not carry of the rig file:", *(f"* {one}" for one in told)]
    return lines
