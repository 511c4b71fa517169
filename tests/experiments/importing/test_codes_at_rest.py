"""Codes of a motor's driver that are 512, not 0, where nothing drives."""

import numpy as np
import pytest

from experiments.importing.import_map import stated
from experiments.importing.proposal import Proposal, propose
from experiments.importing.recording import Stream
from tests.support.other_labs.bench import run


def proposed(name: str, code, said: tuple[str, ...] = ()) -> Proposal:
    """The proposal for two axes whose volts are told as `code` makes numbers of them."""
    axes = [run(axis, motor=True, dead=0, seconds=25.0, frame_hz=30.0) for axis in (0, 1)]
    columns = {"t_s": axes[0].t}
    for axis, one in zip("xy", axes, strict=True):
        columns[name.format(axis)] = code(one.volts)
        columns[f"encoder_{axis}_rad"] = one.angle
        columns[f"ball_{axis}_mm"] = 1000 * one.seen
    return propose(Stream(columns), stated(list(said)))


@pytest.mark.parametrize(("middle", "full"), [(512.0, 511.0), (127.5, 127.5), (0.5, 0.5)])
def test_the_middle_of_a_code_is_taken_off(middle: float, full: float):
    """512 of 1023 was 6 V of 12 at rest, and nothing was said; what is full is asked in counts."""
    found = proposed("pwm_{}", lambda volts: np.round((middle + full * volts / 12) * 256) / 256)
    keys = found.draft["signals"]["voltage_x_V"]
    assert (keys["offset"], keys["unit"], keys["sign"]) == (middle, "counts", 1)
    assert [doubt.option for doubt in found.doubts] == ["--set voltage.scale=NUMBER"]


def test_a_middle_that_is_no_round_number_is_asked_for():
    found = proposed("pwm_{}", lambda volts: 700 + 200 * volts / 12)
    assert "voltage_x_V.offset" in " ".join(doubt.option for doubt in found.doubts)
    stays = proposed("pwm_{}", lambda volts: 700 + 200 * volts / 12, ("voltage.offset=700",))
    assert stays.draft["signals"]["voltage_y_V"]["offset"] == 700
    assert "offset" not in " ".join(doubt.option for doubt in stays.doubts)


def test_an_amplifiers_offset_stays():
    assert proposed("motor_{}_V", lambda volts: volts + 0.3).doubts == ()


def test_a_share_whose_direction_stands_elsewhere_is_asked_about():
    """As of analogWrite beside a pin for the direction: its size was taken for the volts."""
    found = proposed("pwm_{}", lambda volts: np.abs(np.round(255 * volts / 12)))
    assert "voltage_x_V.column=none" in found.doubts[0].option
    none = proposed("pwm_{}", lambda volts: np.abs(volts), ("voltage.column=none",))
    assert none.doubts == ()


@pytest.mark.parametrize("volts", [6.0, -6.0])
def test_steps_of_volts_the_one_way_have_a_direction(volts: float):
    """A motor's step response was asked about as if it turned both ways."""
    t_s = np.arange(0, 12, 0.01)
    driven = np.where(t_s % 4 > 2, volts, 0.0)
    speed = np.zeros(len(t_s))
    for row in range(1, len(t_s)):
        speed[row] = speed[row - 1] + 0.01 / 0.08 * (1.2 * driven[row] - speed[row - 1])
    angle = np.cumsum(speed) * 0.01 + np.random.default_rng(0).normal(0, 0.001, len(t_s))
    found = propose(Stream({"t_s": t_s, "motor_x_V": driven, "theta_x_rad": angle}))
    assert found.doubts == ()
    assert found.draft["signals"]["voltage_x_V"]["sign"] == 1


@pytest.mark.parametrize(("unit", "size"), [("0.1 V", 10.0), ("10 mV", 100.0)])
def test_volts_in_tenths_are_volts(unit: str, size: float):
    found = proposed(f"motor_{{}} [{unit}]", lambda volts: size * volts)
    assert found.doubts == ()
    assert found.draft["signals"]["voltage_x_V"]["unit"] == unit
