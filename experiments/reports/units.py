"""Numbers with units in running text: no line ends between the two, nor within an interval."""

import re

_UNIT = r"(?:deg(?:rees?)?|[cmµ]?m|ms|s|min|m?rad|Hz|px|[VN°%])(?![a-z])"
_BLANK = re.compile(
    rf"(?<=\d) (?={_UNIT}|\[)"  # 5 mm, 0.21 [0.20, 0.22]
    r"|(?<=\]) (?=\w)"  # [0.20, 0.22] cm
    r"|(?<=\d,) (?=[-+]?\d+(?:\.\d+)?\])"  # 0.20, 0.22]
)


def unbroken(text: str) -> str:
    """The text with no-break spaces where a line would part a number from its unit."""
    return _BLANK.sub("\u00a0", text)
