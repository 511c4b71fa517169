"""How a run ended, by name; what was raised has a name, too."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Ending:
    """How a run ended: completed, ball lost, limit, not released or aborted, and why; or with the
    name of what the guard saw. `level`: the plate may be levelled afterwards, else 0 V at once."""

    outcome: str
    reason: str = ""
    level: bool = True


def ending_of(error: BaseException) -> Ending:
    """How a run ended that raised: an error may bear its own `outcome` (a lost link, a camera)."""
    if isinstance(error, KeyboardInterrupt):
        return Ending("interrupted", "by the operator")
    outcome = getattr(error, "outcome", "aborted")
    return Ending(outcome, f"{type(error).__name__}: {error}")
