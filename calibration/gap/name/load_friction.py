"""What brakes the arm behind the gears? The logs decide.

Nominal models compete. Where the rig file has friction of arm or joints, an assumed value: one
whose motors are loaded by it, and one without it. Where the joints have none: one in which the arm
coasts through the gap of the gears, and one in which it stays where the teeth leave it; a gap of a
quarter of an encoder count through which the arm coasts already delays a servo by a millisecond or
two. Which of them is right shows beside the effects that act: naming begins with the one that costs
least where the motors have the Coulomb friction that fits best, and what was selected is then
fitted to the others. Where one of them costs less, or the ball shows a joint's play that loaded
motors deny, effects are selected anew beside it (`calibration.gap.name.stepwise`). Where the
Coulomb friction that is named is as large as that of the rig file, it is no other one: the naming
is repeated with shafts that do not wind up, and where it is named there, too, it is not certain
(`calibration.gap.veto`).
"""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import partial

from calibration.gap.decision_rule import (
    CREEP_QUANTILE,
    CREEP_SPEED_SHARE,
    NAME_THRESHOLD,
    PENALTY_PER_PARAMETER,
)
from calibration.gap.model.data import Evidence
from calibration.gap.model.fit import evaluate
from calibration.gap.model.parameters import BALL, COAST_KEY, SERVO, NominalModel, held_nm
from calibration.gap.model.state import State, baseline, refit
from calibration.gap.name.candidates import fastest
from calibration.gap.name.screen import Screened
from rig.parameters import Rig

FRICTION, JOINT = "coulomb_friction", "joint_backlash"
RIGID_SHAFTS = (
    "a Coulomb friction as large as that of arm and joints in [drive] of the rig file is taken for "
    "that one: the file's shafts are less stiff than the logs show, and the rig file that is "
    "written has all of it on the arms"
)
FILES_FRICTION = (
    "not certain: coulomb_friction: it is as large as that of arm and joints in [drive] of the rig "
    "file, but no model in which that friction loads the motors explains the logs as well"
)


def choose_friction_model(
    evidence: Evidence,
    rig: Rig,
    tolerances: Mapping[str, float] | None,
    row_s: float = 0.0,
) -> NominalModel:
    """The nominal model of the rig that the logs prefer before anything is named. `tolerances`,
    `row_s`: as in `NominalModel`."""
    known = friction_models(rig, tolerances, row_s)
    outputs = _servos(evidence)
    if len(known) == 1 or not outputs:
        return known[-1]
    servos = evidence.of(outputs)
    return min(known, key=lambda nominal: _cost_with_coulomb(servos, nominal))


def friction_models(
    rig: Rig, tolerances: Mapping[str, float] | None = None, row_s: float = 0.0
) -> list[NominalModel]:
    """The nominal models of a rig that compete, the last of them that of held arms without load; it
    is alone where a controller holds the servo's angle: no motor feels a load, no arm coasts.
    """
    model = partial(NominalModel, rig, tolerances=tolerances, row_s=row_s)
    held = model(load_friction=False, coasts=False)
    if rig.servo.takes_angle:
        return [held]
    joint, arm = rig.drive.joint_friction_nm, rig.drive.arm_friction_nm
    models = [held]
    if joint == 0.0:
        models.insert(0, model(load_friction=False))
    if joint + arm > 0.0:
        models.insert(0, model(load_friction=True))
    return models


def better_friction_model(state: State) -> NominalModel | None:
    """The nominal model with which the servos cost least, the same effects released and the Coulomb
    friction of the motors as well; None where that is the state's own, or nothing is named there.
    """
    outputs, nominal = _servos(state.evidence), state.nominal
    axes = {output[-1] for output in outputs}
    if not any(axis in axes for _, axis in state.named):
        return None
    own = sum(state.fit.costs[output] for output in outputs)
    costs = [
        (_cost_with_same(state, other, outputs), other)
        for other in competing(nominal)
        if (other.load_friction, other.coasts) != (nominal.load_friction, nominal.coasts)
    ]
    least, best = min(costs, key=lambda pair: pair[0], default=(own, None))
    return best if least < own else None


def unloaded_model(state: State, screened: Iterable[Screened]) -> NominalModel | None:
    """The nominal model of held arms without load, where motors are loaded by a joint whose play
    the ball shows in the screen of a state and that is not named; None elsewhere.

    The servos may deny such a play only as they do not feel the friction in it that the rig file
    has, by which a motor would be loaded on a flank alone.
    """
    nominal = state.nominal
    named = any(name == JOINT for name, _ in state.named)
    shown = any(one.name == JOINT and one.gain >= NAME_THRESHOLD for one in screened)
    loads = nominal.load_friction and nominal.rig.drive.joint_friction_nm > 0.0
    if named or not (shown and loads):
        return None
    return competing(nominal)[-1]


def competing(nominal: NominalModel) -> list[NominalModel]:
    """The nominal models that compete with one, its own among them."""
    return friction_models(nominal.rig, nominal.given_tolerances, nominal.row_s)


def _cost_with_same(state: State, other: NominalModel, outputs: tuple[str, ...]) -> float:
    """The cost of the servos with another nominal model and the effects of the state, beside the
    Coulomb friction of the motors, which is paid for; how far arms coast is that model's own."""
    axes = {output[-1] for output in outputs}
    more = other.assumed_friction_V - state.nominal.assumed_friction_V
    friction = {f"{FRICTION}.friction_V.{axis}": 0.0 for axis in sorted(axes)}
    of_state = {k: v for k, v in state.fit.setting.items() if f".{COAST_KEY}." not in k}
    setting = friction | of_state
    setting |= {name: max(setting[name] - more, 0.0) for name in friction}
    released = dict.fromkeys((*state.named, *((FRICTION, axis) for axis in sorted(axes))))
    moved = State(
        state.evidence, other, evaluate(state.evidence, other, setting, outputs), tuple(released)
    )
    moved = refit(moved, moved.bounds(outputs))
    return moved.fit.cost + PENALTY_PER_PARAMETER * (len(released) - len(state.named))


def model_of_rigid_shafts(before: State, after: State) -> NominalModel | None:
    """The nominal model of shafts that do not wind up, whose arms have all friction that the rig
    file has of arm and joints, where motors that arms neither load nor let coast have friction by
    name, one of them that one; None elsewhere. `before`, `after`: without and with the names."""
    coasts = after.nominal.coasts
    return None if coasts or not names_files_friction(before, after) else _rigid(before.nominal)


def names_files_friction(before: State, after: State) -> bool:
    """Whether, where a plate is there and the model has no load of the motors, all of them have
    Coulomb friction by name, one of them as much as what the rig file has of arm and joints: what
    another has beside it, as the play of a gear, may mix with the size of its own. `before`,
    `after`: without and with the names."""
    axes = [output[-1] for output in _servos(after.evidence)]
    if after.nominal.load_friction or not axes or BALL not in after.evidence.outputs:
        return False
    if not {(FRICTION, axis) for axis in axes} <= set(after.named):
        return False
    other, names = _rigid(before.nominal), {a: f"{FRICTION}.friction_V.{a}" for a in axes}
    more = {n: after.fit.setting[n] - other.assumed_friction_V for n in names.values()}
    return not all(other.exceeds_minimum(FRICTION, axis, more) for axis in axes)


def _rigid(nominal: NominalModel) -> NominalModel:
    """Motors loaded by arms that have the friction of arm and joints."""
    drive = nominal.rig.drive
    rigid = replace(drive, arm_friction_nm=held_nm(drive), joint_friction_nm=0.0)
    rig = replace(nominal.rig, drive=rigid)
    tolerances, row_s = nominal.given_tolerances, nominal.row_s
    return NominalModel(rig, load_friction=True, tolerances=tolerances, row_s=row_s)


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
