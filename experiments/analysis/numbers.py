"""The numbers of a report: run metrics in the units people read, each with its interval.

Everything here is recomputable from a run folder: no number comes from the plant.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from experiments.analysis.centroids import centroid
from experiments.analysis.metrics import RunMetrics, run_metrics, settled_interval
from experiments.analysis.samples import Place, ball_samples, place, run_part
from experiments.analysis.statistics import mean_interval
from rig.log import Log, shown_angles

CM = 100.0


@dataclass(frozen=True, eq=False)
class Recorded:
    """A run shown in a report: its folder (for recomputing), log, metrics and outcome.

    outcome: how the run ended, as run.json says it, such as "completed".
    """

    folder: Path
    log: Log
    metrics: RunMetrics
    outcome: str


def recorded(folder: Path, log: Log, outcome: str, *, servo_only: bool = False) -> Recorded:
    """A recorded run with its metrics; outcome: as run.json has it; servo_only: as in
    `run_metrics`.
    """
    return Recorded(folder, log, run_metrics(log, servo_only=servo_only), outcome)


def centroid_cm(run: Recorded) -> np.ndarray:
    """Centroid (2,) [cm] of the run as the paper makes it: k-means with one cluster.

    NaN without a sample of both axes.
    """
    xy_m = ball_samples(run.log).xy_m
    return CM * centroid(xy_m) if np.isfinite(xy_m).all(axis=1).any() else np.full(2, np.nan)


def resting_centroid_cm(run: Recorded) -> np.ndarray | None:
    """`centroid_cm` where the ball is to rest; None without samples, or where the target moves."""
    xy = centroid_cm(run)
    return None if run.metrics.target_moves or not np.isfinite(xy).all() else xy


def resting_centroids_cm(without: Recorded, with_: Recorded) -> dict[str, np.ndarray]:
    """`resting_centroid_cm` by controller, "without" and "with"; empty unless both have one."""
    found = {"without": resting_centroid_cm(without), "with": resting_centroid_cm(with_)}
    known = {arm: xy for arm, xy in found.items() if xy is not None}
    return known if len(known) == len(found) else {}


def _place_cm(where: Place) -> dict:
    return {
        "centroid_cm": (CM * where.centroid_m).tolist(),
        "distance_cm": CM * where.distance_m,
        "spread_cm": CM * where.spread_m,
        "error_rms_cm": CM * where.error_rms_m,
        "samples": where.samples,
    }


def run_numbers(run: Recorded) -> dict:
    """Numbers of one run for results.json: whole run, settled part, limit cycle, servos, plays.

    Keys end in their units: lengths in cm, servo angles in rad, estimated plays (full width) in
    degrees. "settled" holds 95 % intervals too where the ball settled and was not pushed.
    """
    m = run.metrics
    whole = Place(m.centroid_m, m.distance_m, m.spread_m, m.error_rms_m, m.samples)
    return {
        **_place_cm(whole),
        "settled": _place_cm(m.settled) | _within(run) | _settled_servos(m),
        "target_moves": m.target_moves,
        "settling_s": m.settling_s,
        "duration_s": m.duration_s,
        "limit_cycle": {
            axis: {
                "amplitude_cm": CM * c.amplitude_m,
                "period_s": c.period_s,
                "cycles": c.cycles,
                "reason": c.reason,
            }
            for axis, c in zip("xy", m.cycle, strict=True)
        },
        "servo_rms_rad": whole_servo_rms(run.log).tolist(),
        "servo_tracking_rad": m.servo_tracking_whole_rad.tolist(),
        "pushes": m.pushes,
        "estimated_gear_play_deg": _play(m.gear_play_rad, m.gear_play_std_rad),
        "estimated_joint_play_deg": _play(m.joint_play_rad, m.joint_play_std_rad),
        "outcome": run.outcome,
        "folder": run.folder.name,
    }


def whole_servo_rms(log: Log) -> np.ndarray:
    """RMS (2,) [rad] of the servo angles x and y, or the commands, about zero over the whole run.

    NaN for an axis with a blank angle.
    """
    return np.sqrt(np.mean(shown_angles(run_part(log).rows) ** 2, axis=0))


def _settled_servos(m: RunMetrics) -> dict:
    """What the servos did after settling: RMS about zero, standard deviation, RMS of the error."""
    return {
        "has_settled": m.has_settled,
        "servo_rms_rad": m.servo_rms_rad.tolist(),
        "servo_activity_rad": m.servo_activity_rad.tolist(),
        "servo_tracking_rad": m.servo_tracking_rad.tolist(),
    }


def _within(run: Recorded) -> dict:
    """95 % intervals of this one run's settled spread and centroid; samples are correlated."""
    if not run.metrics.has_settled or run.metrics.pushes:
        return {}  # a pushed run is no stationary one: its value has no interval of its own
    w = settled_interval(run.log, rng=np.random.default_rng(12))
    centroid_low, centroid_high = CM * w.mean_low_m, CM * w.mean_high_m
    return {
        "spread_interval_cm": [CM * w.spread_low_m, CM * w.spread_high_m],
        "centroid_interval_cm": np.column_stack([centroid_low, centroid_high]).tolist(),
    }


def _play(width_rad: np.ndarray, std_rad: np.ndarray) -> dict:
    """Full widths and standard deviations (x, y); None where the run could not show the play."""
    known = _shown(width_rad, std_rad)
    return {
        "value": [
            float(np.degrees(w)) if k else None for w, k in zip(width_rad, known, strict=True)
        ],
        "std": np.degrees(std_rad).tolist(),
    }


def _shown(width_rad: np.ndarray, std_rad: np.ndarray) -> np.ndarray:
    return width_rad > 2 * std_rad


def found_no_play(m: RunMetrics) -> bool:
    """Whether the compensation looked for play in this run and found none."""
    looked = np.isfinite([m.gear_play_rad, m.joint_play_rad]).any()
    gear = _shown(m.gear_play_rad, m.gear_play_std_rad)
    joint = _shown(m.joint_play_rad, m.joint_play_std_rad)
    return bool(looked and not gear.any() and not joint.any())


def arm_numbers(runs: Sequence[Recorded]) -> dict:
    """Numbers of one arm's runs, at least one, for results.json.

    At the top and under "settled" (the settled parts): positions [cm], pooled over the samples of
    all runs, and servo numbers [rad], means over the runs; "runs": their number; "runs_list":
    `run_numbers` of each; "intervals" (two runs or more): mean and 95 % interval over the runs of
    every entry of MEASURES.
    """
    samples = [ball_samples(run.log) for run in runs]
    settled = [s.where(s.t_s >= _settled_from(run)) for s, run in zip(samples, runs, strict=True)]
    numbers = _place_cm(place(_joined(samples)))
    numbers["settled"] = _place_cm(place(_joined(settled)))
    each = [run_numbers(run) for run in runs]
    for key in ("servo_rms_rad", "servo_tracking_rad"):
        numbers[key] = np.mean([one[key] for one in each], axis=0).tolist()
    for key in ("servo_rms_rad", "servo_activity_rad", "servo_tracking_rad"):
        mean = np.mean([one["settled"][key] for one in each], axis=0)
        numbers["settled"][key] = mean.tolist()
    numbers["runs"] = len(runs)
    numbers["runs_list"] = each
    if len(runs) > 1:
        numbers["intervals"] = _intervals(runs)
    return numbers


def _settled_from(run: Recorded) -> float:
    m = run.metrics
    return m.settling_s if m.has_settled else m.duration_s / 2


def _joined(samples):
    first = samples[0]
    parts = {name: np.concatenate([getattr(s, name) for s in samples]) for name in vars(first)}
    return type(first)(**parts)


# What is compared between arms: name, unit, factor, how it is read off a run's metrics.
MEASURES = {
    "distance": ("cm", lambda m: CM * m.distance_m),
    "settled_distance": ("cm", lambda m: CM * m.settled.distance_m),
    "settled_spread": ("cm", lambda m: CM * m.settled.spread_m),
    "settled_error": ("cm", lambda m: CM * m.settled.error_rms_m),
    "cycle_amplitude": ("cm", lambda m: CM * _mean_seen([c.amplitude_m for c in m.cycle])),
    "settling": ("s", lambda m: m.settling_s),
    "servo_rms": ("rad", lambda m: float(m.servo_rms_rad.mean())),
    "servo_activity": ("rad", lambda m: float(m.servo_activity_rad.mean())),
    "servo_tracking": ("rad", lambda m: float(m.servo_tracking_rad.mean())),
}


def _mean_seen(values: Sequence[float]) -> float:
    """Mean over the axes that showed a limit cycle; NaN where neither did."""
    seen = [value for value in values if np.isfinite(value)]
    return float(np.mean(seen)) if seen else float("nan")


def measures(m: RunMetrics) -> dict[str, float]:
    """Every number of one run that arms are compared in, by its name in MEASURES, in its unit."""
    return {name: read(m) for name, (_, read) in MEASURES.items()}


def completed_measures(m: RunMetrics, outcome: str) -> dict[str, float]:
    """Every compared number of one run by name, as `measures`; NaN for a run not completed.

    A pair with a NaN is left out of a paired comparison.
    """
    done = outcome == "completed"
    return {name: value if done else float("nan") for name, value in measures(m).items()}


def _intervals(runs: Sequence[Recorded]) -> dict:
    """Mean and 95 % interval over the runs of every compared number."""
    table = [measures(run.metrics) for run in runs]
    found = {}
    for name, (unit, _) in MEASURES.items():
        i = mean_interval(np.array([row[name] for row in table]))
        found[name] = {"unit": unit, "mean": i.value, "low": i.low, "high": i.high, "n": i.n}
    return found
