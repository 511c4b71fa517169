"""The sealed truth: written before any log is made, its hash published first, opened last."""

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from experiments.blind.trial import BlindTrial, to_plain
from experiments.records.run_folder import replace_json
from rig.files import file_bytes, first_error_line, json_of, write_whole

TRUTH, SEAL = "sealed/truth.json", "seal.json"
LONGEST_TRUTH = 1 << 27  # bytes; 9999 trials of 6 kB take half of it


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
    write_whole(path, text.encode())
    replace_json(out / SEAL, {"sha256": digest, "trials": len(trials)})
    return digest


def sealed_hash(out: Path) -> str | None:
    """The SHA-256 (hex) of the trials sealed in `out`; None: no trials are sealed there.
    ValueError (one line): seal.json is damaged.
    """
    path = out / SEAL
    if not path.is_file():
        return None
    try:
        content = json_of(path)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    digest = content.get("sha256") if isinstance(content, dict) else None
    if not isinstance(digest, str):
        raise ValueError(f"{path}: no seal (it holds no sha256)")
    return digest


def open_seal(out: Path, sha256: str) -> list[BlindTrial]:
    """The trials sealed in `out`, in sealed order.

    sha256: hash that was printed when they were sealed. ValueError: the file of the truth has
    another hash, or is none. FileNotFoundError: there is none.
    """
    try:
        content = file_bytes(out / TRUTH, LONGEST_TRUTH)
    except ValueError as error:
        raise ValueError(f"{out / TRUTH}: {error}") from None
    found = hashlib.sha256(content).hexdigest()
    if found != sha256:
        raise ValueError(
            f"{out / TRUTH}: the seal is broken (hash {found[:12]}, not {sha256[:12]})"
        )
    try:
        trials = TypeAdapter(list[BlindTrial]).validate_json(content)
    except ValidationError as error:
        raise ValueError(f"{out / TRUTH}: {first_error_line(error)}") from None
    if not trials:
        raise ValueError(f"{out / TRUTH}: no trial in it, nothing to score with")
    return trials
