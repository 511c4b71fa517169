"""One recorded run on a real table: loop and camera in processes of their own, a person as hand."""

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from experiments.hardware import check_there, open_homed
from experiments.live_eye import open_ball, watching
from experiments.live_run import record_live
from experiments.protocol import OWN, Protocol, course
from experiments.run_folder import new_run_folder, plain, read_meta, replace_json
from experiments.runner import Done, Order, Watch, arm_number, start_record
from experiments.telling import Telling
from rig.hardware.eye import CameraEye
from rig.hardware.homed import home_file, load
from rig.loop_process import Job
from rig.parameters import Rig

NOTES = "table.json"  # what the table's driver has to say, until it is in run.json


def check(rig: Rig, rig_file: Path, protocol: Protocol) -> None:
    """ValueError or FileNotFoundError before anything is opened: no port, no homing, or a protocol
    that this table cannot run."""
    check_there(rig)
    homed = load(home_file(rig_file))
    homed.check(rig, homed.boot_id)
    if protocol.servo_only:
        return
    if not rig.table.camera and rig.table.kind != "remote":
        raise ValueError(
            f"protocol '{protocol.name}' needs to see the ball: set table.camera and "
            "table.calibration, or run a servo protocol"
        )
    if protocol.pushes.kind == "at-centre":
        raise ValueError("pushes at-centre are for the virtual table: use pushes drawn")


@dataclass(frozen=True, eq=False)
class Ready:
    """A run that only has to be begun: the order as asked of a person, its job, its folder, what is
    known of it beforehand, and the eye of its camera."""

    order: Order
    job: Job
    folder: Path
    start: dict
    eye: CameraEye | None = None


@contextmanager
def ready(order: Order, rig_file: Path) -> Iterator[Ready]:
    """Check the rig file's real table, start its camera, make the run's folder. Nothing is armed
    before the job is run. ValueError, OSError, NotHomed: the table cannot be used."""
    check(order.rig, rig_file, order.protocol)
    order = replace(order, protocol=_asked(order.protocol))
    way = course(order.protocol, order.rig, order.seed, place_std_m=0.0)
    folder = new_run_folder(order.parent, order.protocol.name, order.arm)
    start = start_record(order) | _measured(order.rig)
    try:
        with watching(order.rig, open_ball) if order.rig.table.camera else nullcontext() as eye:
            table = partial(open_homed, order.rig, rig_file, eye, folder / NOTES)
            job = Job(
                table, order.believed, arm_number(order.arm), way,
                controller=order.protocol.controller if order.arm == OWN else "",
            )  # fmt: skip
            yield Ready(order, job, folder, start, eye)
    finally:
        _keep_notes(folder)


def measure(
    order: Order,
    rig_file: Path,
    *,
    say: Callable[[str], None] = print,
    progress: Callable[[float], None] | None = None,
) -> Done:
    """Run an order on the rig file's real table; the person is told what to do through `say`.

    Ctrl-C and SIGTERM end the run in order: level, 0 V, the reason in the recording. NotHomed,
    OSError: the table cannot be used; what was recorded stays readable.
    """
    with ready(order, rig_file) as run:
        recorder = Telling(run.folder, run.start)
        watch = Watch(run.order, recorder, progress)
        recorder.say = lambda t_s, text: say(f"{t_s:7.1f} s  {text.removeprefix('asked: ')}")
        recorder.at_end = partial(watch.note_pushes, run.order.believed)
        with recorder:
            ending = record_live(run.job, recorder, started=watch.stop_through, watch=watch.look)
    return Done(run.folder, ending, np.zeros((0, 5)))


def _asked(protocol: Protocol) -> Protocol:
    """A person has to be asked for the ball, whether the protocol says so or not."""
    if protocol.servo_only or protocol.operator:
        return protocol
    steps = ["place", "hold", "release"] if protocol.start.hold_s > 0 else ["place"]
    return protocol.model_copy(update={"operator": steps})


def _measured(rig: Rig) -> dict:
    """What differs in the start record of a measured run."""
    table = rig.table
    seen = "none" if not table.camera else table.camera
    return {
        "source": "measured",
        "table": table.kind,
        "camera": "served" if table.kind == "remote" and not table.camera else seen,
        "calibration": Path(table.calibration).name if table.calibration else None,
    }


def _keep_notes(folder: Path) -> None:
    """Move the driver's notes into run.json."""
    path = folder / NOTES
    if not path.is_file():
        return
    notes = plain(json.loads(path.read_text()))
    replace_json(folder / "run.json", read_meta(folder) | {"link": notes})
    path.unlink()
