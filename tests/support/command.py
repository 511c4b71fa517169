"""`rig` called as from a shell, in this process."""

import sys
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO

import pytest

from experiments.cli import application


def call(*words: object) -> int:
    """Call `rig` with these words and return its exit code."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["rig", *map(str, words)])
        try:
            application.main()
        except SystemExit as end:
            return int(end.code or 0)
    return 0


def told(*words: object) -> tuple[int, str, str]:
    """As `call`, with what was printed: exit code, standard output, standard error."""
    with redirect_stdout(StringIO()) as out, redirect_stderr(StringIO()) as error:
        code = call(*words)
    return code, out.getvalue(), error.getvalue()
