"""The rivals' part of the study's page: is it the model, or would anything help?"""

from experiments.figures import verdict_word
from experiments.report import Section
from experiments.rivals import JUDGED


def rivals_section(results: dict) -> Section:
    """Is it the model, or would anything help? Sham, misplaced inverse, retuned PID, no play."""
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
            f"With {friction}: {_verdict_on_rivals(found['arms'])} Retuned gains: "
            f"K_p = {gains['proportional_rad_m']:g} rad/m, K_d = {gains['derivative_rad_s_m']:g} "
            "rad s/m."
        )
        for arm, table in found["arms"].items():
            rows.append([f"{friction}: {arm}", *(_with_interval(table[m]) for m in JUDGED)])
    head = ["table: arm", "RMS distance [cm]", "servo activity [rad]", "limit cycle [cm]"]
    return Section("Is it the model? Sham, misplaced, retuned", lines, [], head, rows)


def _with_interval(value: dict) -> str:
    numbers = f"{value['value']:.3g} [{value['low']:.3g}, {value['high']:.3g}]"
    return f"{numbers}, n = {value['n']}"


def _verdict_on_rivals(arms: dict) -> str:
    """Which rivals the model beats on the ball, in one sentence."""
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
