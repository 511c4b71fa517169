"""A plate on three arms (3-RRS): arms, hinged rods, a carrier, the plate on it with its play."""

from math import cos, pi, sin

import numpy as np

from experiments.export.mjcf.parts import SOFT, Document, add, light, numbers, play_of, stiff
from experiments.export.mjcf.plates import add_plate
from experiments.export.mjcf.servos import add_servo
from rig.parameters import Rig
from rig.plant.plant_record import pack

FAR_M = 100.0  # chosen: how far the cords lead that hold the friction against the ground
CARRIER_KG, CARRIER_KG_M2 = 0.02, 2e-5  # chosen: light beside the plate


def add_three_arms(document: Document, rig: Rig) -> float:
    """Add arms, rods, carrier and plate; returns the height of the plate's centre [m]."""
    p, height = pack(rig), rig.linkage.height_m
    _, plate_radius, _, _ = rig.linkage.size
    carrier = add(document.world, "body", name="carrier", pos=(0, 0, height))
    add(carrier, "freejoint", name="carrier")
    i = CARRIER_KG_M2
    add(carrier, "inertial", pos=(0, 0, 0), mass=CARRIER_KG, diaginertia=(i, i, 2 * i))
    for n in range(3):
        _leg(document, rig, p, n)
        psi = 2 * pi * n / 3
        at = (plate_radius * cos(psi), plate_radius * sin(psi), 0)
        add(carrier, "site", name=f"edge_{n}", pos=at, size=(0.001,))
        joined = {"site1": f"top_{n}", "site2": f"edge_{n}"}
        add(document.equality, "connect", name=f"rod_{n}", **joined)
    plate = add(carrier, "body", name="plate")
    for axis, axle in (("x", "0 1 0"), ("y", "-1 0 0")):
        _joint(plate, rig, axis, axle)
    inertia = rig.drive.plate_inertia_kg_m2
    add_plate(plate, rig, (inertia, inertia))
    for a, axis in enumerate("xy"):
        _held_by_ground(document, plate, rig, a, axis)
    document.told += [
        f"effects.{name}: not with three arms."
        for name in ("linkage_quadratic", "linkage_cubic", "cross_coupling")
        if name in rig.effects
    ]
    document.told.append(
        "Controls are the three arms' angles from level [rad], not the plate's tilt: MuJoCo has no "
        "inverse kinematics; rig.three_arms.arm_angle has them in closed form."
    )
    return height


def _leg(document: Document, rig: Rig, p: np.record, n: int) -> None:
    """Arm n with its servo and the rod hinged at its elbow."""
    base, plate, arm, _ = rig.linkage.size
    level, psi = float(p["level_arm"]), 2 * pi * n / 3
    u, v = cos(psi), sin(psi)
    elbow = np.array([base + arm * cos(level), arm * sin(level)])
    top = np.array([plate, rig.linkage.height_m]) - elbow
    axle = (v, -u, 0.0)  # a positive turn raises the arm
    body = add(document.world, "body", name=f"arm_{n}", pos=(base * u, base * v, 0))
    light(body)
    name, limit = f"arm_{n}_rad", rig.servo.stop_rad
    of_arm = add_servo(document, p, n, f"arm_{n}", name, limit)
    add(body, "joint", name=f"arm_{n}", axis=axle, **of_arm)
    out = ((elbow[0] - base) * u, (elbow[0] - base) * v, elbow[1])
    add(body, "geom", type="capsule", size=(0.003,), fromto=(0, 0, 0, *out))
    rod = add(body, "body", name=f"rod_{n}", pos=out)
    light(rod)
    end = (top[0] * u, top[0] * v, top[1])
    add(rod, "joint", name=f"rod_{n}", axis=axle, armature=1e-6)
    add(rod, "geom", type="capsule", size=(0.002,), fromto=(0, 0, 0, *end))
    add(rod, "site", name=f"top_{n}", pos=end, size=(0.001,))
    add(document.sensor, "jointpos", name=f"theta_{n}", joint=f"arm_{n}")


def _joint(plate, rig: Rig, axis: str, axle: str) -> None:
    """The joint's play and shaft between carrier and plate about one axis."""
    k, c = rig.drive.joint_stiffness_nm_rad, rig.drive.joint_damping_nm_s
    play, centre = play_of(rig, "joint", axis)
    hinge = add(plate, "joint", name=f"joint_{axis}", axis=axle)
    if play == 0:
        hinge.attrib |= {"stiffness": numbers(k), "damping": numbers(c)}
        return
    # the plate lags behind the carrier: its turn is minus what is lost in the play
    ends = numbers(-centre - play / 2, -centre + play / 2)
    apart = 1 / rig.drive.plate_inertia_kg_m2 + 1 / CARRIER_KG_M2
    hinge.attrib |= {"limited": "true", "range": ends, "solimplimit": numbers(SOFT, SOFT, 1)}
    hinge.attrib["solreflimit"] = numbers(-k * apart, -c * apart)


def _held_by_ground(document: Document, plate, rig: Rig, a: int, axis: str) -> None:
    """The plate's dry friction against the ground, on a cord from its edge to far above."""
    half = rig.linkage.half_sides_m[a]
    at = (-half, 0.0) if axis == "x" else (0.0, -half)
    add(plate, "site", name=f"cord_{axis}", pos=(*at, 0.0), size=(0.001,))
    above = (*at, rig.linkage.height_m + FAR_M)
    add(document.world, "site", name=f"over_{axis}", pos=above, size=(0.001,))
    held = rig.drive.joint_friction_nm / half
    cord = add(document.tendon, "spatial", name=f"friction_{axis}", frictionloss=held)
    cord.attrib |= {"rgba": "0 0 0 0", "width": "0.0001", **stiff("friction")}
    for site in (f"over_{axis}", f"cord_{axis}"):
        add(cord, "site", site=site)
