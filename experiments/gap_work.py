"""What the forms of `rig gap` do: investigate and report, learn tolerances, demo, blind trials."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import typer

from calibration.gap.findings import Findings
from calibration.gap.workflow import STAGES
from experiments.console import bars
from experiments.folders import writable, write_json, write_results
from experiments.gap import investigate
from experiments.gap_input import read_evidence
from experiments.gap_report import write_gap_report
from experiments.gap_summary import summary_lines
from rig.parameters import Rig
from rig.rigfile import write_rig

DEMO_PLAY_RAD = {"x": 0.035, "y": 0.020}  # 2.0 and 1.1 degrees at the servo shaft


def investigate_and_report(
    logs: Sequence[Path], *, rig_file: Path | None, out: Path, json_file: Path | None, until: str
) -> Findings:
    """Run the stages and write gap.html, figures, results.json and rig.toml (the extended model).

    ValueError, OSError: bad input or an unwritable folder, before any work.
    """
    if until not in STAGES:
        raise ValueError(f"--until {until}: known stages: {', '.join(STAGES)}")
    folder = writable(out)
    with bars() as progress:
        found = investigate(logs, rig_file, until=until, threads=2, progress=progress)
    write_results(folder, found.to_json())
    if json_file is not None:
        write_json(json_file, found.to_json())
    if found.rig_after is not None and (found.effects or found.unknown):
        write_rig(found.rig_after, folder / "rig.toml")
    page = write_gap_report(found, folder, names=[path.name for path in logs])
    for line in summary_lines(found):
        typer.echo(line)
    typer.echo(f"report: {page}   numbers: {folder / 'results.json'}")
    return found


def tolerances(logs: Sequence[Path], *, rig_file: Path | None, out: Path) -> None:
    """Learn tolerances and floors of a table from clean runs; write them into OUT/rig.toml."""
    from calibration.gap.tolerances import learn

    inputs, folder = read_evidence(list(logs), rig_file), writable(out)
    learned = learn(inputs.logs, inputs.rig)
    write_rig(learned, folder / "rig.toml")
    for name, value in (*learned.tolerances.items(), *learned.floors.items()):
        typer.echo(f"{name:22s} {value:.4g}")
    typer.echo(f"from {len(inputs.logs)} clean runs; written to {folder / 'rig.toml'} [tolerances] "
               "(half width of the first parameter) and [floors] (RMS, rad or m)")  # fmt: skip


def demo(*, out: Path, json_file: Path | None, seed: int) -> None:
    """Record three runs of a table with a hidden joint play, and let the workflow find it."""
    from experiments.protocol import read_protocol
    from experiments.runner import Order, keep_simulated, simulate_order

    folder = writable(out)
    believed = Rig()
    plays = {axis: {"play_rad": play} for axis, play in DEMO_PLAY_RAD.items()}
    plant = replace(believed, effects={"joint_backlash": plays})
    runs = []
    for name, number in (("steps", seed), ("sine-sweep", seed + 1), ("free-release", seed + 2)):
        order = Order(plant, read_protocol(name), "without", number, folder / "runs", kind=believed)
        runs.append(keep_simulated(order, simulate_order(order)))
    typer.echo(
        "hidden in the simulated table, unknown to the workflow: joint play of "
        + ", ".join(f"{play} rad ({axis})" for axis, play in DEMO_PLAY_RAD.items())
    )
    investigate_and_report(runs, rig_file=None, out=out, json_file=json_file, until="next")


def blind(
    logs: Sequence[Path],
    *,
    rig_file: Path | None,
    out: Path,
    trials: int,
    seed: int | None,
    jobs: int | None,
    cluster: str | None,
    effects: Sequence[str],
    pairs: bool,
) -> None:
    """Blind trials, in the house's simulator or onto the user's logs; prints the table."""
    from experiments.blind.command import blind_trial
    from experiments.blind.table import rows, show

    with bars() as progress:
        results = blind_trial(
            trials=trials, out=writable(out), seed=seed, effects=effects, pairs=pairs, onto=logs,
            rig_file=rig_file, cluster=cluster, jobs=jobs, say=typer.echo, progress=progress,
        )  # fmt: skip
    if not logs:
        show(rows(results), "Blind trials")
    typer.echo(f"table: {out / 'table.md'}   numbers: {out / 'results.json'}")
