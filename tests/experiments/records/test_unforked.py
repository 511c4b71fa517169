"""What a forked process has of files that are its parent's own."""

import os
from pathlib import Path

import pytest

from experiments.records import unforked

pytestmark = [
    pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not fork"),
    pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning"),  # the child leaves at once
]


def forked(file: int) -> bool:
    """Whether a process that is forked now has an open file of this number."""
    child = os.fork()
    if child == 0:
        try:
            os.fstat(file)
        except OSError:
            os._exit(1)
        os._exit(0)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0


def test_a_fork_has_no_copy_and_the_parent_still_writes(tmp_path: Path):
    file = os.open(tmp_path / "own", os.O_WRONLY | os.O_CREAT)
    assert forked(file)
    unforked.keep_to_itself(file)
    assert not forked(file)
    os.write(file, b"row")
    unforked.close(file)
    assert (tmp_path / "own").read_bytes() == b"row"


def test_the_number_of_a_file_that_others_closed_is_another_files(tmp_path: Path):
    """A lab's code closes what it finds: processes started since could not be told their folder."""
    file = os.open(tmp_path / "own", os.O_WRONLY | os.O_CREAT)
    unforked.keep_to_itself(file)
    os.close(file)
    other = os.open(tmp_path / "other", os.O_WRONLY | os.O_CREAT)
    assert other == file
    try:
        assert forked(other)
    finally:
        unforked.close(other)
