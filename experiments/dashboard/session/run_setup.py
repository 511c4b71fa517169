"""Preparation of a run: folder, loop job and start record, for the virtual or the real table."""

from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path

import numpy as np

from experiments.dashboard.session import virtual_job
from experiments.dashboard.session.plan import PlannedRun, RunPlan
from experiments.dashboard.session.real_camera import RealCamera
from experiments.records.run_folder import new_run_folder, write_truth
from experiments.runs.hardware_run import Ready, check, ready
from experiments.runs.protocol import course
from experiments.runs.runner import RunRequest, start_record, truth_record
from rig.files import file_bytes
from rig.parameters import Rig
from rig.shared_memory import SharedArray


class VirtualRunSetup:
    """Prepares runs of the virtual table, in `out`/runs; the operator may be at the page
    (`RunPlan.by_hand`).
    """

    real = False

    def __init__(self, out: Path) -> None:
        self._runs = out / "runs"
        self._steps: SharedArray | None = None

    def check(self, plan: RunPlan, rig: Rig) -> None:
        """Raise ValueError where this table cannot run the plan; rig: the plant."""
        course(plan.protocol, rig, plan.seed)

    def confirm(self, operator_step: str) -> None:
        """Tell the simulation that the operator did `operator_step`, which begins with "place" or
        "release".
        """
        if self._steps is not None and not operator_step.startswith("hold"):
            step = virtual_job.PLACE if operator_step.startswith("place") else virtual_job.RELEASE
            self._steps.array[step] = 1.0

    @contextmanager
    def ready(self, planned: PlannedRun, rig: Rig) -> Iterator[Ready]:
        """Make the run's folder and give the run, ready to start, for as long as the context lasts;
        rig: the plant. ValueError, OSError: as `course` and `new_run_folder` raise them.
        """
        plan = planned.plan
        request = RunRequest(rig, plan.protocol, planned.method, planned.seed, self._runs)
        try:
            if plan.by_hand and not plan.protocol.servo_only:
                self._steps = SharedArray((2,), np.dtype(np.float64))
            job = virtual_job.virtual_job(
                rig,
                planned.method,
                course(plan.protocol, rig, planned.seed),
                protocol=plan.protocol,
                seed=planned.seed,
                speed=plan.speed,
                steps=self._steps,
            )
            folder = new_run_folder(request.parent, plan.protocol.name, planned.method)
            write_truth(folder, truth_record(request))
            yield Ready(request, job, folder, start_record(request))
        finally:
            steps, self._steps = self._steps, None
            if steps is not None:
                steps.close()


class RealRunSetup:
    """Prepares runs of the table that a rig file names, in `out`/runs; camera: lent to each run.

    The table is homed before and armed anew for every run. A person places the ball and lets it go,
    which the loop recognises from the ball's position.
    """

    real = True

    def __init__(self, rig_file: Path, out: Path, camera: RealCamera | None = None) -> None:
        self._file, self._runs, self._camera = rig_file, out / "runs", camera
        self._content = file_bytes(rig_file)

    def check(self, plan: RunPlan, rig: Rig) -> None:
        """Raise what keeps the table from running the plan: ValueError or OSError for no port, no
        homing, a camera in use, a protocol beyond the limits, a rig file that was changed.
        """
        self._check_file()
        check(rig, self._file, plan.protocol)
        course(plan.protocol, rig, plan.seed)
        if self._camera is not None:
            self._camera.check_free()

    def confirm(self, operator_step: str) -> None:
        """Raise ValueError: a real table sees from the ball that the step was done."""
        raise ValueError("just do it: the table sees from the ball that it was done")

    @contextmanager
    def ready(self, planned: PlannedRun, rig: Rig) -> Iterator[Ready]:
        """Give the run, ready to start and not yet armed, for as long as the context lasts; the
        camera is lent to it until then. ValueError, OSError: table or camera cannot be used, or
        the rig file was changed.
        """
        self._check_file()
        request = RunRequest(rig, planned.plan.protocol, planned.method, planned.seed, self._runs)
        lend = self._camera.lend() if self._camera else nullcontext(lambda eye: None)
        with lend as show_through, ready(request, self._file) as run:
            show_through(run.eye)
            yield run

    def _check_file(self) -> None:
        """ValueError: the page would drive the table by what the rig file no longer says."""
        if file_bytes(self._file) != self._content:
            raise ValueError(
                f"{self._file} was changed since this page was started, which knows only what it "
                "was: start rig dashboard again"
            )
