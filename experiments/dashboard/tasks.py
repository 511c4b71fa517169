"""What is done in a worker process: figures, report, the gap. All picklable."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import degrees
from pathlib import Path
from typing import Any

import numpy as np

from experiments.dashboard.desk import Tell
from rig.parameters import Rig


@dataclass(frozen=True)
class Shown:
    """A picture with what to see in it."""

    path: Path
    caption: str


@dataclass(frozen=True)
class RunRow:
    """A recorded run as a list shows it."""

    folder: Path
    protocol: str
    arm: str
    seed: int | None
    outcome: str
    centroid_cm: tuple[float, float] | None = None


def list_runs(parent: Path, most: int = 40) -> list[RunRow]:
    """The newest runs of a folder, newest first; what is not readable is left out."""
    from experiments.run_folder import read_meta

    rows = []
    folders = parent.iterdir() if parent.is_dir() else ()
    for folder in sorted((f for f in folders if (f / "run.json").is_file()), reverse=True):
        try:
            meta = read_meta(folder)
        except (OSError, ValueError):
            continue
        protocol = meta.get("protocol")
        name = protocol.get("name", "?") if isinstance(protocol, dict) else str(protocol)
        outcome = str(meta.get("outcome") or "unfinished")
        rows.append(RunRow(folder, str(name), str(meta.get("arm")), meta.get("seed"), outcome))
        if len(rows) == most:
            break
    return rows


def draw_figures(rows: Sequence[RunRow], out: Path, tell: Tell) -> dict[str, Any]:
    """The paper's figures that these runs allow; {"figures": [Shown], "rows": [RunRow]}.

    rows: newest first, of one protocol. Fig. 10 and 11 need a run of either arm, Fig. 14 four.
    """
    from experiments import figures
    from experiments.figures import save
    from experiments.numbers import centroid_cm, recorded
    from experiments.recording import read_run

    runs: dict[str, list] = {"without": [], "with": []}
    counted, sources = [], set()
    for i, row in enumerate(rows):
        tell("reading runs", i, len(rows))
        whole = read_run(row.folder)
        servo_only = bool((whole.meta.get("protocol") or {}).get("servo_only"))
        one = recorded(row.folder, whole.log, row.outcome, servo_only=servo_only)
        sources.add(str(whole.meta.get("source")))
        xy = np.full(2, np.nan) if servo_only else centroid_cm(one)
        known = (float(xy[0]), float(xy[1])) if np.isfinite(xy).all() else None
        counted.append(replace(row, centroid_cm=known))
        if known is not None and row.arm in runs and row.outcome == "completed":
            runs[row.arm].append(one)
    out.mkdir(parents=True, exist_ok=True)
    source = sources.pop() if len(sources) == 1 else "simulated"
    drawn: list[Shown] = []

    def add(figure: Any, name: str, caption: str) -> None:
        drawn.append(Shown(save(figure, out, name, source), caption))

    tell("drawing", 0, 1)
    a, b = runs["without"], runs["with"]
    if a and b:
        centres = {"without": centroid_cm(a[0]), "with": centroid_cm(b[0])}
        pushed = rows[0].protocol == "pushed"
        if pushed:
            add(figures.pushed_scatter(a[0].log, centres["without"], "without"), "fig12",
                "Fig. 12: the pushed ball, without the model")  # fmt: skip
            add(figures.pushed_scatter(b[0].log, centres["with"], "with"), "fig13",
                "Fig. 13: the pushed ball, with the model")  # fmt: skip
        else:
            add(figures.release_scatter(a[0].log, b[0].log, centres), "fig10",
                "Fig. 10: where the ball was, with and without the model")  # fmt: skip
            add(figures.servo_over_time(a[0].log, b[0].log), "fig11",
                "Fig. 11: servo angles")  # fmt: skip
        if not pushed and min(len(a), len(b)) >= 4:
            add(figures.eight_runs([r.log for r in a[:4]], [r.log for r in b[:4]]), "fig14",
                "Fig. 14: eight runs")  # fmt: skip
    elif a or b:
        arm, one = ("without", a[0]) if a else ("with", b[0])
        colour = figures.WITH if arm == "with" else figures.WITHOUT
        add(figures.pushed_scatter(one.log, centroid_cm(one), arm), "ball",
            f"The ball, {arm} the model; the other arm is still to come")  # fmt: skip
        add(figures.ball_of_run(one.log, colour), "ball-time", "Ball over time")
    tell("drawing", 1, 1)
    return {"figures": drawn, "rows": counted}


def write_report(folders: Sequence[Path], out: Path, tell: Tell) -> Path:
    """The report page of runs."""
    from experiments.folders import writable
    from experiments.report_runs import report_runs

    return report_runs(list(folders), writable(out))


def demo_runs(out: Path, seed: int, tell: Tell) -> list[Path]:
    """Three runs of a table with a hidden joint play, as `rig gap --demo` makes them."""
    from experiments.gap_work import DEMO_PLAY_RAD
    from experiments.protocol import read_protocol
    from experiments.runner import Order, keep_simulated, simulate_order

    believed = Rig()
    plays = {axis: {"play_rad": play} for axis, play in DEMO_PLAY_RAD.items()}
    plant = replace(believed, effects={"joint_backlash": plays})
    runs = []
    for i, name in enumerate(("steps", "sine-sweep", "free-release")):
        tell("recording the demo's runs", i, 3)
        order = Order(plant, read_protocol(name), "without", seed + i, out / "runs", kind=believed)
        runs.append(keep_simulated(order, simulate_order(order)))
    return runs


@dataclass(frozen=True, eq=False)
class GapAnswer:
    """What the page shows of `rig gap`: sentence, lines, map, pictures, both models side by side.

    plate_map: x_edges, y_edges [m] and the size of the mean error (m, n) in floors, or None.
    """

    verdict: str
    sentence: str
    lines: list[str]
    report: Path
    pictures: list[Shown]
    plate_map: tuple[np.ndarray, np.ndarray, np.ndarray] | None
    sides: Any


def hidden_words() -> str:
    """What the demo hid, for whoever wants to judge the answer."""
    from experiments.gap_work import DEMO_PLAY_RAD

    sizes = ", ".join(f"{a} {degrees(play):.2f}" for a, play in DEMO_PLAY_RAD.items())
    return f"What was hidden, which the analysis did not know: joint play of {sizes} degrees."


def find_gap(logs: Sequence[Path] | None, out: Path, seed: int, tell: Tell) -> GapAnswer:
    """The gap of recorded runs (None: of the hidden-play demo), with its report and pictures."""
    from experiments.dashboard.sides import both_models
    from experiments.folders import writable, write_results
    from experiments.gap import investigate
    from experiments.gap_input import read_evidence
    from experiments.gap_report import write_gap_report
    from experiments.gap_summary import summary_lines
    from rig.rigfile import write_rig

    folder = writable(out)
    paths = list(logs) if logs is not None else demo_runs(folder, seed, tell)
    found = investigate(paths, None, progress=tell)
    tell("report", 0, 1)
    write_results(folder, found.to_json())
    if found.rig_after is not None and (found.effects or found.unknown):
        write_rig(found.rig_after, folder / "rig.toml")
    report = write_gap_report(found, folder, names=[path.name for path in paths])
    pictures = [
        Shown(folder / f"{name}.png", caption)
        for name, caption in (("gap-shrinking", "The gap, effect by effect (1 = a perfect model)"),
                              ("ranking", "The likeliest names"),
                              ("gap-over-state-ball", "Where the ball's model is wrong"))
        if (folder / f"{name}.png").is_file()
    ]  # fmt: skip
    plate_map = None
    if found.maps:
        first = found.maps[0]
        size = np.where(first.count > 0, np.hypot(*np.moveaxis(first.mean, -1, 0)), np.nan)
        plate_map = (np.asarray(first.x_edges), np.asarray(first.y_edges), size)
    sides = None
    if found.rig_before is not None and found.rig_after is not None and found.effects:
        tell("both models, side by side", 0, 1)
        sides = both_models(read_evidence(paths), found.rig_before, found.rig_after)
    lines = summary_lines(found)[1:]
    if found.next_experiment is None:
        lines.append("next nothing more has to be measured to tell names apart")
    if logs is None:
        lines.insert(0, hidden_words())
    return GapAnswer(found.verdict, found.sentence, lines, report, pictures, plate_map, sides)
