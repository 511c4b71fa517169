"""Answerers for the tests: they see a folder, as the real one does."""

from pathlib import Path

from experiments.records.importing import read_log
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


def one_who_peeks(folder: Path) -> dict:
    """Answers by the volts alone, differently for every log: for tests of what follows."""
    log = read_log(folder / "log-1.csv")
    level = float(abs(log["voltage_x_V"]).mean())
    interval = {"value": level, "low": 0.5 * level, "high": 2 * level}
    effect = {
        "name": "dead_zone",
        "probability": level % 1,
        "parameters": {"x": {"half_width_V": interval}},
    }
    verdict = ("named", "undecided", "nothing-missing", "unknown-effect")[int(1e6 * level) % 4]
    after = {"protocol": "steps", "separates": ["dead_zone", "coulomb_friction"], "seconds": 30}
    return {
        "verdict": verdict,
        "effects": [effect] if verdict in ("named", "undecided") else [],
        "next_experiment": after if verdict == "undecided" else None,
        "gap": {"before": {"servo_x": 3.0}, "after": {"servo_x": 1.1}, "held_out": True},
    }
