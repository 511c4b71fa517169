"""`rig.toml` <-> `Rig`: every key has a default, an unknown one is an error naming the known."""

import dataclasses
from pathlib import Path, PurePath
from typing import Any

import tomli_w
from pydantic import TypeAdapter, ValidationError

from rig import effects
from rig.parameters import CHANNELS, Rig
from rig.validation import first_error_line, read_toml
from vision.sources.addresses import without_password

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


def read_rig(path: Path) -> Rig:
    """Return the rig of a TOML file; files that its [table] names are found from the file's folder.

    ValueError (one line that names the file): no TOML, an unknown key or a wrong value. OSError:
    the file cannot be read.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise ValueError(f"{path}: not a TOML file ({error})") from None
    try:
        return _beside(from_dict(read_toml(text)), path.absolute().parent)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def _beside(rig: Rig, folder: Path) -> Rig:
    """The rig with the files that [table] names found from the rig file's folder."""
    named = {key: name for key in _FILES if (name := getattr(rig.table, key))}
    if ".py:" in (rig.table.camera or ""):  # a camera's class in a file of one's own
        named["camera"] = rig.table.camera
    if not named:
        return rig
    found = {key: str(folder / name) for key, name in named.items()}
    return dataclasses.replace(rig, table=dataclasses.replace(rig.table, **found))


def from_dict(data: dict[str, Any]) -> Rig:
    """Return the rig of `data`, a parsed TOML document or what `to_dict` gave; a missing key has
    its default.

    ValueError (one line): an unknown key, which lists the known ones, or a wrong value.
    """
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
    """The section `name` of the keys `given`, checked by the types in `parameters`. ValueError."""
    if not isinstance(given, dict):
        raise ValueError(f"[{name}] must be a table of keys, got {given!r}")
    keys = [f.name for f in dataclasses.fields(default)]
    for key in given:
        if key not in keys:
            raise ValueError(f"unknown key '{name}.{key}'; known: {', '.join(keys)}")
    for axis in ("x", "y") if getattr(default, "by_axis", ()) else ():
        _check_axis(name, axis, default, given.get(axis, {}))
    return _validated(name, default, given)


def _check_axis(name: str, axis: str, default: Any, given: Any) -> None:
    """The values of one axis, `axis.key = number`, checked as those of the section. ValueError."""
    known = ", ".join(f"{axis}.{key}" for key in default.by_axis)
    if not isinstance(given, dict):
        raise ValueError(f"{name}.{axis} = {given!r}: write {name}.{axis}.KEY = number ({known})")
    for key in given:
        if key not in default.by_axis:
            raise ValueError(f"unknown key '{name}.{axis}.{key}'; known: {known}")
    _validated(f"{name}.{axis}", default, given)


def _validated(name: str, default: Any, given: dict[str, Any]) -> Any:
    """The section `default` with the keys `given`. ValueError: a value is of the wrong type."""
    try:
        return TypeAdapter(type(default)).validate_python(dataclasses.asdict(default) | given)
    except ValidationError as error:
        raise ValueError(first_error_line(error, within=name)) from None


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
    """Return the rig as nested dictionaries of plain data, as `from_dict` takes it."""
    return dataclasses.asdict(rig)


def to_record(rig: Rig) -> dict[str, Any]:
    """Return the rig as recordings keep it: `to_dict` without secrets and where they lie.

    The camera's address has no password; of token file and calibration only the name is left.
    """
    record = to_dict(rig)
    table = record["table"]
    table["camera"] = without_password(table["camera"])
    for key in ("token_file", "calibration"):
        table[key] = PurePath(table[key]).name
    return record


def write_rig(rig: Rig, path: Path) -> None:
    """Write the rig, with every key, to a TOML file that `read_rig` reads. OSError: it cannot be
    written.
    """
    path.write_text(tomli_w.dumps(to_dict(rig)), encoding="utf-8")
