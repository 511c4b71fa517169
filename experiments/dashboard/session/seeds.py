"""Seeds of the runs that a Start makes: what was run already is not simulated again."""

from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from experiments.dashboard.session.plan import RunPlan
from experiments.records.run_folder import plain, read_meta
from experiments.runs.assemble import known
from rig.files import json_of
from rig.parameters import Rig
from rig.rigfile import to_record


def with_new_seeds(plan: RunPlan, rig: Rig, parent: Path) -> RunPlan:
    """The plan with the first seeds, from its own on, that no run in `parent` has used.

    A seed is used where a run of the protocol has it with one of the plan's controllers, or on
    another table than `rig`: so a run with the other controller alone completes a pair.
    """
    used = set()
    for file in parent.glob("*/run.json"):
        with suppress(OSError, ValueError):
            meta = read_meta(file.parent)
            protocol = meta["protocol"]
            name = protocol.get("name") if isinstance(protocol, dict) else protocol
            if name != plan.protocol.name:
                continue
            if meta["arm"] in plan.methods or not _of_table(file.parent, meta, rig):
                used.add(meta["seed"])
    seed = plan.seed
    while used & set(range(seed, seed + plan.repetitions)):
        seed += 1
    return replace(plan, seed=seed)


def _of_table(folder: Path, meta: dict, rig: Rig) -> bool:
    """Whether a run is of this plant: of a simulated one truth.json says it, since controllers, and
    so run.json, know nothing of its play.
    """
    if meta["source"] == "simulated":
        truth = json_of(folder / "truth.json")
        return isinstance(truth, dict) and truth.get("rig") == plain(to_record(rig))
    return meta["rig"] == plain(to_record(known(rig)))
