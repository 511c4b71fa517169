"""The call with which long work reports its progress."""

from collections.abc import Callable

# progress(stage, done, total); "stage: words" says what a stage is doing
ProgressCall = Callable[[str, int, int], None]


def silent(stage: str, done: int, total: int) -> None:
    """Ignore the progress of a stage, `done` of `total`: the default `ProgressCall`."""
