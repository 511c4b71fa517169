"""What MuJoCo's XML does not carry of a rig, one line each."""

from experiments.export import own_effects
from rig.parameters import Rig

# Effects for which MuJoCo has nothing of its own, and why.
NOT_CARRIED = {
    "dead_zone": "an actuator's gain has no dead zone",
    "gain_asymmetry": "an actuator's gain is one for both directions",
    "viscous_asymmetry": "damping is one for both directions",
    "gain_drift": "a gain does not depend on time",
    "supply_sag": "an actuator does not see the other's control",
    "transmission_ripple": "joints are coupled by polynomials alone",
    "level_drift": "gravity does not depend on time",
    "camera_scale": "a sensor has no scale",
    "lens_distortion": "a sensor has no lens",
}


def left_out(rig: Rig) -> list[str]:
    """The lines, those for effects that the rig has first."""
    told = [f"effects.{name}: {NOT_CARRIED[name]}." for name in rig.effects if name in NOT_CARRIED]
    told += own_effects.left_out(rig)
    friction = rig.effects.get("coulomb_friction", {}).values()
    if any(pairs.get(key) for pairs in friction for key in ("settling_s", "softness_rad_s")):
        told.append("effects.coulomb_friction: hard; neither settling_s nor softness_rad_s.")
    if rig.unknown != type(rig.unknown)():
        told.append("[unknown]: the discrepancy term has no equivalent.")
    servo = rig.servo
    if servo.takes_angle:
        for key, what in (
            ("period_s", "set data.ctrl at its multiples only"),
            ("quantum_rad", "round data.ctrl to its multiples"),
        ):
            if any(servo.pair(key)):
                told.append(f"servo.{key} = {max(servo.pair(key)):g}: not modelled; {what}.")
        told.append(
            "servo.acceleration_limit_rad_s2: as a force limit on an inertia, which also brakes; "
            "the rig's servo brakes just in time."
        )
    elif servo.tachometer_scale:
        told.append("servo.tachometer_scale: a sensor has no scale.")
    if "stribeck_friction" in rig.effects:
        told.append("effects.stribeck_friction: as LuGre's, which creeps 1 mrad before it breaks.")
    if servo.has_angle:
        told.append("Sensors: angles are not rounded to encoder counts.")
    told.append("Sensors: MuJoCo adds no noise and drops no frame; noise is noted in `camera`.")
    if rig.camera.ball_height_m:
        told.append("camera.ball_height_m: the sensor gives the ball's centre itself.")
    return told
