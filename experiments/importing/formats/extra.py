"""Libraries of the optional extra `import`."""

from importlib import import_module
from typing import Any

from experiments.importing.recording import BadFileError


def library(module: str, what: str) -> Any:
    """Import a module. BadFileError: it is not installed; says what installs it."""
    try:
        return import_module(module)
    except ImportError as error:
        raise BadFileError(
            f"{what} is read by a library that is not installed: uv sync --extra import"
        ) from error
