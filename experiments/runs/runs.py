"""Run a protocol's arms and repetitions, and keep or reject what came out."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from experiments.assemble import virtual_scene
from experiments.console import ProgressCall
from experiments.folders import write_results
from experiments.protocol import Protocol
from experiments.run_folder import read_meta, replace_json
from experiments.runner import Done, Order, run
from rig.parameters import Rig


def calibrate_camera(rig: Rig, out: Path, seed: int) -> Path:
    """Calibrate the virtual camera from its own pictures, like a real one; the bundle's path."""
    from calibration.bundle import calibrate_virtual
    from vision.synthetic import Renderer, virtual_view

    renderer = Renderer(virtual_scene(rig), virtual_view(), np.random.default_rng([seed, 6]))
    bundle = calibrate_virtual(renderer, np.random.default_rng([seed, 7]))
    path = out / "calibration.json"
    bundle.save(path)
    return path


def run_protocol(
    rig: Rig,
    protocol: Protocol,
    *,
    arms: Sequence[str],
    out: Path,
    seed: int,
    repetitions: int,
    frames: bool,
    progress: ProgressCall,
) -> list[Done]:
    """Every repetition of every arm in turn (a seed's arms get the same course); results.json."""
    bundle = calibrate_camera(rig, out, seed) if frames else None
    orders = [
        Order(rig, protocol, arm, seed + i, out / "runs", bundle)
        for i in range(repetitions)
        for arm in arms
    ]
    done = []
    for i, order in enumerate(orders):
        label = f"{protocol.name} {order.arm} {order.seed}"
        total = round(protocol.duration_s)
        done.append(run(order, progress=lambda t, s=label, n=total: progress(s, int(t), n)))
        progress(label, total, total)
        progress("runs", i + 1, len(orders))
    runs = [
        {"folder": one.folder.name, "arm": order.arm, "seed": order.seed}
        | {"outcome": one.ending.outcome, "reason": one.ending.reason}
        for order, one in zip(orders, done, strict=True)
    ]
    write_results(out, {"source": "simulated", "protocol": protocol.name, "runs": runs})
    return done


def measure_protocol(
    rig: Rig,
    rig_file: Path,
    protocol: Protocol,
    *,
    arms: Sequence[str],
    out: Path,
    seed: int,
    repetitions: int,
    arm_table: Callable[[str], None],
    say: Callable[[str], None],
) -> list[Done]:
    """The same on the real table: `arm_table` asks before every run, `say` tells what to do.

    A run that did not come to its end is the last one; results.json is written all the same.
    """
    from experiments.hardware_run import check, measure

    check(rig, rig_file, protocol)
    orders = [
        Order(rig, protocol, arm, seed + i, out / "runs")
        for i in range(repetitions)
        for arm in arms
    ]
    done: list[Done] = []
    try:
        for i, order in enumerate(orders):
            arm_table(f"Run {i + 1} of {len(orders)}: {protocol.title}, {order.arm} the model.")
            done.append(measure(order, rig_file, say=say))
            if done[-1].ending.outcome not in ("completed", "ball lost"):
                break
    finally:
        runs = [
            {"folder": one.folder.name, "arm": order.arm, "seed": order.seed}
            | {"outcome": one.ending.outcome, "reason": one.ending.reason}
            for order, one in zip(orders, done, strict=False)
        ]
        write_results(out, {"source": "measured", "protocol": protocol.name, "runs": runs})
    return done


def reject(folder: Path, reason: str) -> None:
    """Mark a run as rejected in its run.json. FileNotFoundError: no run there."""
    if not (folder / "run.json").is_file():
        raise FileNotFoundError(f"{folder} is no run folder: it has no run.json")
    replace_json(folder / "run.json", read_meta(folder) | {"rejected": reason})
