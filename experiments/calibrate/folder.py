"""A calibration's folder: calibration.json that grows, rig.toml with its numbers, pictures."""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

import typer

from calibration.bundle import Draft, load_draft
from calibration.records import (
    LevelRecord,
    PositionServoAxis,
    PositionServoRecord,
    SectionRecord,
    ServoRecord,
    TimingRecord,
    fingerprint,
)
from experiments.records.recording import lock
from experiments.records.run_folder import writable
from experiments.runs.assemble import known, load_rig
from experiments.runs.hardware import is_hardware
from rig.files import freed
from rig.parameters import Rig, Servo, torque_per_volt
from rig.rigfile import changes, read_rig, refuse_own, write_rig

FILE, RIG_FILE, LOCK_FILE = "calibration.json", "rig.toml", ".lock"
VIEW = ("lens", "plate")  # fields of a draft through which all else is seen
NOT_YOURS = "this would measure the virtual table, not yours: name its frames or its runs"
Source = Literal["measured", "simulated"]


def table_file(step: str) -> str:
    """Name of the file with the virtual table on which a step was measured: its play may be changed
    between two of them."""
    return f"table-{step}.toml"


class CalibrationFolder:
    """One calibration that is being made in a folder.

    source: "measured" or "simulated"; rig: whose table is calibrated. ValueError: a real table's
    numbers would be the virtual one's, calibration.json in it cannot be read or is of the other
    source (numbers of a simulated and a measured table are never mixed), or rig.toml in it is
    somebody's own. OSError: the folder cannot be written.
    """

    def __init__(self, folder: Path, source: Source, rig: Rig) -> None:
        if source == "simulated" and is_hardware(rig):
            raise ValueError(
                f'table.kind = "{rig.table.kind}": {NOT_YOURS}; rig gap finds gain, time constant '
                "and play of motors that take volts in its runs"
            )
        self._source: Source = source
        self.path = writable(folder)
        self.draft = self._read()

    def _read(self) -> Draft:
        """What the folder holds now; errors as of the class."""
        refuse_own(self.path / RIG_FILE)
        file = self.path / FILE
        draft = load_draft(file) if file.is_file() else Draft(made=_now(), source=self._source)
        if draft.source != self._source:
            raise ValueError(
                f"{file} holds a {draft.source} calibration, this one is {self._source}: choose "
                "another --out"
            )
        return draft

    def keep(
        self,
        name: str,
        *,
        data: Sequence[Path] = (),
        pictures: Sequence[Path] = (),
        warnings: Sequence[str] = (),
        **records: Any,
    ) -> None:
        """Add the section `name` and its records to calibration.json, and print where it stands.

        data: files that the numbers came from, kept as fingerprints; pictures: that show it;
        warnings: kept and printed; records: fields of `calibration.bundle.Draft`, None to remove
        one. ValueError: another program measured the view meanwhile, by which this was measured;
        OSError: the file cannot be written.
        """
        section = SectionRecord(
            made=_now(),
            data=fingerprint(data),
            pictures=[picture.name for picture in pictures],
            warnings=list(warnings),
        )
        with _alone(self.path):  # another program may have kept its section meanwhile
            now = self._read()
            for part in VIEW:
                if part not in records and getattr(now, part) != getattr(self.draft, part):
                    raise ValueError(
                        f"{self.path / FILE} has another {part} now, of another program: {name} "
                        "was measured by the one before, and is not kept; measure it again"
                    )
            self.draft = now.with_section(name, section, **records)
            self.draft.save(self.path / FILE)
        for text in warnings:
            typer.echo(f"warning: {text}", err=True)
        shown = ", ".join(str(picture) for picture in pictures)
        of = " (of the virtual table)" if self.draft.source == "simulated" else ""
        typer.echo(f"written: {self.path / FILE}{of}" + (f"   pictures: {shown}" if shown else ""))

    def believed(self, rig_file: Path | None) -> Rig:
        """The rig with what was measured in this folder, which is said where a `rig_file` is given,
        too; else what is known of that.

        ValueError, FileNotFoundError: a rig file is missing or wrong.
        """
        own = self.path / RIG_FILE
        if rig_file is not None and own.is_file():
            words = f"note: goes on from {own}, which holds what the earlier steps here measured"
            typer.echo(f"{words}; {rig_file} is not read again", err=True)
        return self._rig(rig_file)

    def _rig(self, rig_file: Path | None) -> Rig:
        own = self.path / RIG_FILE
        return read_rig(own) if own.is_file() else known(load_rig(rig_file))

    def believe(self, rig_file: Path | None, change: Callable[[Rig], Rig]) -> None:
        """Write the rig that was `believed`, with a change, as rig.toml of the folder, and say what
        is another in it. OSError: it cannot be written.
        """
        with _alone(self.path):
            before = self._rig(rig_file)
            after = change(before)
            write_rig(after, self.path / RIG_FILE)
        typer.echo(f"your rig file with what was measured: {self.path / RIG_FILE}")
        for line in changes(before, after):
            typer.echo(f"changed: {line}")


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """The folder without another program that calibrates in it, where the disk has locks; a moment
    is waited for it.
    """
    with freed(folder / LOCK_FILE).open("a") as file:
        while not lock(file.fileno()):
            time.sleep(0.01)
        yield


def _now() -> datetime:
    return datetime.now(UTC).replace(microsecond=0)


def with_timing(rig: Rig, record: TimingRecord) -> Rig:
    """The rig with the measured delay of the camera [s], at least 0."""
    return replace(rig, camera=replace(rig.camera, delay_s=max(record.delay_s.value, 0.0)))


def with_level(rig: Rig, record: LevelRecord) -> Rig:
    """The rig with the measured slopes [rad] as its effect level_offset."""
    slopes = {axis: {"slope_rad": value.value} for axis, value in record.slope_rad.items()}
    return replace(rig, effects={**rig.effects, "level_offset": slopes})


def with_servo(rig: Rig, record: ServoRecord) -> Rig:
    """The rig with the measured servo: gain, time constant, offsets and dry friction.

    Gain and time constant are the means of both axes, which are modelled alike. The voltage offset,
    -(V_+ + V_-)/2 of the breakaway volts, and the friction that the bearings do not explain,
    (V_+ - V_-)/2 less the bearings' [V], at least 0, become effects of each axis.
    """
    axes = {"x": record.x, "y": record.y}
    bearings_V = (rig.drive.arm_friction_nm + rig.drive.joint_friction_nm) / torque_per_volt()
    friction, offset = {}, {}
    for name, axis in axes.items():
        up, down = axis.breakaway_positive_V.value, axis.breakaway_negative_V.value
        friction[name] = {"friction_V": max(0.5 * (up - down) - bearings_V, 0.0)}
        offset[name] = {"offset_V": -0.5 * (up + down)}
    servo = replace(
        rig.servo,
        gain_rad_s_V=sum(a.gain_rad_s_V.value for a in axes.values()) / 2,
        time_constant_s=sum(a.time_constant_s.value for a in axes.values()) / 2,
    )
    effects = {**rig.effects, "coulomb_friction": friction, "voltage_offset": offset}
    return replace(rig, servo=servo, effects=effects)


def with_position_servo(rig: Rig, record: PositionServoRecord) -> Rig:
    """The rig with the measured servos that take an angle, axis by axis.

    What was not seen stays as it was. A scale or zero whose interval leaves 0 out becomes an effect
    (`angle_scale`, `angle_zero`), else such an effect goes.
    """
    axes = {"x": record.x, "y": record.y}
    own = {name: {**getattr(rig.servo, name), **_keys(axis)} for name, axis in axes.items()}
    effects = {k: v for k, v in rig.effects.items() if k not in ("angle_scale", "angle_zero")}
    for effect, key, field in (
        ("angle_scale", "fraction", "scale"),
        ("angle_zero", "offset_rad", "zero_rad"),
    ):
        values = {name: getattr(axis, field) for name, axis in axes.items()}
        sure = {
            name: {key: value.value}
            for name, value in values.items()
            if value is not None and value.low * value.high > 0
        }
        effects |= {effect: sure} if sure else {}
    return replace(rig, servo=replace(rig.servo, **own), effects=effects)


def _keys(axis: PositionServoAxis) -> dict[str, float]:
    values = {key: getattr(axis, key, None) for key in Servo.by_axis}
    return {key: value.value for key, value in values.items() if value is not None}
