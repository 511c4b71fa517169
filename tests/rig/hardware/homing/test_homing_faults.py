"""A part of the faults while homing, on the board's code built for this machine; the whole, on the
chip, is tests/benchmarks/hardware/homing_faults.py."""

from dataclasses import replace

import pytest

from tests.benchmarks.hardware import homing_faults
from tests.benchmarks.hardware.homing_faults import one
from tests.support.boards.host import HostBoard, StuckBoard

SEEDS = {"board reset": 2, "host killed": 7, "cable out and in": 9, "dropped packets": 22}


@pytest.mark.parametrize("kind", SEEDS)
def test_a_fault_while_homing_leaves_no_volts_and_no_wrong_zero(kind: str):
    result = one(kind, SEEDS[kind], HostBoard)
    assert not result.unsafe, result
    assert result.outcome.startswith(("homed", "refused", "link lost", "board stopped", "host"))


def test_the_judge_notices_volts_that_stay():
    unsafe = one("host killed", SEEDS["host killed"], StuckBoard).unsafe
    assert "volts without a fresh command" in unsafe
    assert "volts at the end" in unsafe


def test_the_judge_notices_a_wrong_zero(monkeypatch: pytest.MonkeyPatch):
    home = homing_faults.home

    def off(*words):
        found = home(*words)
        zeros = (found.wiring.zero_counts[0] + 40, found.wiring.zero_counts[1])
        return replace(found, wiring=replace(found.wiring, zero_counts=zeros))

    monkeypatch.setattr(homing_faults, "home", off)
    assert any("wrong by" in words for words in one("clock drift", 1, HostBoard).unsafe)
