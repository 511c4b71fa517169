"""The part of the study's page on alternative explanations of the effect."""

from experiments.analysis.numbers import MEASURES
from experiments.paper.alternative_explanations import JUDGED
from experiments.reports.figures import shown_unit, verdict_word
from experiments.reports.report import Section, Table


def alternatives_section(results: dict) -> Section:
    """Section on whether the effect is the model's: sham, misplaced inverse, retuned PID, no play.

    results: as of `experiments.paper.reproduce.reproduce`.
    """
    lines = [
        "Compensation also raises the gain at reversals and shakes what dry friction holds: is "
        "that all that it does? Rivals hold the ball at the centre for 24 s on paired other units: "
        "sham is the same inverse of the play, backwards; misplaced undoes the gear's play on the "
        "reference; retuned is the PID alone, tuned on other seeds to the best ball at the servo "
        'activity of the controller "with".',
    ]
    rows = []
    for friction, found in results["rivals"].items():
        gains = found["retuned_gains"]
        lines.append(
            f"With {friction}: {_verdict_on_alternatives(found['arms'])} Retuned gains: "
            f"P {gains['proportional_rad_m']:g} rad/m, D {gains['derivative_rad_s_m']:g} "
            "rad s/m."
        )
        for arm, table in found["arms"].items():
            rows.append([f"{friction}: {arm}", *(_with_interval(table[m], m) for m in JUDGED)])
    head = ["table: controller", "RMS distance [cm]", "servo activity [deg]", "limit cycle [cm]"]
    return Section("Is it the compensation? Sham, misplaced, retuned", [*lines, Table(head, rows)])


def _with_interval(value: dict, measure: str) -> str:
    """Mean and interval of n runs; of one run the value alone, of none that there is none."""
    factor, _ = shown_unit(MEASURES[measure][0])
    mean, low, high = (f"{factor * value[key]:.3f}" for key in ("value", "low", "high"))
    numbers = {0: "no value", 1: mean}.get(value["n"], f"{mean} [{low}, {high}]")
    return f"{numbers}, n = {value['n']}"


def _verdict_on_alternatives(arms: dict) -> str:
    """Which alternatives the model beats on the ball, in one sentence."""
    words: dict[str, list[str]] = {}
    for arm, table in arms.items():
        if arm in ("with", "no play, without"):
            continue
        against = table["settled_error"]["against_with"]
        words.setdefault(verdict_word(against), []).append(arm)
    said = {
        "helps": "compensation keeps the ball nearer than",
        "hurts": "it keeps it less near than",
        "neutral": "it is as good as",
        "unclear": "it cannot be told from",
    }
    parts = [f"{said[w]} {', '.join(words[w])}" for w in said if w in words]
    floor, reached = arms["no play, without"]["settled_error"], arms["with"]["settled_error"]
    return (
        f"{'; '.join(parts)} (with {reached['value']:.3g} cm; a table without play, PID alone, "
        f"{floor['value']:.3g} cm)."
    )
