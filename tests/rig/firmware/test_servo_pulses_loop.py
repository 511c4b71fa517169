"""The hobby table under the ordinary loop: the real servo firmware, pulses at simulated pins."""

from dataclasses import replace

import numpy as np
import pytest

from experiments.runs.assemble import known, load_rig
from experiments.runs.protocol import course, read_protocol
from rig.control.controllers import COMPENSATORS
from rig.hardware.board.pulse_servo import PulseServo
from rig.log import Log
from rig.loop.loop import Loop
from rig.simulation.operator import SimulatedOperator
from tests.support import ROOT
from tests.support.boards.chip import PulseChip
from tests.support.boards.host import HostPulseBoard
from tests.support.boards.world import PulseWorld, pulse_table_on

RIG = load_rig(ROOT / "experiments/rigs/hobby-two-servos.toml")
SERVOS = (PulseServo(1520.0, 636.6), PulseServo(1475.0, -620.0))


def balance(board, *, seed: int, seconds: float) -> tuple[Log, PulseWorld, str]:
    """The shipped free-release protocol: log, world, outcome.

    Period and quantum of the command are the pulses' own here, not the plant's.
    """
    protocol = read_protocol("free-release")
    way = course(protocol.model_copy(update={"duration_s": seconds}), RIG, seed)
    bare = replace(RIG, servo=replace(RIG.servo, period_s=0.0, quantum_rad=0.0))
    world = PulseWorld(board, bare, SERVOS, seed=seed, start_m=way.start_m, held=True)
    operator, rows = SimulatedOperator(world.plant, way.hold_s), []
    with pulse_table_on(world, RIG) as table:
        loop = Loop(
            table,
            known(RIG),
            COMPENSATORS["with"],
            way,
            operator=operator,
            keep=lambda row: rows.append(row.copy()),
        )
        ending = loop.run()
        assert table.ticks_missed == 0
    return Log.from_rows(np.array(rows)), world, ending.outcome


def spread_m(log: Log) -> float:
    t_s, xy = log.ball()
    return float(np.sqrt(np.mean(np.sum(xy[t_s > t_s[-1] - 4.0] ** 2, axis=1))))


@pytest.mark.parametrize("board", [HostPulseBoard, pytest.param(PulseChip, marks=pytest.mark.slow)])
def test_the_hobby_table_balances_the_ball_through_its_firmware(board):
    log, world, outcome = balance(board(), seed=1, seconds=12.0)
    assert outcome == "completed"
    assert np.isnan(log["theta_x_rad"]).all()
    assert np.isfinite(log["command_x_rad"]).any()
    assert spread_m(log) < 0.004  # the simulated table: 2 mm
    world.run(0.1)
    assert not any(world.board.pulses_us())
    assert np.all(np.abs(world.arms_rad) < 0.03)
