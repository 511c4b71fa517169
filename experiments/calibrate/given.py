"""What a calibration is made from: recorded runs, or the virtual table on which a ball is led."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calibration.camera.sheet import CalibrationError
from experiments.analysis.alike import difference_words
from experiments.calibrate.folder import Source
from experiments.records.importing import read_log, refuse_same_rows
from experiments.records.made_with import Entries, entries
from experiments.records.recording import read_run
from experiments.records.run_folder import plain, refuse_twice
from experiments.runs.assemble import known
from rig.control.controllers import WITHOUT
from rig.course import Course
from rig.log import Log
from rig.parameters import Rig
from rig.rigfile import to_record
from rig.simulation.simulate import draw, simulate

# Sections and numbers of the rig file that no calibration changes.
TABLE = ("servo.kind", "servo.angle_measured", "linkage.", "ball.radius_m", "ball.hollow")
LEVEL_HZ, LEVEL_M = (0.35, 0.45), 0.05
STEP_S, STEP_M = (0.4, 1.6), (0.01, 0.05)  # chosen: quicker than the ball can follow, and slower


@dataclass(frozen=True, eq=False)
class Given:
    """A log from a file or run folder; `delay_s`: of the camera, as far as its times know it."""

    log: Log
    source: Source
    delay_s: float | None


def read_given(path: Path, rig: Rig) -> Given:
    """The log of a file or run folder that was recorded on the table `rig`.

    FileNotFoundError: nothing is there. ValueError: it cannot be used, or a run folder says that it
    is of another table.
    """
    if not path.exists():
        raise FileNotFoundError(f"{path}: no such run folder or log")
    if not path.is_dir():
        return Given(read_log(path), "measured", None)
    whole = read_run(path)
    one, other = (_table(record) for record in (whole.meta.get("rig") or {}, plain(to_record(rig))))
    if words := difference_words(one, other):
        raise ValueError(
            f"{path}: was recorded on another table than the rig file's, in {words}; name the "
            "rig file of its table with --rig"
        )
    if whole.meta.get("source") != "simulated":
        return Given(whole.log, "measured", float(whole.meta.get("camera_late_s", 0.0)))
    delay = ((whole.meta.get("rig") or {}).get("camera") or {}).get("delay_s")
    return Given(whole.log, "simulated", None if delay is None else float(delay))


def read_all(paths: Sequence[Path], rig: Rig) -> list[Given]:
    """`read_given` of each path. ValueError, too, where one is named twice, or two hold the same
    rows: they would count twice."""
    refuse_twice(paths)
    given = [read_given(path, rig) for path in paths]
    refuse_same_rows([one.log for one in given], [str(path) for path in paths])
    return given


def _table(record: dict) -> Entries:
    """What tells two tables apart, calibrated anew or not, of the rig in a run's record."""
    made = entries(Path(), {"source": "measured", "rig": record})
    return {k: v for k, v in made.items() if k.startswith(("source", *TABLE))}


def source_of(given: Sequence[Given]) -> Source:
    return "measured" if any(one.source == "measured" for one in given) else "simulated"


def write_csv(path: Path, names: str, columns: np.ndarray) -> None:
    """Write `columns` (n, k) under the comma-separated `names`. OSError: it cannot be written."""
    np.savetxt(path, columns, "%.9g", ",", header=names, comments="")


def led_about(rig: Rig, seconds: float, rng: np.random.Generator) -> Log:
    """Log of a simulated run of `seconds` in which the ball follows a sine on each axis.

    CalibrationError: the run ended before `seconds` were over.
    """
    t = np.arange(round(seconds * rig.control_rate_hz)) / rig.control_rate_hz
    targets = LEVEL_M * np.column_stack([np.sin(2 * np.pi * f * t) for f in LEVEL_HZ])
    return _led(rig, targets, rng)


def led_in_steps(rig: Rig, seconds: float, rng: np.random.Generator) -> Log:
    """Log of a simulated run of `seconds` in which the ball is sent to and fro in steps of random
    sizes and durations on each axis.

    CalibrationError: the run ended before `seconds` were over.
    """
    n = round(seconds * rig.control_rate_hz)
    targets = np.zeros((n, 2))
    for a in range(2):
        at, way = 0, 1.0
        while at < n:
            ticks = round(rng.uniform(*STEP_S) * rig.control_rate_hz)
            targets[at : at + ticks, a] = way * rng.uniform(*STEP_M)
            at, way = at + ticks, -way
    return _led(rig, targets, rng)


def _led(rig: Rig, targets: np.ndarray, rng: np.random.Generator) -> Log:
    course = Course(targets, np.zeros_like(targets))
    run = simulate(rig, known(rig), WITHOUT, course, draw(rng, rig, course))
    if run.outcome != "completed":
        raise CalibrationError(f"the run in which the ball is led about ended early: {run.outcome}")
    return run.log
