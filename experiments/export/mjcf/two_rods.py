"""Two rods between arms and plate: joint with play, crank, rod of finite or of endless length."""

from experiments.export.mjcf.motors import add_motor, arm_inertia
from experiments.export.mjcf.parts import Document, add, effect, light, numbers, shaft, stiff
from experiments.export.mjcf.plates import add_plate, add_twist_brake
from experiments.export.mjcf.servos import add_servo
from rig.parameters import Rig
from rig.plant.plant_record import pack

FAR_M = 100.0  # chosen: a rod so long that its slant changes Eq. 14 by less than 1e-5
CRANK_SHARE = 0.1  # chosen: of the plate's inertia at the crank; the plate's body has the rest
CAM_SHARE = 0.2  # chosen: of the crank's inertia


def add_two_rods(document: Document, rig: Rig) -> None:
    """Add both drives, the rods and the plate on its ball joint at the origin."""
    inertia, ratios = rig.drive.plate_inertia_kg_m2, rig.linkage.ratios
    for a, axis in enumerate("xy"):
        _axis(document, rig, a, axis)
    body = add(document.world, "body", name="plate")
    add(body, "joint", name="tilt", type="ball")
    # about x turns the tilt of axis y, about y that of axis x
    own = [(1 - CRANK_SHARE) * inertia / ratio**2 for ratio in ratios]
    add_plate(body, rig, (own[1], own[0]))
    for axis in "xy":
        half = rig.linkage.half_sides_m["xy".index(axis)]
        add(body, "site", name=f"edge_{axis}", pos=_along(axis, -half), size=(0.001,))
    add_twist_brake(document, own[0] + own[1])


def _along(axis: str, value: float, z: float = 0.0) -> tuple[float, float, float]:
    return (value, 0.0, z) if axis == "x" else (0.0, value, z)


def _axis(document: Document, rig: Rig, a: int, axis: str) -> None:
    """Motor or servo, arm, joint, crank and rod of one axis, below the plate's far edge."""
    one, drive = rig.linkage.on(axis), rig.drive
    radius, lever, rod = one.arm_radius_m, one.plate_side_m / 2, one.rod_length_m
    at = _along(axis, -(lever - radius), -(rod or 4 * radius))
    axle = "0 1 0" if axis == "x" else "-1 0 0"
    arm = add(document.world, "body", name=f"arm_{axis}", pos=at)
    light(arm)
    add(arm, "geom", type="capsule", size=(0.003,), fromto=(0, 0, 0, *_along(axis, -radius)))
    if rig.servo.takes_angle:
        name, limit = f"command_{axis}_rad", rig.servo.angle_limit_rad
        of_arm = add_servo(document, pack(rig), a, f"arm_{axis}", name, limit)
        inertia = float(of_arm["armature"])
    else:
        inertia = arm_inertia(rig)
        of_arm = {"armature": inertia, "frictionloss": drive.arm_friction_nm, **stiff("friction")}
    add(arm, "joint", name=f"arm_{axis}", axis=axle, **of_arm)
    add(document.sensor, "jointpos", name=f"theta_{axis}", joint=f"arm_{axis}")
    if not rig.servo.takes_angle:
        add_motor(document, rig, axis, at)
    crank_inertia = CRANK_SHARE * drive.plate_inertia_kg_m2
    shaft(document, rig, "joint", axis, ("arm", "crank"), 1 / inertia + 1 / crank_inertia)
    bent = [
        effect(rig, "linkage_quadratic", "coefficient_1_rad", axis),
        effect(rig, "linkage_cubic", "coefficient_1_rad2", axis),
    ]
    share = CAM_SHARE * crank_inertia if any(bent) else 0.0
    pins = {"crank": crank_inertia - share} | ({"cam": share} if share else {})
    for part, armature in pins.items():
        body = add(document.world, "body", name=f"{part}_{axis}", pos=at)
        light(body)
        dry = drive.joint_friction_nm if part == "crank" else 0.0
        hinge = add(body, "joint", name=f"{part}_{axis}", axis=axle, armature=armature)
        hinge.attrib |= {"frictionloss": numbers(dry), **stiff("friction")}
        for end, side in (("pin", -1), ("back", 1)):
            name = f"{end}_{part}_{axis}"
            add(body, "site", name=name, pos=_along(axis, side * radius), size=(0.001,))
    last = list(pins)[-1]
    if share:
        poly = numbers(0, 1, *bent, 0)
        joints = {"joint1": f"cam_{axis}", "joint2": f"crank_{axis}"}
        add(document.equality, "joint", name=f"bend_{axis}", polycoef=poly, **joints)
    _rod(document, rig, axis, last, at)


def _rod(
    document: Document, rig: Rig, axis: str, last: str, at: tuple[float, float, float]
) -> None:
    """The rod from the pin of the body `last` to the plate's edge, as a tendon that keeps its
    length, or, where it is endlessly long, as two tendons that lead far up and change alike.
    """
    one, other = rig.linkage.on(axis), "yx"["xy".index(axis)]
    cross = effect(rig, "cross_coupling", "fraction", axis)
    invisible = {"width": "0.0001", "rgba": "0 0 0 0"}
    if one.rod_length_m > 0:
        rod = add(document.tendon, "spatial", name=f"rod_{axis}", width=0.002)
        for site in (f"pin_{last}_{axis}", f"edge_{axis}"):
            add(rod, "site", site=site)
        # a tendon without a partner keeps the length that it has in the level pose
        add(document.equality, "tendon", name=f"rod_{axis}", tendon1=f"rod_{axis}")
        if cross:
            document.told.append(f"effects.cross_coupling.{axis}: not with rods of finite length.")
        return
    up = add(document.tendon, "spatial", name=f"rod_{axis}", **invisible)
    edge = add(document.tendon, "spatial", name=f"edge_{axis}", **invisible)
    half = rig.linkage.half_sides_m["xy".index(axis)]
    for name, place in (
        (f"over_pin_{axis}", (*_along(axis, -half)[:2], at[2] + FAR_M)),
        (f"over_back_{axis}", (*_along(axis, 2 * one.arm_radius_m - half)[:2], at[2] + FAR_M)),
        (f"over_edge_{axis}", (*_along(axis, -half)[:2], FAR_M)),
    ):
        add(document.world, "site", name=name, pos=place, size=(0.001,))
    add(up, "site", site=f"over_pin_{axis}")
    add(up, "site", site=f"pin_{last}_{axis}")
    if cross:
        end = "pin" if cross > 0 else "back"
        of_other = "cam" if _bent(rig, other) else "crank"
        divisor = rig.linkage.on(other).arm_radius_m / (one.arm_radius_m * abs(cross))
        add(up, "pulley", divisor=divisor)
        add(up, "site", site=f"over_{end}_{other}")
        add(up, "site", site=f"{end}_{of_other}_{other}")
    add(edge, "site", site=f"over_edge_{axis}")
    add(edge, "site", site=f"edge_{axis}")
    ends = {"tendon1": f"edge_{axis}", "tendon2": f"rod_{axis}", "polycoef": "0 1 0 0 0"}
    add(document.equality, "tendon", name=f"rod_{axis}", **ends)


def _bent(rig: Rig, axis: str) -> bool:
    return bool(
        effect(rig, "linkage_quadratic", "coefficient_1_rad", axis)
        or effect(rig, "linkage_cubic", "coefficient_1_rad2", axis)
    )
