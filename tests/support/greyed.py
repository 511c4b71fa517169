"""Why a page sees a button or an input greyed."""

from typing import Any

from experiments.dashboard.server.controls import Controls
from experiments.dashboard.server.pages import refusal


def why(controls: Controls, handle: Any, page: int = 1) -> str:
    """The reason, "" where it can be used."""
    return "; ".join(filter(None, (refusal(one, page) for one in controls.checks[id(handle)][1])))
