"""Does the friction of arm and joints, an assumed value, load the motors? The logs decide.

Two nominal models compete: one loaded by the assumed friction, and one without it. They differ in
what the arm does in the gap of the gears, so that which of them is right shows beside the effects
that act: naming begins with the one that costs less where the motors have the Coulomb friction that
fits best, and what was selected is then fitted to the other. Where that costs less, effects are
selected anew beside it (`calibration.gap.name.stepwise`).
"""

from collections.abc import Mapping
from dataclasses import replace

from calibration.gap.decision_rule import (
    CREEP_QUANTILE,
    CREEP_SPEED_SHARE,
    PENALTY_PER_PARAMETER,
)
from calibration.gap.model.data import Evidence
from calibration.gap.model.fit import evaluate
from calibration.gap.model.parameters import SERVO, NominalModel
from calibration.gap.model.state import State, baseline, refit
from calibration.gap.name.candidates import fastest
from rig.parameters import Rig

FRICTION = "coulomb_friction"


def choose_friction_model(
    evidence: Evidence, rig: Rig, tolerances: Mapping[str, float] | None
) -> NominalModel:
    """The nominal model of the rig, with the motors loaded by the assumed friction of arm and
    joints or without, whichever the logs prefer before anything is named. `tolerances`: as in
    `NominalModel`."""
    free = NominalModel(rig, load_friction=False, tolerances=tolerances)
    outputs = _servos(evidence)
    if not _has_load(rig) or not outputs:
        return free
    loaded = NominalModel(rig, load_friction=True, tolerances=tolerances)
    servos = replace(evidence, masks={output: evidence.masks[output] for output in outputs})
    return min((loaded, free), key=lambda nominal: _cost_with_coulomb(servos, nominal))


def _has_load(rig: Rig) -> bool:
    """Whether there is friction of arm and joints, and motors without a controller that feel it."""
    return rig.drive.joint_friction_nm > 0.0 and not rig.servo.takes_angle


def better_friction_model(state: State) -> NominalModel | None:
    """The other nominal model, if the servos cost less with it, the same effects released and the
    Coulomb friction of the motors as well; None if not, or if nothing is named there."""
    evidence, outputs = state.evidence, _servos(state.evidence)
    axes = {output[-1] for output in outputs}
    if not (_has_load(state.nominal.rig) and any(a in axes for _, a in state.named)):
        return None
    other = state.nominal.with_other_load()
    more = other.assumed_friction_V - state.nominal.assumed_friction_V
    friction = {f"{FRICTION}.friction_V.{axis}": 0.0 for axis in sorted(axes)}
    setting = friction | state.fit.setting
    setting |= {name: max(setting[name] - more, 0.0) for name in friction}
    released = dict.fromkeys((*state.named, *((FRICTION, axis) for axis in sorted(axes))))
    moved = State(evidence, other, evaluate(evidence, other, setting, outputs), tuple(released))
    moved = refit(moved, moved.bounds(outputs))
    paid = PENALTY_PER_PARAMETER * (len(released) - len(state.named))
    costs = sum(state.fit.costs[output] for output in outputs)
    return other if moved.fit.cost + paid < costs else None


def creeping_servos(evidence: Evidence, nominal: NominalModel) -> tuple[str, ...]:
    """Servo outputs that only creep: CREEP_QUANTILE of their speeds lie below CREEP_SPEED_SHARE of
    the speed that the volts of the load's friction would give. Breakaway of that friction within
    winding shafts decides there, and the first-order motor model does not hold."""
    if not nominal.load_friction:
        return ()
    slow = CREEP_SPEED_SHARE * nominal.rig.servo.gain_rad_s_V * nominal.assumed_friction_V
    there = (output for output in SERVO if output in evidence.outputs)
    return tuple(output for output in there if fastest(evidence, output[-1], CREEP_QUANTILE) < slow)


def _servos(evidence: Evidence) -> tuple[str, ...]:
    return tuple(output for output in evidence.outputs if output in SERVO)


def _cost_with_coulomb(evidence: Evidence, nominal: NominalModel) -> float:
    """The cost of the nominal model whose motors have the Coulomb friction that fits best."""
    state = baseline(evidence, nominal, iterations=3)
    state = replace(state, named=tuple((FRICTION, output[-1]) for output in evidence.outputs))
    return refit(state, state.bounds(evidence.outputs)).fit.cost
