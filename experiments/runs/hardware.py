"""A real table put together: driver, homing, camera. What stands between a rig file and a run."""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from math import inf
from pathlib import Path
from typing import Self

from experiments.records.run_folder import plain, replace_json
from experiments.runs.live_eye import open_markers, real_calibration, watching
from rig.hardware.camera.eye import CameraEye
from rig.hardware.choose import OpenTable, check_drive, open_table
from rig.hardware.homing.home import Homing, home
from rig.hardware.homing.home_angles import ByServo, home_angles
from rig.hardware.homing.homed import Homed, home_file, load, power_up
from rig.hardware.wiring import raw_wiring
from rig.loop.realtime import go_realtime
from rig.parameters import ANGLE_KINDS, BUS_KINDS, Rig
from rig.safety.levelling import LevelOnExit
from rig.table import ArmingStoppedError, Reading, Table, takes_angle, watch_arming

TILT_STALL_S = 2.0  # homing is slow: markers that are late do no harm
READ_S = 0.3  # chosen: nobody reads a question in less, a key that is held down answers sooner
MARKS = (8192, 24576)  # where a card's counters are put by homing, far from where they wake up


def is_hardware(rig: Rig) -> bool:
    """True if the rig file names a real table."""
    return rig.table.kind != "simulated"


def check_there(rig: Rig) -> None:
    """Check, before anything is opened, that the board's port is there.

    FileNotFoundError: `table.port` of a serial board or bus is a path that does not exist.
    """
    port, what = rig.table.port, "adapter" if rig.table.kind in BUS_KINDS else "board"
    if (
        rig.table.kind in ("serial", *ANGLE_KINDS)
        and port.startswith("/")
        and not Path(port).exists()
    ):
        raise FileNotFoundError(
            f"table.port = '{port}' is not there: plug the {what} in; rig doctor lists the ports"
        )


def consent(text: str, yes: bool) -> None:
    """Show `text` to a person at the table, who presses Enter before anything moves; `yes` True: do
    not ask.

    ValueError: nobody can be asked (no terminal), or nobody answered. KeyboardInterrupt: Ctrl-C.
    """
    if yes:
        return
    if not sys.stdin.isatty():
        raise ValueError("the table would move and nobody is there to be asked: add --yes")
    while True:
        print(f"{text}\nPress Enter to arm the table, Ctrl-C to leave it. ", end="", flush=True)
        _forget_typed()
        asked_s = time.monotonic()
        try:
            input()
        except EOFError:
            raise ValueError("not armed: nobody answered") from None
        if time.monotonic() - asked_s >= READ_S:
            return


def _forget_typed() -> None:
    """Forget what was typed ahead at the terminal: it was no answer to what is asked now."""
    try:
        import termios
    except ImportError:
        import msvcrt  # Windows

        while msvcrt.kbhit():  # pyright: ignore[reportAttributeAccessIssue]
            msvcrt.getwch()  # pyright: ignore[reportAttributeAccessIssue]
        return
    with suppress(termios.error, OSError, ValueError):  # no terminal of the system's
        termios.tcflush(sys.stdin, termios.TCIFLUSH)


@contextmanager
def plate_tilt(rig: Rig) -> Iterator[Callable[[float], tuple[float, float] | None]]:
    """Open the rig file's camera and give a function that measures the plate's tilt with it.

    The function takes a time (not used) and returns sin(phi_x), sin(phi_y) of Eq. 14, or None
    before markers were seen; always None where the rig file names no camera. Frames are evaluated
    in a process of their own: in this one they would hold the loop's interpreter. ValueError,
    OSError: the calibration cannot be used; CameraStopped (an OSError): no frame comes.
    """
    if not rig.table.camera:
        yield lambda t_s: None
        return
    real_calibration(rig)  # its error as it is; of the process it is a line of words
    with watching(rig, open_markers, stall_s=TILT_STALL_S) as eye:

        def tilt(t_s: float) -> tuple[float, float] | None:
            seen = eye.latest(-inf)
            return seen.xy_m if seen is not None else None

        yield tilt


def home_table(rig: Rig, rig_file: Path) -> tuple[Homing, Path]:
    """Home the table and save the result beside the rig file, replacing an earlier one.

    Returns what homing found and the path of the saved file. FileNotFoundError: the port is not
    there; HomingRefused: homing stopped, with its reason; ValueError, OSError: the table or its
    camera cannot be opened. An earlier homing is deleted once the table is open: what moves it from
    then on makes it worthless, and a table that somebody else uses stays homed.
    """
    check_drive(rig)
    check_there(rig)
    path = home_file(rig_file)
    with plate_tilt(rig) as tilt:
        go_realtime()  # where it is allowed: a late tick costs the board's trust
        table = open_table(rig, homed=False)
        with table:
            path.unlink(missing_ok=True)
            if takes_angle(table):
                servos = ByServo(table)  # pyright: ignore[reportArgumentType] - such a table can
                found = home_angles(servos, rig, raw_wiring(rig).zero_counts, tilt)
            else:
                found = home(table, rig, tilt)
            found = _marked(table, found)
            homed = Homed.of(found, rig, power_up(table))
    homed.save(path)
    return found, path


def _marked(table: Table, found: Homing) -> Homing:
    """Where a card keeps counting and cannot tell a power-up, its counters get a mark.

    After a power-up they are zero again, many turns from the mark, and `Homed.check_angles` sees.
    """
    shift = getattr(table, "shift_counts", None)
    if shift is None:
        return found
    import secrets
    from dataclasses import replace

    marks = tuple(MARKS[0] + secrets.randbelow(MARKS[1] - MARKS[0]) for _ in range(2))
    zeros = found.wiring.zero_counts
    shift((marks[0] - zeros[0], marks[1] - zeros[1]))
    return replace(found, wiring=replace(found.wiring, zero_counts=(marks[0], marks[1])))


class Checked(LevelOnExit):
    """A hardware table whose first reading is checked against its homing before it is armed.

    Reads and drives the table, and tells `eye` (if any) the servo angles. The driver's `notes`
    (clocks, lost ticks) are written to `notes_file` as JSON when the context ends, where there is
    room. Entering raises NotHomed (a ValueError) where the homing does not hold, OSError where the
    table cannot be read, and ArmingStoppedError where a stop was asked for meanwhile.
    """

    def __init__(
        self,
        table: OpenTable,
        rig: Rig,
        homed: Homed,
        eye: CameraEye | None = None,
        notes_file: Path | None = None,
    ) -> None:
        self._table, self._rig, self._homed = table, rig, homed
        self._eye, self._notes_file, self._told = eye, notes_file, (0.0, 0.0)
        self._stop_asked: Callable[[], bool] = lambda: False
        self.period_s, self.voltage_limit_V = table.period_s, table.voltage_limit_V
        self.takes_angle = takes_angle(table)

    @property  # what the loop says of levelling is the table's to do
    def level_s(self) -> float:  # pyright: ignore
        """Time [s] for which the table is levelled on the way out; 0 where it has no such time."""
        return getattr(self._table, "level_s", 0.0)

    @level_s.setter
    def level_s(self, seconds: float) -> None:  # pyright: ignore
        self._table.level_s = seconds  # pyright: ignore[reportAttributeAccessIssue]

    @property
    def stop_asked(self) -> Callable[[], bool]:
        """Looked at before and while the table is armed (`rig.table.watch_arming`)."""
        return self._stop_asked

    @stop_asked.setter
    def stop_asked(self, stopped: Callable[[], bool]) -> None:
        self._stop_asked = stopped
        watch_arming(self._table, stopped)  # pyright: ignore[reportArgumentType]

    def __enter__(self) -> Self:
        try:
            first = self._table.read()
            self._homed.check(self._rig, power_up(self._table))  # before anything is armed
            if not takes_angle(self._table):  # one that does cannot lose its place
                self._homed.check_angles(first.theta_rad)
            if self._eye is not None:
                self._eye.begin(self._table.zero_s)  # pyright: ignore[reportAttributeAccessIssue]
            if self._stop_asked():  # opening and the first reading took seconds
                raise ArmingStoppedError
            self._table.__enter__()
        except BaseException:
            self._table.close()
            raise
        return self

    def __exit__(self, *error) -> None:
        try:
            self._table.__exit__(*error)
        finally:
            notes = getattr(self._table, "notes", None)
            if notes is not None and self._notes_file is not None:
                with suppress(OSError):  # a full disk makes no other run of one that was completed
                    replace_json(self._notes_file, plain(notes()))

    def read(self) -> Reading:
        """Wait for the table's next reading; its angles [rad], or those that the servos were told
        where nobody measures them, are passed on to the eye. OSError: the table or its camera is
        lost.
        """
        reading = self._table.read()
        if self._eye is not None:
            self._eye.tell(reading.theta_rad if self._rig.servo.has_angle else self._told)
        return reading

    def drive(self, volts: tuple[float, float]) -> None:
        """Apply the volts (x, y) [V]. ValueError, OSError: as the table's driver raises them."""
        self._told = volts
        self._table.drive(volts)

    def close(self) -> None:
        """Close the table without levelling it."""
        self._table.close()


def open_homed(
    rig: Rig, rig_file: Path, eye: CameraEye | None = None, notes_file: Path | None = None
) -> Checked:
    """Open the rig file's table with the wiring found by homing; its context checks, then arms.

    eye: the camera's, None without a camera; notes_file: see `Checked`. NotHomed (a ValueError):
    there is no homing beside the rig file; ValueError, OSError: the table cannot be opened.
    """
    homed = load(home_file(rig_file))
    table = open_table(rig, eye, wiring=homed.wiring, breakaway_V=homed.breakaway_V)
    return Checked(table, rig, homed, eye, notes_file)


class VirtualServos:
    """The virtual table's servos, told one by one and read as if they went where they are told; it
    keeps three arms' height, whatever they do.
    """

    def __init__(self, table: Table, rig: Rig) -> None:
        self.period_s, self.voltage_limit_V = table.period_s, table.voltage_limit_V
        self.turned_rad = self._told = (0.0,) * rig.linkage.servos
        self.travel_rad = (2 * rig.servo.stop_rad,) * rig.linkage.servos
        self._table, self._linkage = table, rig.linkage
        self._step_rad = min(rig.servo.pair("rate_limit_rad_s")) * table.period_s

    def read(self) -> Reading:
        """Wait for the next tick. OSError: never."""
        ways, most = zip(self.turned_rad, self._told, strict=True), self._step_rad
        self.turned_rad = tuple(now + min(max(told - now, -most), most) for now, told in ways)
        return self._table.read()

    def turn(self, angles: tuple[float, ...]) -> None:
        """Tell the servos angles from level [rad]. ValueError: they are not finite."""
        self._told = tuple(angles)
        self._table.drive(self._linkage.table_angles(self._told))

    def close(self) -> None:
        """Close the table."""
        self._table.close()


def rehearse_home(rig: Rig) -> Homing:
    """Home the virtual table, with the tilt of its plate as markers would show it.

    HomingRefused: homing stopped, with its reason.
    """
    import numpy as np

    from rig.plant.ball import tilt_sines
    from rig.simulation.simulator import SimulatedTable

    table = SimulatedTable(rig, np.random.default_rng(1), start_m=(1.0, 1.0))
    table.level_s = 0.0

    def tilt(t_s: float) -> tuple[float, float]:
        x, y = table.truth()["plate_rad"]
        return tilt_sines((float(x), float(y)), rig.linkage.ratio)

    with table:
        if rig.servo.takes_angle:
            servos = ByServo(VirtualServos(table, rig))
            return home_angles(servos, rig, raw_wiring(rig).zero_counts, tilt)
        return home(table, rig, tilt)
