"""What a terminal says of an error: the parser's own, the system's, or any."""

from itertools import pairwise
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
    from experiments.picture_files import style_trouble

    if isinstance(error, OSError) and error.strerror:
        named = "" if error.filename is None else f"{error.filename}: "
        return f"{named}{error.strerror}"
    return style_trouble(error) or str(error)
