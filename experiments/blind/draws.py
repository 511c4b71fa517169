"""From a sealed seed to trials: what is hidden, how large, in which table, seen by which protocol.

Every trial has its own generator [seed, number], so any of them can be drawn alone.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from experiments.blind import sizes, uncatalogued_effects
from experiments.blind.hidden_tables import calibrated_table, merged, well_kept
from experiments.blind.trial import BATTERY, BlindTrial, Effects, Noise, rig_data
from experiments.runs.assemble import load_rig
from experiments.runs.protocol import read_protocol
from rig.effects import effects_of
from rig.parameters import Rig

# Shares of the trials with something hidden.
MIXTURE = {"single": 0.5, "pair": 0.15, "shape": 0.1, "stranger": 0.12, "realistic": 0.09}
MIXTURE |= {"untestable": 0.04}
NOTHING: dict[str, tuple[float, Noise]] = {  # variant: share, noise
    "plain": (0.5, Noise()),
    "process doubled": (0.1, Noise(process=2.0)),
    "process halved": (0.05, Noise(process=0.5)),
    "noise doubled": (0.1, Noise(process=2.0, camera=2.0)),
    "noise halved": (0.05, Noise(process=0.5, camera=0.5)),
    "camera coloured": (0.1, Noise(colour=0.6)),
    "frames dropped": (0.1, Noise(dropped=0.15)),
}
RUNS = 2  # of a single protocol: the 60 s of the smallest amplitudes, where it lasts 30 s
REALISTIC_COUNTS = (1, 3, 5)  # effects on top of a realistic rig
# Pairs that one effect explains: antisymmetric coupling is a yaw, a dead zone with an offset has
# two sides.
COMPLEMENTARY = ({"camera_yaw", "cross_coupling"}, {"dead_zone", "voltage_offset"})
# The same where the servos take an angle that nobody measures.
COMPLEMENTARY += ({"angle_zero", "level_offset"}, {"angle_scale", "camera_scale"})
COMPLEMENTARY += tuple(
    {one, other} for one, other in combinations(("servo_dead_time", "servo_lag", "camera_delay"), 2)
)
FIVE = 5  # effects at once of the kind of that name
ALL_EFFECTS = tuple(effect.name for effect in effects_of("voltage"))


@dataclass(frozen=True)
class TrialPlan:
    """How many trials of which kinds are drawn, and from which seed.

    hidden, nothing: number of trials with and without something hidden; effects: catalogue names
    that may be hidden; kinds: see `trial.KINDS`; protocols: names, or "battery" for all of
    `BATTERY`; table: the rig that a trial's rig file describes where the table is well kept
    (default: the shipped rig); runs: of a single protocol; factors: over the smallest amplitude,
    lowest and highest, of catalogued effects; strangers: uncatalogued effects that may be hidden.
    """

    hidden: int
    nothing: int
    seed: int
    effects: tuple[str, ...] = ALL_EFFECTS
    kinds: tuple[str, ...] = tuple(MIXTURE)
    protocols: tuple[str, ...] = ("steps", "battery")
    table: Rig | None = None
    runs: int = RUNS
    factors: tuple[float, float] = sizes.FACTORS
    strangers: tuple[str, ...] = uncatalogued_effects.NAMES

    @property
    def kind(self) -> Rig:
        """The nominal rig, without effects. ValueError: the shipped rig file cannot be read."""
        return replace(self.table or load_rig(None), effects={})


def plan_trials(plan: TrialPlan) -> list[BlindTrial]:
    """The trials of a plan, `plan.hidden` + `plan.nothing` of them, in random order.

    The order depends on the seed alone, so it tells nothing of the kinds. ValueError: an unknown
    effect or protocol, no effect, protocol or kind at all, or pairs without two effects that
    differ.
    """
    _check(plan)
    kinds = [*_kinds(plan), *["nothing"] * plan.nothing]
    order = np.random.default_rng([plan.seed, 0]).permutation(len(kinds))
    return [draw_trial(plan, number + 1, kinds[i]) for number, i in enumerate(order)]


def _check(plan: TrialPlan) -> None:
    unknown = [name for name in plan.effects if name not in ALL_EFFECTS]
    if unknown:
        raise ValueError(f"unknown effect '{unknown[0]}'; known: {', '.join(ALL_EFFECTS)}")
    if not plan.effects or not plan.protocols or not plan.kinds:
        raise ValueError("a blind trial needs at least one effect, one protocol and one kind")
    for name in plan.protocols:
        if name != "battery":
            read_protocol(name)
    if "pair" in plan.kinds and not _pairs(plan.effects):
        raise ValueError("a pair needs two effects that can be told apart: name more")


def _kinds(plan: TrialPlan) -> list[str]:
    """`plan.hidden` kinds in the mixture's shares (equal ones for kinds that it does not hold)."""
    share = np.array([MIXTURE.get(kind, 0.1) for kind in plan.kinds])
    edges = np.concatenate([[0.0], np.cumsum(share / share.sum())])
    counts = np.diff(np.round(edges * plan.hidden).astype(int))
    return [kind for kind, n in zip(plan.kinds, counts, strict=True) for _ in range(n)]


def _pairs(names: Sequence[str]) -> list[tuple[str, str]]:
    return [
        (a, b) for i, a in enumerate(names) for b in names[i + 1 :] if not _complementary({a, b})
    ]


def _apart(pool: Sequence[str], count: int, rng: np.random.Generator) -> tuple[str, ...]:
    """So many names of the pool, of which no two are the same data as one effect."""
    while True:
        names = tuple(str(n) for n in rng.choice(pool, count, replace=False))
        if not _complementary(set(names)):
            return names


def _complementary(names: set[str]) -> bool:
    """True if two of the names are the same data as one effect."""
    return any(apart <= names for apart in COMPLEMENTARY)


def draw_trial(plan: TrialPlan, number: int, kind: str) -> BlindTrial:
    """Trial `number` (from 1) of a plan, of a kind of `trial.KINDS`, drawn with the generator
    [seed, number]. ValueError: an unknown protocol.
    """
    rng = np.random.default_rng([plan.seed, number])
    choice = plan.protocols[rng.integers(len(plan.protocols))]
    protocols = BATTERY if choice == "battery" else (choice,) * plan.runs
    seeds = tuple(int(n) for n in rng.integers(1, 2**31, len(protocols)))
    nominal = plan.kind
    trial = BlindTrial(f"trial-{number:05d}", kind, "", protocols, seeds, {}, {})
    if kind == "realistic":
        return _realistic(plan, trial, rng)
    plant = well_kept(nominal, rng)
    if kind == "nothing":
        variant = str(rng.choice(list(NOTHING), p=[share for share, _ in NOTHING.values()]))
        trial = replace(trial, variant=variant, noise=NOTHING[variant][1])
    elif kind == "stranger":
        name = plan.strangers[rng.integers(len(plan.strangers))]
        seconds = min(read_protocol(p).duration_s for p in protocols)
        times = sizes.factor(rng)
        stranger = uncatalogued_effects.draw(name, times, rng, seconds=seconds)
        trial = replace(trial, variant=name, stranger=stranger, factor=times)
    elif kind == "untestable":
        return _untestable(trial, plant, nominal, rng)
    else:
        names, within, other = _names(plan, kind, rng)
        trial = _hide(trial, names, rng, within, other)
    return _finish(trial, plant, nominal)


def _names(plan: TrialPlan, kind: str, rng: np.random.Generator):
    """What is hidden where effects are catalogued: names, factors, whether reshaped."""
    if kind == "pair":
        pairs = _pairs(plan.effects)
        return pairs[rng.integers(len(pairs))], plan.factors, False
    pool = plan.effects
    if kind == "five":
        return _apart(pool, FIVE, rng), plan.factors, False
    if kind == "shape":
        pool = tuple(name for name in pool if name in sizes.SHAPES) or tuple(sizes.SHAPES)
    within = sizes.WEAK_FACTORS if kind == "weak" else plan.factors
    return (pool[rng.integers(len(pool))],), within, kind == "shape"


def _hide(
    trial: BlindTrial,
    names: Sequence[str],
    rng: np.random.Generator,
    within: tuple[float, float] = sizes.FACTORS,
    other_shape: bool = False,
) -> BlindTrial:
    """The trial with these effects drawn into `hidden`."""
    hidden, factors = {}, []
    for name in names:
        hidden[name], times = sizes.draw_effect(name, rng, within=within, other_shape=other_shape)
        factors.append(times)
    return replace(trial, variant=" + ".join(names), hidden=hidden, factor=factors[0])


def _finish(trial: BlindTrial, plant: Rig, nominal: Rig) -> BlindTrial:
    """Put what is hidden into the plant; a saturation's limit follows from the volts in use."""
    from experiments.blind.logs import peak_volts

    hidden: Effects = dict(trial.hidden)
    trial = replace(trial, believed=rig_data(nominal))
    if "saturation" in hidden:
        rest: Effects = {n: v for n, v in hidden.items() if n != "saturation"}
        free = replace(plant, effects=merged(plant.effects, rest))
        peaks = peak_volts(replace(trial, plant=rig_data(free)))
        hidden["saturation"] = {
            axis: {"limit_V": sizes.saturation_limit(peaks[axis], values["limit_V"])}
            for axis, values in hidden["saturation"].items()
        }
    plant = replace(plant, effects=merged(plant.effects, hidden))
    return replace(trial, hidden=hidden, plant=rig_data(plant))


def _realistic(plan: TrialPlan, trial: BlindTrial, rng: np.random.Generator) -> BlindTrial:
    """1, 3 or 5 effects on top of a table as measured, which the rig file knows with an error."""
    plant, nominal = calibrated_table(replace(plan.kind, effects=load_rig(None).effects), rng)
    pool = [name for name in plan.effects if name not in nominal.effects]
    count = min(int(rng.choice(REALISTIC_COUNTS)), len(pool))
    names = _apart(pool, count, rng)
    trial = replace(_hide(trial, names, rng), variant=f"{count} on top")
    return _finish(trial, plant, nominal)


def _untestable(
    trial: BlindTrial, plant: Rig, nominal: Rig, rng: np.random.Generator
) -> BlindTrial:
    """What these logs cannot show: a limit above the volts used, the ball of a log without one."""
    if rng.random() < 0.5:
        peak = max(peak for peak in _highest(trial, plant, nominal).values())
        hidden: Effects = {"saturation": {"x": {"limit_V": min(1.3 * peak, 5.9)}}}
        return _finish_as_is(trial, hidden, plant, nominal)
    name = ("rolling_resistance", "camera_scale", "level_offset")[rng.integers(3)]
    hidden = {name: sizes.draw_effect(name, rng)[0]}
    trial = replace(trial, protocols=("servo-squares",), seeds=trial.seeds[:1])
    return _finish_as_is(trial, hidden, plant, nominal)


def _highest(trial: BlindTrial, plant: Rig, nominal: Rig) -> dict[str, float]:
    from experiments.blind.logs import peak_volts

    whole = replace(trial, plant=rig_data(plant), believed=rig_data(nominal))
    return peak_volts(whole, share=1.0)


def _finish_as_is(trial: BlindTrial, hidden: Effects, plant: Rig, nominal: Rig) -> BlindTrial:
    plant = replace(plant, effects=merged(plant.effects, hidden))
    return replace(
        trial,
        variant=next(iter(hidden)),
        hidden=hidden,
        plant=rig_data(plant),
        believed=rig_data(nominal),
    )
