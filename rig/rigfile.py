"""`rig.toml` <-> `Rig`: every key has a default, an unknown one is an error naming the known.

Effects of a lab's own are files that `[effects] own = "mine.py"` names (`own = ["a.py", "b.py"]`
for two, `effects = "mine.py"` where no effect is set). Only `read_rig` executes them: what a
recording says of them is text.
"""

import dataclasses
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path, PurePath
from typing import Any

import tomli_w
from pydantic import TypeAdapter, ValidationError

from rig import effects
from rig.effects import Effect
from rig.files import file_bytes, first_error_line, known_names, read_toml, toml_of, write_whole
from rig.linkage import THREE_ARMS
from rig.own_effects import OwnEffect, catalogue_of, read_effect
from rig.parameters import CHANNELS, CameraTiming, Rig
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
OWN_EFFECTS = "own_effects"  # in what `to_dict` gives: name, file and text of each
_FILES = ("token_file", "calibration")  # of [table]: relative to the rig file's folder


def read_rig(path: str | Path) -> Rig:
    """Return the rig of a TOML file; files that its [table] and [effects] name are found from the
    file's folder.

    ValueError (one line that names the file): no TOML, an unknown key, a wrong value or an effect
    file that is no good. OSError: the file cannot be read.
    """
    path = Path(path)
    try:
        data, folder = toml_of(path), path.absolute().parent
        own = tuple(read_effect(folder / name) for name in _own_files(data))
        return _beside(_with_stops(from_dict(data, own), data), folder)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def _with_stops(rig: Rig, data: dict[str, Any]) -> Rig:
    """The rig of a file's `data`, whose arms reach their angle limit: stops that it does not tell
    lie no nearer. ValueError: those that it tells do."""
    servo = rig.servo
    if rig.linkage.kind == THREE_ARMS or servo.stop_rad >= servo.angle_limit_rad:
        return rig
    if "stop_rad" in data["servo"]:
        raise ValueError(
            f"servo.stop_rad = {servo.stop_rad:g} is below servo.angle_limit_rad = "
            f"{servo.angle_limit_rad:g}: an arm would strike its stop before its volts are "
            "limited; lower angle_limit_rad, or correct stop_rad"
        )
    servo = dataclasses.replace(servo, stop_rad=servo.angle_limit_rad)
    return dataclasses.replace(rig, servo=servo)


def _beside(rig: Rig, folder: Path) -> Rig:
    """The rig with the files that [table] names found from the rig file's folder."""
    named = {key: name for key in _FILES if (name := getattr(rig.table, key))}
    if ".py:" in (rig.table.camera or ""):  # a camera's class in a file of one's own
        named["camera"] = rig.table.camera
    if not named:
        return rig
    found = {key: str(folder / name) for key, name in named.items()}
    return dataclasses.replace(rig, table=dataclasses.replace(rig.table, **found))


def effect_files(text: str) -> list[str]:
    """Return the effect files that the text of a rig file names, whose code `read_rig` executes.

    ValueError (one line): as of `read_rig`.
    """
    return _own_files(read_toml(text))


def _own_files(data: dict[str, Any]) -> list[str]:
    """The effect files that a rig file names, taken out of its `data`. ValueError: no names."""
    found = data.get("effects")
    if isinstance(found, str | list):
        named = data.pop("effects")
    else:
        named = found.pop("own", []) if isinstance(found, dict) else []
    files = [named] if isinstance(named, str) else named
    if not isinstance(files, list) or not all(isinstance(f, str) and f for f in files):
        raise ValueError(
            f'effects.own = {named!r}: write [effects] own = "mine.py", or own = ["a.py", "b.py"]'
        )
    return files


def own_names(data: dict[str, Any]) -> dict[str, str]:
    """Name -> file of the effects of a lab's own that `data` of `to_dict` tells of."""
    found = data.get(OWN_EFFECTS, [])
    there = [one for one in found if isinstance(one, dict)] if isinstance(found, list) else []
    return {str(one.get("name")): str(one.get("file")) for one in there}


def from_dict(data: dict[str, Any], own: Sequence[OwnEffect] = ()) -> Rig:
    """Return the rig of `data`, a parsed TOML document or what `to_dict` gave; a missing key has
    its default: a camera's rate that of a loop that is slower.

    own: the effects of a lab's own; values of those that `data` itself tells of are left out where
    they are not among them. ValueError (one line): an unknown key, which lists the known ones, or a
    wrong value.
    """
    known = (*SECTIONS, "control_rate_hz", "effects", "tolerances", "floors")
    for key in data:
        if key not in (*known, OWN_EFFECTS):
            raise ValueError(f"unknown key '{key}'; {_places(key) or known_names(key, known)}")
    rate = data.get("control_rate_hz", Rig.control_rate_hz)
    if not isinstance(rate, int | float) or not 10 <= rate <= 5000:
        raise ValueError(f"control_rate_hz = {rate}: must be a number from 10 to 5000")
    camera = CameraTiming(rate_hz=min(CameraTiming.rate_hz, float(rate)))  # one frame a tick
    rig = Rig(camera=camera)
    sections = {}
    for name in SECTIONS:
        default = getattr(rig, name)
        sections[name] = _section(name, default, data.get(name, {}))
    found = data.get("effects", {})
    catalogue = catalogue_of(own)
    foreign = {name for name in own_names(data) if name not in catalogue}
    if foreign and isinstance(found, dict):
        found = {name: by_axis for name, by_axis in found.items() if name not in foreign}
    _check_effects_shape(found, catalogue)
    effects.check(found, catalogue)
    return Rig(
        **sections,
        control_rate_hz=float(rate),
        effects=found,
        own=tuple(own),
        tolerances=_sizes("tolerances", data, (*catalogue, *foreign)),
        floors=_sizes("floors", data, CHANNELS),
    )


def _places(key: str) -> str:
    """Words on where a key or an effect belongs in a rig file; "" for one that is nowhere known."""
    if key in effects.BY_NAME:
        return f"an effect belongs in [effects.{key}]"
    rig = Rig()
    places = [s for s in SECTIONS if key in (f.name for f in dataclasses.fields(getattr(rig, s)))]
    return f"it belongs in [{'] or ['.join(places)}]" if places else ""


def _sizes(section: str, data: dict[str, Any], names: tuple[str, ...]) -> dict[str, float]:
    """section.NAME = number above zero, NAME one of `names`."""
    found = data.get(section, {})
    if not isinstance(found, dict):
        raise ValueError(f"[{section}] must hold lines such as {names[0]} = 0.0014")
    for name, value in found.items():
        if name not in names:
            raise ValueError(f"{section}: unknown name '{name}'; {known_names(name, names)}")
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
            words = _places(key) or known_names(key, keys)
            raise ValueError(f"unknown key '{name}.{key}'; {words}")
    for axis in ("x", "y") if getattr(default, "by_axis", ()) else ():
        _check_axis(name, axis, default, given.get(axis, {}))
    return _validated(name, default, given)


def _check_axis(name: str, axis: str, default: Any, given: Any) -> None:
    """The values of one axis, `axis.key = number`, checked as those of the section. ValueError."""
    if not isinstance(given, dict):
        keys = ", ".join(default.by_axis)
        raise ValueError(f"{name}.{axis} = {given!r}: write {name}.{axis}.KEY = number ({keys})")
    for key in given:
        if key not in default.by_axis:
            known = known_names(key, default.by_axis)
            raise ValueError(f"unknown key '{name}.{axis}.{key}'; {known}")
    _validated(f"{name}.{axis}", default, given)


def _validated(name: str, default: Any, given: dict[str, Any]) -> Any:
    """The section `default` with the keys `given`. ValueError: a value is of the wrong type."""
    try:
        # JSON has lists for tuples, and no dates: what is none of its types is given as a list.
        values = json.dumps(dataclasses.asdict(default) | given, default=lambda odd: [str(odd)])
        return TypeAdapter(type(default)).validate_json(values, strict=True)
    except ValidationError as error:
        raise ValueError(first_error_line(error, within=name)) from None


def _check_effects_shape(found: Any, known: Mapping[str, Effect]) -> None:
    """effects.NAME.AXIS.KEY = number, else one clear line."""
    if not isinstance(found, dict):
        raise ValueError("[effects] must hold tables such as [effects.joint_backlash]")
    for name, by_axis in found.items():
        if name not in known or _is_by_axis(by_axis):
            continue
        axis, key = known[name].axes[0], known[name].parameters[0].key
        raise ValueError(f"effect '{name}': write it as [effects.{name}] {axis}.{key} = number")


def _is_by_axis(by_axis: Any) -> bool:
    """{axis: {key: number}}?"""
    if not isinstance(by_axis, dict) or not all(isinstance(p, dict) for p in by_axis.values()):
        return False
    numbers = [value for pairs in by_axis.values() for value in pairs.values()]
    return all(isinstance(v, int | float) and not isinstance(v, bool) for v in numbers)


def to_dict(rig: Rig) -> dict[str, Any]:
    """Return the rig as nested dictionaries of plain data, as `from_dict` takes it."""
    data = dataclasses.asdict(rig)
    own = [{"name": one.effect.name, "file": one.file, "text": one.text} for one in rig.own]
    del data["own"]
    return {**data, OWN_EFFECTS: own} if own else data


def to_record(rig: Rig) -> dict[str, Any]:
    """Return the rig as recordings keep it: `to_dict` without secrets and where they lie.

    The camera's address has no password; of token file, calibration and effect files only the name
    is left, of the last their text, too.
    """
    record = to_dict(rig)
    for one in record.get(OWN_EFFECTS, []):
        one["file"] = PurePath(one["file"]).name
    table = record["table"]
    table["camera"] = without_password(table["camera"])
    for key in ("token_file", "calibration"):
        table[key] = PurePath(table[key]).name
    return record


def changes(before: Rig, after: Rig) -> list[str]:
    """What differs in the second rig, a line a key: `servo.gain_rad_s_V = 1.72 (was 1.735)`."""

    def flat(data: Any, name: str = "") -> dict[str, Any]:
        if not isinstance(data, dict):
            return {name: data}
        parts = [flat(value, f"{name}.{key}".strip(".")) for key, value in data.items()]
        return {key: value for part in parts for key, value in part.items()}

    def words(value: Any) -> str:
        return f"{value:.6g}" if isinstance(value, float) else f"{value}"

    old, new = flat(to_record(before)), flat(to_record(after))
    return [
        f"{key} = {words(value)} ({f'was {words(old[key])}' if key in old else 'new'})"
        for key, value in new.items()
        if key not in old or old[key] != value
    ] + [f"{key}: taken out (was {words(old[key])})" for key in old if key not in new]


MADE = "# Made by balancing-table-rig, which may write it anew.\n"


def refuse_own(path: Path) -> None:
    """ValueError (one line) where a file lies that `write_rig` did not make: somebody's own rig
    file, which the one that a command makes would replace."""
    if path.is_file() and not _is_made(file_bytes(path, None)):
        raise ValueError(
            f"{path}: a rig file of yours lies where one is to be written; name another --out"
        )


def _is_made(content: bytes) -> bool:
    """Whether `write_rig` made this: it says so or, of an earlier version, has every section and no
    comment."""
    if content.startswith(MADE.encode()):
        return True
    sections = {key for key, value in to_dict(Rig()).items() if isinstance(value, dict)}
    there = {name.decode() for name in re.findall(rb"^\[(\w+)", content, re.MULTILINE)}
    return b"#" not in content and sections <= there


def write_rig(rig: Rig, path: str | Path, remarks: Iterable[str] = ()) -> None:
    """Write the rig, with every key, to a TOML file that `read_rig` reads, as long as the effect
    files of its own lie where they lay; `refuse_own` knows it again. remarks: comments, each a line
    at its head. OSError: it cannot be written; an older one stays.
    """
    data = to_dict(rig)
    if data.pop(OWN_EFFECTS, []):
        data["effects"] = {"own": [one.file for one in rig.own]} | data["effects"]
    head = MADE + "".join(f"# {remark}\n" for remark in remarks)
    write_whole(Path(path), (head + tomli_w.dumps(data)).encode())
