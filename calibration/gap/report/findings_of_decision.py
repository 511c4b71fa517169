"""The pieces of the findings from a decision: parameters with intervals, what the log cannot show,
the ranking, the calibrated servo, and the extended rig that the simulator then runs."""

from collections.abc import Mapping
from dataclasses import replace
from math import atan2, cos, hypot, inf, sin

from calibration.gap.findings import Interval, Named, RankedEffect, Untestable
from calibration.gap.model.intervals import FIXED, UNKNOWN, Spread, interval, interval_of
from calibration.gap.model.nuisances import MOTOR_KEY
from calibration.gap.model.parameters import (
    BALL,
    CALIBRATED,
    COAST_KEY,
    HEIGHT_KEY,
    IN_RECORD,
    PERIODIC,
    SERVO,
    NominalModel,
)
from calibration.gap.model.seen_effects import TOLD_TWINS, in_ball
from calibration.gap.model.state import State, outputs_of
from calibration.gap.name.candidates import largest_volts
from calibration.gap.name.decide import Decision
from calibration.gap.name.screen import Screened
from calibration.gap.name.stepwise import Accepted
from calibration.gap.prove import model_of
from calibration.gap.sizes import axes_with_size
from rig.effects import BY_NAME, Effect
from rig.parameters import GEARS_INERTIA_HIGH_KG_M2, Rig

TWINS: Mapping[str, tuple[str, ...]] = {
    "level_offset": ("encoder_zero", "asymmetric_play"),
    "camera_scale": ("linkage_gain", "ball_inertia"),
    "camera_delay": ("delay_encoder_to_plate",),
    "camera_yaw": ("antisymmetric_cross_coupling",),
}
# Where servos that take an angle read it back: what lies between is also what reads it.
READ_TWINS = {"angle_zero": ("encoder_zero",), "angle_scale": ("encoder_scale",)}
Parameters = dict[str, dict[str, Interval]]


def twins_of(name: str, rig: Rig) -> tuple[str, ...]:
    """What makes the same data as the effect on this rig, whatever the motion."""
    told = {**TWINS, **(READ_TWINS if rig.servo.has_angle else TOLD_TWINS)}
    return told.get(name, ())


def parameters(
    state: State, name: str, axes: tuple[str, ...], spread: Mapping[str, Spread]
) -> Parameters:
    """The fitted parameters of a named effect: axis -> catalogue key -> 95 % interval. `spread`:
    parameter name -> (standard deviation, blocks), as from `deviations`; infinite where it has no
    entry."""
    found: Parameters = {}
    for axis in axes:
        by_key = {
            parameter.key: interval_of(state, parameter, spread.get(parameter.name, UNKNOWN))
            for parameter in state.nominal.of(name, axis)
            if parameter.name in state.fit.setting
        }
        found[axis] = _catalogue_keys(name, by_key)
    return found


def _catalogue_keys(name: str, by_key: dict[str, Interval]) -> dict[str, Interval]:
    """Amplitude and phase from sine and cosine; keys that no catalogue has left out."""
    if name in PERIODIC:
        s, c = by_key["sine"], by_key["cosine"]
        size, phase = hypot(s.value, c.value), atan2(c.value, s.value)
        reach_s, reach_c = s.high - s.value, c.high - c.value
        along = hypot(reach_s * cos(phase), reach_c * sin(phase))
        across = hypot(reach_s * sin(phase), reach_c * cos(phase)) / max(size, 1e-12)
        return {
            PERIODIC[name]: Interval(size, size - along, size + along),
            "phase_rad": Interval(phase, phase - across, phase + across),
            "periods_per_turn": by_key["periods_per_turn"],
        }
    return {key: interval for key, interval in by_key.items() if key not in IN_RECORD}


def one_dead_zone(
    found: tuple[Named, ...], state: State, spread: Mapping[str, Spread]
) -> tuple[Named, ...]:
    """Join a dead zone of half width w and a voltage offset |o| < w to one dead zone with the sides
    w - o and w + o, among the named effects `found`.

    Both give the same volts for every command, so one effect is preferred to two, also where the
    offset exceeds w by no more than its own tolerance. `spread`: as in `parameters`.
    """
    by_name, tolerance = {one.name: one for one in found}, BY_NAME["voltage_offset"].tolerance
    dead, offset = by_name.get("dead_zone"), by_name.get("voltage_offset")
    if dead is None or (offset and not set(offset.parameters) <= set(dead.parameters)):
        return found
    sides: Parameters = {}
    for axis, pairs in dead.parameters.items():
        w, parameter = (
            pairs["half_width_V"],
            state.nominal.parameters[f"voltage_offset.offset_V.{axis}"],
        )
        o = state.fit.setting.get(parameter.name, parameter.nominal)
        if abs(o - parameter.nominal) < 1.1 * parameter.tolerance:
            sides[axis] = pairs
            continue
        if abs(o) >= w.value + tolerance:
            return found
        one = interval(o, spread.get(parameter.name, FIXED))
        reach = hypot(w.high - w.value, one.high - o, 0.95 * tolerance)
        sides[axis] = {
            key: Interval(size, size - reach, size + reach)
            for key, size in (
                ("positive_V", max(w.value - o, 0.0)),
                ("negative_V", max(w.value + o, 0.0)),
            )
        }
    joined = replace(dead, parameters=sides)
    return tuple(joined if one is dead else one for one in found if one is not offset)


def effects_of(state: State, name: str) -> dict[str, dict[str, dict[str, float]]]:
    """A named effect of the state as a rig file has it: {name: {axis: {key: value}}}; sizes that
    cannot be negative are clipped to 0."""
    axes = tuple(axis for effect, axis in state.named if effect == name)
    found = parameters(state, name, axes, {})
    effect = state.nominal.catalogue[name]
    return {
        name: {
            axis: {key: _allowed(effect, key, value.value) for key, value in pairs.items()}
            for axis, pairs in found.items()
        }
    }


def named(decision: Decision, accepted: Accepted, spread: Mapping[str, Spread]) -> Named:
    """An accepted effect as the findings have it, on the axes where it is told. `spread`: as in
    `parameters`."""
    state = decision.state
    large = replace(accepted, axes=accepted.told_axes(state))
    axes = axes_with_size(state, large, spread) or large.axes
    found = parameters(state, accepted.name, axes, spread)
    twins = twins_of(accepted.name, state.nominal.rig)
    return Named(accepted.name, accepted.probability, twins, found)


def ranking(decision: Decision) -> tuple[RankedEffect, ...]:
    """The accepted and the refused names, their rivals and the effects of the last ranking, each
    once, best score first."""
    found: dict[str, RankedEffect] = {}
    accepted = {one.name: one for one in decision.accepted}
    for first in decision.naming.accepted:
        one, twins = accepted.get(first.name), twins_of(first.name, decision.state.nominal.rig)
        if one is None:
            found[first.name] = RankedEffect(first.name, first.score, 0.0, twins, refused=True)
            continue
        found[one.name] = RankedEffect(one.name, one.score, one.probability, twins)
        for rival in one.rivals:
            share = (1.0 - one.probability) / max(len(one.rivals), 1)
            found.setdefault(rival.name, RankedEffect(rival.name, one.score - rival.margin, share))
    for fit in decision.naming.last:
        found.setdefault(fit.name, RankedEffect(fit.name, fit.score, 0.0))
    return tuple(sorted(found.values(), key=lambda c: -c.score))


def calibrated(state: State, spread: Mapping[str, Spread]) -> dict[str, Interval]:
    """The fitted K [rad/s/V] and tau [s] of each axis that has a servo channel, with 95 %
    intervals, by the labels "gain_x_rad_s_V", "time_constant_x_s" and likewise for y; of a servo
    that takes an angle "motor_lag_x_s" [s], where it is not what the rig file says for certain.
    `spread`: as in `parameters`."""
    found = {}
    for key in CALIBRATED:
        for axis in "xy":
            name = f".{key}.{axis}"
            if f"servo_{axis}" in state.evidence.outputs and name in state.fit.setting:
                label = key.replace("gain_", f"gain_{axis}_").replace(
                    "constant_", f"constant_{axis}_"
                )
                found[label] = interval(state.fit.setting[name], spread.get(name, UNKNOWN))
    for axis in "xy":
        motor = state.nominal.parameters.get(f".{MOTOR_KEY}.{axis}")
        if motor is not None and motor.name in state.fit.setting:
            value = interval(state.fit.setting[motor.name], spread.get(motor.name, UNKNOWN))
            if not value.low <= motor.nominal <= value.high:
                found[f"motor_lag_{axis}_s"] = value
    return found


def _answering(state: State, servo: Mapping[str, Interval]) -> dict[str, dict[str, float]]:
    """By axis the lags and the dead time of a servo that takes an angle and whose motor's lag is
    among the calibrated numbers `servo`, with what its file has by axis."""
    record, own = model_of(state).record, state.nominal.rig.servo
    found = {"x": dict(own.x), "y": dict(own.y)}
    for a, axis in enumerate("xy"):
        if f"motor_lag_{axis}_s" in servo:
            answer = (MOTOR_KEY, "lag_s", "dead_time_s")
            found[axis] |= {key: float(record[key][a]) for key in answer}
    return found


def untestable(state: State, screened: list[Screened] | None) -> tuple[Untestable, ...]:
    """The effects that these logs would not have shown within their range, because a channel or the
    motion is missing. `screened` None: nothing was screened, so only the channels are known."""
    smallest: dict[str, float] = {}
    for one in screened or ():
        smallest[one.name] = min(one.smallest, smallest.get(one.name, inf))
    found = []
    known = {name for name, _ in state.named}
    for effect in state.nominal.effects:
        first = effect.parameters[0]
        if effect.name in known:
            continue
        size = smallest.get(effect.name)
        key = PERIODIC.get(effect.name, first.key)
        there = set(state.evidence.outputs) & set(outputs_of(effect, effect.axes))
        if size is None and there and screened is not None:  # it was tried
            continue
        if size is None:
            given = "commands" if state.nominal.rig.servo.takes_angle else "volts"
            servo = f"{given} and angles of a servo that moves"
            channel = "the ball" if in_ball(effect) else servo
            found.append(Untestable(effect.name, f"the log lacks {channel}", {}))
        elif effect.name == "saturation":
            servos = [p[-1] for p in state.evidence.outputs if p != BALL]
            volts = max(largest_volts(state.evidence, axis) for axis in servos)
            if volts < 0.99 * state.nominal.rig.servo.voltage_limit_V:
                why = f"the log hardly ever used more than {volts:.2f} V"
                found.append(Untestable(effect.name, why, {key: volts}))
        elif size > max(abs(first.low), abs(first.high)):
            why = "too little motion of the kind that shows it"
            found.append(Untestable(effect.name, why, {key: size} if size < inf else {}))
    return tuple(found)


def extended(decision: Decision, found: tuple[Named, ...], servo: Mapping[str, Interval]) -> Rig:
    """The nominal rig with the named effects `found`, K and tau as fitted (`servo`, mean of both
    axes), or how a servo answers an angle, the unnamed term, the ball's height, and without the
    friction of the load where the logs refute it."""
    nominal: NominalModel = decision.state.nominal
    rig = nominal.rig
    effects = {n: {a: dict(p) for a, p in by.items()} for n, by in rig.effects.items()}
    for one in found:
        known = nominal.catalogue[one.name]
        for axis, pairs in one.parameters.items():
            into = effects.setdefault(one.name, {}).setdefault(axis, {})
            if one.name == "dead_zone":
                into.clear()
            into |= {key: _allowed(known, key, value.value) for key, value in pairs.items()}
    mean = {
        key: [v.value for label, v in servo.items() if label.startswith(key.split("_")[0])]
        for key in CALIBRATED
    }
    fitted = {key: sum(v) / len(v) for key, v in mean.items() if v}
    drive = rig.drive
    if not (nominal.load_friction or rig.servo.takes_angle):  # the assumed friction is refuted
        drive = replace(
            drive, arm_friction_nm=_light_friction(decision.state), joint_friction_nm=0.0
        )
    camera = replace(rig.camera, ball_height_m=ball_height_m(decision.state))
    servos = replace(rig.servo, **fitted, **_answering(decision.state, servo))
    return replace(rig, effects=effects, servo=servos, drive=drive, camera=camera)


def ball_height_m(state: State) -> float:
    """Fitted height of the ball's centre above the plane for which its positions were computed
    [m]."""
    nominal = state.nominal.rig.camera.ball_height_m
    return state.fit.setting.get(f"camera_scale.{HEIGHT_KEY}.xy", nominal)


def _light_friction(state: State) -> float:
    """Friction on arm and plate while they coast in the gears' gap [N m], mean of the axes; 0 if
    none was fitted."""
    found = [
        value
        for name, value in state.fit.setting.items()
        if f".{COAST_KEY}." in name and value > 0.0
    ]
    load = GEARS_INERTIA_HIGH_KG_M2 + state.nominal.rig.drive.plate_inertia_kg_m2
    return load * len(found) / sum(found) if found else 0.0


def _allowed(effect: Effect, key: str, value: float) -> float:
    """A value that a rig file takes: sizes that cannot be negative are clipped to 0."""
    parameter = next(p for p in effect.parameters if p.key == key)
    return float(max(value, 0.0) if parameter.low >= 0 else value)


def enough_motion(state: State) -> str | None:
    """What the logs lack to name anything, in words for the user; None if they lack nothing."""
    theta = [r.theta_rad for r in state.evidence.runs]
    step = state.nominal.rig.servo.encoder_step_rad
    moved = any(float(t[:, a].max() - t[:, a].min()) > 8 * step for t in theta for a in range(2))
    if not state.evidence.outputs:
        return "no channel has signals enough"
    servo = [output for output in SERVO if output in state.evidence.outputs]
    if not moved and (servo or BALL in state.evidence.outputs):
        return "the servos hardly move"
    return None
