"""The answer in plain words: the sentence that sums it up, and what a reader should know beside."""

from collections.abc import Mapping
from math import degrees, hypot

from calibration.gap.answer import higher
from calibration.gap.chance import ONE_IN
from calibration.gap.decide import Decision
from calibration.gap.findings import Interval, Named
from calibration.gap.knobs import CALIBRATED, PERIODIC
from calibration.gap.name import THRESHOLD
from calibration.gap.state import State
from calibration.gap.unknown_words import describe
from rig.effects import BY_NAME

EDGE = 0.01  # of a knob's step
VAGUE = 0.5  # width of an interval over its value
ANGLES = ("play_rad", "offset_rad", "amplitude_rad", "slope_rad", "angle_rad")


def notes(decision: Decision, servo: Mapping[str, Interval]) -> tuple[str, ...]:
    """What the names do not say: the servo, the ball's height, what chance alone would bring."""
    state = decision.state
    return (
        _servo_notes(state, servo) + _height_note(state) + _edge_notes(state)
        + _chance_note(decision)
    )  # fmt: skip


def vague(value: Interval) -> bool:
    """Is the interval of K or tau so wide that the log says little of it?"""
    return value.high - value.low > VAGUE * abs(value.value)


def far_off(value: Interval, nominal: float, limit: float) -> bool:
    """Is K or tau surely further from the rig file's than the share `limit` of it?"""
    sure = not value.low <= nominal <= value.high and not vague(value)
    return sure and abs(value.value / nominal - 1) > limit


def _servo_notes(state: State, servo: Mapping[str, Interval]) -> tuple[str, ...]:
    """K or tau outside what a rig file may differ: say "recalibrate the servo"; or not known."""
    rig, found = state.believed.rig.servo, []
    for label, value in servo.items():
        key = "gain_rad_s_V" if label.startswith("gain") else "time_constant_s"
        nominal = getattr(rig, key)
        limit = CALIBRATED[key]
        if vague(value):
            found.append(f"these logs do not tell {label}: {value.value:.3g} [{value.low:.3g}, "
                         f"{value.high:.3g}], the rig file says {nominal:.4g}")  # fmt: skip
        elif far_off(value, nominal, limit):
            found.append(f"recalibrate the servo: {label} is {value.value:.4g}, the rig file says "
                         f"{nominal:.4g} (tolerance {100 * limit:.0f} %)")  # fmt: skip
    return tuple(found)


def _edge_notes(state: State) -> tuple[str, ...]:
    """A size at the end of what may be: it stands in for something else."""
    setting, found = state.fit.setting, []
    for effect, axis in state.named:
        knob, *more = state.believed.of(effect, axis)
        value = setting.get(knob.name, knob.believed)
        if any(end and abs(value - end) < EDGE * knob.step for end in knob.range):
            key, told = knob.key, value
            if effect in PERIODIC:  # turned by its sine and cosine
                cosine = setting.get(more[0].name, more[0].believed)
                key, told = PERIODIC[effect], hypot(value, cosine)
            found.append(f"{effect}: {axis} {key} = {told:.3g} is the most it may be: it may "
                         "stand in for something else; check geometry and units in rig.toml"
            )  # fmt: skip
    return tuple(found)


def _height_note(state: State) -> tuple[str, ...]:
    """A scale that comes with a shift as the plate tilts: the ball is higher than believed."""
    more = higher(state) - state.believed.rig.camera.ball_height_m
    if not more or ("camera_scale", "xy") not in state.named:
        return ()
    way = "higher" if more > 0 else "lower"
    return (f"the scale comes with a shift as the plate tilts: the ball's centre lies "
            f"{1e3 * abs(more):.0f} mm {way} than its pictures were taken for",)  # fmt: skip


def _chance_note(decision: Decision) -> tuple[str, ...]:
    chance = decision.chance
    if chance is None:
        return ()
    scores = ", ".join(
        f"{score:.1f} on {part.replace('_', ' ')}" for part, score in chance.scores.items()
    )
    return (f"by chance alone the best name on a log like this scores {scores} in 1 of {ONE_IN} "
            f"({chance.draws} draws): a name needs more, and at least {THRESHOLD:g}",)  # fmt: skip


def sentence(decision: Decision, names: tuple[Named, ...]) -> str:
    """What is wrong, in plain words."""
    told = [_told(name) for name in names]
    left = decision.shape and describe(decision.shape)
    if decision.verdict == "nothing-missing":
        return "Nothing is missing: the model explains the log within the declared tolerances."
    if decision.verdict == "unknown-effect":
        channel = decision.shape.channel if decision.shape else "the log"
        return f"Something that has no name in the catalogue acts on {channel}: {left}."
    if decision.verdict == "undecided":
        rivals = dict.fromkeys(r.name for one in decision.accepted for r in one.rivals[:1])
        return f"{'; '.join(told)}, or {' or '.join(rivals)}: this log cannot tell them apart."
    text = "The model lacks " + " and ".join(told) + "."
    return text + (f" Something without a name is left: {left}." if left else "")


def _told(name: Named) -> str:
    words = BY_NAME[name.name].sentence.rstrip(".").lower()
    sizes = []
    for axis, pairs in name.parameters.items():
        for key, value in list(pairs.items())[:1]:
            size = f"{axis} {key} = {value.value:.4g} [{value.low:.4g}, {value.high:.4g}]"
            in_degrees = f", {degrees(value.value):.2f} degrees" if key in ANGLES else ""
            sizes.append(size + in_degrees)
    return f"{name.name} ({words}): {', '.join(sizes)}"
