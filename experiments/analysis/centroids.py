"""Centroids as the paper makes them, by k-means, and what two clusters make of both arms.

The centroid hardly measures play. With one cluster k-means gives the mean, and a mean over a run is
tied down by the controller: see `mean_of_run.py`. Spread and limit cycle (`metrics.py`) say more.
"""

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np

STARTS = 10  # k-means is started so often, from the same seed
SEED = 0


def centroid(xy_m: np.ndarray) -> np.ndarray:
    """Centroid (2,) [m] of positions xy_m (n, 2) as the paper makes it: k-means with one cluster.

    With one cluster k-means gives the mean. Rows with NaN are left out. ValueError: the shape is
    not (n, 2), or no row is free of NaN.
    """
    return _k_means(xy_m, 1).cluster_centers_[0]


@dataclass(frozen=True, eq=False)
class TwoClusters:
    """Result of k-means with two clusters on the pooled samples of both arms.

    centres_m (2, 2): centres of the clusters, one row (x, y) each; distances_m (2,): distance of
    each centre from the plate's centre; adjusted_rand_index: agreement of clusters and arms (Hubert
    and Arabie, 1985), 1 = identical partitions, about 0 = chance; explained: share of the scatter
    about the common mean that the two clusters remove; samples: number of samples used.
    """

    centres_m: np.ndarray
    distances_m: np.ndarray
    adjusted_rand_index: float
    explained: float
    samples: int


def two_clusters(pooled_xy_m: np.ndarray, labels: np.ndarray) -> TwoClusters:
    """Cluster the pooled samples (n, 2) [m] of both arms and compare the clusters with the arms.

    labels (n,): the arm of each sample. Rows with NaN are left out. Expect an adjusted Rand index
    near 0: the samples of both arms lie about the same centre, and two clusters cut the longest
    direction of the common cloud (usually the way in from the start), not one arm from the other.
    Samples of one run are correlated, so that n is not a number of independent trials. ValueError:
    the shapes do not match, or there are fewer than two different points.
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
    with threadpool_limits(1), warnings.catch_warnings():  # threads would wait for each other
        # of a machine that does not tell its cores (a container without /sys), which decide nothing
        warnings.filterwarnings("ignore", "Could not find the number of physical cores")
        return KMeans(clusters, **settings).fit(xy)
