"""How often `rig watch` cries wolf, and how soon and rightly it tells a change.

`python tests/benchmarks/gap/watching.py --tables 200 --out out/watching` (about an hour of one
core): each table has 30 runs of 12 s of random steps; 1 or 3 are accepted. Of five tables one stays
as it is, one wears (joint play grows from run to run), one has its camera knocked (turned, or of
another scale), one a joint that comes loose at once, one a weaker supply. Healthy tables differ
from run to run, too (SPREAD). Every other table is the independent one of tests/support/foreign,
which shares no code with the product. A table is followed up to its first alarm. Interrupted, it
goes on where it stopped. `--prior` prints the moments from which PRIOR_RATIO and PRIOR_RUNS of
calibration/watch/change_detection.py come.
"""

import argparse
import json
import sys
import time
from dataclasses import replace
from math import log as ln
from math import radians
from pathlib import Path

import numpy as np
from scipy.optimize import brentq
from scipy.special import digamma, polygamma
from scipy.stats import beta, chi2
from threadpoolctl import threadpool_limits

sys.path.insert(0, str(Path(__file__).parents[3]))

from calibration.watch.change_detection import alarm_threshold, alarms, strongest
from calibration.watch.run_estimates import Accepted, accept, effect_of, estimate
from rig import COMPENSATORS, Course, Rig, draw, simulate_many
from rig.log import Log
from rig.parameters import Drive
from rig.simulation.simulate import Task
from tests.support.foreign.table import make_log

RUNS, SECONDS, RATE_HZ = 30, 12.0, 500.0
KINDS = ("nothing", "wear", "camera", "joint", "supply")
RIGHT = {
    "wear": ("joint_backlash",),
    "camera": ("camera_yaw", "camera_scale"),
    "joint": ("joint_backlash",),
    "supply": ("gain",),
}
# Standard deviation of what differs between runs of a healthy table; of plays and gains a share.
# Chosen: about what one run tells of each.
SPREAD = {
    "gain": 0.004, "play": 0.01, "friction_V": 0.003, "offset_V": 0.003, "slope_rad": 2e-5,
    "extra_s": 3e-4, "fraction": 5e-4, "angle_rad": 5e-4,
}  # fmt: skip


def truth(rng: np.random.Generator) -> dict:
    """A table: plays of 0.5 to 1.7 degrees, friction, offset and level by axis."""
    return {
        "gain": 1.0 + rng.uniform(-0.03, 0.03, 2),
        "gear": radians(1) * rng.uniform(0.5, 1.5, 2),
        "joint": radians(1) * rng.uniform(0.5, 1.7, 2),
        "friction_V": rng.uniform(0.01, 0.08, 2),
        "offset_V": rng.uniform(-0.13, 0.13, 2),
        "slope_rad": rng.uniform(-1.7e-3, 1.7e-3, 2),
        "fraction": rng.uniform(-0.002, 0.002),
        "angle_rad": rng.uniform(-0.002, 0.002),
        "extra_s": rng.uniform(-0.001, 0.001),
    }


def jittered(table: dict, rng: np.random.Generator) -> dict:
    """The table as it is in one run."""
    found = dict(table)
    for key in ("friction_V", "offset_V", "slope_rad"):
        found[key] = table[key] + SPREAD[key] * rng.standard_normal(2)
    for key, share in (("gain", "gain"), ("gear", "play"), ("joint", "play")):
        found[key] = table[key] * (1.0 + SPREAD[share] * rng.standard_normal(2))
    for key in ("extra_s", "fraction", "angle_rad"):
        found[key] = table[key] + SPREAD[key] * rng.standard_normal()
    return found | {"friction_V": np.maximum(found["friction_V"], 0.0)}


def changed(table: dict, kind: str, runs_after: int, size: float, axis: int, how: int) -> dict:
    """The table so many runs after its change began; `size` in 0 to 1 of the kind's range."""
    found = dict(table)
    at = np.eye(2)[axis]
    if kind == "wear":  # 0.3 to 1 mrad a run, on one axis or both
        found["joint"] = table["joint"] + (3e-4 + 7e-4 * size) * (runs_after + 1) * (
            at if how else np.ones(2)
        )
    elif kind == "joint":  # 4 to 12 mrad at once
        found["joint"] = table["joint"] + (0.004 + 0.008 * size) * at
    elif kind == "supply":  # 4 to 12 % less
        found["gain"] = table["gain"] * (1.0 - 0.04 - 0.08 * size)
    elif kind == "camera":  # turned by 0.6 to 2.3 degrees, or 1 to 4 % too large or small
        sign = 1 if axis else -1
        key, step = ("angle_rad", 0.01 + 0.03 * size) if how else ("fraction", 0.01 + 0.03 * size)
        found[key] = table[key] + sign * step
    return found


def effects_of(table: dict) -> dict:
    """The effects of a rig file, as of the catalogue."""

    def pair(key: str, values: np.ndarray) -> dict:
        return {a: {key: float(v)} for a, v in zip("xy", values, strict=True)}

    return {
        "gear_backlash": pair("play_rad", table["gear"]),
        "joint_backlash": pair("play_rad", table["joint"]),
        "coulomb_friction": pair("friction_V", table["friction_V"]),
        "voltage_offset": pair("offset_V", table["offset_V"]),
        "level_offset": pair("slope_rad", table["slope_rad"]),
        "camera_scale": {"xy": {"fraction": table["fraction"]}},
        "camera_yaw": {"xy": {"angle_rad": table["angle_rad"]}},
        "camera_delay": {"xy": {"extra_s": table["extra_s"]}},
    }


def believed(table: dict, engine: str, rng: np.random.Generator) -> Rig:
    """The rig file: plays known to a tenth, nothing else known."""
    plays = {
        f"{shaft}_backlash": {
            a: {"play_rad": float(v * rng.uniform(0.9, 1.1))}
            for a, v in zip("xy", table[shaft], strict=True)
        }
        for shaft in ("gear", "joint")
    }
    smooth = Drive(arm_friction_nm=0.0, joint_friction_nm=0.0)
    return Rig(effects=plays) if engine == "own" else Rig(effects=plays, drive=smooth)


def own_logs(tables: list[dict], rng: np.random.Generator) -> list[Log | None]:
    """Runs of the product's simulator; None where the ball was lost."""
    known, tasks, n = Rig(), [], round(SECONDS * RATE_HZ)
    for table in tables:
        rig = with_gains(Rig(effects=effects_of(table)), table["gain"])
        points = rng.uniform(-0.045, 0.045, (round(SECONDS / 2) + 1, 2))
        course = Course(np.repeat(points, round(2 * RATE_HZ), axis=0)[:n], np.zeros((n, 2)))
        tasks.append(Task(rig, known, COMPENSATORS["without"], course, draw(rng, rig, course)))
    done = simulate_many(tasks)
    return [one.log if one.outcome == "completed" else None for one in done]


def with_gains(rig: Rig, shares: np.ndarray) -> Rig:
    """The rig with K times the mean of two shares: the product's plant has one K for both axes."""
    servo = replace(rig.servo, gain_rad_s_V=float(rig.servo.gain_rad_s_V * np.mean(shares)))
    return replace(rig, servo=servo)


def foreign_log(table: dict, seed: int) -> Log | None:
    """A run of the independent table; None where the ball was lost."""
    columns = make_log(
        "steps", effects=effects_of(table), seed=seed, imperfect=False, duration_s=SECONDS,
        gain=tuple(1.53 * table["gain"]),
    )  # fmt: skip
    if columns["t_s"][-1] < SECONDS - 0.1:
        return None
    return Log.from_columns(columns)


def plan(index: int) -> dict:
    """What a table is and what happens to it, from its number alone."""
    rng = np.random.default_rng([index, 20])
    return {
        "index": index,
        "kind": KINDS[index % 5],
        "engine": ("own", "foreign")[index // 5 % 2],
        "accepted": int(rng.choice([1, 3])),
        "begins": int(rng.integers(6, 20)),
        "size": float(rng.uniform()),
        "axis": int(rng.integers(2)),
        "how": int(rng.integers(2)),
    }


def logs_of(made: dict, first: int, last: int) -> list[Log | None]:
    """The logs of the runs first to last - 1 of a planned table."""
    base = truth(np.random.default_rng([made["index"], 21]))
    rng = np.random.default_rng([made["index"], 22, first])
    tables = []
    for run in range(first, last):
        now = base
        if run >= made["begins"]:
            how = (run - made["begins"], made["size"], made["axis"], made["how"])
            now = changed(base, made["kind"], *how)
        tables.append(jittered(now, rng))
    if made["engine"] == "own":
        return own_logs(tables, rng)
    seeds = [1_000_003 * (made["index"] + 1) + run for run in range(first, last)]
    return [foreign_log(table, seed) for table, seed in zip(tables, seeds, strict=True)]


def followed(made: dict) -> dict:
    """The planned table up to its first alarm: what was told, and when."""
    base = truth(np.random.default_rng([made["index"], 21]))
    rig = believed(base, made["engine"], np.random.default_rng([made["index"], 23]))
    m, began = made["accepted"], time.time()
    logs = [log for log in logs_of(made, 0, m) if log is not None]
    if not logs:
        return made | {"failed": "no accepted run kept its ball"}
    model = accept(logs, rig)
    rows = [estimate(model, log) for log in logs]
    runs, limit, lost = [-1] * len(rows), alarm_threshold(len(model.parameters)), 0
    for block in range(m, RUNS, 8):
        for k, log in enumerate(logs_of(made, block, min(block + 8, RUNS))):
            if log is None:
                lost += 1
                continue
            rows.append(estimate(model, log))
            runs.append(block + k)
            values, stds = np.array([r.values for r in rows]), np.array([r.stds for r in rows])
            over = alarms(strongest(values, stds, len(logs)), limit)
            if over:
                return made | summary(model, over, runs, lost, began)
    made |= summary(model, [], runs, lost, began)
    return made | {"ratios": ratios(values, stds)} if made["kind"] == "nothing" else made


def summary(model: Accepted, over: list, runs: list[int], lost: int, began: float) -> dict:
    """The result of a table in plain numbers."""
    found = {
        "judged": [run for run in runs if run >= 0],
        "lost": lost,
        "seconds": time.time() - began,
        "watched": len(model.parameters),
        "alarm": runs[-1] if over else None,
    }
    if over:
        found["name"] = effect_of(model.parameters[over[0].parameter])
        found["parameter"] = model.names[over[0].parameter]
        found["since"] = runs[over[0].since]
        found["earliest"] = runs[over[0].earliest]
        found["latest"] = runs[over[0].latest]
        found["change"] = [over[0].size, over[0].low, over[0].high]
        found["z"] = over[0].z
    return found


def ratios(values: np.ndarray, stds: np.ndarray) -> list[float]:
    """Spread of each parameter over its median standard deviation, on a table without a change."""
    return (values.std(axis=0, ddof=1) / np.median(stds, axis=0)).tolist()


def share(k: int, n: int) -> str:
    """k of n as a percentage with its exact 95 % interval (Clopper and Pearson)."""
    low = beta.ppf(0.025, k, n - k + 1) if k else 0.0
    high = beta.ppf(0.975, k + 1, n - k) if k < n else 1.0
    return f"{k} of {n}: {100 * k / max(n, 1):.2f} % ({100 * low:.2f} to {100 * high:.2f})"


def told(found: list[dict]) -> list[str]:
    """The lines of the page."""
    lines, whole = [], [one for one in found if "judged" in one]
    lines.append(f"{len(whole)} tables, {len(found) - len(whole)} failed")
    for engine in ("own", "foreign", "both"):
        some = [one for one in whole if engine in (one["engine"], "both")]
        healthy = 0
        false = 0
        for one in some:
            begins = RUNS if one["kind"] == "nothing" else one["begins"]
            healthy += sum(run < begins for run in one["judged"])
            false += one["alarm"] is not None and one["alarm"] < begins
        low, high = (
            chi2.ppf(0.025, 2 * false) / 2 if false else 0.0,
            chi2.ppf(0.975, 2 * false + 2) / 2,
        )
        rate = f"{100 * false / max(healthy, 1):.2f} ({100 * low / max(healthy, 1):.2f} to "
        rate += f"{100 * high / max(healthy, 1):.2f})"
        lines.append(f"{engine}: {false} false alarms in {healthy} healthy runs: {rate} a 100 runs")
        for kind in KINDS[1:]:
            of = [o for o in some if o["kind"] == kind]
            of = [o for o in of if o["alarm"] is None or o["alarm"] >= o["begins"]]
            seen = [o for o in of if o["alarm"] is not None]
            if not of:
                continue
            delays = [sum(o["begins"] <= r <= o["alarm"] for r in o["judged"]) for o in seen]
            right = sum(o["name"] in RIGHT[kind] for o in seen)
            since = sum(o["earliest"] <= o["begins"] <= o["latest"] for o in seen)
            middle = np.percentile(delays, [50, 90]) if delays else [np.nan] * 2
            lines.append(
                f"{engine} {kind}: told {share(len(seen), len(of))}; run of the alarm, counted "
                f"from the change: median {middle[0]:.0f}, 90 % {middle[1]:.0f}; right name "
                f"{share(right, len(seen))}; begin within the told runs {share(since, len(seen))}"
            )
    return lines


def prior(found: list[dict]) -> str:
    """PRIOR_RATIO and PRIOR_RUNS by the moments of log variances (Smyth 2004, section 6.2)."""
    x = [2 * ln(r) for one in found for r in one.get("ratios", []) if r > 0]
    freedom = RUNS - 2
    e = np.array(x) - digamma(freedom / 2) + ln(freedom / 2)
    over = float(np.var(e, ddof=1) - polygamma(1, freedom / 2))
    nu = 2 * brentq(lambda y: polygamma(1, y) - max(over, 1e-6), 1e-3, 1e6)
    ratio = float(np.exp(0.5 * (e.mean() + digamma(nu / 2) - ln(nu / 2))))
    return f"from {len(x)} parameters: ratio {ratio:.2f}, worth {nu:.1f} runs"


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--tables", type=int, default=200)
    parser.add_argument("--first", type=int, default=0, help="number of the first table")
    parser.add_argument("--out", type=Path, default=Path("out/watching"))
    parser.add_argument("--only", choices=KINDS, help="tables of this kind alone")
    parser.add_argument("--prior", action="store_true", help="also print the moments of the spread")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    file = options.out / "tables.jsonl"
    found = [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []
    done = {one["index"] for one in found}
    with threadpool_limits(1):
        for index in range(options.first, options.first + options.tables):
            if index in done or options.only not in (None, KINDS[index % 5]):
                continue
            one = followed(plan(index))
            found.append(one)
            with file.open("a") as out:
                out.write(json.dumps(one) + "\n")
            print(index, one["kind"], one["engine"], one.get("name"), one.get("alarm"), flush=True)
    for line in told(found) + ([prior(found)] if options.prior else []):
        print(line)


if __name__ == "__main__":
    main()
