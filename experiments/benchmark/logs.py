"""The blind trials' logs from the two independent tables, with the trial's own imperfections.

Those tables' own draws are switched off, for all logs of a trial come from one table; where a
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
    """One log of a trial on its table; an `experiments.blind.logs.LogMaker`."""
    if trial.engine == "mujoco":
        from experiments.benchmark.engines.mujoco_engine.logs import make_log
    else:
        from experiments.benchmark.engines.foreign.table import make_log
    servo, noise, stranger = trial.plant["servo"], trial.noise, trial.stranger
    if stranger is not None:
        name = OTHERS[stranger["kind"]]
        odd = (name, STRANGERS[name][1] * trial.factor / 1.5)
    seconds = read_protocol(protocol).duration_s
    alone = stranger is not None and len(trial.protocols) == 1
    columns = make_log(
        PROTOCOLS[protocol],
        effects=trial.plant["effects"],
        seed=seed,
        imperfect=False,
        gain=(servo["gain_rad_s_V"],) * 2,
        tau=(servo["time_constant_s"],) * 2,
        stranger=odd if stranger is not None else None,
        process_scale=noise.process,
        noise_scale=noise.camera,
        colour=noise.colour,
        dropout=noise.dropped,
        duration_s=2 * seconds if alone else seconds,
    )
    return Log.from_columns({n: v for n, v in columns.items() if not np.isnan(v).all()})
