"""Public names of a package that are imported when they are first used (PEP 562)."""

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any


def lazy_names(package: str, names_of: Mapping[str, str]) -> Callable[[str], Any]:
    """The module-level `__getattr__` of `package` (PEP 562), with which its `__init__` stays
    instant to import.

    `names_of`: submodule (relative to the package) -> its public names, separated by blanks. The
    function that is returned raises `AttributeError` for any other name.
    """
    homes = {name: home for home, names in names_of.items() for name in names.split()}

    def imported(name: str) -> Any:
        if name not in homes:
            raise AttributeError(f"module '{package}' has no attribute '{name}'")
        return getattr(import_module(f"{package}.{homes[name]}"), name)

    return imported
