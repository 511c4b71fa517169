"""A lab's own controller out of its file: `controller = "mine.py:MyController"` in a protocol."""

import importlib.util
import sys
from pathlib import Path

from rig.own import METHODS, OwnController


def load_controller(name: str) -> OwnController:
    """A fresh controller of FILE.py:ClassName. ValueError (one line): what is missing or fails."""
    file, _, made = name.rpartition(":")
    path = Path(file)
    if not path.is_file():
        raise ValueError(f"controller file {path} not found: give it relative to the protocol file")
    spec = importlib.util.spec_from_file_location(f"own_{path.stem}", path)
    if spec is None or spec.loader is None:
        raise ValueError(f"controller file {path} is no Python file: it must end in .py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses and pickles look there
    try:
        spec.loader.exec_module(module)
        controller = getattr(module, made)()
    except Exception as error:  # whatever is wrong in a lab's file is bad input
        raise ValueError(f"controller {path}:{made}: {type(error).__name__}: {error}") from error
    missing = [method for method in METHODS if not callable(getattr(controller, method, None))]
    if missing:
        raise ValueError(
            f"controller {path}:{made} lacks {', '.join(missing)}: it needs {', '.join(METHODS)}"
        )
    return controller
