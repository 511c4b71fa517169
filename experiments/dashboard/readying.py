"""What a run needs before it begins: on the virtual table, or on the rig file's real one."""

from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path

import numpy as np

from experiments.dashboard import recipes
from experiments.dashboard.plan import Leg, Plan
from experiments.dashboard.real_camera import RealCamera
from experiments.hardware_run import Ready, check, ready
from experiments.protocol import course
from experiments.run_folder import new_run_folder, write_truth
from experiments.runner import Order, start_record, truth_record
from rig.parameters import Rig
from rig.shared_ring import SharedArray


class VirtualTable:
    """Runs on the rig's plant; with `Plan.by_hand` the operator at the page is the ball's hand."""

    real = False

    def __init__(self, out: Path) -> None:
        self._runs = out / "runs"
        self._words: SharedArray | None = None

    def check(self, plan: Plan, rig: Rig) -> None:
        """ValueError: the plan is impossible on this table."""
        course(plan.protocol, rig, plan.seed)

    def confirm(self, asked: str) -> None:
        """The operator has done what was asked for."""
        if self._words is not None and not asked.startswith("hold"):
            step = recipes.PLACE if asked.startswith("place") else recipes.RELEASE
            self._words.array[step] = 1.0

    @contextmanager
    def ready(self, leg: Leg, rig: Rig) -> Iterator[Ready]:
        plan = leg.plan
        order = Order(rig, plan.protocol, leg.arm, leg.seed, self._runs)
        way = course(plan.protocol, rig, leg.seed)
        if plan.by_hand and not plan.protocol.servo_only:
            self._words = SharedArray((2,), np.dtype(np.float64))
        job = recipes.job(
            rig, leg.arm, way, protocol=plan.protocol, seed=leg.seed, speed=plan.speed,
            words=self._words,
        )  # fmt: skip
        folder = new_run_folder(order.parent, plan.protocol.name, leg.arm)
        write_truth(folder, truth_record(order))
        try:
            yield Ready(order, job, folder, start_record(order))
        finally:
            words, self._words = self._words, None
            if words is not None:
                words.close()


class RealTable:
    """Runs on the table that the rig file names: homed before, armed for every run anew, the ball
    placed and let go by a person, which the loop sees from the ball."""

    real = True

    def __init__(self, rig_file: Path, out: Path, camera: RealCamera | None = None) -> None:
        self._file, self._runs, self._camera = rig_file, out / "runs", camera

    def check(self, plan: Plan, rig: Rig) -> None:
        """ValueError, OSError: no port, no homing, no free camera, or a protocol beyond it."""
        check(rig, self._file, plan.protocol)
        course(plan.protocol, rig, plan.seed)
        if self._camera is not None:
            self._camera.check_free()

    def confirm(self, asked: str) -> None:
        raise ValueError("just do it: the table sees from the ball that it was done")

    @contextmanager
    def ready(self, leg: Leg, rig: Rig) -> Iterator[Ready]:
        order = Order(rig, leg.plan.protocol, leg.arm, leg.seed, self._runs)
        through = self._camera.lent() if self._camera else nullcontext(lambda eye: None)
        with through as shown, ready(order, self._file) as run:
            shown(run.eye)
            yield run
