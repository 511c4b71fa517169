"""Specification tests of a named model: is it complete, is it in time?

A wrong name fits because it stands in for something else. Two properties of the right model,
which need no idea of what else could act, tell it (a third: `calibration.gap.constancy`):

**Completeness.** What the logs explain of each other beyond the named model is nothing. With
G_names the fall of the cost (`calibration.gap.model.fit`) by the names of an output, and G_flexible
by what a flexible model (`calibration.gap.model.flexible`, and hats of HAT_S in time) that was
fitted to four of five seconds predicts of the fifth,

    completeness = G_names/(G_names + G_flexible)

G_flexible counts where it is above 0 for certain, by blocks (`decision_rule.is_certain`).

A constant (OFFSETS) cannot be told from the mean of what depends on the place, where such a term is
left: a dent has a mean slope where the ball was. Nor can a dead zone from a part of what depends on
speed: a bridge that loses volts by the sign of the current, V - omega/K, gives both.

**Order in time.** A cause does not come after what it causes (Sims, Am. Econ. Rev. 62, 1972). In
closed loop a gust is answered by the controller, and a function of the angles of this answer looks
like its cause, but comes too late. With z the residuals without a name and r(t) its response, z
with it less z without,

    C(tau) = sum m rho(z - a r(t + tau)),   a by least squares,   D = C(0) - C(tau)

is below 0 for the right name. It is not in time where D > SURE_Z of its standard errors by blocks
for a tau of LEADS_S. A name that is a delay itself is not asked, nor a constant, which has no time.
"""

from collections.abc import Collection, Mapping

import numpy as np

from calibration.gap.decision_rule import (
    CANCELLED_SHARE,
    CHANCE_ONE_IN,
    RANGE_END_STEPS,
    is_certain,
)
from calibration.gap.model.cost import huber, weights
from calibration.gap.model.fit import evaluate
from calibration.gap.model.flexible import ball_regressors, servo_regressors, with_hats
from calibration.gap.model.intervals import FALLING_HIGH, FIXED, Spread, blocks_of, interval
from calibration.gap.model.parameters import BALL, CALIBRATED, FALL_KEY, SERVO
from calibration.gap.model.state import State, outputs_of
from calibration.gap.name.stepwise import Accepted
from calibration.gap.prove import model_of
from calibration.gap.unnamed.term import UnnamedTerm

OFFSETS = ("level_offset", "voltage_offset")  # effects whose size is a constant
JOINT, DEAD_ZONE = "joint_backlash", "dead_zone"
RIPPLE, RESISTANCE = "transmission_ripple", "rolling_resistance"
# By the effect that makes a servo late, the effect and key of what makes it late otherwise.
LATE_OTHERWISE = {
    "servo_lag": ("servo_dead_time", "delay_s"),
    "servo_dead_time": ("servo_lag", "lag_s"),
    "input_delay": ("", "time_constant_s"),
}
LEADS_S = (0.1, 0.2, 0.4)  # from a controller's first answer to most of it; chosen
FOLD_S = 1.0  # of folds in turn: longer than a filter remembers, shorter than a hat; chosen
FOLDS = 5  # four fifths of the seconds tell a fifth: the usual number of a cross-validation


def completeness(bare: State, state: State, output: str) -> float:
    """The module's completeness of `state` on an output, 0 to 1, against `bare`, the same without
    names; 0 where the names lower no cost."""
    named = bare.fit.costs[output] - state.fit.costs[output]
    if named <= 0.0:
        return 0.0
    return named / (named + predictable(state, output))


def predictable(state: State, output: str) -> float:
    """G_flexible of the module's equation on an output, for the residuals of a state; 0 where it is
    not certain that a flexible model predicts more of them."""
    evidence, model = state.evidence, model_of(state)
    z, mask = state.fit.z(output), evidence.masks[output]
    w, (t, run) = weights(z, mask), evidence.times(output)
    fold = (np.floor(t / FOLD_S).astype(int) + run) % FOLDS
    levels, gain = evidence.levels, np.zeros(len(z))
    if output == BALL:
        axes = ball_regressors(evidence.runs, float(model.record["half_side"].max()))
        noise = float(levels["ball_process"]), float(levels["ball_measured"])
        parts = [(axes[a], slice(a, None, 2)) for a in range(2) if evidence.ball_axes[a]]
        times = [r.exposed_s for r in evidence.runs]
    else:
        a = SERVO.index(output)
        rows = servo_regressors(evidence.runs, output, model.time_constant_s[a])
        noise = float(levels["servo_process"][a]), float(levels["servo_measured"][a])
        parts, times = [(rows, slice(None))], [r.t_s for r in evidence.runs]
    for rows, own in parts:
        said = with_hats(rows, times).predicted(z[own], w[own], fold[own], *noise)
        gain[own] = mask[own] * (huber(z[own]) - huber(z[own] - said))
    falls = np.bincount(blocks_of(state, (output,)), gain)
    return float(falls.sum()) if is_certain(falls) else 0.0


def part_of_what_is_left(one: Accepted, outputs: Collection[str], left: UnnamedTerm | None) -> str:
    """Why a name on these outputs cannot be certain beside what is left without a name there, in
    words; "" if it can: a constant beside what depends on the place, a dead zone beside what
    depends on speed."""
    if left is None or left.output not in outputs:
        return ""
    if one.name in OFFSETS and left.kind == "map":
        return "what is left depends on the place, and its mean looks like this"
    if one.name == DEAD_ZONE and left.kind == "speed":
        return "what is left depends on speed: both may be volts lost by the current's direction"
    return ""


def another_response(state: State, one: Accepted) -> str:
    """Why a servo's lag (of volts: the time constant of its motor) or dead time cannot be certain
    beside the other, in words; "" if it can.

    Both make it late. Where one grows while the other falls, by all of its tolerance or more and by
    CANCELLED_SHARE of that growth, the servo is hardly later but answers otherwise: to first order
    in s, a dead time T beside a lag -T is nothing, to second what an elastic plate or drive does.
    """
    if one.name not in LATE_OTHERWISE:
        return ""
    other, key = LATE_OTHERWISE[one.name]
    for axis in one.axes:
        late = state.nominal.of(one.name, axis)[0]
        beside = next(k for k in state.nominal.of(other, axis) if k.key == key)
        edge = beside.tolerance
        if key in CALIBRATED:
            edge = CALIBRATED[key] * beside.nominal
        edge -= RANGE_END_STEPS * beside.step
        own, fall = (state.fit.setting.get(k.name, k.nominal) - k.nominal for k in (late, beside))
        if own * fall < 0.0 and abs(fall) >= max(edge, CANCELLED_SHARE * abs(own)) > 0.0:
            return (
                f"on {axis} it stands beside a {other or 'time constant'} of {1e3 * fall:+.0f} ms: "
                "the servo or the plate answers otherwise, and may be elastic"
            )
    return ""


def weaker_at_centre(
    state: State, one: Accepted, accepted: Collection[Accepted], spread: Mapping[str, Spread]
) -> str:
    """Why a ripple that takes away tilt near level cannot be certain, in words; "" if it can.
    `spread`: of the parameters' sizes.

    With a phase of pi, A sin(n theta + pi) = -A n theta near level. The teeth of a wheel do not
    know where level is: within w of pi, the farther end of an interval, a phase is with chance
    w/pi. Where the product p of these over the axes is at most 1 in CHANCE_ONE_IN, the plate
    follows less about its centre, as in a play that a spring centres; by chance a true ripple is as
    near in p of cases on one axis, p (1 - ln p) on two, 1 in 18. Where one is not as sure, but a
    rolling resistance is named beside it, the ball is held at rest by more than it resists while it
    rolls, as by felt, hair or a dent.
    """
    if one.name != RIPPLE:
        return ""
    chance, at_pi = 1.0, True
    for axis in one.axes:
        along, across = state.nominal.of(one.name, axis)[:2]  # A cos(phase), A sin(phase)
        size = state.fit.setting[along.name]
        aside = interval(state.fit.setting[across.name], spread.get(across.name, FIXED))
        chance *= np.arctan2(max(-aside.low, aside.high), -size) / np.pi
        at_pi &= size < 0.0 and aside.low <= 0.0 <= aside.high
    if at_pi and RESISTANCE in (other.name for other in accepted):
        return (
            "beside rolling resistance it takes away the tilt of a ball at rest, which may be held "
            "by more than that: felt, hair, a dent"
        )
    if chance <= 1.0 / CHANCE_ONE_IN:
        return "it makes the plate follow less about level, as a play that a spring centres does"
    return ""


def misfit_of_a_fall(state: State, one: Accepted, accepted: Collection[Accepted]) -> str:
    """Why a small name on the ball beside a joint in whose play the plate falls cannot be certain,
    in words; "" if it can.

    That play may be FALLING_HIGH times what was fitted (`calibration.gap.model.intervals`). What
    it explains goes with the square of its size, so that (1 - 1/FALLING_HIGH)^2 of its score may be
    left over for a name that only takes up the rest.
    """
    if one.name == JOINT or BALL not in outputs_of(state.nominal.catalogue[one.name], one.axes):
        return ""
    share = (1.0 - 1.0 / FALLING_HIGH) ** 2
    setting = state.fit.setting
    for joint in accepted:
        falls = [a for a in joint.axes if setting.get(f"{JOINT}.{FALL_KEY}.{a}")]
        if joint.name == JOINT and falls and one.score < share * joint.score:
            return (
                "the plate falls in the play of its joint, bounces are not followed, and what they "
                "leave looks like this"
            )
    return ""


def untimely(state: State, one: Accepted, output: str) -> str:
    """By how much the cause that a name tells comes too late on an output, in words; "" if it is in
    time."""
    if state.nominal.catalogue[one.name].parameters[0].unit == "s" or one.name in OFFSETS:
        return ""
    own = {k.name for axis in one.axes for k in state.nominal.of(one.name, axis)}
    setting = {name: value for name, value in state.fit.setting.items() if name not in own}
    z = evaluate(state.evidence, state.nominal, setting, (output,)).z(output)
    response, block = state.fit.z(output) - z, blocks_of(state, (output,))
    mask = state.evidence.masks[output]
    w = weights(z, mask)

    def costs(told: np.ndarray) -> np.ndarray:
        share = np.sum(w * z * told) / max(np.sum(w * told**2), 1e-30)
        return np.bincount(block, mask * huber(z - share * told))

    in_time = costs(response)
    for lead_s in LEADS_S:
        falls = in_time - costs(_advanced(state, output, response, lead_s))
        if is_certain(falls):
            return f"what it explains begins {1e3 * lead_s:.0f} ms before its cause"
    return ""


def _advanced(state: State, output: str, response: np.ndarray, lead_s: float) -> np.ndarray:
    """The response (n,) `lead_s` earlier, each run and each axis of the ball by itself."""
    t, run = state.evidence.times(output)
    lane = 2 * run + (np.arange(len(t)) % 2 if output == BALL else 0)
    moved = np.empty_like(response)
    for one in np.unique(lane):
        own = lane == one
        moved[own] = np.interp(t[own] + lead_s, t[own], response[own])
    return moved
