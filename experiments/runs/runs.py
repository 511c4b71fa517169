"""Run a protocol's arms and repetitions, and keep or reject what came out."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path

import numpy as np

from experiments.progress import ProgressCall, silent
from experiments.records.recording import being_recorded, lock
from experiments.records.run_folder import read_meta, refuse_other, replace_json, write_results
from experiments.runs.assemble import virtual_renderer
from experiments.runs.own_run import run_own
from experiments.runs.protocol import OWN, Protocol
from experiments.runs.runner import FinishedRun, RunRequest, run
from rig.files import freed
from rig.parameters import Rig

LOCK_FILE = ".camera.lock"


def calibrate_camera(rig: Rig, out: Path, seed: int) -> Path:
    """Calibrate the virtual camera from its own pictures, as a real one is calibrated.

    The pictures are drawn from `seed`. Returns the path of the bundle, calibration.json in `out`.
    CalibrationError: the pictures are refused; OSError: `out` cannot be written. ValueError: the
    calibration there is of another camera, which is told before any picture is drawn.
    """
    from calibration.bundle import calibrate_virtual

    path = _place(out)
    renderer = virtual_renderer(rig, np.random.default_rng([seed, 6]))
    bundle = calibrate_virtual(renderer, np.random.default_rng([seed, 7]))
    bundle.save(path)
    return path


def _place(out: Path) -> Path:
    """The file of the virtual camera's calibration. ValueError: what is there is another's."""
    path = out / "calibration.json"
    refuse_other(
        path, "the virtual camera's calibration is", lambda c: c.get("source") == "simulated"
    )
    return path


@contextmanager
def own_calibration(rig: Rig, out: Path, seed: int) -> Iterator[Path]:
    """`calibrate_camera`, and no other program does so in `out` as long as the context lasts.

    ValueError: another one does; and errors as of `calibrate_camera`.
    """
    _place(out)  # before the folder is touched
    out.mkdir(parents=True, exist_ok=True)
    with freed(out / LOCK_FILE).open("a") as file:
        if not lock(file.fileno()):
            raise ValueError(
                f"{out}: another program makes runs through frames there, with a calibration.json "
                "of its own: name another --out"
            )
        yield calibrate_camera(rig, out, seed)


def run_protocol(
    rig: Rig,
    protocol: Protocol,
    *,
    arms: Sequence[str],
    out: Path,
    seed: int,
    repetitions: int,
    frames: bool = False,
    progress: ProgressCall = silent,
) -> list[FinishedRun]:
    """Run every repetition of every arm on the simulated table, and write results.json in `out`.

    Repetition i has the seed `seed` + i; all arms of a seed get the same course. frames: use the
    rendered camera, calibrated first. progress: called with a label, what is done and the total.
    Errors as of `runner.run` and `own_calibration`.
    """
    with own_calibration(rig, out, seed) if frames else nullcontext() as bundle:
        requests = [
            RunRequest(rig, protocol, arm, seed + i, out / "runs", bundle)
            for i in range(repetitions)
            for arm in arms
        ]
        done = []
        for i, request in enumerate(requests):
            label = f"{protocol.name} {request.arm} {request.seed}"
            total = round(protocol.duration_s)
            make = run_own if request.arm == OWN else run
            done.append(make(request, progress=lambda t, s=label, n=total: progress(s, int(t), n)))
            progress(label, total, total)
            progress("runs", i + 1, len(requests))
    runs = [
        {"folder": one.folder.name, "arm": request.arm, "seed": request.seed}
        | {"outcome": one.ending.outcome, "reason": one.ending.reason}
        for request, one in zip(requests, done, strict=True)
    ]
    write_results(out, {"source": "simulated", "protocol": protocol.name, "runs": runs})
    return done


def measure_protocol(
    rig: Rig,
    rig_file: Path,
    protocol: Protocol,
    *,
    arms: Sequence[str],
    out: Path,
    seed: int,
    repetitions: int,
    arm_table: Callable[[str], None],
    say: Callable[[str], None],
) -> list[FinishedRun]:
    """Run every repetition of every arm on the real table, and write results.json in `out`.

    Repetition i has the seed `seed` + i; all arms of a seed get the same course. arm_table: called
    with a sentence before every run, asks for consent; say: called with each line for the person at
    the table. A run that neither completed nor lost the ball is the last one; results.json is
    written in any case. ValueError (also NotHomed), OSError: the table cannot be used.
    """
    from experiments.runs.hardware_run import check, measure

    check(rig, rig_file, protocol)
    requests = [
        RunRequest(rig, protocol, arm, seed + i, out / "runs")
        for i in range(repetitions)
        for arm in arms
    ]
    done: list[FinishedRun] = []
    try:
        for i, request in enumerate(requests):
            arm_table(f"Run {i + 1} of {len(requests)}: {protocol.title}, {request.arm} the model.")
            done.append(measure(request, rig_file, say=say))
            if done[-1].ending.outcome not in ("completed", "ball lost"):
                break
    finally:
        runs = [
            {"folder": one.folder.name, "arm": request.arm, "seed": request.seed}
            | {"outcome": one.ending.outcome, "reason": one.ending.reason}
            for request, one in zip(requests, done, strict=False)
        ]
        write_results(out, {"source": "measured", "protocol": protocol.name, "runs": runs})
    return done


def reject(folder: Path, reason: str) -> None:
    """Mark a run as rejected, with the reason, in its run.json.

    FileNotFoundError: the folder has no run.json; ValueError: that of another version, or the run
    is still being recorded, whose end would forget it, or the reason is no text.
    """
    if not (folder / "run.json").is_file():
        raise FileNotFoundError(f"{folder} is no run folder: it has no run.json")
    if being_recorded(folder):
        raise ValueError(f"{folder} is still being recorded: reject it when it has ended")
    if not reason.strip():
        raise ValueError("the reason is empty: say why, in a word at least")
    if not reason.isprintable():
        raise ValueError("the reason holds control characters: write it as plain text")
    replace_json(folder / "run.json", read_meta(folder) | {"rejected": reason})
