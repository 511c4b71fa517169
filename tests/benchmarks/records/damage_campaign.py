"""Recordings damaged on purpose, all from one seed, and what `rig recover` leaves of them.

    python tests/benchmarks/records/damage_campaign.py --damages 2000 --seed 1

Prints a table: per kind of damage how many files, how many rows were left whole by it, found again,
and lost. Lost is a row that the damage did not touch and that is neither in the recovered recording
nor in a file that keeps the damaged bytes. Exit code 1 where any was, or anything but a ValueError
was raised.
"""

import argparse
import json
import shutil
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from experiments.records.recording import Recorder, read_run, recover
from experiments.records.samples_file import RECORD, message_records
from rig.log import COLUMNS

ROWS = 400
START = {"source": "simulated", "protocol": "hold", "arm": "with", "seed": 7}
Part = tuple[int, int]  # of the original's bytes, or (-1, index) of foreign ones


@dataclass(frozen=True)
class Recording:
    """A recording's bytes, its run.json, and the rows (n, columns) with their places [bytes]."""

    content: bytes
    meta: str
    rows: np.ndarray
    places: np.ndarray  # (n, 2): where the bytes begin and end on which a row depends


@dataclass(frozen=True)
class Result:
    """One damaged file: rows left whole, found again, lost, and what was raised."""

    kind: str
    whole: int
    found: int
    lost: int
    raised: str = ""


def recording(folder: Path, *, finished: bool, seed: int) -> Recording:
    """A recording of ROWS rows, cut off by a kill (plain) or finished (compressed, indexed)."""
    rows = np.random.default_rng(seed).normal(size=(ROWS, len(COLUMNS)))
    rows[:, 0] = np.arange(ROWS) * 0.002
    recorder = Recorder(folder, START)
    for k, row in enumerate(rows):
        recorder.append(row)
        if k % 90 == 0:
            recorder.event(float(row[0]), f"event {k}")
    plain = (folder / "samples.mcap").read_bytes()
    meta = (folder / "run.json").read_text()
    recorder.finish("completed")
    if not finished:
        begins = [plain.index(row.tobytes()[8:16]) for row in rows[:, 1:]]
        first = [_record_begin(plain, place) for place in begins]
        places = np.array([(place, place + RECORD.itemsize) for place in first])
        return Recording(plain, meta, rows, places)
    content = (folder / "samples.mcap").read_bytes()
    places = np.array(_chunk_of_rows(content))
    return Recording(content, (folder / "run.json").read_text(), rows, places)


def _record_begin(content: bytes, inside: int) -> int:
    """Where the row's record begins that holds the byte `inside`."""
    head = message_records(np.zeros((1, len(COLUMNS))), 0).tobytes()[:9]
    return content.rindex(head, 0, inside)


def _chunk_of_rows(content: bytes) -> list[Part]:
    """Bytes of the chunk of each row: a chunk is read whole or not at all."""
    places, at = [], 8
    while len(places) < ROWS:
        length = int.from_bytes(content[at + 1 : at + 9], "little")
        if content[at] == 6:
            places += [(at, at + 9 + length)] * ROWS
        at += 9 + length
    return places[:ROWS]


Damage = Callable[[np.random.Generator, bytes], list[bytes | Part]]


def flips(rng: np.random.Generator, data: bytes) -> list[bytes | Part]:
    """Up to twenty flipped bits."""
    parts: list[bytes | Part] = []
    last = 0
    for at in sorted(set(rng.integers(0, len(data), rng.integers(1, 21)).tolist())):
        parts += [(last, at), bytes([data[at] ^ 1 << int(rng.integers(8))])]
        last = at + 1
    return [*parts, (last, len(data))]


def cut(rng: np.random.Generator, data: bytes) -> list[bytes | Part]:
    """The end is missing."""
    return [(0, int(rng.integers(0, len(data))))]


def hole(rng: np.random.Generator, data: bytes) -> list[bytes | Part]:
    """Blocks of zeros, as a power cut leaves them, or of nothing."""
    begin, end = _span(rng, data)
    return [(0, begin), bytes(end - begin) if rng.random() < 0.5 else b"", (end, len(data))]


def doubled(rng: np.random.Generator, data: bytes) -> list[bytes | Part]:
    """A block stands there twice, perhaps elsewhere."""
    begin, end = _span(rng, data)
    again = data[begin:end]
    at = int(rng.integers(end, len(data) + 1)) if rng.random() < 0.5 else end
    return [(0, at), again, (at, len(data))]


def foreign(rng: np.random.Generator, data: bytes) -> list[bytes | Part]:
    """Bytes of something else, put in or in the place of ours."""
    begin, end = _span(rng, data)
    alien = rng.bytes(int(rng.integers(1, 5000)))
    return [(0, begin), alien, (end if rng.random() < 0.5 else begin, len(data))]


def two_writers(rng: np.random.Generator, data: bytes) -> list[bytes | Part]:
    """Rows of a second recorder in between, at ends of records or in the middle of one."""
    other = message_records(rng.normal(size=(int(rng.integers(1, 30)), len(COLUMNS))), 0)
    at = int(rng.integers(8, len(data)))
    return [(0, at), other.tobytes(), (at, len(data))]


def _span(rng: np.random.Generator, data: bytes) -> Part:
    begin = int(rng.integers(0, len(data)))
    return begin, min(len(data), begin + int(rng.integers(1, 8192)))


DAMAGES: dict[str, Damage] = {
    "flips": flips,
    "cut": cut,
    "hole": hole,
    "doubled": doubled,
    "foreign": foreign,
    "two writers": two_writers,
}


def one(kind: str, original: Recording, rng: np.random.Generator, folder: Path) -> Result:
    """Damage a copy of a recording, recover it, count its rows."""
    parts = DAMAGES[kind](rng, original.content)
    kept = [part for part in parts if isinstance(part, tuple)]
    damaged = b"".join(
        original.content[part[0] : part[1]] if isinstance(part, tuple) else part for part in parts
    )
    a, b = original.places.T
    intact = np.zeros(len(original.rows), bool)
    for begin, end in kept:
        intact |= (begin <= a) & (b <= end)
    folder.mkdir()
    path = folder / "samples.mcap"
    path.write_bytes(damaged)
    (folder / "run.json").write_text(original.meta)
    wanted = {row.tobytes() for row in original.rows[intact]}
    raised = ""
    try:
        recover(folder)
        found = {row.tobytes() for row in read_run(folder).log.rows} & wanted
    except ValueError:
        found = set()
    except Exception as error:  # whatever it is, it is told
        found, raised = set(), f"{type(error).__name__}: {error}"
    copies = [path, path.with_suffix(".damaged.mcap")]
    safe = any(copy.is_file() and copy.read_bytes() == damaged for copy in copies)
    lost = 0 if safe else len(wanted - found)
    shutil.rmtree(folder)
    return Result(kind, len(wanted), len(found), lost, raised)


def campaign(damages: int, seed: int) -> list[Result]:
    """So many damages, kinds and files in turn; the same answer for the same arguments."""
    results = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        originals = [
            recording(folder / f"original{k}", finished=bool(k % 2), seed=seed + k)
            for k in range(4)
        ]
        for k in range(damages):
            rng = np.random.default_rng([seed, k])
            kind = list(DAMAGES)[k % len(DAMAGES)]
            original = originals[k // len(DAMAGES) % len(originals)]
            results.append(one(kind, original, rng, folder / "run"))
    return results


def table(results: list[Result]) -> str:
    """The results as a table in Markdown."""
    lines = ["| damage | files | rows left whole | found again | lost |", "|---|---|---|---|---|"]
    for kind in (*DAMAGES, "all"):
        some = [one for one in results if kind in (one.kind, "all")]
        sums = [sum(getattr(one, name) for one in some) for name in ("whole", "found", "lost")]
        lines.append(f"| {kind} | {len(some)} | " + " | ".join(map(str, sums)) + " |")
    raised = sorted({one.raised for one in results if one.raised})
    return "\n".join([*lines, *(f"raised: {text}" for text in raised)])


def main() -> None:
    """Run the campaign and print its table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--damages", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    begin = time.perf_counter()
    results = campaign(asked.damages, asked.seed)
    print(table(results))
    print(f"{time.perf_counter() - begin:.0f} s, seed {asked.seed}")
    lost = sum(one.lost for one in results)
    if asked.json:
        asked.json.write_text(json.dumps({"damages": len(results), "rows_lost": lost}))
    sys.exit(1 if lost or any(one.raised for one in results) else 0)


if __name__ == "__main__":
    main()
