"""What a terminal says of an error: the parser's own, the system's, or any."""

import traceback
from itertools import pairwise
from pathlib import Path
from typing import Any


def usage_words(error: Any, given: list[str]) -> str:
    """The parser's own error in words, with the value that it refuses and where help is."""
    words = error.format_message().rstrip(".?")
    options = getattr(getattr(error, "param", None), "opts", ())
    values = [b for a, b in pairwise(given) if a in options]
    values += [
        one.partition("=")[2] for one in given if "=" in one and one.split("=")[0] in options
    ]
    if values and repr(values[-1]) not in words:
        words = f"{words}, not {values[-1]!r}"
    context = getattr(error, "ctx", None)
    return f"{words}; see {context.command_path} --help" if context else words


def error_words(error: Exception) -> str:
    """The error in words; one of the system's own is "FILE: what it says", without its number."""
    if isinstance(error, OSError) and error.strerror:
        named = "" if error.filename is None else f"{error.filename}: "
        return f"{named}{error.strerror}"
    if isinstance(error, UnicodeDecodeError) and _of_matplotlib(error):
        return (
            f"matplotlibrc, matplotlib's own settings, is no UTF-8 text ({error}): mend or move it"
        )
    return str(error)


def _of_matplotlib(error: Exception) -> bool:
    """Whether matplotlib itself raised it, as it was imported: nothing can be drawn then."""
    frames = traceback.extract_tb(error.__traceback__)
    return any(Path(frame.filename).parent.name == "matplotlib" for frame in frames)
