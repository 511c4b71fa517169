"""Text of strangers, line by line: neither a line nor a block of rows takes much memory."""

import csv
from collections.abc import Iterable, Iterator
from itertools import islice
from typing import TextIO

LONGEST_LINE = 1 << 24  # characters; chosen: a thousand times that of the widest table
BLOCK_CELLS = 1 << 20  # cells taken apart at once, some 60 bytes each


def lines_of(file: TextIO) -> Iterator[str]:
    """Yield the lines of a file. ValueError (one line): one is longer than LONGEST_LINE."""
    while line := file.readline(LONGEST_LINE + 1):
        if len(line) > LONGEST_LINE:
            raise ValueError(f"a line of it has more than {LONGEST_LINE} characters")
        yield line


def blocks_of(rows: Iterable[list[str]], width: int) -> Iterator[list[list[str]]]:
    """Yield the rows of a table of `width` columns in lists of BLOCK_CELLS cells or a row more.

    ValueError (one line): quotes that do not close, or a cell of absurd length.
    """
    rows = iter(rows)
    try:
        while block := list(islice(rows, 1 + BLOCK_CELLS // max(width, 1))):
            yield block
    except csv.Error as error:
        raise ValueError(f"not readable as a table ({error})") from error
