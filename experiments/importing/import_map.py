"""The map beside an imported log: which column of the file becomes which of the log, and how.

    SI value = sign * (column - offset) * scale * SI factor of the unit

`offset` is in the file's own unit; `scale` is needed where the unit has no SI factor (counts, px,
shares of a supply, pulse widths): how much SI one of them is, or the supply's volts of a share.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError, field_validator, model_validator

from experiments.importing.units import canonical, factor, family, quantity
from rig.files import StrictModel, first_error_line, toml_of, write_whole
from rig.log import CONTRACT

SIGNALS = tuple(name for name in CONTRACT if name != "t_s")
PER_AXIS = ("ball", "theta", "command", "voltage", "motor_speed", "target")
Positive = Annotated[float, Field(gt=0)]


class TimeMap(StrictModel):
    """Where the time comes from: a column in a unit, or a rate where there is no such column.

    clock: `even` where the stamps are coarser than the rows, which were equally far apart;
    session: column that has another number in every session. A time that starts anew, or a hole
    of more than 2 s, begins a session, too.
    """

    column: str | None = None
    unit: str = "s"
    rate_hz: Positive | None = None
    clock: Literal["as recorded", "even"] = "as recorded"
    session: str | None = None

    @field_validator("unit")
    @classmethod
    def _time(cls, unit: str) -> str:
        if factor(unit, "t_s") is None:
            raise ValueError(f"{unit!r} is no unit of time")
        return unit

    @model_validator(mode="after")
    def _one_source(self) -> "TimeMap":
        if (self.column is None) == (self.rate_hz is None):
            raise ValueError("time needs a column or a rate_hz, one of the two")
        return self


class SignalMap(StrictModel):
    """How one column becomes one of the log.

    absent: values that mean `no ball` (where both coordinates have one of theirs), absent_alone:
    those that do so by themselves; held_rows: a place of the ball that stays for so many rows is
    one that its detector held, after the first of them (0: none is); seen: columns that are 0 or
    blank where there was no ball, or conditions (`NAME >= 0.6`, `NAME < 1`) that do not hold there;
    resistance_ohm, back_emf_V_s_rad: of a motor whose current was recorded,
    V = R i + k_e theta'.
    """

    column: str
    unit: str
    sign: Literal[1, -1] = 1
    scale: Positive | None = None
    offset: float = 0.0
    absent: tuple[float, ...] = ()
    absent_alone: tuple[float, ...] = ()
    held_rows: Annotated[int, Field(ge=0)] = 0
    seen: tuple[str, ...] = ()
    resistance_ohm: Positive | None = None
    back_emf_V_s_rad: Annotated[float, Field(ge=0)] | None = None

    @field_validator("unit")
    @classmethod
    def _known_spelling(cls, unit: str) -> str:
        return unit if unit == "1" else canonical(unit) or unit


class ImportMap(StrictModel):
    """The whole map. calibration: bundle of the camera for positions in px; sources: the files
    that the map was made for."""

    schema_version: Literal[1] = 1
    sources: tuple[str, ...] = ()
    calibration: str | None = None
    time: TimeMap
    signals: dict[str, SignalMap]

    @model_validator(mode="after")
    def _fits_together(self) -> "ImportMap":
        for name, signal in self.signals.items():
            if name not in SIGNALS:
                raise ValueError(f"signals.{name}: the log has {', '.join(SIGNALS)}")
            if name == "push":
                continue
            by_camera = signal.unit == "px" and self.calibration is not None
            if factor(signal.unit, name) is None and signal.scale is None and not by_camera:
                raise ValueError(f"signals.{name}: unit {signal.unit!r} needs a scale")
            if quantity(signal.unit) == "current" and (
                signal.resistance_ohm is None or signal.back_emf_V_s_rad is None
            ):
                raise ValueError(
                    f"signals.{name}: a current needs resistance_ohm and back_emf_V_s_rad"
                )
        if not self.signals:
            raise ValueError("signals: none is mapped")
        return self


def read_map(path: Path) -> ImportMap:
    """Read a map. ValueError (one line): it is none; FileNotFoundError: it is not there."""
    if not path.is_file():
        raise FileNotFoundError(f"{path} does not exist")
    try:
        return ImportMap.model_validate(toml_of(path))
    except ValidationError as error:
        raise ValueError(f"{path}: {first_error_line(error, ImportMap)}") from error
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def write_map(path: Path, made: ImportMap) -> None:
    """Write a map as TOML. OSError: it cannot be written."""
    import tomli_w

    kept = made.model_dump(mode="json", exclude_none=True, exclude={"sources"})
    for signal in kept["signals"].values():
        for key in ("absent", "absent_alone", "held_rows", "seen"):
            if not signal[key]:
                del signal[key]
    text = tomli_w.dumps({"sources": list(made.sources), **kept})
    write_whole(path, text.encode())


KINDS = ("commanded", "measured")
Stated = dict[str, dict[str, Any]]


def stated(texts: list[str] | tuple[str, ...]) -> Stated:
    """What options `KEY=VALUE` say: {"time" or a log's column: {key: value}}.

    Also {"": {"calibration": path}} and {"angle": {"kind": commanded or measured}}.

    `ball.unit=mm` speaks of both axes. ValueError (one line): no such key, or no value.
    """
    said: Stated = {}
    for text in texts:
        place, equals, value = text.partition("=")
        place = place.strip()
        if place == "calibration" and equals:
            said.setdefault("", {})["calibration"] = value.strip()
            continue
        if place == "angle.kind" and value.strip() in KINDS:
            said.setdefault("angle", {})["kind"] = value.strip()
            continue
        name, dot, key = place.partition(".")
        fields = TimeMap.model_fields if name == "time" else SignalMap.model_fields
        names = [name] if name in ("time", *SIGNALS) else [s for s in SIGNALS if family(s) == name]
        if not equals or not dot or key not in fields or not names:
            raise ValueError(
                f"--set {text}: write NAME.KEY=VALUE; NAME is time, {', '.join(PER_AXIS)} or a "
                f"column of the log; KEY is {', '.join(fields)}; or "
                "angle.kind=commanded or measured"
            )
        for one in names:
            said.setdefault(one, {})[key] = _value(key, value.strip(), text)
    return said


def with_answers(said: Stated, *texts: str) -> Stated:
    """What was stated, and more of it. ValueError (one line): as of `stated`."""
    more = stated(texts)
    return {name: {**said.get(name, {}), **more.get(name, {})} for name in {**said, **more}}


def _value(key: str, text: str, whole: str) -> Any:
    """A value of the type that its key has. ValueError: it is no number where one is needed."""
    if key in ("column", "unit", "clock", "session"):
        return (canonical(text) or text) if key == "unit" and text != "1" else text
    if key == "seen":
        return tuple(part.strip() for part in text.split(",") if part.strip() not in ("", "none"))
    try:
        if key.startswith("absent"):
            return tuple(
                float(part) for part in text.split(",") if part.strip() not in ("", "none")
            )
        number = float(text)
    except ValueError:
        raise ValueError(f"--set {whole}: {text!r} is no number") from None
    if key == "sign" and number not in (1, -1):
        raise ValueError(f"--set {whole}: a sign is 1 or -1")
    count = key in ("sign", "held_rows") and float(number).is_integer()
    return int(number) if count else number


def merged(made: ImportMap, said: Mapping[str, Mapping[str, Any]]) -> ImportMap:
    """A map with what was stated in its place. ValueError (one line): it no longer fits."""
    data = made.model_dump()
    data |= said.get("", {})
    for name, keys in said.items():
        if name == "time":
            data["time"] |= keys
        elif keys.get("column") == "none":
            data["signals"].pop(name, None)
        elif name in data["signals"]:
            data["signals"][name] |= keys
        elif "column" in keys:
            data["signals"][name] = dict(keys)
    return validated(data)


def time_map(keys: Mapping[str, Any]) -> TimeMap:
    """Where the time comes from, of plain `keys`. ValueError (one line): a key is wrong."""
    try:
        return TimeMap.model_validate(keys)
    except ValidationError as error:
        raise ValueError(f"the map: time: {first_error_line(error, TimeMap)}") from error


def validated(data: Mapping[str, Any]) -> ImportMap:
    """The map of plain `data`. ValueError (one line): a key is wrong."""
    try:
        return ImportMap.model_validate(data)
    except ValidationError as error:
        raise ValueError(f"the map: {first_error_line(error, ImportMap)}") from error
