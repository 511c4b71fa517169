"""Which table a trial runs on: a well-kept one, or one as measured and calibrated with an error."""

from dataclasses import replace

import numpy as np

from experiments.blind.trial import Effects
from experiments.runs.assemble import SPREAD_GAIN, SPREAD_TACHOMETER, SPREAD_TAU, another_unit
from rig.effects import BY_NAME, effects_of
from rig.parameters import Rig

# Of a realistic table, what its rig file knows (with an error inside the tolerances): the uneven
# breakaway and the level. Plays are left to be hidden.
KNOWN = ("coulomb_friction", "voltage_offset", "level_offset")


def merged(effects: Effects, more: Effects) -> Effects:
    """A copy of `effects` in which the values of `more` replace those of the same effect and axis.

    All of an axis's keys are replaced together, so a dead zone given by two sides replaces one
    given by a width.
    """
    result = {name: {a: dict(v) for a, v in by.items()} for name, by in effects.items()}
    for name, by_axis in more.items():
        for axis, values in by_axis.items():
            result.setdefault(name, {})[axis] = dict(values)
    return result


def boxed(rng: np.random.Generator, share: float = 1.0, *, kind: str = "voltage") -> Effects:
    """Every effect of servos of this kind that has a tolerance, on all axes, uniformly within
    `share`.

    The first parameter lies in [-share tolerance, share tolerance], or [0, share tolerance] where
    the catalogue allows no negative value.
    """
    effects: Effects = {}
    for effect in effects_of(kind):
        if effect.tolerance == 0:
            continue
        first = effect.parameters[0]
        most = share * effect.tolerance
        low = 0.0 if first.low >= 0 else -most
        effects[effect.name] = {
            axis: {first.key: float(rng.uniform(low, most))} for axis in effect.axes
        }
    return effects


def well_kept(nominal: Rig, rng: np.random.Generator) -> Rig:
    """A table that differs from its rig file `nominal` by small imperfections alone.

    The gain K, the time constant tau and the tachometer's scale are drawn uniformly within their
    spread (a few percent), every effect with a tolerance uniformly within it.
    """
    one = rng.uniform
    servo = replace(
        nominal.servo,
        gain_rad_s_V=nominal.servo.gain_rad_s_V * (1 + SPREAD_GAIN * one(-1, 1)),
        time_constant_s=nominal.servo.time_constant_s * (1 + SPREAD_TAU * one(-1, 1)),
        tachometer_scale=SPREAD_TACHOMETER * one(-1, 1),
    )
    return replace(
        nominal, servo=servo, effects=merged(nominal.effects, boxed(rng, kind=servo.kind))
    )


def calibrated_table(kind: Rig, rng: np.random.Generator) -> tuple[Rig, Rig]:
    """A unit with imperfections as measured on real tables, and the rig as its calibration finds
    it.

    Returns (plant, nominal): the plant has its own K, tau, uneven breakaway, voltage offset and
    level (the effects in `KNOWN`, taken from `kind`), and every other effect within its tolerance;
    the nominal rig knows the effects in `KNOWN` with errors within their tolerances, K within 1.5 %
    and tau within 3 %. KeyError: `kind` lacks coulomb_friction or voltage_offset.
    """
    base = replace(kind, effects={n: v for n, v in kind.effects.items() if n in KNOWN})
    unit = another_unit(base, int(rng.integers(2**31)))
    errors = boxed(rng)
    found: Effects = {}
    for name in KNOWN:
        key = BY_NAME[name].parameters[0].key
        for axis, values in unit.effects[name].items():
            value = values[key] - errors[name][axis][key]
            least = 0.0 if BY_NAME[name].parameters[0].low >= 0 else -np.inf
            found.setdefault(name, {})[axis] = {key: float(max(value, least))}
    rest = {name: by_axis for name, by_axis in errors.items() if name not in KNOWN}
    # A calibration finds K and tau of the unit itself to a percent or two.
    servo = replace(
        kind.servo,
        gain_rad_s_V=unit.servo.gain_rad_s_V * (1 + 0.015 * rng.uniform(-1, 1)),
        time_constant_s=unit.servo.time_constant_s * (1 + 0.03 * rng.uniform(-1, 1)),
    )
    plant = replace(unit, effects=merged(unit.effects, rest), drive=kind.drive)
    return plant, replace(kind, servo=servo, effects=found)
