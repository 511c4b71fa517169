"""Fixtures of several rooms: a served table, and the rig file of the foreign table's logs."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from rig.rigfile import write_rig
from tests.support.gap.exchange import RIG
from tests.support.rig_lab import Lab


@pytest.fixture(scope="module")
def lab() -> Iterator[Lab]:
    """A table served by a process of its own, not homed yet."""
    with Lab() as one:
        yield one


@pytest.fixture(scope="module")
def rig_file(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("rig") / "rig.toml"
    write_rig(RIG, path)
    return path
