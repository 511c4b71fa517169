"""What homing found, kept beside the rig file until the encoders may have lost their place."""

import json
from dataclasses import asdict, dataclass, fields
from datetime import UTC, datetime, timedelta
from math import inf, pi
from pathlib import Path
from typing import Any, ClassVar
from zlib import crc32

from pydantic import TypeAdapter, ValidationError

from rig.files import file_bytes, first_error_line, read_json, write_whole
from rig.hardware.homing.home import Homing
from rig.hardware.wiring import Wiring, file_wiring
from rig.linkage import Linkage
from rig.parameters import BUS_KINDS, PULSES, QUANSER, Rig, Servo
from rig.table import Table

LONGEST = timedelta(hours=12)  # for a table that does not tell when it was switched off
MARGIN_RAD = 0.1
CURE = "run rig home"
CHECKSUM = "checksum"  # the key, in the file, of that of all others; earlier versions wrote none


class NotHomed(ValueError):  # noqa: N818 - it names a state used as a run ending
    """The table's encoders are not known to be right; the message ends with the cure.

    Outcome of the run: "not homed".
    """

    outcome = "not homed"


@dataclass(frozen=True)
class Homed:
    """A homing as kept in a file, and the table that it holds for.

    kind, where: of the table's [table] (kind; port or address, and what a number that is written
    there means: ids on a bus, pulses, the amplifier behind a card); boot_id: name of the table's
    power-up, or of this homing, as the table knows it (None: it knows none); at: ISO time, UTC;
    confirmed: the markers saw the plate move; travel_rad: between the stops, by servo; wiring: what
    the homing found; voltage_limit_V: with which it was done (inf: a file of an earlier version
    does not tell); breakaway_V: at which each arm begins to move, up and down (none: as that, or
    the servos take angles).
    """

    # A key that is damaged is no key that was left out.
    __pydantic_config__: ClassVar[Any] = {"extra": "forbid"}
    kind: str
    where: str
    boot_id: str | None
    at: str
    confirmed: bool
    travel_rad: tuple[float, ...]
    wiring: Wiring
    voltage_limit_V: float = inf
    breakaway_V: tuple[tuple[float, float], ...] = ()

    @classmethod
    def of(cls, found: Homing, rig: Rig, boot_id: str | None) -> "Homed":
        """Return the record of a homing that was found just now on the rig's table."""
        now = datetime.now(UTC).isoformat(timespec="seconds")
        where = (rig.table.kind, _where(rig))
        kept = (found.confirmed, found.travel_rad, found.wiring, rig.servo.voltage_limit_V)
        return cls(*where, boot_id, now, *kept, found.breakaway_V)

    def save(self, path: Path) -> None:
        """Write the homing to a JSON file that `load` reads. OSError: it cannot be written."""
        kept = asdict(self)
        kept[CHECKSUM] = _checksum(kept)
        write_whole(path, json.dumps(kept, indent=1).encode() + b"\n")

    def check(self, rig: Rig, boot_id: str | None, now: datetime | None = None) -> None:
        """Raise NotHomed where the homing is of another table, another power-up, too long ago, of
        narrower limits than the rig file has now, or of other channels that no camera confirmed.

        boot_id: as `power_up` names it now; now: the time (default: the system's).
        """
        if (self.kind, self.where) != (rig.table.kind, _where(rig)):
            raise NotHomed(f"the homing is of another table ({self.kind} {self.where}): {CURE}")
        if self.wiring.counts_per_rev != rig.servo.encoder_counts_per_rev:
            raise NotHomed(f"servo.encoder_counts_per_rev has changed since the homing: {CURE}")
        self._check_limits(rig.servo, rig.linkage)
        if not self.confirmed:
            self._check_told(rig)
        age = (now or datetime.now(UTC)) - datetime.fromisoformat(self.at)
        if boot_id is not None or self.boot_id is not None:
            if self.boot_id != boot_id:
                raise NotHomed(
                    "the table was switched off or reset since its homing, or homed with another "
                    f"rig file: {CURE}"
                )
            return
        if not timedelta(minutes=-5) < age < LONGEST:
            hours = LONGEST.total_seconds() / 3600
            raise NotHomed(f"the homing of {self.at} is older than {hours:g} hours: {CURE}")

    def _check_limits(self, servo: Servo, linkage: Linkage) -> None:
        if len(self.travel_rad) != linkage.servos:
            raise NotHomed(f"linkage.kind has changed since the homing: {CURE}")
        needed = linkage.servo_limits_rad(servo.angle_limit_rad)
        ways = [
            (0.5 * travel - limit, 0.5 * travel)
            for travel, limit in zip(self.travel_rad, needed, strict=True)
        ]
        room, reach = min(ways)
        if room < 0:
            raise NotHomed(
                f"servo.angle_limit_rad = {servo.angle_limit_rad:g} is beyond the stops that "
                f"homing found, {reach:.2f} rad from the middle: lower it, or {CURE}"
            )
        if servo.voltage_limit_V > self.voltage_limit_V:
            raise NotHomed(
                f"servo.voltage_limit_V = {servo.voltage_limit_V:g} is above the "
                f"{self.voltage_limit_V:g} V of the homing: lower it, or {CURE}"
            )

    def _check_told(self, rig: Rig) -> None:
        """NotHomed: the rig file says otherwise now what nobody but it could tell the homing."""
        told, kept = file_wiring(rig), self.wiring
        if (told.order, told.sign_angle) != (kept.order, kept.sign_angle):
            raise NotHomed(f"table.swap or sign_angle has changed since the homing: {CURE}")
        if rig.servo.takes_angle and told.zero_counts != kept.zero_counts:
            raise NotHomed(f"table.trim_rad has changed since the homing: {CURE}")

    def check_angles(self, theta_rad: tuple[float, float]) -> None:
        """Raise NotHomed where the encoder angles theta_rad (x, y) lie beyond the stops: the
        counters were lost.
        """
        for axis, angle, travel in zip("xy", theta_rad, self.travel_rad, strict=True):
            if not abs(angle) < 0.5 * travel + MARGIN_RAD:
                raise NotHomed(
                    f"encoder {axis} shows {angle:.2f} rad, beyond its stops at "
                    f"{0.5 * travel:.2f}: the table was switched off since its homing; {CURE}"
                )


def _where(rig: Rig) -> str:
    table = rig.table
    where = table.port or table.address
    servos = rig.linkage.servos
    if table.kind == PULSES:
        lowest, highest = table.pulse_range_us
        told = table.by_channel("pulse_us_per_rad", servos)
        slopes = ", ".join(f"{slope:.6g}" for slope in told)
        return f"{where}, pulses of {slopes} us/rad from {lowest:g} to {highest:g} us"
    if table.kind == QUANSER:
        return f"{where}, amplifier gain {table.amplifier_gain:g}"
    return f"{where} {list(table.by_channel('ids', servos))}" if table.kind in BUS_KINDS else where


def power_up(table: Table) -> str | None:
    """Return what names this power-up of a table that has been read, or the last homing since;
    None where it cannot tell.
    """
    boot_id = getattr(table, "boot_id", None)
    return None if boot_id is None else f"id {boot_id}"


def home_file(rig_file: Path) -> Path:
    """Return where the homing of a rig file's table is kept: FILE.home.json beside FILE.toml."""
    return rig_file.with_suffix(".home.json")


def load(path: Path) -> Homed:
    """Return the kept homing. NotHomed: there is no such file, it holds no homing, or another one
    than was written: a single digit that is damaged would be another zero.
    """
    if not path.is_file():
        raise NotHomed(f"this table has not been homed ({path} is missing): {CURE}")
    try:
        kept = read_json(file_bytes(path).decode())
        checksum = kept.pop(CHECKSUM, None) if isinstance(kept, dict) else None
        if checksum not in (None, _checksum(kept)):
            raise ValueError("it is damaged, or was changed by hand")
        found = TypeAdapter(Homed).validate_python(kept)
        _check_values(found)
        # No homing leaves a channel's meaning open: what stands for it elsewhere is a guess here.
        if absent := {one.name for one in fields(Wiring)} - set(kept["wiring"]):
            raise ValueError(f"wiring.{min(absent)} is missing")
        return found
    except ValueError as error:
        is_known = isinstance(error, ValidationError)
        why = first_error_line(error) if is_known else str(error).splitlines()[0]
        raise NotHomed(f"{path} is no homing ({why}): {CURE}") from None


def _checksum(kept: Any) -> int:
    return crc32(json.dumps(kept, sort_keys=True).encode())


def _check_values(found: Homed) -> None:
    """ValueError: no homing finds such values."""
    if datetime.fromisoformat(found.at).tzinfo is None:
        raise ValueError(f"at = {found.at} has no time zone")
    if not all(0.0 < travel <= 4 * pi for travel in found.travel_rad):  # a servo's turn both ways
        raise ValueError(f"travel_rad = {found.travel_rad} is no way between stops")
    servos = len(found.wiring.order)
    if len(found.travel_rad) != servos or len(found.breakaway_V) not in (0, servos):
        raise ValueError(f"travel_rad or breakaway_V is not of {servos} servos")
    if not found.voltage_limit_V > 0.0:
        raise ValueError(f"voltage_limit_V = {found.voltage_limit_V} moves no arm")
    if not all(0.0 <= volts < inf for pair in found.breakaway_V for volts in pair):
        raise ValueError(f"breakaway_V = {found.breakaway_V} moves no arm")
