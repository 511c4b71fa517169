"""One recorded run on a real table: loop and camera in processes of their own, a person as hand."""

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from experiments.records.run_folder import new_run_folder, plain, read_meta, replace_json
from experiments.runs.hardware import check_there, open_homed
from experiments.runs.live_eye import open_ball, real_calibration, watching
from experiments.runs.live_run import AnnouncingRecorder, record_live
from experiments.runs.protocol import OWN, Protocol, course
from experiments.runs.runner import FinishedRun, RunRequest, Watch, compensator_index, start_record
from rig.hardware.camera.eye import CameraEye
from rig.hardware.homing.homed import Homed, home_file, load
from rig.loop.job import Job
from rig.parameters import Rig
from rig.safety.monitor import MonitorLimits
from vision.sources.addresses import without_password

NOTES = "table.json"  # what the table's driver has to say, until it is in run.json


def check(rig: Rig, rig_file: Path, protocol: Protocol) -> Homed:
    """Check, before anything is opened, that the rig file's table can run the protocol; return its
    homing.

    FileNotFoundError: the port is not there. ValueError: there is no valid homing (NotHomed), the
    protocol needs a camera that the rig file does not name, its calibration is none of that camera,
    or the protocol's pushes are for the virtual table.
    """
    check_there(rig)
    homed = load(home_file(rig_file))
    homed.check(rig, homed.boot_id)
    camera_late_s(rig)
    if protocol.servo_only:
        return homed
    if not rig.table.camera and rig.table.kind != "remote":
        raise ValueError(
            f"protocol '{protocol.name}' needs to see the ball: set table.camera and "
            "table.calibration, or run a servo protocol"
        )
    if protocol.pushes.kind == "at-centre":
        raise ValueError("pushes at-centre are for the virtual table: use pushes drawn")
    return homed


@dataclass(frozen=True, eq=False)
class Ready:
    """A run that is ready to begin.

    request: with the steps that a person is asked for; job: loop and table for `LoopProcess`;
    folder: of the run; start: its start record; eye: of the table's camera, None without one.
    """

    request: RunRequest
    job: Job
    folder: Path
    start: dict
    eye: CameraEye | None = None


@contextmanager
def ready(request: RunRequest, rig_file: Path) -> Iterator[Ready]:
    """Check the rig file's real table, start its camera and make the run's folder.

    Nothing is armed before the job is run. When the context ends the driver's notes are moved into
    run.json. ValueError (also NotHomed), OSError: the table or its camera cannot be used.
    """
    breakaway_V = check(request.rig, rig_file, request.protocol).breakaway_V
    request = replace(request, protocol=_asked(request.protocol))
    way = course(request.protocol, request.rig, request.seed, place_std_m=0.0)
    start = start_record(request) | measured(request.rig)
    start["camera_late_s"] = camera_late_s(request.rig)
    folder = new_run_folder(request.parent, request.protocol.name, request.arm)
    try:
        with watching(request.rig, open_ball) if request.rig.table.camera else nullcontext() as eye:
            table = partial(open_homed, request.rig, rig_file, eye, folder / NOTES)
            job = Job(
                table,
                request.believed,
                compensator_index(request.arm),
                way,
                limits=MonitorLimits.of_rig(request.believed, breakaway_V),
                controller=request.protocol.controller if request.arm == OWN else "",
            )
            yield Ready(request, job, folder, start, eye)
    finally:
        _keep_notes(folder)


def measure(
    request: RunRequest,
    rig_file: Path,
    *,
    say: Callable[[str], None] = print,
    progress: Callable[[float], None] | None = None,
) -> FinishedRun:
    """Run a request on the rig file's real table and record it.

    say: called with each line for the person at the table, such as what to do next; progress:
    called with the run's time [s]. Ctrl-C and SIGTERM end the run in order: level, 0 V, the reason
    in the recording. ValueError (also NotHomed), OSError: the table cannot be used; what was
    recorded stays readable.
    """
    with ready(request, rig_file) as run:
        recorder = AnnouncingRecorder(run.folder, run.start)
        watch = Watch(run.request, recorder, progress)
        recorder.say = lambda t_s, text: say(f"{t_s:7.1f} s  {text.removeprefix('asked: ')}")
        recorder.at_end = partial(watch.note_pushes, run.request.believed)
        with recorder:
            ending = record_live(run.job, recorder, started=watch.stop_through, watch=watch.check)
    return FinishedRun(run.folder, ending, np.zeros((0, 5)))


def _asked(protocol: Protocol) -> Protocol:
    """A person has to be asked for the ball, whether the protocol says so or not."""
    if protocol.servo_only or protocol.operator:
        return protocol
    steps = ["place", "hold", "release"] if protocol.start.hold_s > 0 else ["place"]
    return protocol.model_copy(update={"operator": steps})


def measured(rig: Rig) -> dict:
    """What differs in the start record of a measured run."""
    table = rig.table
    seen = without_password(table.camera) or "none"
    return {
        "source": "measured",
        "table": table.kind,
        "camera": "served" if table.kind == "remote" and not table.camera else seen,
        "calibration": Path(table.calibration).name if table.calibration else None,
    }


def camera_late_s(rig: Rig) -> float:
    """What is subtracted from the stamps of the camera's frames [s]: 0 where nothing is measured.

    ValueError (also BundleError), OSError: the calibration cannot be used.
    """
    return real_calibration(rig).stamped_late_s if rig.table.camera else 0.0


def _keep_notes(folder: Path) -> None:
    """Move the driver's notes into run.json."""
    path = folder / NOTES
    if not path.is_file():
        return
    notes = plain(json.loads(path.read_text()))
    replace_json(folder / "run.json", read_meta(folder) | {"link": notes})
    path.unlink()
