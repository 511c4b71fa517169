"""What a calibration found, as a table for a person: a line an axis, in units that people read."""

from math import degrees, inf
from typing import Literal

from calibration.bundle import Draft
from calibration.gap.findings import Interval
from calibration.gap.report.units import interval_words, sig
from calibration.records import Value

HEAD = ("quantity", "found")
AXES: tuple[Literal["x", "y"], ...] = ("x", "y")
_DEG, _MS = (degrees(1), "deg"), (1e3, "ms")
_WHERE = {"whole": "gear and joint"}
_SERVO = {
    "breakaway_positive_V": ("breaks away at, up", 1.0, "V"),
    "breakaway_negative_V": ("breaks away at, down", 1.0, "V"),
    "friction_V": ("friction", 1.0, "V"),
    "offset_V": ("offset", 1.0, "V"),
    "gain_rad_s_V": ("gain", 1.0, "rad/(s V)"),
    "time_constant_s": ("time constant", *_MS),
}
_POSITION_SERVO = {
    "lag_s": ("lag", *_MS),
    "dead_time_s": ("dead time", *_MS),
    "together_s": ("lag and dead time", *_MS),
    "rate_limit_rad_s": ("rate limit", degrees(1), "deg/s"),
    "acceleration_limit_rad_s2": ("acceleration limit", degrees(1), "deg/s²"),
    "dead_band_rad": ("dead band", *_DEG),
    "scale": ("scale, beyond 1", 100.0, "%"),
    "zero_rad": ("zero", *_DEG),
}


def value_words(one: Value | None, factor: float) -> str:
    """A value and its 95 % interval, as `1.72 [1.69, 1.76]`, written as in the tab Gap; "-" for
    None, the value alone where there is no interval. factor: to the unit shown.
    """
    if one is None:
        return "-"
    if not 0 < one.high - one.low < inf:
        return sig(factor * one.value)
    return interval_words(Interval(one.value, one.low, one.high), "", factor)


def found_table(draft: Draft) -> list[list[str]]:
    """Rows under HEAD of all that a calibration holds: two columns fit beside the 3-D view."""
    rows: list[list[str]] = []

    def add(name: str, unit: str, *found: str) -> None:
        """found: of both axes, or of what has none."""
        names = [name] if len(found) == 1 else [f"{name}, {axis}" for axis in AXES]
        rows.extend(
            [one, words if words == "-" else f"{words} {unit}"]
            for one, words in zip(names, found, strict=True)
        )

    if draft.lens is not None:
        add("lens: error in the picture", "px", f"{draft.lens.rms_px:.3f}")
        add("lens: error on the plate", "mm", f"{draft.lens.plate_std_mm:.3f}")
    if draft.plate is not None:
        add("plate: markers off their places", "mm", f"{draft.plate.residual_mm:.3f}")
    if draft.timing is not None:
        add("camera delay", _MS[1], value_words(draft.timing.delay_s, _MS[0]))
        if draft.timing.readout_s is not None:
            add("camera readout", _MS[1], value_words(draft.timing.readout_s, _MS[0]))
    if draft.level is not None:
        slope, gain = draft.level.slope_rad, draft.level.gain_m_s2
        add("plate's slope at zero", _DEG[1], *(value_words(slope.get(a), _DEG[0]) for a in AXES))
        unit = "m/s² per rad"
        add("ball's acceleration", unit, *(value_words(gain.get(a), 1.0) for a in AXES))
    for servo, names in ((draft.servo, _SERVO), (draft.position_servo, _POSITION_SERVO)):
        for key, (name, factor, unit) in names.items() if servo is not None else ():
            pair = [getattr(getattr(servo, axis), key) for axis in AXES]
            if any(pair):
                add(f"servo: {name}", unit, *(value_words(v, factor) for v in pair))
    for where, by_axis in draft.play.plays.items() if draft.play else ():
        widths = [by_axis[a].width_rad if a in by_axis else None for a in AXES]
        name = f"play: {_WHERE.get(where, where)}"
        add(name, _DEG[1], *(value_words(v, _DEG[0]) for v in widths))
    return rows
