"""Plate, walls and ball, and what brakes the ball."""

from math import atan2, exp, pi, sqrt

from scipy.optimize import brentq

from experiments.export.mjcf.parts import HARD, Document, add, effect, numbers
from rig.parameters import Rig
from rig.plant.plant_record import STEP_S

HALF_THICKNESS_M = 0.004
PLATE_KG = 0.3  # assumed, as rig.parameters does; it hangs in its middle
WALL_RATE_RAD_S = 600.0  # chosen: of the wall's spring on the ball, a hit of 5 ms
GRIP = 1.0  # friction of ball and plate: it does not slip (its tilt is far below 45 degrees)


def add_plate(body, rig: Rig, inertia: tuple[float, float]) -> None:
    """Fill the plate's body: inertia about its axes [kg m2], the top at its origin, walls."""
    (h_x, h_y), t = rig.linkage.half_sides_m, HALF_THICKNESS_M
    i_1, i_2 = inertia
    add(body, "inertial", pos=(0, 0, 0), mass=PLATE_KG, diaginertia=(i_1, i_2, i_1 + i_2))
    add(body, "geom", name="top", type="box", size=(h_x, h_y, t), pos=(0, 0, -t))
    add(body, "site", name="centre", pos=(0, 0, rig.ball.radius_m), size=(0.001,))
    yaw = effect(rig, "camera_yaw", "angle_rad", "xy")
    add(body, "site", name="camera_frame", pos=(0, 0, 0), euler=(0, 0, -yaw), size=(0.001,))
    if rig.walls.present:
        for k, (x, y) in enumerate(((1, 0), (-1, 0), (0, 1), (0, -1))):
            size = (t if x else 2 * h_x, t if y else 2 * h_y, 0.05)
            at = (x * (h_x + t), y * (h_y + t), 0.05)
            add(body, "geom", name=f"wall_{k}", type="box", size=size, pos=at, rgba="0 0 0 0.2")


def add_ball(document: Document, rig: Rig, height_m: float) -> None:
    """Add the ball on the level plate's centre, its contacts, and what brakes it."""
    ball, r, k = rig.ball, rig.ball.radius_m, rig.ball.rolling_factor
    i = (1 / k - 1) * ball.mass_kg * r * r
    body = add(document.world, "body", name="ball", pos=(0, 0, height_m + r))
    # force d v and torque d omega at once brake the rolling ball by k d (1 + 1/r2) v/m
    drag = effect(rig, "viscous_drag", "rate_1_s", "xy") * ball.mass_kg / (k * (1 + 1 / r**2))
    add(body, "joint", name="ball", type="free", damping=drag)
    add(body, "inertial", pos=(0, 0, 0), mass=ball.mass_kg, diaginertia=(i, i, i))
    add(body, "geom", name="ball", type="sphere", size=(r,), rgba="1 0.5 0.1 1")
    add(body, "site", name="ball", pos=(0, 0, 0), size=(0.001,))
    slowed = effect(rig, "rolling_resistance", "deceleration_m_s2", "xy")
    rolling = slowed * r / (k * 9.81) if slowed else 1e-9
    add(
        document.contact,
        "pair",
        name="ball_on_plate",
        geom1="top",
        geom2="ball",
        condim="6" if slowed else "3",
        friction=(GRIP, GRIP, 1e-9, rolling, rolling),
        **HARD,
    )
    if rig.walls.present:
        w, z = WALL_RATE_RAD_S, damping_ratio(max(rig.walls.restitution, 1e-3))
        for n in range(4):
            pair = add(document.contact, "pair", geom1=f"wall_{n}", geom2="ball", condim="1")
            pair.attrib |= {"solref": numbers(-w * w, -2 * w * z), "solimp": HARD["solimp"]}
    bowl = effect(rig, "plate_bowl", "stiffness_1_s2", "xy")
    if bowl > 0:
        spring = add(document.tendon, "spatial", name="bowl", springlength=0, width=1e-4)
        spring.attrib["stiffness"] = numbers(bowl * ball.mass_kg / k)
        for site in ("centre", "ball"):
            add(spring, "site", site=site)
    elif bowl < 0:
        document.told.append("effects.plate_bowl: MuJoCo has no spring that pushes (a hill).")


def add_camera(document: Document, rig: Rig) -> None:
    """Add the camera as a sensor: the ball in the plate's frame, at its rate and delay."""
    late = max(rig.camera.delay_s + effect(rig, "camera_delay", "extra_s", "xy"), 0.0)
    period = 1 / rig.camera.rate_hz
    add(
        document.sensor,
        "framepos",
        name="camera",
        objtype="site",
        objname="ball",
        reftype="site",
        refname="camera_frame",
        noise=rig.camera.noise_m,
        interval=(period, 0),
        delay=late or None,
        nsample=str(int(late / period) + 2) if late else None,
    )
    for name, kind in (("ball_position", "framepos"), ("ball_velocity", "framelinvel")):
        ends = {"objtype": "site", "objname": "ball", "reftype": "body", "refname": "plate"}
        add(document.sensor, kind, name=name, **ends)
    add(document.sensor, "framezaxis", name="plate_normal", objtype="body", objname="plate")


def damping_ratio(restitution: float) -> float:
    """Damping ratio [1] of a spring with damper, which can only push, that a body leaves at
    -restitution times its speed: e = exp(-z/s (pi - atan2(2 z s, 1 - 2 z2))), s = sqrt(1 - z2).
    """

    def leaves_at(z: float) -> float:
        s = sqrt(1 - z * z)
        return exp(-z / s * (pi - atan2(2 * z * s, 1 - 2 * z * z)))

    if restitution >= 1:
        return 0.0
    found = brentq(lambda z: leaves_at(z) - restitution, 1e-9, 0.9999)
    return float(found)  # pyright: ignore


def add_twist_brake(document: Document, inertia: float) -> None:
    """Keep the plate from turning about its normal: a shorted motor about it, K2/R in N m s/rad.

    Explicit steps bear 0.3 I/h: what turns is gone after three steps.
    """
    k = sqrt(0.3 * inertia / STEP_S)
    add(
        document.actuator,
        "dcmotor",
        name="no_twist",
        joint="tilt",
        gear=(0, 0, 1),
        input="none",
        resistance=1,
        motorconst=(k, k),
    )
