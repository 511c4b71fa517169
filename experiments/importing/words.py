"""What an import would do, in five lines."""

import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from experiments.importing.draft import Proposal
from experiments.importing.import_map import ImportMap
from experiments.importing.recording import Recording
from experiments.importing.units import family
from rig.log import Log

NO_DRIVE = "no volts or motor speeds in the file"
NO_REST = "no targets, pushes or times of exposure in the file"


def report_lines(recording: Recording, proposal: Proposal) -> list[str]:
    """Five lines: time, ball, angles, drive and the rest; each with its reasons."""
    signals = proposal.draft["signals"]
    because = proposal.reasons
    lines = [
        f"time    {_time(proposal.draft['time'])}{_why(because.get('time', ()))}",
        f"ball    {_signals(signals, 'ball')}{_why(because.get('ball', ()))}",
        f"angle   {_signals(signals, 'theta', 'command')}{_why(because.get('angle', ()))}",
        f"drive   {_signals(signals, 'voltage', 'motor_speed', none=NO_DRIVE)}"
        f"{_why(because.get('drive', ()))}",
    ]
    rest = _signals(signals, "target", "push", "ball_exposed_s", none=NO_REST)
    left = proposal.left
    more = f" and {len(left) - 8} more" if len(left) > 8 else ""
    unused = f"; not used: {', '.join(left[:8])}{more}" if left else ""
    notes = (*recording.notes, *because.get("rest", ()))
    lines.append(f"rest    {rest}{unused}{_why(notes)}")
    return [line.replace("\n", "?") for line in lines]  # a name may hold a line of its own


def _time(time: Mapping[str, Any]) -> str:
    if "rate_hz" in time:
        return f"{time['rate_hz']:g} rows a second"
    if "column" not in time:
        return "not found"
    return f"{time['column']} [{time.get('unit', '?')}]"


def _signals(signals: Mapping[str, Mapping[str, Any]], *families: str, none: str = "none") -> str:
    """Each signal as `ball_x_m = -(BallX - 3) mm`; none: said where there is none."""
    parts = []
    for name, keys in signals.items():
        if family(name) not in families:
            continue
        offset, sign = keys.get("offset", 0.0), "-" if keys.get("sign", 1) < 0 else ""
        inside = f"({keys['column']} - {offset:g})" if offset else keys["column"]
        scale = f" x {keys['scale']:g}" if keys.get("scale") else ""
        parts.append(f"{name} = {sign}{inside} [{keys.get('unit', '?')}]{scale}")
    return "; ".join(parts) or none


def _why(reasons: Sequence[str]) -> str:
    return f" | {'; '.join(reasons)}" if reasons else ""


def log_line(path: str, log: Log) -> str:
    """One line about a log that was written: rows, length, rate, how often the ball was seen."""
    t_s = log["t_s"]
    seen = 100 * float(np.mean(np.isfinite(log["ball_x_m"]) | np.isfinite(log["ball_y_m"])))
    notes = f" ({'; '.join(log.notes)})" if log.notes else ""
    return (
        f"{path}: {len(log)} rows, {t_s[-1]:.1f} s, {1 / np.median(np.diff(t_s)):.4g} Hz, "
        f"ball in {seen:.0f} % of them{notes}"
    )


def next_line(names: Sequence[Path], made: ImportMap) -> str:
    """What to do with the logs: where the angles were commanded and nobody measured them, how late
    both servos are comes before what else is missing."""
    logs, families = shlex.join(map(str, names)), [family(name) for name in made.signals]
    if families.count("command") < 2 or "theta" in families:
        return f"next: rig gap {logs} --rig my.toml"
    out = names[0].with_name("calibration")
    first = f"rig calibrate servo {logs} --rig my.toml --out {shlex.quote(str(out))}"
    return f"next: {first} && rig gap {logs} --rig {shlex.quote(str(out / 'rig.toml'))}"
