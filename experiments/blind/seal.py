"""The sealed truth: written before any log is made, its hash published first, opened last."""

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path

from experiments.blind.trial import BlindTrial, from_plain, to_plain
from experiments.records.run_folder import replace_json

TRUTH, SEAL = "sealed/truth.json", "seal.json"


def text_of(trials: Sequence[BlindTrial]) -> str:
    """The trials as JSON text with sorted keys, so that equal trials give equal bytes."""
    return json.dumps([to_plain(t) for t in trials], sort_keys=True, separators=(",", ":"))


def hash_of(trials: Sequence[BlindTrial]) -> str:
    """SHA-256 (hex) of the trials' text (`text_of`, UTF-8)."""
    return hashlib.sha256(text_of(trials).encode()).hexdigest()


def seal(trials: Sequence[BlindTrial], out: Path) -> str:
    """Write the trials' truth and its SHA-256 below `out`; return that hash (hex).

    The truth is written to sealed/truth.json, the hash and the number of trials to seal.json.
    OSError: `out` cannot be written.
    """
    text = text_of(trials)
    digest = hash_of(trials)
    path = out / TRUTH
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(".part")
    part.write_text(text, encoding="utf-8")
    part.replace(path)
    replace_json(out / SEAL, {"sha256": digest, "trials": len(trials)})
    return digest


def sealed_hash(out: Path) -> str | None:
    """The SHA-256 (hex) of the trials sealed in `out`; None: no trials are sealed there.
    ValueError, KeyError: seal.json is damaged.
    """
    path = out / SEAL
    return json.loads(path.read_text(encoding="utf-8"))["sha256"] if path.is_file() else None


def open_seal(out: Path, sha256: str) -> list[BlindTrial]:
    """The trials sealed in `out`, in sealed order.

    sha256: hash that was printed when they were sealed. ValueError: the file of the truth has
    another hash. FileNotFoundError: there is none.
    """
    text = (out / TRUTH).read_text(encoding="utf-8")
    found = hashlib.sha256(text.encode()).hexdigest()
    if found != sha256:
        raise ValueError(
            f"{out / TRUTH}: the seal is broken (hash {found[:12]}, not {sha256[:12]})"
        )
    return [from_plain(data) for data in json.loads(text)]
