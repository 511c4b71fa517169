"""Where the ball was: samples of a log, their centroids, and what a centroid can be expected to be.

The centroid hardly measures play. With one cluster k-means gives the mean, and a mean over a run is
tied down by the controller: see `expected_mean_m` and `integral_identity`. Spread and limit cycle
(`metrics.py`) say more. Only rows of phase 2 (run) count, times from the first of them; a log
without phases (an import) is a run from its first row.
"""

from dataclasses import dataclass
from math import nan, sqrt
from typing import Any

import numpy as np

from rig.log import Log, Phase
from rig.parameters import Rig

STARTS = 10  # k-means is started so often, from the same seed
SEED = 0


@dataclass(frozen=True, eq=False)
class Place:
    """Where the ball was over a stretch: all [m], NaN without samples.

    centroid_m (2,): mean; distance_m: of the mean from the mean target; spread_m: RMS about the
    mean, both axes together; error_rms_m: RMS distance to the target. A missing axis is left out.
    """

    centroid_m: np.ndarray
    distance_m: float
    spread_m: float
    error_rms_m: float
    samples: int


@dataclass(frozen=True, eq=False)
class Samples:
    """New observations of the run phase: t_s (k,) from its first row, xy_m and target_m (k, 2).

    `target_m` is what was asked for when the light hit the sensor; the plate's centre where the
    log does not say. `pushed` (k,): a push was on. until_s (k,): until when it stood in the
    log, which may hold values: what comes much later followed a gap.
    """

    t_s: np.ndarray
    xy_m: np.ndarray
    target_m: np.ndarray
    pushed: np.ndarray
    until_s: np.ndarray

    def where(self, chosen: np.ndarray | slice) -> "Samples":
        """Return the samples of the mask or slice `chosen`."""
        return Samples(**{name: values[chosen] for name, values in vars(self).items()})

    @property
    def off_m(self) -> np.ndarray:
        """Distance of each sample to its target [m], over the axes that the log has."""
        return np.sqrt(np.nansum((self.xy_m - self.target_m) ** 2, axis=1))


def run_part(log: Log) -> Log:
    """Return the rows of the run phase; all rows of a log without phases."""
    return log.where(log["phase"] == Phase.RUN) if log.has("phase") else log


def ball_samples(log: Log) -> Samples:
    """Return the ball's samples of a log's run phase."""
    run = run_part(log)
    t_s, xy = run.ball()
    tick = run["t_s"]
    start = tick[0] if len(tick) else 0.0
    at = np.clip(np.searchsorted(tick, t_s + 1e-9, side="right") - 1, 0, None)
    target = np.column_stack([run["target_x_m"], run["target_y_m"]])[at]
    seen = tick[~np.isnan(run["ball_x_m"]) | ~np.isnan(run["ball_y_m"])]
    held = seen[np.searchsorted(seen, np.append(t_s[1:], np.inf)) - 1] if len(seen) else t_s
    return Samples(
        t_s=t_s - start,
        xy_m=xy,
        target_m=np.where(np.isnan(target), 0.0, target),
        pushed=np.nan_to_num(run["push"])[at] != 0,
        until_s=np.maximum(held[: len(t_s)], t_s) - start,
    )


def place(ball: Samples) -> Place:
    """Reduce samples to where the ball was."""
    if not len(ball.t_s):
        return Place(np.full(2, nan), nan, nan, nan, 0)
    centroid = mean_seen(ball.xy_m)
    away = np.nansum((centroid - ball.target_m.mean(axis=0)) ** 2)
    spread = np.nansum(mean_seen((ball.xy_m - centroid) ** 2))
    error = sqrt(np.mean(ball.off_m**2))
    return Place(centroid, float(np.sqrt(away)), float(np.sqrt(spread)), error, len(ball.t_s))


def mean_seen(values: np.ndarray) -> np.ndarray:
    """Mean over the rows of values (n, 2) that are numbers, (2,); NaN where there are none."""
    count = (~np.isnan(values)).sum(axis=0)
    return np.where(count > 0, np.nansum(values, axis=0) / np.maximum(count, 1), nan)


def centroid(xy_m: np.ndarray) -> np.ndarray:
    """Centroid (2,) of xy (n, 2) as the paper makes it: k-means with one cluster, i.e. the mean."""
    return _k_means(xy_m, 1).cluster_centers_[0]


@dataclass(frozen=True, eq=False)
class TwoClusters:
    """What k-means with two clusters makes of the pooled samples of both arms.

    centres_m (2, 2): one row a cluster; distances_m (2,) of these from the plate's centre;
    adjusted_rand_index: agreement of clusters and arms, 1 = the same partition, about 0 = chance;
    explained: share of the scatter about the common mean that the two clusters take away;
    samples: how many were used.
    """

    centres_m: np.ndarray
    distances_m: np.ndarray
    adjusted_rand_index: float
    explained: float
    samples: int


def two_clusters(pooled_xy_m: np.ndarray, labels: np.ndarray) -> TwoClusters:
    """Cluster the pooled samples (n, 2) of both arms and compare with labels (n,), their arms.

    Expect an adjusted Rand index near 0: the samples of both arms lie about the same centre, and
    two clusters cut the longest direction of the common cloud (usually the way in from the start),
    not one arm from the other. Samples of a run are correlated: n is no number of trials.
    ValueError: shapes, or fewer than two different points.
    """
    from sklearn.metrics import adjusted_rand_score

    xy, labels = np.asarray(pooled_xy_m, float), np.asarray(labels)
    if xy.ndim != 2 or labels.shape != (len(xy),):
        raise ValueError(
            f"samples (n, 2) need one label each, got {xy.shape} and {labels.shape}: "
            "give every sample its arm"
        )
    seen = ~np.isnan(xy).any(axis=1)
    xy, labels = xy[seen], labels[seen]
    fit = _k_means(xy, 2)
    centres = fit.cluster_centers_
    scatter = float(np.sum((xy - xy.mean(axis=0)) ** 2))
    return TwoClusters(
        centres,
        np.hypot(centres[:, 0], centres[:, 1]),
        float(adjusted_rand_score(labels, fit.labels_)),
        1 - float(fit.inertia_) / scatter,
        len(xy),
    )


def _k_means(xy_m: np.ndarray, clusters: int) -> Any:
    """Fit k-means to the rows of xy (n, 2) that are numbers. Imported here: it takes a second."""
    from sklearn.cluster import KMeans
    from threadpoolctl import threadpool_limits  # sklearn's own dependency

    xy = np.asarray(xy_m, float)
    if xy.ndim != 2 or xy.shape[1] != 2:
        raise ValueError(f"samples have shape (n, 2), these have {xy.shape}: give x and y columns")
    xy = xy[~np.isnan(xy).any(axis=1)]
    if len(np.unique(xy, axis=0)) < clusters:
        raise ValueError(
            f"{len(xy)} samples hold fewer than {clusters} different points: "
            "k-means needs one a cluster; give a run in which the ball was seen"
        )
    # sklearn's annotation of n_init is wrong (it takes numbers), hence the dictionary.
    settings: dict[str, Any] = {"n_init": STARTS, "random_state": SEED}
    with threadpool_limits(1):  # more threads only wait for each other on so few samples
        return KMeans(clusters, **settings).fit(xy)


def expected_mean_m(
    duration_s: float,
    *,
    start_m: tuple[float, float] = (-0.13, 0.13),
    speed_m_s: tuple[float, float] = (0.0, 0.0),
    integral_change_rad: tuple[float, float] | None = None,
    rig: Rig | None = None,
) -> np.ndarray:
    """Expected mean (2,) of the ball's position over a run about the target (0, 0), play or not.

    PD alone (integral_change_rad None): the ball obeys x'' = b theta, theta = -K_p x - K_d x'.
    Integrated from x_0, v_0 to rest at 0: -v_0 = b (-K_p int(x) dt + K_d x_0), so that

        mean = ((K_d/K_p) x_0 + v_0/(b K_p))/T       = 0.61 s * 0.13 m/T = 0.079 m s/T

    from rest, also with a lag of the servo (of gain one: it keeps int(theta) dt): 10 mm at T = 8 s
    and 2.6 mm at 30 s without any play. T must be long against the loop (2 s). A first frame that
    comes delta late adds x_0 delta/T, and the sine of Eq. 14 about 5 % from 13 cm.
    With an integral that was never clipped: theta_i' = -K_i x, so that mean = -(change)/(K_i T).
    ValueError: a duration that is not positive, or an integral's change without K_i.
    """
    rig = rig or Rig()
    gains = rig.gains
    if not duration_s > 0:
        raise ValueError(f"duration_s = {duration_s}: must be above 0")
    if integral_change_rad is None:
        kp, kd = gains.proportional_rad_m, gains.derivative_rad_s_m
        x_0, v_0 = np.asarray(start_m), np.asarray(speed_m_s)
        return (kd / kp * x_0 + v_0 / (rig.ball_gain_m_s2 * kp)) / duration_s
    if not gains.integral_rad_m_s > 0:
        raise ValueError("an integral changes only with gains.integral_rad_m_s above 0")
    return -np.asarray(integral_change_rad) / (gains.integral_rad_m_s * duration_s)


@dataclass(frozen=True, eq=False)
class Identity:
    """Mean error of a run against what its integral says; pairs (2,) are x, y.

    mean_error_m: mean of target - position over duration_s = T; predicted_m: (change of the
    integral)/(K_i T), equal to it where the integral was not clipped; integral_change_rad: that
    change; ki_rad_m_s: K_i; clipped (2,): share of ticks with the wanted angle at its limit.
    """

    mean_error_m: np.ndarray
    predicted_m: np.ndarray
    integral_change_rad: np.ndarray
    duration_s: float
    ki_rad_m_s: float
    clipped: np.ndarray


def integral_identity(
    log: Log, ki: float, *, rig: Rig | None = None, edge_s: float = 1.0
) -> Identity:
    """Test "mean error = (change of the integral)/(K_i T)" on a run of a PID with `ki` [rad/m/s].

    A log holds no integral. It is zero at the first observation and read back at the end from the
    wanted angle, I = theta_wanted - K_p e + K_d v, averaged over the last `edge_s`; T ends in the
    middle of these. Good to 0.1 mm at T = 15 s. `rig` gives K_p, K_d and the angle's limit.
    ValueError: ki not above 0, or a run without ball or wanted angle or shorter than four edges.
    """
    if not ki > 0:
        raise ValueError(f"ki = {ki}: the identity needs an integral; run with ki above 0")
    rig = rig or Rig()
    run, ball = run_part(log), ball_samples(log)
    ball = ball.where(np.asarray(~np.isnan(ball.xy_m).any(axis=1)))
    wanted = np.column_stack([run["desired_theta_x_rad"], run["desired_theta_y_rad"]])
    if len(ball.t_s) < 8 or np.isnan(wanted).any() or np.ptp(ball.t_s) < 4 * edge_s:
        raise ValueError(
            f"the integral identity needs both axes of the ball over {4 * edge_s:g} s or more and "
            "desired_theta in every row: give a run of the rig's own controller"
        )
    t, tick, error = ball.t_s, run["t_s"] - run["t_s"][0], ball.target_m - ball.xy_m
    begin, last = float(tick[~np.isnan(run["ball_x_m"])][0]), float(t[-1])
    end, gains = last - edge_s / 2, rig.gains
    final = (tick >= last - edge_s) & (tick <= last)
    change = (
        wanted[final].mean(axis=0)
        - gains.proportional_rad_m * _mean_between(t, error, last - edge_s, last)
        + gains.derivative_rad_s_m * _filtered_speed(ball, edge_s, gains.ball_filter_rad_s)
    )
    limit = rig.servo.angle_limit_rad - 1e-9
    return Identity(
        mean_error_m=_mean_between(t, error, begin, end),
        predicted_m=change / (ki * (end - begin)),
        integral_change_rad=change,
        duration_s=end - begin,
        ki_rad_m_s=ki,
        clipped=np.mean(np.abs(wanted) >= limit, axis=0),
    )


def _filtered_speed(ball: Samples, edge_s: float, filter_rad_s: float) -> np.ndarray:
    """Mean speed (2,) [m/s] over the last `edge_s` as the ball's filter sees it: 2/filter late."""
    late = ball.t_s[-1] - 2 / filter_rad_s
    half = min(0.05, 2 / filter_rad_s)
    after = _mean_between(ball.t_s, ball.xy_m, late - half, late + half)
    before = _mean_between(ball.t_s, ball.xy_m, late - edge_s - half, late - edge_s + half)
    return (after - before) / edge_s


def _mean_between(t: np.ndarray, values: np.ndarray, begin: float, end: float) -> np.ndarray:
    """Mean over the time from begin to end of values (n, 2) at times t (n,), straight between."""
    inner = (t > begin) & (t < end)
    at = np.concatenate(([begin], t[inner], [end]))
    line = np.column_stack([np.interp(at, t, values[:, a]) for a in range(2)])
    return np.asarray(np.trapezoid(line, at, axis=0)) / (end - begin)
