"""Units that a recording may be in, how they are spelled, and their SI factors."""

import re
from math import inf, pi

FACTORS: dict[str, dict[str, float | None]] = {  # None: the map's `scale` says it
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "day": 86400.0},
    "length": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": 0.0254, "px": None},
    "angle": {"rad": 1.0, "mrad": 1e-3, "deg": pi / 180, "turn": 2 * pi, "us": None},
    "speed": {"rad/s": 1.0, "deg/s": pi / 180, "rpm": 2 * pi / 60, "turn/s": 2 * pi},
    "voltage": {"V": 1.0, "mV": 1e-3},
    "current": {"A": 1.0, "mA": 1e-3},
}
SCALED = {"counts", "1"}  # of any quantity: the map's `scale` says how much SI one of them is
QUANTITIES = {  # what a column of the log can be made from, the most usual first
    "t_s": ("time",),
    "ball_exposed_s": ("time",),
    "ball": ("length",),
    "target": ("length",),
    "theta": ("angle", "speed"),
    "command": ("angle", "speed"),
    "voltage": ("voltage", "current"),
    "motor_speed": ("speed",),
}
_SPELLED = {
    "s": "s sec secs second seconds sek sekunde sekunden seconde secondes segundos secondi "
    "saniye с сек 秒",
    "ms": "ms msec millis millisecond milliseconds millisec мс 毫秒 ミリ秒",
    "us": "us usec micros microsecond microseconds µs μs мкс 微秒",
    "ns": "ns nsec nsecs nanosec nanosecs nanosecond nanoseconds nanos",
    "min": "min minutes",
    "day": "day days tage jours",
    "m": "m meter meters metre metres metros metri м",
    "cm": "cm centimeter centimeters centimetre centimetres centímetros centimetros centimetri "
    "centimètres см 厘米",
    "mm": "mm millimeter millimeters millimetre millimetres milímetros milimetros millimetri "
    "millimètres мм 毫米",
    "um": "um µm μm micrometer",
    "in": "in inch inches zoll pouces pulgadas pollici",
    "px": "px pix pxl pixel pixels",
    "rad": "rad rads radian radians рад",
    "mrad": "mrad milliradians",
    "deg": "deg degs degree degrees ° grad grad. gradi grados degré degrés degrès graus graden "
    "stopnie stopni derece град град. градусы 度",
    "turn": "turn turns rev revs revolution",
    "rad/s": "rad/s rads/s rad/sec radps rad_s rad_per_s",
    "deg/s": "deg/s °/s degps dps deg/sec deg_s deg_per_s",
    "rpm": "rpm 1/min u/min",
    "turn/s": "turn/s rev/s rps",
    "V": "v volt volts в",
    "mV": "mv millivolt millivolts мв",
    "A": "a amp amps ampere amperes",
    "mA": "ma milliamp milliamps",
    "counts": "counts count cnt ticks tick steps lsb raw adc",
    "1": "norm normalized normalised normiert",
    "1/100": "% percent pct",
}
_NAMED = {spelling: unit for unit, spellings in _SPELLED.items() for spelling in spellings.split()}
_PART = re.compile(r"(1|turn)/([1-9]\d{0,8})")
# Decimals, parts and powers of ten: another whole number is an index (`servo_2deg`).
_FRONT = re.compile(r"(1/[1-9]\d*|10\^-?\d+|10+|\d*[.,]\d+|\d+e-?\d+)[*x·×]?([^\d*x·×].*)")
_TIMES = re.compile(r"[x*×](10+)([^\d*x·×].*)")  # x100 mm: a hundred times the millimetres
_BEHIND = re.compile(r"(.+?)[*x·×/]?(10+)")


def canonical(text: str) -> str | None:
    """The unit that somebody's spelling means; None where it means none.

    A number may stand before it, as in `0.1 mm`; `mm*10`, `mm/10` and `x10 mm` are all 0.1 mm.
    """
    text = text.strip()
    if text in ("M", "S"):  # mega and siemens; nobody's metre
        return None
    text = text.lower().replace(" ", "")
    known = _NAMED.get(text) or (text if _PART.fullmatch(text) else None)
    return known or _multiple(text)


def _multiple(text: str) -> str | None:
    """The unit with a number before it (`0.1 mm`) that `text` means; None where it means none."""
    if front := _FRONT.fullmatch(text):
        size, unit = front[1].replace(",", "."), _NAMED.get(front[2])
        if size.startswith("10^"):
            size = f"1e{size[3:]}"
        times = 1 / float(size[2:]) if size.startswith("1/") else float(size)
    elif times_ten := _TIMES.fullmatch(text):
        times, unit = 1 / float(times_ten[1]), _NAMED.get(times_ten[2])
    elif behind := _BEHIND.fullmatch(text):
        times, unit = 1 / float(behind[2]), _NAMED.get(behind[1])
    else:
        return None
    sized = any(units.get(unit or "") for units in FACTORS.values())
    if not sized or not 0 < times < inf:
        return None
    return unit if unit is None or times == 1 else f"{times:g} {unit}"


def is_time(unit: str | None) -> bool:
    """Whether a canonical unit is one of time."""
    return (unit or "").rsplit(" ", maxsplit=1)[-1] in FACTORS["time"]


def quantity(unit: str) -> str | None:
    """What a canonical unit measures; None where that is open (counts, shares)."""
    unit = unit.split(" ")[-1]
    if unit.startswith("turn/") and unit != "turn/s":
        return "angle"
    return next((name for name, units in FACTORS.items() if unit in units and unit != "us"), None)


def family(column: str) -> str:
    """What a column of the log is, without axis and unit: ball_x_m -> ball."""
    return re.sub(r"_[xy]_(?:m|rad|V|rad_s)$", "", column)


def factor(unit: str, column: str) -> float | None:
    """SI units in one `unit` for a column of the log; None where the map's `scale` must say it.

    `1/N`: one of N parts, of a supply for instance; `turn/N`: one of N counts of a turn.
    ValueError: the unit does not go with the column; names those that do.
    """
    if unit in SCALED:
        return None
    kinds = QUANTITIES.get(family(column), ())
    if " " in unit:
        times, unit = unit.split(" ")
        own = factor(unit, column)
        return None if own is None else float(times) * own
    if part := _PART.fullmatch(unit):
        if part[1] == "1":
            return None
        if "angle" in kinds:
            return 2 * pi / int(part[2])
    for kind in kinds:
        if unit in FACTORS[kind]:
            return FACTORS[kind][unit]
    known = [unit for kind in kinds for unit in FACTORS[kind]]
    more = [*(["turn/4096"] if "angle" in kinds else []), "counts", "1/255"]
    raise ValueError(f"unit {unit!r} of {column}: known are {', '.join([*known, *more])}")


def part_of(unit: str) -> float:
    """What one of `unit` is a share of `scale` of: 1/255 for `1/255`, else 1."""
    part = _PART.fullmatch(unit)
    return 1 / int(part[2]) if part and part[1] == "1" else 1.0
