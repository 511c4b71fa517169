"""`rig home` and `rig run` as typed, in this process and in a board's own time: nothing is late."""

import sys
from collections.abc import Callable
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from experiments.cli import application
from experiments.records.recording import Run, read_run
from experiments.runs.assemble import load_rig
from rig.hardware.board.board import BoardTable
from rig.hardware.board.serial_link import SerialLink
from rig.hardware.board.usb_link import UsbLink
from rig.hardware.wiring import Wiring
from rig.loop.commands import CommandSlot
from rig.loop.job import Job
from rig.loop.loop import Ending, Loop, ending_of
from rig.parameters import Ball, Rig
from rig.plant.ball import tilt_sines
from tests.support.boards.pty import PtyBoard, SteppedLink
from tests.support.boards.usb_fake import FakeUsb
from tests.support.boards.world import World
from tests.support.exact_bundle import exact_bundle
from vision.frames import Observation
from vision.synthetic.synthetic import Scene, virtual_view

AWAY_M = (1.0, 1.0)  # of a ball that lies in a drawer
PICTURE_S = 1 / 60
SQUARES = """title = "squares"
duration_s = 2.0
servo_only = true
[reference]
shape = "squares"
amplitude = 0.1
period_s = 1.0
[start]
hold_s = 0.0
"""
KNOWN = "[servo]\ngain_rad_s_V = 1.735\ntime_constant_s = 0.046\n"


class LoopHere:
    """Stands for `LoopProcess`: the same job in this process."""

    def __init__(self, job: Job) -> None:
        self._job, self._slot, self.notes = job, CommandSlot(), {}
        self.put = self._slot.put

    def run(self, keep, event) -> Ending:
        job = self._job
        try:
            with job.table() as table:  # pyright: ignore[reportGeneralTypeIssues]
                inbox, way = self._slot, job.course
                loop = Loop(
                    table, job.known, job.compensator, way, commands=inbox, keep=keep, event=event
                )
                return loop.run()
        except BaseException as error:
            return ending_of(error)


class WorldsEye:
    """Stands for the camera's process: the plant's statistical camera on the table's clock."""

    def __init__(self, world: Any) -> None:
        self._world, self._zero_s = world, 0.0

    def begin(self, zero_s: float) -> None:
        self._zero_s = zero_s

    def tell(self, theta_rad: tuple[float, float]) -> None:
        pass

    def latest(self, after_s: float) -> Observation | None:
        if not self._world.balls:
            return None
        ball = self._world.balls[-1]
        exposed_s = ball.exposed_s - self._zero_s
        return Observation(ball.xy_m, ball.cov_m2, exposed_s) if exposed_s > after_s else None


def worlds_eye(folder: Path, ball: Ball) -> str:
    """Lines of [table] for a camera that the world stands in for, and its calibration on disk."""
    scene = Scene(ball_radius_m=ball.radius_m)
    exact_bundle(virtual_view(), scene).save(folder / "calibration.json")
    return 'camera = "the world\'s"\ncalibration = "calibration.json"\n'


class Lab:
    """A board with its plant, plugged in by `cable` ("serial" or "usb"), and its rig file.

    An assistant lays the ball at `start_m` when a run begins and lets it go 1.5 s later.
    """

    def __init__(
        self, board, cable: str, folder: Path, patch: pytest.MonkeyPatch, capsys, *,
        wiring: Wiring | None = None, markers: bool = True,
    ) -> None:  # fmt: skip
        self.known = load_rig(None)
        self.world = World(board, self.known, start_m=AWAY_M, wiring=wiring)
        self.folder, self.rig_file, self._capsys = folder, folder / "lab.toml", capsys
        self._patch, self.markers, self._next_s = patch, markers, 0.0
        self.most_V, self.then = 0.0, lambda run_s: None
        self._begun_s: float | None = None
        self.start_m = (-0.1, 0.1)
        self.world.watch = self._watch
        self.pty, self.usb = PtyBoard(self.world, thread=False), FakeUsb(self.world)
        named = f'port = "{self.pty.port}"' if cable == "serial" else 'address = "1209:0001"'
        eye = worlds_eye(folder, self.known.ball)
        self.rig_file.write_text(f'{KNOWN}[table]\nkind = "{cable}"\n{named}\n{eye}')
        self._stand_in()

    def clock(self) -> float:
        return self.world.now_s

    def _stand_in(self) -> None:
        """The world's time for the driver, and this process for the two that a run has else."""

        def serial(port: str, baud: int) -> SteppedLink:
            return SteppedLink(self.pty, SerialLink(port, baud))

        def usb(*numbers: int) -> UsbLink:
            return UsbLink(*numbers, backend=self.usb, clock=self.clock)

        @contextmanager
        def seeing(rig: Rig, recipe):
            yield WorldsEye(self.world)

        @contextmanager
        def tilt(rig: Rig):
            yield self._tilt

        def table(*arguments, **named) -> BoardTable:
            return BoardTable(*arguments, **named, clock=self.clock)

        for name, stand_in in {
            "rig.hardware.board.serial_link.SerialLink": serial,
            "rig.hardware.board.usb_link.UsbLink": usb,
            "rig.hardware.board.board.BoardTable": table,
            "experiments.runs.hardware.plate_tilt": tilt,
            "experiments.runs.hardware.go_realtime": dict,
            "experiments.runs.hardware_run.watching": seeing,
            "experiments.runs.live_run.LoopProcess": LoopHere,
        }.items():
            self._patch.setattr(name, stand_in)

    def _tilt(self, t_s: float) -> tuple[float, float] | None:
        if not self.markers or self.world.now_s < self._next_s:
            return None
        self._next_s = self.world.now_s + PICTURE_S
        x, y = self.world.plant.truth()["plate_rad"]
        return tilt_sines((float(x), float(y)), self.known.linkage.ratio)

    def _watch(self) -> None:
        self.most_V = max(self.most_V, *map(abs, self.world.volts))
        if self._begun_s is not None:
            run_s = self.world.now_s - self._begun_s
            if run_s > 1.5:
                self.world.plant.release()
            self.then(run_s)

    def lay_the_ball(self, then: Callable[[float], None] = lambda run_s: None) -> None:
        """For the run to come; `then` is called in every millisecond of it."""
        self.world.plant.place(self.start_m)
        self._begun_s, self.then, self.most_V = self.world.now_s, then, 0.0

    def call(self, *words: str) -> tuple[int, str, str]:
        """Type it; the exit code and what was said. A finished program leaves its board alone."""
        self._patch.setattr(sys, "argv", ["rig", *words, "--rig", str(self.rig_file), "--yes"])
        code = 0
        try:
            application.main()
        except SystemExit as end:
            code = int(end.code or 0)
        self._begun_s = None
        self.world.plant.place(AWAY_M)
        said = self._capsys.readouterr()
        return code, said.out, said.err

    def run(self, text: str, *words: str) -> tuple[int, str, Run]:
        """`rig run` of a protocol: exit code, what was said, the recording."""
        protocol = self.folder / "mine.toml"
        protocol.write_text(text)
        out = self.folder / f"out{len(list(self.folder.iterdir()))}"
        code, said, error = self.call(
            "run", str(protocol), "--out", str(out), "--arm", "with", *words
        )
        (folder,) = (out / "runs").iterdir()
        return code, said + error, read_run(folder)

    def close(self) -> None:
        self.pty.close()
        self.world.board.close()
