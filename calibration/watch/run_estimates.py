"""What one run says of the parameters that are watched, beside the model that was accepted.

The accepted model is the rig file's with every watched parameter fitted to the accepted runs
(`calibration.gap.model.fit`, the one estimator of the gap workflow), at noise levels estimated with
it. A later run is fitted from there with the same parameters free, at the same noise levels: what
the model gets wrong for every run of a protocol stays in all estimates alike and cancels where runs
are compared. This is the local approach to the monitoring of a model (Benveniste, Basseville and
Moustakides, IEEE Trans. Autom. Control 32, 1987) with the fit carried on to its minimum.

Standard deviations are those of the jackknife over seconds (`calibration.gap.model.intervals`),
without its floors for errors of the model. Not watched, but free within their tolerances, are the
other effects that have one.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from calibration.gap.investigation import levels_of, usable_runs
from calibration.gap.model.data import Evidence, gather
from calibration.gap.model.fit import evaluate
from calibration.gap.model.intervals import covariance
from calibration.gap.model.parameters import CALIBRATED, IN_RECORD, NominalModel, Parameter
from calibration.gap.model.state import Key, State, refit, settle
from calibration.gap.name.candidates import Start
from calibration.gap.name.drive_law import best_of_grid, has_law
from calibration.gap.name.load_friction import choose_friction_model, friction_models
from calibration.gap.report.findings_of_decision import enough_motion
from calibration.linear_algebra import single_threaded
from rig.effects import BY_NAME
from rig.log import Log
from rig.parameters import Rig

# Watched beside K and tau: what wears, comes loose, is knocked or is fed otherwise. Chosen: each is
# told by one run of random steps; the others of the catalogue need a look with `rig gap`.
WATCHED = (
    *("voltage_offset", "coulomb_friction", "gear_backlash", "joint_backlash", "level_offset"),
    *("camera_scale", "camera_yaw", "camera_delay", "servo_lag", "servo_dead_time", "angle_scale"),
)
START_PLAYS_RAD = (0.0, 0.015)  # where the rig file knows no play; chosen: none, and a degree
ITERATIONS = 3  # of the fit of one run, which begins near its minimum; chosen
PLAYS = ("gear_backlash", "joint_backlash")


@dataclass(frozen=True, eq=False)
class Accepted:
    """The model that was accepted: a fit to the accepted runs, and the watched parameters in their
    order."""

    state: State
    parameters: tuple[Parameter, ...]
    rig: Rig

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the watched parameters, "effect.key.axis"; of K and tau they begin with "."."""
        return tuple(one.name for one in self.parameters)

    def value(self, name: str) -> float:
        """The accepted value of a parameter, in its unit. `KeyError`: no such parameter."""
        return self.state.fit.setting.get(name, self.state.nominal.parameters[name].nominal)


@dataclass(frozen=True, eq=False)
class RunEstimate:
    """Estimates of the watched parameters from one run, and their standard deviations, (p,) each in
    the units of the parameters; NaN where the run tells nothing."""

    values: np.ndarray
    stds: np.ndarray


@single_threaded
def accept(logs: Sequence[Log], rig: Rig) -> Accepted:
    """The accepted model from logs of accepted runs and the rig file.

    `ValueError`: the logs have too little motion to say anything.
    """
    evidence = gather(usable_runs(logs, rig), levels_of(rig))
    states = []
    for nominal, start in _starts(evidence, rig):
        begun = State(evidence, nominal, evaluate(evidence, nominal, start, evidence.outputs))
        lacking = enough_motion(begun)
        if lacking:
            raise ValueError(f"the accepted runs have too little motion: {lacking}")
        for law in ({}, _drive_law(begun)) if has_law(nominal) else ({},):
            fit = evaluate(evidence, nominal, start | law, evidence.outputs)
            state = State(evidence, nominal, fit, _named(nominal))
            states.append(settle(settle(state, evidence.outputs), evidence.outputs))
    best = min(states, key=_cost_at_one_level(states[0]))
    return Accepted(best, _watched(best), rig)


@single_threaded
def estimate(accepted: Accepted, log: Log) -> RunEstimate:
    """What a log says of the watched parameters, fitted from the accepted model.

    `ValueError`: it has too little motion for any of them.
    """
    old = accepted.state
    evidence = gather(usable_runs([log], accepted.rig), old.evidence.levels)
    begun = evaluate(evidence, old.nominal, old.fit.setting, evidence.outputs)
    state = State(evidence, old.nominal, begun, old.named)
    lacking = enough_motion(state)
    if lacking:
        raise ValueError(f"too little motion: {lacking}")
    state = refit(state, state.bounds(evidence.outputs), iterations=ITERATIONS)
    spread = _spread(state)
    values = [state.fit.setting.get(k.name, k.nominal) for k in accepted.parameters]
    stds = [spread.get(k.name, np.nan) for k in accepted.parameters]
    told = np.isfinite(stds) & (np.array(stds) > 0)
    return RunEstimate(np.where(told, values, np.nan), np.where(told, stds, np.nan))


def effect_of(parameter: Parameter) -> str:
    """The effect that a parameter belongs to, as `rig effects` calls it; K is "gain", tau "time
    constant"."""
    return (
        parameter.effect
        or {"gain_rad_s_V": "gain", "time_constant_s": "time_constant"}[parameter.key]
    )


def unit_of(parameter: Parameter) -> str:
    """The unit of a parameter, as the catalogue writes it."""
    if not parameter.effect:
        return dict(zip(CALIBRATED, ("rad/s/V", "s"), strict=True))[parameter.key]
    return next(p.unit for p in BY_NAME[parameter.effect].parameters if p.key == parameter.key)


def _starts(evidence: Evidence, rig: Rig) -> list[tuple[NominalModel, dict[str, float]]]:
    """Nominal models and settings to fit from: one where the rig file knows the play, else with and
    without play and, which play and friction decide together, with and without loaded motors."""
    known = choose_friction_model(evidence, rig, None)
    if any(known.parameters[n].nominal > 0 for n in _play_names(known)):
        return [(known, {})]
    starts = product(friction_models(rig), START_PLAYS_RAD)
    return [(model, dict.fromkeys(_play_names(model), play)) for model, play in starts]


def _drive_law(begun: State) -> Start:
    """Friction, offset and play of both servos from a grid: from none of them the fit ends in other
    minima, where the play stands for the offset and no change of K is seen."""
    x, y = (best_of_grid(begun, axis)[0] for axis in "xy")
    return x | y


def _play_names(nominal: NominalModel) -> list[str]:
    return [f"{e}.play_rad.{a}" for e in PLAYS for a in "xy" if nominal.of(e, a)]


def _named(nominal: NominalModel) -> tuple[Key, ...]:
    there = {e.name for e in nominal.effects}
    return tuple((name, a) for name in WATCHED if name in there for a in BY_NAME[name].axes)


def _cost_at_one_level(first: State):
    """Costs of fits compare at the same noise levels only: those of the first."""

    def cost(state: State) -> float:
        evidence = state.evidence.with_levels(first.evidence.levels)
        return evaluate(evidence, state.nominal, state.fit.setting, evidence.outputs).cost

    return cost


def _watched(state: State) -> tuple[Parameter, ...]:
    """The parameters of K, tau and the WATCHED effects that the accepted runs tell; not the inner
    shape of an effect, which is fitted but no wear, and has neither name nor unit."""
    spread, named = _spread(state), set(state.named)
    return tuple(
        parameter
        for parameter in state.nominal.parameters.values()
        if spread.get(parameter.name, 0.0) > 0
        and parameter.key not in IN_RECORD
        and (parameter.key in CALIBRATED or (parameter.effect, parameter.axis) in named)
    )


def _spread(state: State) -> dict[str, float]:
    """Standard deviations by parameter name. A play that is below one count of the encoder is known
    to half a count at best: within it the fit jumps between minima."""
    outputs = tuple(state.evidence.outputs)
    groups = [outputs] if state.nominal.load_friction else [(output,) for output in outputs]
    found: dict[str, float] = {}
    for group in groups:
        names, cov, *_ = covariance(state, group)
        found |= dict(zip(names, np.sqrt(np.maximum(np.diag(cov), 0.0)).tolist(), strict=True))
    count = state.nominal.rig.servo.encoder_step_rad
    for name in _play_names(state.nominal):
        if name in found and state.fit.setting.get(name, 0.0) < count:
            found[name] = max(found[name], 0.5 * count)
    return found
