"""What homing found, kept beside the rig file until the encoders may have lost their place."""

import json
import time
from dataclasses import asdict, dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

from pydantic import TypeAdapter

from rig.hardware.home import Homing
from rig.hardware.wiring import Wiring
from rig.parameters import Rig
from rig.table import Table

LONGEST = timedelta(hours=12)  # for a table that does not tell when it was switched off
MARGIN_RAD = 0.1
CLOCK_TURN_S = 2**32 * 1e-6  # a board's microseconds start anew
BOOT_S, DRIFT = 0.3, 2e-3  # a ceramic resonator is good to half a percent at worst, often to 0.1
CURE = "run rig home"


class NotHomed(ValueError):  # noqa: N818 - the state, not the slip
    """The table's encoders are not known to be right; the message ends with the cure."""

    outcome = "not homed"


@dataclass(frozen=True)
class Homed:
    """A homing and what it holds for. at: ISO time; boot_id: the table's power-up, where it
    tells; travel_rad by axis; confirmed: the markers saw the plate move."""

    kind: str
    where: str
    boot_id: str | None
    at: str
    confirmed: bool
    travel_rad: tuple[float, float]
    wiring: Wiring

    @classmethod
    def of(cls, found: Homing, rig: Rig, boot_id: str | None) -> "Homed":
        now = datetime.now(UTC).isoformat(timespec="seconds")
        where = (rig.table.kind, _where(rig))
        return cls(*where, boot_id, now, found.confirmed, found.travel_rad, found.wiring)

    def save(self, path: Path) -> None:
        path.write_text(json.dumps(asdict(self), indent=1) + "\n", encoding="utf-8")

    def check(self, rig: Rig, boot_id: str | None, now: datetime | None = None) -> None:
        """NotHomed: it was another table, another power-up, or too long ago."""
        if (self.kind, self.where) != (rig.table.kind, _where(rig)):
            raise NotHomed(f"the homing is of another table ({self.kind} {self.where}): {CURE}")
        if self.wiring.counts_per_rev != rig.servo.encoder_counts_per_rev:
            raise NotHomed(f"servo.encoder_counts_per_rev has changed since the homing: {CURE}")
        age = (now or datetime.now(UTC)) - datetime.fromisoformat(self.at)
        if boot_id is not None or self.boot_id is not None:
            if not _same(self.boot_id, boot_id, age.total_seconds()):
                raise NotHomed(f"the table was switched off or reset since its homing: {CURE}")
            return
        if not timedelta(minutes=-5) < age < LONGEST:
            hours = LONGEST.total_seconds() / 3600
            raise NotHomed(f"the homing of {self.at} is older than {hours:g} hours: {CURE}")

    def check_angles(self, theta_rad: tuple[float, float]) -> None:
        """NotHomed: the arms are where they cannot be, so the counters were lost."""
        for axis, angle, travel in zip("xy", theta_rad, self.travel_rad, strict=True):
            if not abs(angle) < 0.5 * travel + MARGIN_RAD:
                raise NotHomed(
                    f"encoder {axis} shows {angle:.2f} rad, beyond its stops at "
                    f"{0.5 * travel:.2f}: the table was switched off since its homing; {CURE}"
                )


def _where(rig: Rig) -> str:
    return rig.table.port or rig.table.address


def power_up(table: Table, now_s: float | None = None) -> str | None:
    """What names this power-up of a table that has been read; None where it cannot tell.

    A board tells its clock, which began at its last reset: that moment on the host's clock.
    """
    if (boot_id := getattr(table, "boot_id", None)) is not None:
        return f"id {boot_id}"
    newest = getattr(table, "newest", None)
    if newest is None:
        return None
    now_s = time.monotonic() if now_s is None else now_s
    return f"up {(now_s - 1e-6 * newest.clock_us) % CLOCK_TURN_S:.3f}"


def _same(before: str | None, now: str | None, age_s: float) -> bool:
    """Whether two names are of one power-up; two clocks may have drifted apart since."""
    if before is None or now is None or not (before.startswith("up ") and now.startswith("up ")):
        return before == now
    apart = abs(float(before[3:]) - float(now[3:]))
    return min(apart, CLOCK_TURN_S - apart) < BOOT_S + DRIFT * abs(age_s)


def home_file(rig_file: Path) -> Path:
    """Where the homing of a rig file's table is kept."""
    return rig_file.with_suffix(".home.json")


def load(path: Path) -> Homed:
    """The kept homing. NotHomed: there is none, or the file is none."""
    if not path.is_file():
        raise NotHomed(f"this table has not been homed ({path} is missing): {CURE}")
    try:
        return TypeAdapter(Homed).validate_json(path.read_bytes())
    except ValueError as error:
        first = str(error).splitlines()[0]
        raise NotHomed(f"{path} is no homing ({first}): {CURE}") from None
