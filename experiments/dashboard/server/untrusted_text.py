"""Text from files and exceptions on the page: shown as it is, never as Markdown or HTML."""

import re

LONGEST = 500  # characters; chosen: some lines of a panel
# A blank behind a number or an interval and before its unit, of a text that `plain` has made.
_OF_A_SIZE = re.compile(
    r"(?<=\d) (?=(?:deg|[cmµ]?m|s|ms|[VN°]|px)\b|&#37;|&#91;)|(?<=&#93;) |(?<=\d&#44;) (?=\d)"
)
_PUNCTUATION = re.compile(r"[!-/:-@\[-`{-~]")  # of ASCII: whatever HTML or Markdown may read


def as_unicode(text: object) -> str:
    """The text with "?" for what is no Unicode (half a surrogate pair, as in names of files that
    are no UTF-8): no message that holds it could be sent, to this page or any other.
    """
    return str(text).encode("utf-8", "replace").decode()


def plain(text: object) -> str:
    """The text for a Markdown widget, which shows it unchanged, on one line.

    viser renders the HTML in its Markdown as it stands, so every text that is no literal of the
    program goes through here. Punctuation becomes numeric character references, which neither HTML
    nor Markdown reads as anything but the character; what is longer than LONGEST is cut off.
    """
    line = " ".join(as_unicode(text).split())
    if len(line) > LONGEST:
        line = line[: LONGEST - 1] + "…"
    return _PUNCTUATION.sub(lambda found: f"&#{ord(found[0])};", line)


def measured(text: object) -> str:
    """As `plain`, of numbers with units: no line ends between the two, nor within an interval."""
    return _OF_A_SIZE.sub("\u00a0", plain(text))


def words_of(error: Exception) -> str:
    """What an error says, or its kind where it says nothing."""
    return str(error) or type(error).__name__
