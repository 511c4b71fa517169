"""Logs of tables with faults, from worlds that share no code with this bench, seen in a mirror."""

import inspect
from collections.abc import Callable

import numpy as np
import pytest

from experiments.importing.draft import Proposal
from experiments.importing.proposal import propose
from experiments.importing.recording import Stream
from tests.support.worlds import axes, healthy, positions, strangers, tables

WORLDS = {
    name: world
    for room in (healthy, positions, tables, strangers, axes)
    for name, world in inspect.getmembers(room, inspect.isfunction)
    if world.__module__ == room.__name__ and list(inspect.signature(world).parameters) == ["seed"]
}
LABELS = {
    "ball": ("ball {} mm", 1000.0),
    "theta": ("encoder {} deg", 180 / np.pi),
    "voltage": ("motor {} volts", 1.0),
}
SIGNALS = ("ball_{}_m", "theta_{}_rad", "voltage_{}_V")


def mirrored(world: Callable, seed: int) -> tuple[Stream, dict[str, int]]:
    """The world's first log in other units, every signal with a sign of its own; those signs."""
    made = world(seed)[0]
    made = made[0] if isinstance(made, list) else made
    rng = np.random.default_rng(seed)
    columns, signs = {"time_s": np.asarray(made["t_s"], float)}, {}
    for pattern in SIGNALS:
        for axis in "xy":
            name = pattern.format(axis)
            if name in made:
                signs[name] = int(rng.choice((1, -1)))
                label, size = LABELS[name.split("_")[0]]
                columns[label.format(axis)] = signs[name] * size * np.asarray(made[name], float)
    return Stream(columns), signs


def check(stream: Stream, signs: dict[str, int]) -> Proposal:
    """Every sign that is not in doubt, nor hangs on one in doubt, agrees with the others'."""
    found = propose(stream)
    doubted = {doubt.place for doubt in found.doubts}
    for axis in "xy":
        names = [pattern.format(axis) for pattern in SIGNALS]
        if any(name in doubted or name.split("_")[0] in doubted for name in names):
            continue  # once it is answered, the others are found anew
        signals = found.draft["signals"]
        agree = {signals[n]["sign"] * signs[n] for n in names if n in signals}
        assert len(agree) <= 1, (axis, signals)
        assert all(f" {axis} " in signals[name]["column"] for name in names if name in signals)
    return found


@pytest.mark.slow
def test_signs_of_every_world_in_a_mirror():
    asked = 0
    for world in WORLDS.values():
        asked += bool(check(*mirrored(world, 1)).doubts)
    assert asked <= len(WORLDS) / 5
