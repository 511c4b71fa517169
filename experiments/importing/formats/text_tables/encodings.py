"""Which encoding a text of strangers is in: Unicode, or what Windows writes in some country."""

import codecs
import re
from itertools import chain
from pathlib import Path

from experiments.importing.recording import BadFileError

HEAD_BYTES = 4096
MIN_ZEROS = 0.3  # of the bytes of ASCII in UTF-16, every other is 0; chosen: names may be no ASCII
_HIGH = re.compile(rb"[\x80-\xff]+")
CYRILLIC_RUN = 3  # letters; chosen: of Latin-1's, two stand side by side in `Größe`
_MIDDLE = re.compile(rb"[a-z][\x9f\xb3\xb9\xbf][a-z]")  # Latin-1 has no letter there
_WORD = re.compile("[\u3040-\u30ff\u4e00-\u9fff]{2}")  # two kana or ideographs side by side
_OTHER = re.compile("[\uff61-\uff9f\ue000-\uf8ff]")  # half as wide, or private: a wrong guess


def encoding_of(path: Path) -> str:
    """By the byte order mark or the place of zero bytes, else UTF-8, else Shift-JIS or GB 18030
    where it makes words of theirs, else as old Windows in the East or, Latin-1, the West of Europe.
    BadFileError: no text."""
    with path.open("rb") as file:
        begin = file.read(HEAD_BYTES)
        if begin.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
            return "utf-16"
        if b"\0" in begin:
            return _utf_16(begin)
        decoder = codecs.getincrementaldecoder("utf-8")()
        part = begin
        try:
            while part:
                decoder.decode(part)
                part = file.read(1 << 20)
            decoder.decode(b"", final=True)
        except UnicodeDecodeError:
            return _of_a_country(begin + part)
    return "utf-8-sig"


def _utf_16(begin: bytes) -> str:
    zeros = [begin[start::2].count(0) for start in (0, 1)]
    if min(zeros) or max(zeros) < MIN_ZEROS * len(begin):
        raise BadFileError("it is no text (it has zero bytes)")
    return "utf-16-be" if zeros[0] else "utf-16-le"


def _of_a_country(sample: bytes) -> str:
    """In words of Latin-1 few accented letters stand side by side, in Cyrillic ones all; and no
    sign, as a superscript 1, stands within a word, as a Polish letter does.

    Shift-JIS begins its letters with a byte that Latin-1 and GB 2312 do without, and the latter
    has two high bytes for each of its own."""
    lines = [line for line in sample.split(b"\n") if not line.isascii()]
    runs = list(chain.from_iterable(map(_HIGH.findall, lines)))
    fitting = {
        "cp932": any(0x80 <= byte < 0xA0 for run in runs for byte in run),
        "gb18030": all(len(run) % 2 == 0 and min(run) > 0xA0 for run in runs),
    }
    for name in (name for name, fits in fitting.items() if fits):
        text = "\n".join(line.decode(name, errors="replace") for line in lines)
        if _WORD.search(text) and not _OTHER.search(text) and text.count("\ufffd") < 2:
            return name
    if _MIDDLE.search(b"\n".join(lines)):
        return "cp1250"
    letters = [run for run in runs if min(run) >= 0xC0]
    cyrillic = sum(len(run) for run in letters if len(run) >= CYRILLIC_RUN)
    return "cp1251" if 2 * cyrillic > sum(map(len, runs)) else "latin-1"
