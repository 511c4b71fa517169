"""The part of the study's page on alternative explanations of the effect."""

from experiments.paper.alternative_explanations import JUDGED
from experiments.reports.figures import verdict_word
from experiments.reports.report import Section, Table


def alternatives_section(results: dict) -> Section:
    """Section on whether the effect is the model's: sham, misplaced inverse, retuned PID, no play.

    results: as of `experiments.paper.reproduce.reproduce`.
    """
    lines = [
        "An inverse also raises the gain at reversals and shakes what dry friction holds. The ball "
        "is held at the centre for 24 s on paired other units; the sham is the same inverse "
        "backwards, the misplaced one undoes gear play on the reference, retuned is the PID alone "
        "tuned on other seeds to the best ball at the servo activity of the arm with the model.",
    ]
    rows = []
    for friction, found in results["rivals"].items():
        gains = found["retuned_gains"]
        lines.append(
            f"With {friction}: {_verdict_on_alternatives(found['arms'])} Retuned gains: "
            f"K_p = {gains['proportional_rad_m']:g} rad/m, K_d = {gains['derivative_rad_s_m']:g} "
            "rad s/m."
        )
        for arm, table in found["arms"].items():
            rows.append([f"{friction}: {arm}", *(_with_interval(table[m]) for m in JUDGED)])
    head = ["table: arm", "RMS distance [cm]", "servo activity [rad]", "limit cycle [cm]"]
    return Section("Is it the model? Sham, misplaced, retuned", [*lines, Table(head, rows)])


def _with_interval(value: dict) -> str:
    numbers = f"{value['value']:.3g} [{value['low']:.3g}, {value['high']:.3g}]"
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
        "helps": "the model keeps the ball nearer than",
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
