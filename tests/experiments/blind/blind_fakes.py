"""Answerers for the tests: they see a folder, as the real one does."""

from pathlib import Path

from experiments.importing import read_log
from rig.rigfile import read_rig


def silent_one(folder: Path) -> dict:
    """Says that nothing is missing, and what it saw."""
    logs = sorted(folder.glob("log-*"))
    seconds = [float(read_log(path)["t_s"][-1]) for path in logs]
    rig = read_rig(folder / "rig.toml")
    files = sorted(path.name for path in folder.iterdir())
    return {
        "verdict": "nothing-missing",
        "effects": [],
        "files": files,
        "seconds": seconds,
        "believed": sorted(rig.effects),
    }


def failing_one(folder: Path) -> dict:
    raise ValueError(f"nothing to see in\n{folder.name[:6]}")
