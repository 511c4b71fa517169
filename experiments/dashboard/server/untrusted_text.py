"""Text from files and exceptions on the page: shown as it is, never as Markdown or HTML."""

import re

from experiments.reports.units import unbroken
from rig.files import as_unicode, upright

LONGEST = 500  # characters; chosen: some lines of a panel
_PUNCTUATION = re.compile(r"[!-/:-@\[-`{-~]")  # of ASCII: whatever HTML or Markdown may read


def plain(text: object) -> str:
    """The text for a Markdown widget, which shows it unchanged, on one line.

    viser renders the HTML in its Markdown as it stands, so every text that is no literal of the
    program goes through here. Punctuation becomes numeric character references, which neither HTML
    nor Markdown reads as anything but the character; what is longer than LONGEST is cut off.
    """
    return _escaped(_line(text))


def measured(text: object) -> str:
    """As `plain`, of numbers with units: no line ends between the two, nor within an interval."""
    return _escaped(unbroken(_line(text)))


def _line(text: object) -> str:
    line = " ".join(upright(as_unicode(text)).split())
    return line if len(line) <= LONGEST else line[: LONGEST - 1] + "…"


def _escaped(line: str) -> str:
    return _PUNCTUATION.sub(lambda found: f"&#{ord(found[0])};", line)


def words_of(error: Exception) -> str:
    """What an error says, or its kind where it says nothing."""
    return str(error) or type(error).__name__
