"""Hobby tables under the ordinary loop: the real servo firmware, pulses at simulated pins."""

from dataclasses import replace

import numpy as np
import pytest

from experiments.runs.assemble import known, load_rig
from experiments.runs.protocol import course, read_protocol
from rig.control.controllers import COMPENSATORS
from rig.hardware.board.pulse_servo import PulseServo
from rig.log import Log
from rig.loop.loop import Loop
from rig.parameters import Rig
from rig.simulation.operator import SimulatedOperator
from tests.support import ROOT
from tests.support.boards.chip import MEGA, PulseChip
from tests.support.boards.host import HostPulseBoard
from tests.support.boards.world import PulseWorld, pulse_table_on

RIGS = ROOT / "experiments/rigs"
HOBBY, ARMS = load_rig(RIGS / "hobby-two-servos.toml"), load_rig(RIGS / "three-arms.toml")
SERVOS = (PulseServo(1520.0, 636.6), PulseServo(1475.0, -620.0), PulseServo(1505.0, 650.0))
# Twice what the simulated table has, and 1.5 times: 2 and 3.8 mm.
SPREAD_M = {HOBBY.linkage.kind: 0.004, ARMS.linkage.kind: 0.0057}
LEVEL_RAD = {HOBBY.linkage.kind: 0.03, ARMS.linkage.kind: 0.01}


def balance(board, rig: Rig, *, seed: int, seconds: float) -> tuple[Log, PulseWorld, str]:
    """The shipped free-release protocol: log, world, outcome.

    Period and quantum of the command are the pulses' own here, not the plant's.
    """
    protocol = read_protocol("free-release")
    way = course(protocol.model_copy(update={"duration_s": seconds}), rig, seed)
    bare = replace(rig, servo=replace(rig.servo, period_s=0.0, quantum_rad=0.0))
    servos = SERVOS[: rig.linkage.servos]
    world = PulseWorld(board, bare, servos, seed=seed, start_m=way.start_m, held=True)
    operator, rows = SimulatedOperator(world.plant, way.hold_s), []
    with pulse_table_on(world, rig) as table:
        loop = Loop(
            table,
            known(rig),
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


@pytest.mark.parametrize(
    ("board", "rig"),
    [
        (lambda: HostPulseBoard(), HOBBY),
        (lambda: HostPulseBoard(servos=3), ARMS),
        pytest.param(lambda: PulseChip(), HOBBY, marks=pytest.mark.slow),
        pytest.param(lambda: PulseChip(MEGA), ARMS, marks=pytest.mark.slow),
    ],
    ids=["two rods", "three arms", "two rods, firmware", "three arms, firmware"],
)
def test_a_table_of_hobby_servos_balances_the_ball_through_its_firmware(board, rig: Rig):
    log, world, outcome = balance(board(), rig, seed=1, seconds=12.0)
    assert outcome == "completed"
    assert np.isnan(log["theta_x_rad"]).all()
    assert np.isfinite(log["command_x_rad"]).any()
    assert spread_m(log) < SPREAD_M[rig.linkage.kind]
    world.run(0.1)
    assert not any(world.board.pulses_us())
    assert np.all(np.abs(world.arms_rad) < LEVEL_RAD[rig.linkage.kind])
