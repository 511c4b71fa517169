"""The study's words on the centroid."""

from experiments.paper.centroid_report import centroid_section
from experiments.reports.report import Table
from rig.parameters import Rig


def test_what_ends_in_a_colon_stands_above_its_table():
    arm = {
        "T_s": 15.5,
        "mean_error_cm": [0.029, 0.082],
        "predicted_cm": [0.023, 0.087],
        "clipped_share": [0.0, 0.0],
    }
    two = {"adjusted_rand_index": -0.0001, "samples": 1920}
    facts = {"without": arm, "with": arm, "pd_only_cm": [-0.37, 0.37], "two_clusters": two}
    blocks = centroid_section(facts, Rig()).blocks
    announced = [i for i, block in enumerate(blocks) if str(block).endswith(":")]
    assert announced
    assert all(isinstance(blocks[i + 1], Table) for i in announced)
