"""Motor and gear of an axis that is driven by volts, up to the arm with the encoder."""

from math import ceil, inf

from experiments.export.mjcf.parts import Document, add, effect, light, shaft, stiff
from rig.parameters import GEARS_INERTIA_HIGH_KG_M2, Rig
from rig.plant.plant_record import STEP_S

_BRISTLE_RAD = 1e-3  # chosen: wind-up at which friction breaks away; 0.1 ms then bear 20 rad/s


def arm_inertia(rig: Rig) -> float:
    """Inertia of the arm's hinge [kg m2]."""
    return GEARS_INERTIA_HIGH_KG_M2


def add_motor(document: Document, rig: Rig, axis: str, at: tuple[float, float, float]) -> None:
    """Add the motor as a hinge of its own, coupled to the hinge arm_AXIS, and its volts."""
    servo = rig.servo
    inertia = servo.inertia_kg_m2 - GEARS_INERTIA_HIGH_KG_M2 - rig.drive.plate_inertia_kg_m2
    per_volt = servo.torque_per_volt_nm
    dry = per_volt * effect(rig, "coulomb_friction", "friction_V", axis)
    extra = per_volt * effect(rig, "stribeck_friction", "extra_V", axis)
    body = add(document.world, "body", name=f"motor_{axis}", pos=at)
    light(body)
    add(
        body,
        "joint",
        name=f"motor_{axis}",
        axis=_axle(axis),
        armature=inertia,
        frictionloss=0.0 if extra else dry,
        limited="true",
        range=(-servo.stop_rad, servo.stop_rad),
        **stiff("limit"),
        **stiff("friction"),
    )
    apart = 1 / inertia + 1 / arm_inertia(rig)
    shaft(document, rig, "gear", axis, ("motor", "arm"), apart)
    _volts(document, rig, axis, per_volt)
    _poles_and_bristles(document, rig, axis, (dry, extra))
    add(document.sensor, "jointvel", name=f"motor_speed_{axis}", joint=f"motor_{axis}")


def _axle(axis: str) -> str:
    return "0 1 0" if axis == "x" else "-1 0 0"


def _volts(document: Document, rig: Rig, axis: str, per_volt: float) -> None:
    """Torque A V - B omega as an actuator whose control is the voltage."""
    limit = min(rig.servo.voltage_limit_V, effect(rig, "saturation", "limit_V", axis, inf))
    late = effect(rig, "input_delay", "delay_s", axis)
    offset = per_volt * effect(rig, "voltage_offset", "offset_V", axis)
    add(
        document.actuator,
        "general",
        name=f"voltage_{axis}_V",
        joint=f"motor_{axis}",
        gainprm=per_volt,
        biastype="affine",
        biasprm=(offset, 0, -rig.servo.damping_nm_s),
        ctrllimited="true",
        ctrlrange=(-limit, limit),
        delay=late or None,
        nsample=str(ceil(late / STEP_S) + 1) if late else None,
    )


def _poles_and_bristles(
    document: Document, rig: Rig, axis: str, friction: tuple[float, float]
) -> None:
    """Cogging and Stribeck friction as a passive motor on the same hinge (LuGre's bristles)."""
    dry, extra = friction
    pull = rig.servo.torque_per_volt_nm * effect(rig, "cogging", "amplitude_V", axis)
    if not (pull or extra):
        return
    periods = effect(rig, "cogging", "periods_per_turn", axis, 1.0)
    if pull and periods != round(periods):
        document.told.append(
            f"cogging.{axis}.periods_per_turn = {periods:g}: MuJoCo's are whole, so cogging is not "
            "in it."
        )
        pull = 0.0
    elif pull:
        document.told.append(
            f"cogging.{axis}: at the motor's angle; the rig takes the arm's, a gear's play apart."
        )
    cogging = (pull, round(periods), effect(rig, "cogging", "phase_rad", axis)) if pull else None
    lugre = None
    if extra:
        bristle = (dry + extra) / _BRISTLE_RAD  # no damping of its own: the motor's is enough
        speed = effect(rig, "stribeck_friction", "speed_rad_s", axis, 0.1)
        lugre = (bristle, 0, dry, dry + extra, speed)
    if not (pull or extra):
        return
    add(
        document.actuator,
        "dcmotor",
        name=f"friction_{axis}",
        joint=f"motor_{axis}",
        input="none",
        resistance=1,
        motorconst=(0, 0),
        cogging=cogging,
        lugre=lugre,
    )
