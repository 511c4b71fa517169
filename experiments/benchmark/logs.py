"""The logs of a trial from the two independent engines, with the trial's own imperfections.

Those engines' own draws are switched off, for all logs of a trial come from one table; where a
stranger sits they draw from the seed, so that all logs of such a trial have one seed.
"""

from dataclasses import replace

import numpy as np

from experiments.benchmark.engines.foreign.truth import STRANGERS
from experiments.blind.draws import TrialPlan, plan_trials
from experiments.blind.trial import BlindTrial
from experiments.blind.uncatalogued_effects import NAMES
from experiments.runs.protocol import read_protocol
from rig.log import Log
from rig.parameters import Drive, Rig, Servo

PROTOCOLS = {
    "steps": "steps",
    "pushed": "pushed",
    "free-release": "corner",
    "sine-sweep": "sweep",
    "circle": "circle",
    "hold": "hold",
    "servo-squares": "squares",
}
OTHERS = dict(zip(NAMES, ("dent", "rhythm", "bump", "unbalanced", "cable", "draught"), strict=True))
# Its servos have no tachometer and its bearings no friction of their own.
TABLE = Rig(
    servo=Servo(gain_rad_s_V=1.53, time_constant_s=0.025, tachometer=False),
    drive=Drive(arm_friction_nm=0.0, joint_friction_nm=0.0),
)


def trials_for(engine: str, plan: TrialPlan) -> list[BlindTrial]:
    """The trials of a plan on that table ("foreign" or "mujoco")."""
    return [_placed(trial, engine) for trial in plan_trials(replace(plan, table=TABLE))]


def _placed(trial: BlindTrial, engine: str) -> BlindTrial:
    if trial.kind != "stranger":
        return replace(trial, engine=engine)
    if trial.battery == "battery":
        return replace(trial, engine=engine, seeds=trial.seeds[:1] * len(trial.seeds))
    return replace(trial, engine=engine, seeds=trial.seeds[:1], protocols=trial.protocols[:1])


def other_log(trial: BlindTrial, protocol: str, seed: int) -> Log:
    """One log of a trial of `trials_for`, an `experiments.blind.logs.LogMaker`: as long as the
    protocol, or twice that where it is a stranger's only one.
    """
    alone = trial.stranger is not None and len(trial.protocols) == 1
    times = 2 if alone else 1
    return engine_log(trial, protocol, seed, times * read_protocol(protocol).duration_s)


def engine_log(trial: BlindTrial, protocol: str, seed: int, seconds: float) -> Log:
    """A log of `seconds` from the trial's engine ("foreign" or "mujoco"), shorter where the ball
    left the plate. KeyError: the engine has no such protocol. ModuleNotFoundError: no MuJoCo.
    """
    if trial.engine == "mujoco":
        from experiments.benchmark.engines.mujoco_engine.logs import make_log
    else:
        from experiments.benchmark.engines.foreign.table import make_log
    servo, noise, stranger = trial.plant["servo"], trial.noise, trial.stranger
    odd = None
    if stranger is not None:
        name = OTHERS[stranger["kind"]]
        odd = (name, STRANGERS[name][1] * trial.factor / 1.5)
    columns = make_log(
        PROTOCOLS[protocol],
        effects=trial.plant["effects"],
        seed=seed,
        imperfect=False,
        gain=(servo["gain_rad_s_V"],) * 2,
        tau=(servo["time_constant_s"],) * 2,
        stranger=odd,
        process_scale=noise.process,
        noise_scale=noise.camera,
        colour=noise.colour,
        dropout=noise.dropped,
        duration_s=seconds,
    )
    return Log.from_columns({n: v for n, v in columns.items() if not np.isnan(v).all()})
