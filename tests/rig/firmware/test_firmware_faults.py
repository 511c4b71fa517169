"""A part of the fault campaign; the whole is tests/benchmarks/hardware/fault_campaign.py."""

import numpy as np
import pytest

from tests.benchmarks.hardware.fault_campaign import BOARDS, campaign, one, table
from tests.support.boards.chip import firmware
from tests.support.boards.chip_faults import KINDS, resampled
from tests.support.boards.host import HostBoard, HostPulseBoard, StuckBoard

OUTCOMES = (
    "completed", "host killed", "no link", "ball lost", "link lost", "board stopped", "late loop",
)  # fmt: skip


@pytest.fixture(scope="module", params=BOARDS)
def board(request) -> str:
    return request.param


@pytest.fixture(scope="module")
def results(board: str):
    firmware()
    return campaign(22, 1, board=board)


@pytest.mark.slow
def test_nothing_unsafe_happens_and_every_run_ends_with_a_name(results):
    assert not [r for r in results if r.unsafe], table(results)
    assert all(r.outcome.startswith(OUTCOMES) for r in results), table(results)
    assert all("NOT AGAIN" not in r.outcome for r in results), table(results)
    assert {r.kind for r in results} == set(KINDS)
    assert sum(r.rows for r in results) > 1000


@pytest.mark.slow
def test_the_campaign_repeats(results, board: str):
    assert one(KINDS[3], 1 + 3, board=board) == results[3]


@pytest.mark.parametrize("change", ["-DWATCHDOG_MS=60000", "-DLEVEL_MS=60000"])
@pytest.mark.parametrize(("board", "make"), [("volts", HostBoard), ("pulses", HostPulseBoard)])
def test_the_judge_notices_a_spoilt_board(board: str, make, change: str):
    """Without the watchdog, or without an end of levelling, something unsafe must be found."""

    def is_unsafe(*changes: str) -> bool:
        return any(
            one("host killed", seed, lambda: make(*changes), board).unsafe for seed in range(4)
        )

    assert not is_unsafe()
    assert is_unsafe(change)


def test_the_judge_notices_volts_that_stay():
    unsafe = one("host killed", 3, StuckBoard).unsafe
    assert "volts without a fresh command" in unsafe
    assert "volts at the end" in unsafe


def test_bytes_at_the_right_baud_arrive_as_sent():
    data = np.random.default_rng(1).integers(0, 256, 200).astype(np.uint8).tobytes()
    assert resampled(data, 1.0) == data
    assert resampled(data, 1.02) == data
    assert resampled(data, 0.5) != data
