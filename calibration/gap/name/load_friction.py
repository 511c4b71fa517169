"""Does the friction of arm and joints, an assumed value, load the motors? The logs decide.

Two nominal models compete: one loaded by the assumed friction, and one without it whose motors have
the Coulomb friction that fits best. If the latter fits better with a Coulomb friction about as
large as the assumed one, something else may be missing that only one of the two can imitate
(backlash in the gears, say): each is then fitted with the one further effect that helps it most,
and the cheaper one is taken.
"""

from collections.abc import Mapping
from dataclasses import replace

from calibration.gap.decision_rule import CREEP_QUANTILE, CREEP_SPEED_SHARE, MIN_FRICTION_SHARE
from calibration.gap.model.data import Evidence
from calibration.gap.model.parameters import SERVO, NominalModel
from calibration.gap.model.state import State, baseline, refit
from calibration.gap.name.candidates import fastest
from calibration.gap.name.refit import rank
from calibration.gap.name.screen import screen
from rig.parameters import Rig


def choose_friction_model(
    evidence: Evidence, rig: Rig, tolerances: Mapping[str, float] | None
) -> NominalModel:
    """The nominal model of the rig, with the motors loaded by the assumed friction of arm and
    joints or without, whichever the logs prefer (the module's comparison). `tolerances`: as in
    `NominalModel`."""
    free = NominalModel(rig, load_friction=False, tolerances=tolerances)
    outputs = tuple(output for output in evidence.outputs if output in SERVO)
    if rig.servo.takes_angle or rig.drive.joint_friction_nm == 0.0 or not outputs:
        return free
    loaded = NominalModel(rig, load_friction=True, tolerances=tolerances)
    servo = replace(evidence, masks={output: evidence.masks[output] for output in outputs})
    with_load = baseline(servo, loaded, iterations=3)
    without_load = _with_coulomb(baseline(servo, free, iterations=3), outputs)
    if with_load.fit.cost < without_load.fit.cost:
        return loaded
    enough = MIN_FRICTION_SHARE * loaded.assumed_friction_V
    if not all(_coulomb_V(without_load, output) > enough for output in outputs):
        return free
    with_load = _with_coulomb(with_load, outputs)
    better = _cost_of_one_more(with_load, outputs) < _cost_of_one_more(without_load, outputs)
    return loaded if better else free


def creeping_servos(evidence: Evidence, nominal: NominalModel) -> tuple[str, ...]:
    """Servo outputs that only creep: CREEP_QUANTILE of their speeds lie below CREEP_SPEED_SHARE of
    the speed that the volts of the load's friction would give. Breakaway of that friction within
    winding shafts decides there, and the first-order motor model does not hold."""
    if not nominal.load_friction:
        return ()
    slow = CREEP_SPEED_SHARE * nominal.rig.servo.gain_rad_s_V * nominal.assumed_friction_V
    there = (output for output in SERVO if output in evidence.outputs)
    return tuple(output for output in there if fastest(evidence, output[-1], CREEP_QUANTILE) < slow)


def _with_coulomb(state: State, outputs: tuple[str, ...]) -> State:
    state = replace(state, named=tuple(("coulomb_friction", output[-1]) for output in outputs))
    return refit(state, state.bounds(outputs), iterations=4)


def _coulomb_V(state: State, output: str) -> float:
    return state.fit.setting.get(f"coulomb_friction.friction_V.{output[-1]}", 0.0)


def _cost_of_one_more(state: State, outputs: tuple[str, ...]) -> float:
    """The cost with the one further effect that lowers it most."""
    fits = rank(state, screen(state, outputs), most=2)
    return min((candidate.state.fit.cost for candidate in fits), default=state.fit.cost)
