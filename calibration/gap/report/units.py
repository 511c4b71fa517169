"""Numbers of the gap workflow for people: degrees, millimetres and milliseconds."""

import re
from collections.abc import Mapping
from math import degrees, floor, isfinite, log10

from calibration.gap.findings import Interval
from rig.effects import BY_NAME, Effect

# SI unit -> unit shown, factor
_SHOWN = {
    "rad": ("deg", degrees(1)),
    "rad/s": ("deg/s", degrees(1)),
    "m": ("mm", 1000.0),
    "m/s": ("mm/s", 1000.0),
    "m/s2": ("mm/s²", 1000.0),
    "s": ("ms", 1000.0),
    "1/s2": ("1/s²", 1.0),
    "1/m2": ("1/m²", 1.0),
    "1/rad2": ("1/rad²", 1.0),
}


def sig(value: float | None, digits: int = 3) -> str:
    """`value` with `digits` significant figures, zeros at their end, too; "-" for None, NaN or
    infinity.

    Numbers below 1e-4 have two figures and an exponent.
    """
    if value is None or not isfinite(value):
        return "-"
    if value == 0:
        return "0"
    if abs(value) < 1e-4:
        return f"{value:.1e}"
    text = f"{value:#.{digits}g}".removesuffix(".")
    return f"{float(text):.0f}" if "e" in text else text


def shown_unit(unit: str, key: str = "") -> tuple[str, float]:
    """The unit shown for an SI unit, and the factor from SI to it.

    key: of a parameter; one called `fraction` is shown in %.
    """
    if key.rpartition(".")[2] == "fraction":
        return "%", 100.0
    return _SHOWN.get(unit, ("" if unit == "1" else unit, 1.0))


def parameter_unit(
    effect: str, key: str, known: Mapping[str, Effect] = BY_NAME
) -> tuple[str, float]:
    """The unit shown for a parameter of one of the `known` effects, and the factor from SI to it.

    Another effect or key has the unit "" and the factor 1.
    """
    key = key.rpartition(".")[2]
    parameters = known[effect].parameters if effect in known else ()
    return shown_unit(next((p.unit for p in parameters if p.key == key), ""), key)


def effect_words(name: str) -> str:
    """An effect's name for people: `joint_backlash` -> `joint play`."""
    return name.replace("backlash", "play").replace("_", " ")


def key_words(key: str) -> str:
    """A parameter's key for people, without its unit: `play_rad` -> `play`."""
    words = re.sub(r"_(rad_s|1_rad2|1_rad|m_s2|1_m2|1_s2|1_s|1_V|rad|V|s|m)$", "", key)
    return words.replace("_", " ")


def interval_words(interval: Interval, unit: str, factor: float) -> str:
    """An interval in words: `2.01 [1.93, 2.09] deg`.

    unit, factor: as of `shown_unit`. All three numbers have as many decimals as the interval's
    width deserves.
    """
    numbers = [factor * v for v in (interval.value, interval.low, interval.high)]
    half = abs(numbers[2] - numbers[1]) / 2
    if not all(map(isfinite, numbers)) or half == 0:
        value, low, high = map(sig, numbers)
    else:
        decimals = -floor(log10(half))
        if half * 10.0**decimals < 2:  # 0.1 would say too little of 0.14
            decimals += 1
        decimals = min(max(0, decimals), 8)
        value, low, high = (f"{number:.{decimals}f}" for number in numbers)
    return f"{value} [{low}, {high}] {unit}".strip()
