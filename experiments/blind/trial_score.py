"""The score of one answer against the truth of its trial."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite, nan, pi
from typing import Any

from experiments.blind.trial import BlindTrial
from rig.effects import BY_NAME

SURE = 0.95
# Names that stand for the same data as a catalogue name, whatever the motion.
TWINS: dict[str, frozenset[str]] = {
    "level_offset": frozenset({"encoder_zero", "asymmetric_play", "angle_zero"}),
    "camera_scale": frozenset({"linkage_gain", "ball_inertia", "angle_scale"}),
    "camera_delay": frozenset({"ball_delay", "plate_delay", "servo_dead_time"}),
    "angle_zero": frozenset({"level_offset"}),
    "angle_scale": frozenset({"camera_scale", "linkage_gain", "ball_inertia"}),
    "servo_dead_time": frozenset({"camera_delay", "ball_delay", "plate_delay"}),
}


@dataclass(frozen=True)
class TrialScore:
    """The score of one trial.

    verdict: the answer's ("named", "undecided", "unknown-effect", "nothing-missing", "failed");
    answered: every name in the answer; named: the answered names if the verdict is "named", else
    none; found: hidden effects among `named`; extra: wrong names among `named`; right: the whole
    answer is right for the trial's kind; axes_right: every named effect has exactly the hidden
    axes; unknown: an unknown effect was reported; truth_among: a hidden effect is among `answered`.

    stated: (probability, name is right) of every answered name; errors, shape_errors: relative
    errors |value - truth| / |truth| of amplitudes and of inner shapes; covered: for each parameter,
    whether its 95 % interval, where it has one, holds the truth; closed: share of the held-out gap
    that was closed (NaN: not stated); ahead: prediction error 1 s ahead over its noise floor (NaN:
    not stated); seconds: duration of the analysis [s]; follow_up: protocol of the proposed next
    experiment, or "".
    """

    trial: BlindTrial
    verdict: str
    answered: tuple[str, ...]
    named: tuple[str, ...]
    found: tuple[str, ...]
    extra: tuple[str, ...]
    right: bool
    axes_right: bool
    unknown: bool
    truth_among: bool
    stated: tuple[tuple[float, bool], ...]
    errors: tuple[float, ...]
    shape_errors: tuple[float, ...]
    covered: tuple[bool, ...]
    closed: float
    ahead: float
    seconds: float
    follow_up: str

    @property
    def confident_wrong(self) -> bool:
        """Whether the verdict "named" gives a wrong name with a probability above 0.95."""
        return self.verdict == "named" and any(p > SURE and not right for p, right in self.stated)


def score_trial(trial: BlindTrial, answer: Mapping[str, Any], seconds: float = nan) -> TrialScore:
    """The score of an answer against the truth of its trial.

    answer: the JSON of `rig gap --json`; seconds: duration of the analysis [s], NaN if not known.
    """
    verdict = answer.get("verdict", "failed")
    effects = answer.get("effects") or []
    pairs = [(effect, matching_hidden(trial, effect)) for effect in effects]
    named = [pair for pair in pairs if verdict == "named"]
    found = tuple(sorted({hidden for _, hidden in named if hidden}))
    extra = tuple(effect["name"] for effect, hidden in named if not hidden)
    unknown = answer.get("unknown") is not None or verdict == "unknown-effect"
    sizes = [_sizes(trial, effect, hidden) for effect, hidden in named if hidden]
    axes = [_axes(effect) == set(trial.hidden[h]) for effect, h in named if effect["name"] == h]
    return TrialScore(
        trial,
        verdict,
        tuple(effect["name"] for effect in effects),
        tuple(effect["name"] for effect, _ in named),
        found,
        extra,
        _right(trial, verdict, found, extra, unknown, answer),
        bool(named) and all(axes),
        unknown,
        any(hidden for _, hidden in pairs),
        tuple((float(e.get("probability") or nan), bool(hidden)) for e, hidden in pairs),
        tuple(v for one in sizes for v in one[0]),
        tuple(v for one in sizes for v in one[1]),
        tuple(v for one in sizes for v in one[2]),
        *_proof(answer.get("gap") or {}),
        seconds,
        (answer.get("next_experiment") or {}).get("protocol", ""),
    )


def matching_hidden(trial: BlindTrial, effect: Mapping[str, Any]) -> str:
    """The hidden effect that an answered effect stands for, or "" if it is none of them.

    effect: one entry of the answer's "effects". It matches by its own name, by a name in `TWINS`,
    or as an antisymmetric cross coupling (c_x = -c_y within 30 % of their difference), which is the
    same data as a turned camera (camera_yaw).
    """
    name = effect["name"]
    for hidden in trial.hidden:
        if name == hidden or name in TWINS.get(hidden, ()):
            return hidden
        if (name, hidden) == ("cross_coupling", "camera_yaw"):
            x, y = (_value(effect, axis, "fraction") for axis in ("x", "y"))
            if x * y < 0 and abs(x + y) < 0.3 * abs(x - y):
                return hidden
    return ""


def _value(effect: Mapping[str, Any], axis: str, key: str) -> float:
    interval = (effect.get("parameters") or {}).get(axis, {}).get(key)
    return nan if interval is None else float(interval["value"])


def _axes(effect: Mapping[str, Any]) -> set[str]:
    return {axis for axis, values in (effect.get("parameters") or {}).items() if values}


def _right(
    trial: BlindTrial,
    verdict: str,
    found: tuple[str, ...],
    extra: tuple[str, ...],
    unknown: bool,
    answer: Mapping[str, Any],
) -> bool:
    """True if all that was hidden is named and nothing else; an uncatalogued effect: unknown."""
    if trial.kind == "nothing" or (trial.kind == "camera" and not trial.hidden):
        return verdict == "nothing-missing"
    if trial.variant == "ball height" and verdict == "unknown-effect":
        return True
    if trial.kind == "stranger":
        return verdict == "unknown-effect"
    if trial.kind == "untestable":
        stated = {
            u["name"]
            for u in answer.get("untestable") or []
            if u.get("smallest") or "lacks" in u.get("why", "")  # without the channel no size shows
        }
        quiet = verdict in ("nothing-missing", "undecided")
        return quiet and set(trial.hidden) <= stated
    return verdict == "named" and not extra and set(found) == set(trial.hidden)


def comparable(
    name: str, values: Mapping[str, float], *, one_width: bool = False
) -> dict[str, float]:
    """The parameters `values` of the effect `name` under keys that do not depend on how they were
    written.

    A dead zone becomes its two sides, positive_V and negative_V [V], or with `one_width` the mean
    of both under half_width_V [V]; every other effect is returned as it is.
    """
    if name != "dead_zone":
        return dict(values)
    half = values.get("half_width_V", 0.0)
    sides = {side: half + values.get(side, 0.0) for side in ("positive_V", "negative_V")}
    return {"half_width_V": sum(sides.values()) / 2} if one_width else sides


def _one_width(hidden: str, true: Mapping[str, float], answered: Mapping[str, Any]) -> bool:
    """Is one width all that a log can show? Its two sides are a width and an offset."""
    apart = abs(true.get("positive_V", 0.0) - true.get("negative_V", 0.0)) / 2
    close = apart <= 1.1 * BY_NAME["voltage_offset"].tolerance
    return hidden == "dead_zone" and close and "half_width_V" in answered


def _sizes(trial: BlindTrial, effect: Mapping[str, Any], hidden: str):
    """Relative errors of the size, of the shape, and whether each interval holds the truth."""
    errors, shapes, covered = [], [], []
    if effect["name"] != hidden:
        return errors, shapes, covered
    first = BY_NAME[hidden].parameters[0].key
    for axis, true in trial.hidden[hidden].items():
        answered = (effect.get("parameters") or {}).get(axis) or {}
        one = _one_width(hidden, true, answered)
        parts = [
            comparable(hidden, {key: _bound(i[part]) for key, i in answered.items()}, one_width=one)
            for part in ("value", "low", "high")
        ]
        for key, truth in comparable(hidden, true, one_width=one).items():
            if not answered or key not in parts[0]:
                continue
            value, low, high = (part[key] for part in parts)
            if key == "phase_rad":
                truth += 2 * pi * round((value - truth) / (2 * pi))
            elif key == first or hidden == "dead_zone":
                errors.append(abs(value - truth) / abs(truth))
            else:
                shapes.append(abs(value - truth) / abs(truth))
            if isfinite(low) and isfinite(high):
                covered.append(low <= truth <= high)
    return errors, shapes, covered


def _bound(number: float | None) -> float:
    return nan if number is None else float(number)


def _proof(gap: Mapping[str, Any]) -> tuple[float, float]:
    """Share of the gap closed in the worst channel as it came, and the error 1 s ahead / floor."""
    before, after = gap.get("before") or {}, gap.get("after") or {}
    open_ = {c: b for c, b in before.items() if c in after and b is not None and b >= 1.05}
    closed = nan
    if open_ and gap.get("held_out"):
        worst = max(open_, key=lambda c: open_[c])
        closed = (open_[worst] - after[worst]) / (open_[worst] - 1.0)
    ahead = gap.get("ahead_1s_mm") or {}
    floor, last = ahead.get("floor"), ahead.get("after")
    ratio = last / floor if floor and last is not None and isfinite(floor) else nan
    return float(closed), float(ratio)
