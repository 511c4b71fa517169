"""Does the friction of arm and joints, an assumed value, load the motors? The logs decide.

Against the assumed friction stands a table without it whose motors have whatever Coulomb friction
fits best. Where that Coulomb friction is about as large as the assumed one, something else may be
missing that only one of the two models can imitate (a play in the gears, say): each then gets the
one effect more that helps it most.
"""

from collections.abc import Mapping
from dataclasses import replace

from calibration.gap.evidence import Evidence
from calibration.gap.knobs import SERVO, Believed
from calibration.gap.menu import fastest
from calibration.gap.screen import screen
from calibration.gap.search import rank
from calibration.gap.state import State, baseline, refit
from rig.parameters import Rig

# A servo creeps that stays for so much of its time below this share of the speed which the volts of
# the assumed friction would give.
CREEPS, CREEPING = 0.95, 0.75
LIKE_IT = 0.5  # share of the assumed friction from which on Coulomb friction may be it


def believe(evidence: Evidence, rig: Rig, tolerances: Mapping[str, float] | None) -> Believed:
    """The believed model, loaded by the assumed friction or not."""
    without = Believed(rig, load_friction=False, tolerances=tolerances)
    parts = tuple(p for p in evidence.parts if p in SERVO)
    if rig.drive.joint_friction_nm == 0.0 or not parts:
        return without
    loaded = Believed(rig, load_friction=True, tolerances=tolerances)
    servo = replace(evidence, masks={p: evidence.masks[p] for p in parts})
    with_it = baseline(servo, loaded, iterations=3)
    bare = _with_coulomb(baseline(servo, without, iterations=3), parts)
    if with_it.fit.cost < bare.fit.cost:
        return loaded
    if not all(_coulomb_V(bare, part) > LIKE_IT * loaded.assumed_friction_V for part in parts):
        return without
    with_it = _with_coulomb(with_it, parts)
    return loaded if _one_more(with_it, parts) < _one_more(bare, parts) else without


def creeping(evidence: Evidence, believed: Believed) -> tuple[str, ...]:
    """Servo parts that only creep: where the load's friction lets go decides then, within winding
    shafts, and no first-order motor; a model of motion finds anything there."""
    if not believed.load_friction:
        return ()
    slow = CREEPING * believed.rig.servo.gain_rad_s_V * believed.assumed_friction_V
    there = (part for part in SERVO if part in evidence.parts)
    return tuple(part for part in there if fastest(evidence, part[-1], CREEPS) < slow)


def _with_coulomb(state: State, parts: tuple[str, ...]) -> State:
    state = replace(state, named=tuple(("coulomb_friction", part[-1]) for part in parts))
    return refit(state, state.bounds(parts), iterations=4)


def _coulomb_V(state: State, part: str) -> float:
    return state.fit.setting.get(f"coulomb_friction.friction_V.{part[-1]}", 0.0)


def _one_more(state: State, parts: tuple[str, ...]) -> float:
    """The cost with the one effect more that lowers it most."""
    trials = rank(state, screen(state, parts), most=2)
    return min((trial.state.fit.cost for trial in trials), default=state.fit.cost)
