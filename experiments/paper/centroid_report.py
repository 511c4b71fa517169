"""The centroids' part of the study's page: what ties them down, and what they cannot show."""

from collections.abc import Mapping, Sequence

import numpy as np

from experiments.analysis.centroids import two_clusters
from experiments.analysis.mean_of_run import expected_mean_m, integral_identity
from experiments.analysis.numbers import Recorded
from experiments.analysis.samples import ball_samples
from experiments.reports.report import Section, Table
from rig.parameters import Rig

Study = Mapping[str, Mapping[str, Sequence[Recorded]]]


def centroid_facts(study: Study, rig: Rig) -> dict:
    """Facts on the centroids of Fig. 10's runs, as results.json holds them.

    For each arm the integral identity (`integral_identity`); the mean that PD alone gives without
    play (`expected_mean_m`) [cm]; two clusters of the pooled samples. ValueError: a run is too
    short.
    """
    gains, facts = rig.gains, {}
    for arm, runs in study["10"].items():
        found = integral_identity(runs[0].log, gains.integral_rad_m_s, rig=rig)
        facts[arm] = {
            "mean_error_cm": (100 * found.mean_error_m).tolist(),
            "predicted_cm": (100 * found.predicted_m).tolist(),
            "T_s": found.duration_s,
            "ki_rad_m_s": found.ki_rad_m_s,
            "clipped_share": found.clipped.tolist(),
        }
    samples = {arm: ball_samples(runs[0].log).xy_m for arm, runs in study["10"].items()}
    pooled = np.concatenate(list(samples.values()))
    labels = np.repeat(np.arange(len(samples)), [len(s) for s in samples.values()])
    two = two_clusters(pooled, labels)
    first = ball_samples(study["10"]["without"][0].log).where(slice(0, 8))
    speed, start = np.polyfit(first.t_s, first.xy_m, 1)
    duration = facts["without"]["T_s"]
    pd_only = expected_mean_m(duration, start_m=start, speed_m_s=speed, rig=rig)
    facts["pd_only_cm"] = (100 * pd_only).tolist()
    facts["two_clusters"] = {
        "centres_cm": (100 * two.centres_m).tolist(),
        "adjusted_rand_index": two.adjusted_rand_index,
        "samples": two.samples,
    }
    return facts


def centroid_section(facts: dict, rig: Rig) -> Section:
    """Section on what the centroid can and cannot show; facts as of `centroid_facts`."""
    t = facts["without"]["T_s"]
    pd_only = ", ".join(f"{v:+.2f}" for v in facts["pd_only_cm"])
    two = facts["two_clusters"]
    identity = (
        f"The centroid hardly measures play. Over T = {t:.1f} s with PD alone it would lie "
        f"at ({pd_only}) cm with no play at all; with the integral "
        f"(I {rig.gains.integral_rad_m_s:g} rad/(m s)) the mean error is (change of the "
        "integral)/(I T) where it was not clipped. Both sides of that identity, for Fig. 10:"
    )
    clusters = (
        "k-means with two clusters on the pooled samples separates the controllers with an "
        f"adjusted Rand index of {round(two['adjusted_rand_index'], 3) + 0.0:.3f} "
        f"(0 = chance, 1 = fully; n = {two['samples']})."
    )
    rows = [
        [
            arm,
            ", ".join(f"{v:+.3f}" for v in facts[arm]["mean_error_cm"]),
            ", ".join(f"{v:+.3f}" for v in facts[arm]["predicted_cm"]),
            ", ".join(f"{100 * v:.0f} %" for v in facts[arm]["clipped_share"]),
        ]
        for arm in ("without", "with")
    ]
    head = [
        "controller",
        "mean error x, y [cm]",
        "from the integral x, y [cm]",
        "ticks clipped x, y",
    ]
    blocks = [identity, Table(head, rows), clusters]
    return Section("What the centroid can and cannot show", blocks)
