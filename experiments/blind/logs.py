"""The logs of a trial: made by a simulator, written by the contract, beside the rig file.

Only the columns of the contract are written; a folder holds log-1.csv, log-2.csv ... and rig.toml
(where there is one) and nothing else.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from experiments.blind import engine, uncatalogued_effects
from experiments.blind.trial import BlindTrial, Noise
from experiments.records.exporting import export_log
from experiments.runs.assemble import known
from experiments.runs.protocol import course, read_protocol
from rig.control.controllers import COMPENSATORS
from rig.control.tick import RUN
from rig.log import CONTRACT, Log
from rig.rigfile import write_rig
from rig.simulation.simulate import Draws, Simulated, draw

# Usual process noise, white, at 500 Hz: a ball that wanders 0.3 mm in a second by itself, and the
# ripple of an amplifier.
PROCESS_M_S2 = 0.01
PROCESS_V = 0.02
BURST = 5  # frames, 83 ms at 60 Hz: below what a loop calls blind
TRIES = 4  # a run whose ball falls off is made again with another seed, as a person would


LogMaker = Callable[[BlindTrial, str, int], Log]


def write_logs(
    trial: BlindTrial, folder: Path, *, make: LogMaker | None = None, suffix: str = ".csv"
) -> list[Path]:
    """Make the trial's logs and its rig file in `folder` (made if missing); return the logs' paths.

    One log per protocol of the trial, log-1 onwards, with the columns of the contract; rig.toml is
    written if the trial has a nominal rig. make: simulator of a log, called with trial, protocol
    and seed (default: `make_log`); suffix: ".csv", ".parquet" or ".mat". ValueError: another suffix
    or an unknown protocol. OSError: `folder` cannot be written.
    """
    make = make or make_log
    folder.mkdir(parents=True, exist_ok=True)
    if trial.believed:
        write_rig(trial.nominal_rig, folder / "rig.toml")
    paths = []
    for i, (protocol, seed) in enumerate(zip(trial.protocols, trial.seeds, strict=True)):
        log = contract_only(make(trial, protocol, seed))
        paths.append(export_log(log, folder / f"log-{i + 1}{suffix}"))
    return paths


def make_log(trial: BlindTrial, protocol: str, seed: int) -> Log:
    """One log of the trial in the rig's own simulator, from the release of the ball on.

    A run whose ball falls off is made again with the next seed, `TRIES` runs at most; the last one
    is used however it ended. ValueError: an unknown protocol.
    """
    done = own_run(trial, protocol, seed)
    for i in range(1, TRIES):
        if done.outcome != "completed":
            done = own_run(trial, protocol, seed + i)
    # By the operator's clock: the controller may take noise for the release.
    let_go = course(read_protocol(protocol), trial.plant_rig, seed).hold_s
    return done.log.where((done.log["phase"] == RUN) & (done.log["t_s"] >= let_go))


def own_run(trial: BlindTrial, protocol: str, seed: int) -> Simulated:
    """One run in the rig's own simulator with the trial's noise and uncatalogued effect; seed: of
    its random numbers.

    Returns the log and how the run ended. The controller uses no compensator and knows the nominal
    rig. ValueError: an unknown protocol.
    """
    plant, nominal = trial.plant_rig, trial.nominal_rig
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
    if plant.servo.kind == "position":
        pushes[:, 2:] = 0.0  # nobody gives volts there
    return engine.disturbed(
        plant,
        known(nominal),
        COMPENSATORS["without"],
        way,
        draws,
        noise=pushes,
        stranger=uncatalogued_effects.disturbance_record(trial.stranger),
    )


def process(rng: np.random.Generator, ticks: int, rate_hz: float, times: float) -> np.ndarray:
    """White process noise (ticks, 4): accelerations of the ball x, y [m/s2] and volts x, y [V].

    Standard deviation: `times` that of `PROCESS_M_S2` and `PROCESS_V` at 500 Hz, multiplied by
    sqrt(rate_hz / 500) so that the power density is the same at every rate.
    """
    size = np.array([PROCESS_M_S2, PROCESS_M_S2, PROCESS_V, PROCESS_V]) * times
    return np.sqrt(rate_hz / 500) * size * rng.standard_normal((ticks, 4))


def spoiled(camera: np.ndarray, noise: Noise, rng: np.random.Generator) -> np.ndarray:
    """A copy of the camera's random numbers with coloured noise and bursts of lost frames.

    camera (k, 3): standard normal numbers for x and y, and a uniform number that drops the frame if
    it is below the camera's dropout. Colour: AR(1) of unchanged variance. In a burst of `BURST`
    frames the uniform number is -1, so these frames are always lost.
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
    """The log with the columns of the contract alone, without those of controller and observers."""
    return Log.from_columns({name: log[name] for name in CONTRACT if log.has(name)})


def peak_volts(trial: BlindTrial, *, share: float = 0.995) -> dict[str, float]:
    """The `share` quantile of |V| [V] over the trial's logs, by axis ("x", "y").

    The logs are run in the rig's own simulator with the usual noise. ValueError: an unknown
    protocol.
    """
    pairs = zip(trial.protocols, trial.seeds, strict=True)
    logs = [own_run(replace(trial, noise=Noise()), p, s).log for p, s in pairs]
    used = {a: np.abs(np.concatenate([log[f"voltage_{a}_V"] for log in logs])) for a in "xy"}
    return {axis: float(np.quantile(volts, share)) for axis, volts in used.items()}
