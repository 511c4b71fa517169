"""The paper's study on the virtual rig, from frame to figure.

1 calibrate the virtual camera from its own frames; 2 the runs of Figs. 10 to 14 through rendered
frames; 3 a statistical camera fitted to them; 4 with it Figs. 7 and 8, paired repetitions for the
claims (other units of the same kind) and the grid of play; 5 figures, results.json, report.html.
"""

from contextlib import nullcontext, suppress
from dataclasses import replace
from itertools import product
from os import cpu_count
from pathlib import Path

import numpy as np
from joblib import Parallel, delayed

from experiments.analysis.metrics import run_metrics
from experiments.analysis.numbers import Recorded, completed_measures, recorded
from experiments.analysis.regime import regime
from experiments.paper.alternative_explanations import (
    compare_alternatives,
    little_friction,
    measured,
)
from experiments.paper.claims import GRID_DEG, judge, play_grid
from experiments.paper.study_report import write_study
from experiments.progress import ProgressCall, silent
from experiments.records.recording import read_run, recover
from experiments.records.run_folder import read_meta, write_results
from experiments.runs.assemble import another_unit, play_rad, with_play
from experiments.runs.protocol import read_protocol
from experiments.runs.runner import (
    RunRequest,
    contract_columns,
    keep_simulated,
    run,
    simulate_run,
    simulate_runs,
)
from experiments.runs.runs import own_calibration
from rig.parameters import Rig
from rig.simulation.simulate import Simulated

PAIRS = 24  # paired seeds a claim
GRID_PAIRS = 20  # paired seeds a cell
ARMS = ("without", "with")
Study = dict[str, dict[str, list[Recorded]]]  # figure -> arm -> runs


def reproduce(
    rig: Rig,
    out: Path,
    *,
    seed: int = 1,
    frames: bool = True,
    pairs: int = PAIRS,
    grid_pairs: int = GRID_PAIRS,
    progress: ProgressCall = silent,
) -> dict:
    """Make the whole study in `out` and return the content of results.json.

    rig: the virtual table; seed: of everything that is drawn; frames: the runs of Figs. 10 to 14
    through rendered camera frames; pairs: paired seeds of each claim; grid_pairs: of each cell of
    play. KeyboardInterrupt: unfinished runs are completed and the interruption is raised again.
    ValueError: a protocol that the rig cannot run, too few frames with the ball, or another program
    that makes runs through frames in `out`; OSError: `out` cannot be written.
    """
    with own_calibration(rig, out, seed) if frames else nullcontext() as bundle:
        progress("camera calibrated", 1, 1)
        try:
            study, pairs_seen = _figure_runs(rig, out, seed, bundle, progress)
        except (KeyboardInterrupt, SystemExit):  # Ctrl-C, or a signal that ends the program
            mend_unfinished(out / "runs")
            raise
    fitted = fit_camera(rig, pairs_seen) if frames else rig
    study |= _simulated_figures(fitted, out, seed)
    table, paired_runs = _claim_runs(fitted, out, seed, pairs, progress)
    cells = list(product((0.0,) if rig.servo.takes_angle else GRID_DEG, GRID_DEG))
    progress("cells of play", 0, len(cells))
    grid = play_grid(_grid_rows(fitted, seed, grid_pairs, len(cells), progress), seed, cells)
    results = {
        "source": "simulated",
        "seed": seed,
        "camera": {
            "frames": frames,
            "noise_m": fitted.camera.noise_m,
            "dropout": fitted.camera.dropout,
            "samples": len(pairs_seen),
        },
        "regime": regime(rig),
        "claims": judge(table, seed),
        "paired_runs": paired_runs,
        "grid": grid,
        "rivals": _rivals(fitted, seed, pairs, progress),
        "grid_pairs": grid_pairs,
    }
    results |= write_study(study, results, rig, out)
    write_results(out, results)
    return results


def _rivals(rig: Rig, seed: int, pairs: int, progress: ProgressCall) -> dict[str, dict]:
    """`compare_alternatives` on the table as it is and with little friction."""
    tables, found = {"friction as it is": rig, "little friction": little_friction(rig)}, {}
    progress("alternative explanations", 0, len(tables))
    for name, table in tables.items():
        found[name] = compare_alternatives(table, seed, pairs)
        progress("alternative explanations", len(found), len(tables))
    return found


def _figure_runs(rig: Rig, out: Path, seed: int, bundle: Path | None, progress: ProgressCall):
    """The runs of Figs. 10 to 14, two processes at a time; also every (true, measured) pair."""
    release, pushed = read_protocol("free-release"), read_protocol("pushed")
    runs = out / "runs"
    wanted = [("10", release, arm, seed) for arm in ARMS]
    wanted += [("12", pushed, "without", seed), ("13", pushed, "with", seed)]
    wanted += [("14", release, arm, seed + i) for i in range(1, 5) for arm in ARMS]
    requests = [RunRequest(rig, p, arm, s, runs, bundle) for _, p, arm, s in wanted]
    stage = "runs through frames" if bundle else "runs"
    progress(f"{stage}: the first compiles the program" if bundle else stage, 0, len(requests))
    jobs = Parallel(n_jobs=min(2, cpu_count() or 1), return_as="generator")
    first = jobs([delayed(run)(requests[0])])  # compiles what sees, before two processes would
    simulate_run(requests[0])  # compiles beside it what only simulates
    done: list = list(first)
    progress(stage, len(done), len(requests))
    for one in jobs(delayed(run)(request) for request in requests[1:]):
        done.append(one)
        progress(stage, len(done), len(requests))
    study: Study = {}
    for (figure, _, arm, _), one in zip(wanted, done, strict=True):
        runs_of_arm = study.setdefault(figure, {}).setdefault(arm, [])
        runs_of_arm.append(recorded(one.folder, read_run(one.folder).log, one.ending.outcome))
    study["11"] = study["10"]
    return study, np.concatenate([one.pairs for one in done])


def mend_unfinished(runs: Path) -> None:
    """Complete the runs in `runs` that have no outcome, whose process was ended in the middle.

    Runs that cannot be read or written are left as they are.
    """
    for folder in sorted(runs.iterdir()) if runs.is_dir() else ():
        with suppress(OSError, ValueError):
            if read_meta(folder).get("outcome") is None:
                recover(folder)


def fit_camera(rig: Rig, pairs: np.ndarray) -> Rig:
    """The rig with the noise and dropout of the statistical camera fitted to frames.

    pairs (k, 5): exposure time [s], true x, y, measured x, y [m] (NaN: not seen). The noise is the
    RMS of the whole error, its constant part included; simulator and tests alone use it.
    ValueError: fewer than 100 frames showed the ball.
    """
    error = pairs[:, 3:] - pairs[:, 1:3]
    seen = np.isfinite(error).all(axis=1)
    if seen.sum() < 100:
        raise ValueError(f"only {seen.sum()} of {len(pairs)} frames showed the ball: no camera fit")
    noise = float(np.sqrt(np.mean(error[seen] ** 2)))
    return replace(rig, camera=replace(rig.camera, noise_m=noise, dropout=float(1 - seen.mean())))


def _simulated_figures(rig: Rig, out: Path, seed: int) -> Study:
    """Figs. 7 and 8: simulation alone, both arms on the same plant and seed."""
    protocol = read_protocol("free-release")
    runs = {}
    for arm in ARMS:
        request = RunRequest(rig, protocol, arm, seed + 100, out / "runs")
        result = simulate_run(request)
        runs[arm] = [recorded(keep_simulated(request, result), result.log, result.outcome)]
    return {"7": runs, "8": runs}


def _claim_runs(rig: Rig, out: Path, seed: int, pairs: int, progress: ProgressCall):
    """Paired repetitions on other units of the kind, recorded; measures by protocol and arm."""
    requests = [
        RunRequest(another_unit(rig, s), read_protocol(name), arm, s, out / "runs", kind=rig)
        for name in ("free-release", "pushed", "hold")
        for s in range(seed + 1000, seed + 1000 + pairs)
        for arm in ARMS
    ]

    folders: dict[tuple[str, int, str], str] = {}

    def one(request: RunRequest, result: Simulated) -> dict[str, float]:
        kept = replace(result, log=contract_columns(result.log))
        folders[request.arm, request.seed, request.protocol.name] = keep_simulated(
            request, kept
        ).name
        return completed_measures(run_metrics(kept.log), kept.outcome)

    progress("paired repetitions", 0, len(requests))
    rows = simulate_runs(requests, one, lambda k: progress("paired repetitions", k, len(requests)))
    table: dict[str, dict[str, list[dict]]] = {}
    for request, row in zip(requests, rows, strict=True):
        table.setdefault(request.protocol.name, {}).setdefault(request.arm, []).append(row)
    named = [
        {"protocol": o.protocol.name, "arm": o.arm, "seed": o.seed}
        | {"folder": folders[o.arm, o.seed, o.protocol.name]}
        for o in requests
    ]
    return table, named


def _grid_rows(rig: Rig, seed: int, pairs: int, cells: int, progress: ProgressCall):
    """A function (gear, joint play in degrees) -> arm -> measures, one row a seed."""
    protocol, finished = read_protocol("free-release"), [0]

    def rows_of(gear_deg: float, joint_deg: float) -> dict[str, list[dict]]:
        played = with_play(
            rig, gear_rad=play_rad(rig, gear_deg), joint_rad=play_rad(rig, joint_deg)
        )
        seeds = range(seed + 2000, seed + 2000 + pairs)
        requests = [
            RunRequest(another_unit(played, s), protocol, arm, s, Path(), kind=played)
            for arm in ARMS
            for s in seeds
        ]
        rows = simulate_runs(requests, measured)
        finished[0] += 1
        progress("cells of play", finished[0], cells)
        return {"without": rows[:pairs], "with": rows[pairs:]}

    return rows_of
