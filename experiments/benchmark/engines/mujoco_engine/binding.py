"""MuJoCo's module, imported when it is first used: without it the engines' names still import."""

import importlib
from typing import Any


class _Lazy:
    """Every attribute is MuJoCo's. ModuleNotFoundError: it is not installed."""

    def __getattr__(self, name: str) -> Any:
        found = getattr(importlib.import_module("mujoco"), name)
        setattr(self, name, found)
        return found


mujoco: Any = _Lazy()  # its compiled part has no types
