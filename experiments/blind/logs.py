"""The logs of a trial: made by a simulator, written by the contract, beside the believed rig file.

Only the columns of the contract are written; a folder holds log-1.csv, log-2.csv ... and rig.toml
(where there is one) and nothing else.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from experiments.assemble import known
from experiments.blind import engine, strangers
from experiments.blind.trial import Noise, Trial
from experiments.exporting import export_log
from experiments.protocol import course, read_protocol
from rig.controllers import ARMS
from rig.log import CONTRACT, Log
from rig.pilot import RUN
from rig.rigfile import write_rig
from rig.simulate import Draws, Simulated, draw

# Usual process noise, white, at 500 Hz: a ball that wanders 0.3 mm in a second by itself, and the
# ripple of an amplifier.
PROCESS_M_S2 = 0.01
PROCESS_V = 0.02
BURST = 5  # frames, 83 ms at 60 Hz: below what a loop calls blind
TRIES = 4  # a run whose ball falls off is made again with another seed, as a person would


LogMaker = Callable[[Trial, str, int], Log]


def write_logs(
    trial: Trial, folder: Path, *, make: LogMaker | None = None, suffix: str = ".csv"
) -> list[Path]:
    """Make the trial's logs in `folder` (new or empty of logs); their paths in order.

    make(trial, protocol, seed): another table than the house's own.
    """
    make = make or make_log
    folder.mkdir(parents=True, exist_ok=True)
    if trial.believed:
        write_rig(trial.believed_rig, folder / "rig.toml")
    paths = []
    for i, (protocol, seed) in enumerate(zip(trial.protocols, trial.seeds, strict=True)):
        log = contract_only(make(trial, protocol, seed))
        paths.append(export_log(log, folder / f"log-{i + 1}{suffix}"))
    return paths


def make_log(trial: Trial, protocol: str, seed: int) -> Log:
    """One log of the trial in the house's own simulator, from the ball's release on.

    Another seed where the ball fell off the plate.
    """
    done = own_run(trial, protocol, seed)
    for i in range(1, TRIES):
        if done.outcome != "completed":
            done = own_run(trial, protocol, seed + i)
    # The hand's own clock: the controller may take noise for the release.
    let_go = course(read_protocol(protocol), trial.plant_rig, seed).hold_s
    return done.log.where((done.log["phase"] == RUN) & (done.log["t_s"] >= let_go))


def own_run(trial: Trial, protocol: str, seed: int) -> Simulated:
    """One run in the house's own simulator, disturbed as the trial says."""
    plant, believed = trial.plant_rig, trial.believed_rig
    plan = read_protocol(protocol)
    noise = trial.noise
    camera = replace(
        plant.camera, noise_m=plant.camera.noise_m * noise.camera, dropout=noise.dropped / 2
    )
    plant = replace(plant, camera=camera)
    way = course(plan, plant, seed)
    rng = np.random.default_rng([seed, 3])
    draws = draw(rng, plant, way)
    frames = spoiled(draws.camera, noise, rng)
    draws = Draws(frames, draws.tachometer)
    pushes = process(rng, len(draws.tachometer), plant.control_rate_hz, noise.process)
    return engine.disturbed(
        plant, known(believed), ARMS["without"], way, draws,
        noise=pushes, stranger=strangers.pack(trial.stranger),
    )  # fmt: skip


def process(rng: np.random.Generator, ticks: int, rate_hz: float, times: float) -> np.ndarray:
    """Process noise (ticks, 4) of the same power whatever the rate: x, y [m/s2], x, y [V]."""
    size = np.array([PROCESS_M_S2, PROCESS_M_S2, PROCESS_V, PROCESS_V]) * times
    return np.sqrt(rate_hz / 500) * size * rng.standard_normal((ticks, 4))


def spoiled(camera: np.ndarray, noise: Noise, rng: np.random.Generator) -> np.ndarray:
    """The camera's numbers (k, 3) with coloured noise of the same size, and bursts of lost frames.

    A uniform number below zero drops its frame whatever the camera's own share.
    """
    camera = camera.copy()
    if noise.colour:
        fresh = np.sqrt(1 - noise.colour**2)
        for k in range(1, len(camera)):
            camera[k, :2] = noise.colour * camera[k - 1, :2] + fresh * camera[k, :2]
    if noise.dropped:
        lost = rng.random(len(camera)) < noise.dropped / 2 / BURST
        lost[:30] = False  # the release is seen
        for start in np.flatnonzero(lost):
            camera[start : start + BURST, 2] = -1.0
    return camera


def contract_only(log: Log) -> Log:
    """The columns of the contract: no word of what the controller thought."""
    return Log.from_columns({name: log[name] for name in CONTRACT if log.has(name)})


def peak_volts(trial: Trial, *, share: float = 0.995) -> dict[str, float]:
    """By axis, the `share` point of |V| over the trial's logs [V], in the house's own simulator."""
    pairs = zip(trial.protocols, trial.seeds, strict=True)
    logs = [own_run(replace(trial, noise=Noise()), p, s).log for p, s in pairs]
    used = {a: np.abs(np.concatenate([log[f"voltage_{a}_V"] for log in logs])) for a in "xy"}
    return {axis: float(np.quantile(volts, share)) for axis, volts in used.items()}
