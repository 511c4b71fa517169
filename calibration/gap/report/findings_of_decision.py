"""From a decision to the answer's pieces: parameters with intervals, what the log cannot show,
the ranking, the calibrated servo, and the rig file that the simulator then runs."""

from collections.abc import Mapping
from dataclasses import replace
from math import atan2, cos, hypot, inf, sin

from calibration.gap.decide import Decision
from calibration.gap.findings import Candidate, Interval, Named, Untestable
from calibration.gap.intervals import interval
from calibration.gap.knobs import (
    BALL,
    CALIBRATED,
    COAST,
    HEIGHT,
    IN_RECORD,
    PERIODIC,
    SERVO,
    Believed,
)
from calibration.gap.menu import largest_volts
from calibration.gap.name import Accepted
from calibration.gap.screen import Screened
from calibration.gap.state import State, parts_of
from rig.effects import BY_NAME, CATALOGUE
from rig.parameters import GEARS_INERTIA_HIGH_KG_M2, Rig

TWINS: Mapping[str, tuple[str, ...]] = {
    "level_offset": ("encoder_zero", "asymmetric_play"),
    "camera_scale": ("linkage_gain", "ball_inertia"),
    "camera_delay": ("delay_encoder_to_plate",),
    "camera_yaw": ("antisymmetric_cross_coupling",),
}
Parameters = dict[str, dict[str, Interval]]


def parameters(state: State, name: str, axes: tuple[str, ...],
               spread: Mapping[str, tuple[float, int]]) -> Parameters:  # fmt: skip
    """axis -> catalogue key -> interval of a named effect."""
    found: Parameters = {}
    for axis in axes:
        by_key = {
            knob.key: interval(state.fit.setting[knob.name], spread.get(knob.name, (inf, 2)))
            for knob in state.believed.of(name, axis)
            if knob.name in state.fit.setting
        }
        found[axis] = _catalogue_keys(name, by_key)
    return found


def _catalogue_keys(name: str, by_key: dict[str, Interval]) -> dict[str, Interval]:
    """Sine and cosine back to amplitude and phase; a dead zone's sides to widths of their own."""
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


def one_dead_zone(found: tuple[Named, ...], state: State,
                  spread: Mapping[str, tuple[float, int]]) -> tuple[Named, ...]:  # fmt: skip
    """A dead zone of width w with an offset |o| < w is a dead zone with two sides: w - o, w + o.

    The two are the same volts for every command; the simpler words are preferred, also where the
    offset exceeds w by no more than its own tolerance, which no log takes off the two sides either.
    """
    by_name, tolerance = {one.name: one for one in found}, BY_NAME["voltage_offset"].tolerance
    dead, offset = by_name.get("dead_zone"), by_name.get("voltage_offset")
    if dead is None or (offset and not set(offset.parameters) <= set(dead.parameters)):
        return found
    sides: Parameters = {}
    for axis, pairs in dead.parameters.items():
        w, knob = pairs["half_width_V"], state.believed.knobs[f"voltage_offset.offset_V.{axis}"]
        o = state.fit.setting.get(knob.name, knob.believed)
        if abs(o - knob.believed) < 1.1 * knob.tolerance:
            sides[axis] = pairs
            continue
        if abs(o) >= w.value + tolerance:
            return found
        one = interval(o, spread.get(knob.name, (0.0, 2)))
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
    """A named effect as a rig file has it: {name: {axis: {key: value}}}."""
    axes = tuple(axis for effect, axis in state.named if effect == name)
    found = parameters(state, name, axes, {})
    return {
        name: {
            axis: {key: _allowed(name, key, value.value) for key, value in pairs.items()}
            for axis, pairs in found.items()
        }
    }


def named(decision: Decision, accepted: Accepted,
          spread: Mapping[str, tuple[float, int]]) -> Named:  # fmt: skip
    believed, setting = decision.state.believed, decision.state.fit.setting
    axes = tuple(a for a in accepted.axes if believed.beyond(accepted.name, a, setting))
    found = parameters(decision.state, accepted.name, axes or accepted.axes, spread)
    return Named(accepted.name, accepted.probability, TWINS.get(accepted.name, ()), found)


def ranking(decision: Decision) -> tuple[Candidate, ...]:
    """The accepted names and their rivals, each once, best first."""
    found: dict[str, Candidate] = {}
    for one in decision.naming.accepted:
        found[one.name] = Candidate(one.name, one.score, one.probability, TWINS.get(one.name, ()))
        for rival in one.rivals:
            share = (1.0 - one.probability) / max(len(one.rivals), 1)
            found.setdefault(rival.name, Candidate(rival.name, one.score - rival.margin, share))
    for trial in decision.naming.last:
        found.setdefault(trial.name, Candidate(trial.name, trial.score, 0.0))
    return tuple(sorted(found.values(), key=lambda c: -c.score))


def calibrated(state: State, spread: Mapping[str, tuple[float, int]]) -> dict[str, Interval]:
    """K and tau of each axis that has a servo channel."""
    found = {}
    for key in CALIBRATED:
        for axis in "xy":
            name = f".{key}.{axis}"
            if f"servo_{axis}" in state.evidence.parts and name in state.fit.setting:
                label = key.replace("gain_", f"gain_{axis}_").replace(
                    "constant_", f"constant_{axis}_"
                )
                found[label] = interval(state.fit.setting[name], spread.get(name, (inf, 2)))
    return found


def untestable(state: State, screened: list[Screened] | None) -> tuple[Untestable, ...]:
    """Effects that this log would not have shown inside their sensible range; None: none tried."""
    smallest: dict[str, float] = {}
    for one in screened or ():
        smallest[one.name] = min(one.smallest, smallest.get(one.name, inf))
    found = []
    known = {name for name, _ in state.named}
    for effect in CATALOGUE:
        first = effect.parameters[0]
        if effect.name in known:
            continue
        size = smallest.get(effect.name)
        key = PERIODIC.get(effect.name, first.key)
        there = set(state.evidence.parts) & set(parts_of(effect, effect.axes))
        if size is None and there and screened is not None:  # it was tried in the model
            continue
        if size is None:
            servo = "volts and angles of a servo that moves"
            channel = servo if effect.side == "servo" else "the ball"
            found.append(Untestable(effect.name, f"the log lacks {channel}", {}))
        elif effect.name == "saturation":
            servos = [p[-1] for p in state.evidence.parts if p != BALL]
            volts = max(largest_volts(state.evidence, axis) for axis in servos)
            if volts < 0.99 * state.believed.rig.servo.voltage_limit_V:
                why = f"the log hardly ever used more than {volts:.2f} V"
                found.append(Untestable(effect.name, why, {key: volts}))
        elif size > max(abs(first.low), abs(first.high)):
            why = "too little motion of the kind that shows it"
            found.append(Untestable(effect.name, why, {key: size} if size < inf else {}))
    return tuple(found)


def extended(decision: Decision, found: tuple[Named, ...],
             servo: Mapping[str, Interval]) -> Rig:  # fmt: skip
    """The believed rig with the named effects, the unnamed term, and K and tau as calibrated."""
    believed: Believed = decision.state.believed
    rig = believed.rig
    effects = {n: {a: dict(p) for a, p in by.items()} for n, by in rig.effects.items()}
    for one in found:
        for axis, pairs in one.parameters.items():
            into = effects.setdefault(one.name, {}).setdefault(axis, {})
            if one.name == "dead_zone":
                into.clear()
            into |= {key: _allowed(one.name, key, value.value) for key, value in pairs.items()}
    mean = {
        key: [v.value for label, v in servo.items() if label.startswith(key.split("_")[0])]
        for key in CALIBRATED
    }
    fitted = {key: sum(v) / len(v) for key, v in mean.items() if v}
    drive = rig.drive
    if not believed.load_friction:  # the logs do not show the assumed friction of arm and joints
        drive = replace(
            drive, arm_friction_nm=_light_friction(decision.state), joint_friction_nm=0.0
        )
    camera = replace(rig.camera, ball_height_m=higher(decision.state))
    return replace(rig, effects=effects, servo=replace(rig.servo, **fitted), drive=drive,
                   camera=camera)  # fmt: skip


def higher(state: State) -> float:
    """By how much the ball's centre lies higher than its pictures were taken for [m]; as believed
    where a scale that says so was not found."""
    knob = state.believed.knobs[f"camera_scale.{HEIGHT}.xy"]
    return state.fit.setting.get(knob.name, knob.believed)


def _light_friction(state: State) -> float:
    """What brakes arm and plate in the gap of the gears [N m], mean of the axes; 0: not seen."""
    found = [
        value for name, value in state.fit.setting.items() if f".{COAST}." in name and value > 0.0
    ]
    load = GEARS_INERTIA_HIGH_KG_M2 + state.believed.rig.drive.plate_inertia_kg_m2
    return load * len(found) / sum(found) if found else 0.0


def _allowed(name: str, key: str, value: float) -> float:
    """A value that a rig file takes: sizes that cannot be negative are not."""
    parameter = next(p for p in BY_NAME[name].parameters if p.key == key)
    return float(max(value, 0.0) if parameter.low >= 0 else value)


def enough_motion(state: State) -> str | None:
    """What the log lacks to name anything, or None."""
    theta = [r.theta_rad for r in state.evidence.runs]
    step = state.believed.rig.servo.encoder_step_rad
    moved = any(float(t[:, a].max() - t[:, a].min()) > 8 * step for t in theta for a in range(2))
    if not state.evidence.parts:
        return "no channel has signals enough"
    servo = [part for part in SERVO if part in state.evidence.parts]
    if not moved and (servo or BALL in state.evidence.parts):
        return "the servos hardly move"
    return None
