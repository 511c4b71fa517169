"""A pytest plugin (`-p tests.support.bare_machine`) that hides every part of `tests.support.parts`.

Programs vanish from the PATH, files from `Path.is_file` and `Path.exists`, shared libraries from
`parts`, modules from the import: code that looks for a part in a way of its own meets the same bare
machine.
"""

import os
import sys
from pathlib import Path
from typing import Any

from tests.support import parts
from tests.support.parts import PARTS

HIDDEN: set[Any] = {part.file for part in PARTS.values()}


def pytest_configure() -> None:
    os.environ["PATH"] = str(Path(sys.executable).parent)
    parts.find_library = lambda name: None
    for part in PARTS.values():
        if part.module:
            sys.modules[part.module] = None  # type: ignore[assignment]
    for question in ("is_file", "exists"):
        asked = getattr(Path, question)
        setattr(Path, question, lambda path, asked=asked: path not in HIDDEN and asked(path))
