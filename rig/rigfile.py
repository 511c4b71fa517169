"""`rig.toml` <-> `Rig`: every key has a default, an unknown one is an error naming the known."""

import dataclasses
import tomllib
from pathlib import Path
from typing import Any

import tomli_w
from pydantic import TypeAdapter, ValidationError

from rig import effects
from rig.parameters import CHANNELS, Rig

SECTIONS = (
    "servo",
    "linkage",
    "ball",
    "camera",
    "drive",
    "walls",
    "gains",
    "play",
    "unknown",
    "table",
)
_FILES = ("token_file", "calibration")  # of [table]: relative to the rig file's folder
# Values that must be above zero; everything else must be zero or more, but for free signs.
_POSITIVE = (
    "gain_rad_s_V time_constant_s encoder_counts_per_rev voltage_limit_V angle_limit_rad stop_rad "
    "arm_radius_m plate_side_m radius_m mass_kg rate_hz gear_stiffness_nm_rad "
    "joint_stiffness_nm_rad plate_inertia_kg_m2 ball_filter_rad_s torque_filter_s"
).split()
_ANY_SIGN = ("tachometer_scale", "ball_height_m")


def read_rig(path: Path) -> Rig:
    """The rig of a TOML file. ValueError (one line) on any mistake, OSError if unreadable."""
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: not a TOML file ({error})") from None
    try:
        return _beside(from_dict(data), path.absolute().parent)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def _beside(rig: Rig, folder: Path) -> Rig:
    """The rig with the files that [table] names found from the rig file's folder."""
    named = {key: name for key in _FILES if (name := getattr(rig.table, key))}
    if not named:
        return rig
    found = {key: str(folder / name) for key, name in named.items()}
    return dataclasses.replace(rig, table=dataclasses.replace(rig.table, **found))


def from_dict(data: dict[str, Any]) -> Rig:
    """The rig of a parsed TOML document or of `to_dict`. ValueError on any mistake."""
    known = (*SECTIONS, "control_rate_hz", "effects", "tolerances", "floors")
    for key in data:
        if key not in known:
            raise ValueError(f"unknown key '{key}'; known: {', '.join(known)}")
    rig = Rig()
    sections = {}
    for name in SECTIONS:
        default = getattr(rig, name)
        sections[name] = _section(name, default, data.get(name, {}))
    rate = data.get("control_rate_hz", rig.control_rate_hz)
    if not isinstance(rate, int | float) or not 10 <= rate <= 5000:
        raise ValueError(f"control_rate_hz = {rate}: must be a number from 10 to 5000")
    found = data.get("effects", {})
    _check_effects_shape(found)
    effects.check(found)
    return Rig(
        **sections,
        control_rate_hz=float(rate),
        effects=found,
        tolerances=_sizes("tolerances", data, tuple(effects.BY_NAME)),
        floors=_sizes("floors", data, CHANNELS),
    )


def _sizes(section: str, data: dict[str, Any], names: tuple[str, ...]) -> dict[str, float]:
    """section.NAME = number above zero, NAME one of `names`."""
    found = data.get(section, {})
    if not isinstance(found, dict):
        raise ValueError(f"[{section}] must hold lines such as {names[0]} = 0.0014")
    for name, value in found.items():
        if name not in names:
            raise ValueError(f"{section}: unknown name '{name}'; known: {', '.join(names)}")
        if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < 1e6:
            raise ValueError(f"{section}.{name} = {value}: must be a number above 0")
    return found


def _section(name: str, default: Any, given: Any) -> Any:
    if not isinstance(given, dict):
        raise ValueError(f"[{name}] must be a table of keys, got {given!r}")
    keys = [f.name for f in dataclasses.fields(default)]
    for key in given:
        if key not in keys:
            raise ValueError(f"unknown key '{name}.{key}'; known: {', '.join(keys)}")
    try:
        section = TypeAdapter(type(default)).validate_python(dataclasses.asdict(default) | given)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise ValueError(f"{name}.{where} = {first['input']!r}: {first['msg']}") from None
    for key in keys if name not in ("unknown", "table") else ():
        _check_value(f"{name}.{key}", key, getattr(section, key))
    return section


def _check_value(label: str, key: str, value: Any) -> None:
    if isinstance(value, bool) or key in ("colour", "shaft_model"):
        return
    if value != value or abs(value) == float("inf"):
        raise ValueError(f"{label} = {value}: must be finite")
    if key in _POSITIVE and value <= 0:
        raise ValueError(f"{label} = {value:g}: must be above 0")
    if value < 0 and key not in _ANY_SIGN:
        raise ValueError(f"{label} = {value:g}: must not be below 0")
    if key in ("dropout", "restitution") and value > 1:
        raise ValueError(f"{label} = {value:g}: must be from 0 to 1")


def _check_effects_shape(found: Any) -> None:
    """effects.NAME.AXIS.KEY = number, else one clear line."""
    if not isinstance(found, dict):
        raise ValueError("[effects] must hold tables such as [effects.joint_backlash]")
    for name, by_axis in found.items():
        if name not in effects.BY_NAME or _is_by_axis(by_axis):
            continue
        axis, key = effects.BY_NAME[name].axes[0], effects.BY_NAME[name].parameters[0].key
        raise ValueError(f"effect '{name}': write it as [effects.{name}] {axis}.{key} = number")


def _is_by_axis(by_axis: Any) -> bool:
    """{axis: {key: number}}?"""
    if not isinstance(by_axis, dict) or not all(isinstance(p, dict) for p in by_axis.values()):
        return False
    numbers = [value for pairs in by_axis.values() for value in pairs.values()]
    return all(isinstance(v, int | float) and not isinstance(v, bool) for v in numbers)


def to_dict(rig: Rig) -> dict[str, Any]:
    """The rig as plain data, as `from_dict` takes it."""
    return dataclasses.asdict(rig)


def write_rig(rig: Rig, path: Path) -> None:
    path.write_text(tomli_w.dumps(to_dict(rig)), encoding="utf-8")
