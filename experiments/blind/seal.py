"""The truth under a seal: written before anything is made, its hash said first, opened last."""

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path

from experiments.blind.trial import Trial, from_plain, to_plain
from experiments.run_folder import replace_json

TRUTH, SEAL = "sealed/truth.json", "seal.json"


def text_of(trials: Sequence[Trial]) -> str:
    """The trials as one text: the same trials give the same bytes."""
    return json.dumps([to_plain(t) for t in trials], sort_keys=True, separators=(",", ":"))


def hash_of(trials: Sequence[Trial]) -> str:
    """SHA-256 (hex) of the trials' text."""
    return hashlib.sha256(text_of(trials).encode()).hexdigest()


def seal(trials: Sequence[Trial], out: Path) -> str:
    """Write the truth of the trials below `out`; its SHA-256 (hex), which is kept beside it."""
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
    """The hash of what was sealed in `out` before, if anything was."""
    path = out / SEAL
    return json.loads(path.read_text(encoding="utf-8"))["sha256"] if path.is_file() else None


def open_seal(out: Path, sha256: str) -> list[Trial]:
    """The trials sealed in `out`. ValueError: the truth is not what the hash was printed of."""
    text = (out / TRUTH).read_text(encoding="utf-8")
    found = hashlib.sha256(text.encode()).hexdigest()
    if found != sha256:
        raise ValueError(
            f"{out / TRUTH}: the seal is broken (hash {found[:12]}, not {sha256[:12]})"
        )
    return [from_plain(data) for data in json.loads(text)]
