"""The steps of naming, told to whoever waits: naming takes most of an investigation's time."""

from collections.abc import Callable
from enum import IntEnum


class NamingStep(IntEnum):
    """What the naming does; each round of it begins at SEARCH."""

    SEARCH = 0
    RIVALS = 1
    CHANCE = 2
    UNNAMED = 3
    PROOF = 4


# tell(step, words): the step that begins, in words
Tell = Callable[[NamingStep, str], None]


def untold(step: NamingStep, words: str) -> None:
    """Ignore the step: the default `Tell`."""
