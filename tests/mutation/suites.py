"""Run a test file's own tests against another module, without pytest: parametrized ones, too."""

import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from inspect import signature
from itertools import product
from pathlib import Path
from types import ModuleType

import pytest


def cases(test: Callable) -> Iterator[dict]:
    """The keyword arguments of every case of a test with `pytest.mark.parametrize` marks."""
    axes = []
    for mark in getattr(test, "pytestmark", ()):
        if mark.name == "parametrize":
            names, values = mark.args[:2]
            names = [n.strip() for n in names.split(",")] if isinstance(names, str) else names
            axes.append(
                [dict(zip(names, v if len(names) > 1 else (v,), strict=True)) for v in values]
            )
    for chosen in product(*axes):
        yield {name: value for one in chosen for name, value in one.items()}


def call(tests: ModuleType, test: Callable, arguments: dict) -> None:
    """Call a test, with a folder for `tmp_path`, a `monkeypatch` and what else the module's
    `contexts` open."""
    known = {"tmp_path": folder, "monkeypatch": pytest.MonkeyPatch.context}
    openers = {**known, **getattr(tests, "contexts", {})}
    with ExitStack() as stack:
        for name in signature(test).parameters:
            if name in openers and name not in arguments:
                arguments = {**arguments, name: stack.enter_context(openers[name]())}
        test(**arguments)


@contextmanager
def folder() -> Iterator[Path]:
    """A folder that is gone afterwards."""
    with tempfile.TemporaryDirectory() as name:
        yield Path(name)


def run_tests(tests: ModuleType, subject: ModuleType, names: Sequence[str]) -> None:
    """Every test called `names` of the module `tests`, with what it imported from the subject's
    original replaced by the subject's own."""
    before = dict(tests.__dict__)
    try:
        for name in before:
            if name in subject.__dict__ and not name.startswith("__"):
                tests.__dict__[name] = subject.__dict__[name]
        tests.__dict__.update(getattr(tests, "derived", dict)())
        for name in names:
            test = tests.__dict__[name]
            for arguments in cases(test):
                call(tests, test, arguments)
    finally:
        tests.__dict__.update(before)


def quickest_first(tests: ModuleType, names: Sequence[str]) -> list[str]:
    """The names in the order of what the tests take: most mutants then die early."""

    def seconds(name: str) -> float:
        start = time.perf_counter()
        for arguments in cases(getattr(tests, name)):
            call(tests, getattr(tests, name), arguments)
        return time.perf_counter() - start

    return sorted(names, key=seconds)
