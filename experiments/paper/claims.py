"""The paper's claims, put to the test: paired seeds, sizes fixed beforehand, over the grid of play.

A claim holds only if the whole 95 % interval of (without - with) lies beyond a relevant size: a
pixel of the paper's camera for positions, an encoder count for angles, both fixed here.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from experiments.analysis.numbers import MEASURES
from experiments.analysis.relevance import RELEVANT
from experiments.analysis.statistics import holm, paired


@dataclass(frozen=True)
class Claim:
    """A claim of the paper: its text and figure, and the protocol and measure that decide it."""

    text: str
    figure: str
    protocol: str
    measure: str


# Nine tests of what the paper says in four places.
CLAIMS = (
    Claim("the servo follows its (own) desired angle with a smaller error", "8", "free-release",
          "servo_tracking"),
    Claim("the centroid of the released ball lies nearer to the centre (whole run)", "10",
          "free-release", "distance"),
    Claim("the centroid of the released ball lies nearer to the centre (after settling)", "10",
          "free-release", "settled_distance"),
    Claim("the servo angles fluctuate less around zero", "11", "free-release", "servo_rms"),
    Claim("the centroid of the pushed ball lies nearer to the centre (whole run)", "13", "pushed",
          "distance"),
    Claim("the centroid of the pushed ball lies nearer to the centre (after settling)", "13",
          "pushed", "settled_distance"),
    Claim("repeated runs keep the ball nearer to the centre (RMS distance after settling)", "14",
          "free-release", "settled_error"),
    Claim("the system works more stably: smaller spread while holding", "14", "hold",
          "settled_spread"),
    Claim("the system works more stably: smaller limit cycle while holding", "14", "hold",
          "cycle_amplitude"),
)  # fmt: skip

Rows = Mapping[str, Sequence[dict[str, float]]]  # arm -> one row of measures a seed


def compare_conditions(rows: Rows, measure: str, seed: int, *, rival: str = "without") -> dict:
    """Effect (rival - with) of one measure over paired seeds, with interval and verdict.

    Returns the fields of `Paired`, "unit", and "mean_without" (of the rival) and "mean_with" over
    the pairs in which both runs completed. seed: of the drawn sign flips.
    """
    unit = MEASURES[measure][0]
    values = {
        "without": np.array([row[measure] for row in rows[rival]]),
        "with": np.array([row[measure] for row in rows["with"]]),
    }
    result = paired(
        values["without"],
        values["with"],
        relevant=RELEVANT[unit],
        rng=np.random.default_rng([seed, 11]),
    )
    whole = np.isfinite(values["without"]) & np.isfinite(values["with"])
    means = {
        f"mean_{arm}": float(values[arm][whole].mean()) if whole.any() else float("nan")
        for arm in values
    }
    return asdict(result) | {"unit": unit} | means


# What is said of `holds`, as `judge` gives it.
VERDICT_WORDS = {True: "holds", False: "fails", None: "undecided"}


def judge(table: Mapping[str, Rows], seed: int) -> list[dict]:
    """Test every claim; the results as results.json holds them, with p-values corrected by Holm.

    table: protocol -> arm -> rows of measures, one for each seed; seed: of the drawn sign flips.
    """
    found = []
    for claim in CLAIMS:
        result = compare_conditions(table[claim.protocol], claim.measure, seed)
        found.append(
            {
                "claim": claim.text,
                "figure": claim.figure,
                "protocol": claim.protocol,
                "measure": claim.measure,
                **{key: result[key] for key in ("holds", "effect", "unit", "low", "high")},
                **{key: result[key] for key in ("relevant", "p", "reason")},
                **{key: result[key] for key in ("mean_without", "mean_with")},
                "runs": result["n"],
                "left_out": result["left_out"],  # pairs in which a run did not complete
            }
        )
    adjusted = holm(np.array([claim["p"] for claim in found]))
    for claim, p in zip(found, adjusted, strict=True):
        claim["p_holm"] = float(p)
    return found


GRID_DEG = (0.0, 1.0, 2.0, 3.0)
GRID_MEASURES = ("settled_error", "servo_activity", "servo_rms", "distance", "settled_distance")


def play_grid(
    rows_of: Callable[[float, float], Rows], seed: int, cells: Sequence[tuple[float, float]]
) -> list[dict]:
    """Compare the arms in every cell of the grid, in the measures GRID_MEASURES.

    cells: (gear, joint) play [degrees, full widths]; rows_of: simulates a cell's paired runs; seed:
    of the drawn sign flips.
    """
    found = []
    for gear_deg, joint_deg in cells:
        rows = rows_of(gear_deg, joint_deg)
        found.append(
            {"gear_deg": gear_deg, "joint_deg": joint_deg}
            | {measure: compare_conditions(rows, measure, seed) for measure in GRID_MEASURES}
        )
    return found
