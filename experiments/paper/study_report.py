"""The study's figures, numbers and page from its runs."""

from collections.abc import Mapping, Sequence
from math import degrees
from pathlib import Path

from experiments.analysis.comparison import comparison_sentence
from experiments.analysis.numbers import Recorded, arm_numbers, centroid_cm
from experiments.analysis.regime import regime_sentence
from experiments.paper.alternative_explanations import little_friction
from experiments.paper.alternatives_report import alternatives_section
from experiments.paper.centroid_report import centroid_facts, centroid_section
from experiments.paper.claims import VERDICT_WORDS
from experiments.reports import figures
from experiments.reports.figures import save, shown_unit, verdict_word
from experiments.reports.report import (
    RUN_HEAD,
    SETTLED,
    Picture,
    Pictures,
    Section,
    Table,
    recompute_section,
    run_row,
    write_page,
)
from rig.parameters import Rig

Study = Mapping[str, Mapping[str, Sequence[Recorded]]]
_VIRTUAL = "simulated"


def write_study(study: Study, results: dict, rig: Rig, out: Path) -> dict:
    """Draw every figure and write report.html in `out`; return {"figures", "centroids"}.

    study: figure -> arm -> runs; results: as of `reproduce`, before these two entries. OSError:
    `out` cannot be written.
    """
    shown = _draw(study, results["grid"], rig, out)
    numbers = {
        figure: {arm: arm_numbers(runs) for arm, runs in study[figure].items()}
        for figure in ("7", "8", "10", "11", "12", "13", "14")
    }
    try:
        centroids = centroid_facts(study, rig)
        about_centroids = centroid_section(centroids, rig)
    except ValueError as error:  # a run of Fig. 10 was too short for it
        centroids = {"missing": str(error)}
        about_centroids = Section("What the centroid can and cannot show", [f"Not said: {error}."])
    sections = [
        claims_section(results["claims"]),
        *_figure_sections(shown),
        alternatives_section(results),
        _grid_section(results, shown),
        about_centroids,
        _play_section(rig, shown),
        _runs_section(study, numbers),
        recompute_section(
            "Every run of the figures and every paired repetition lies in runs/ as a run folder "
            "(MCAP). Numbers of the grid of play come from "
            f"{results['grid_pairs']} paired seeds a cell that are not kept: the same --seed makes "
            "the same runs bit for bit. The log behind a run, as a table:",
            "rig export RUN --out F.csv",
        ),
    ]
    write_page(
        out / "report.html",
        title="Backlash on a 2-DOF balancing table: the paper's study, reproduced",
        source="virtual rig",
        answer=comparison_sentence(study["14"]["without"], study["14"]["with"]),
        summary=[*_summary(results, rig), *unfinished(study)],
        sections=sections,
    )
    return {"figures": numbers, "centroids": centroids}


def _draw(study: Study, grid: list[dict], rig: Rig, out: Path) -> dict[str, Path]:
    def log(figure: str, arm: str):
        return study[figure][arm][0].log

    side = 100 * rig.linkage.side_m
    centres = {arm: centroid_cm(study["10"][arm][0]) for arm in ("without", "with")}
    pushed = {f: centroid_cm(study[f][arm][0]) for f, arm in (("12", "without"), ("13", "with"))}
    eight = {arm: [run.log for run in runs] for arm, runs in study["14"].items()}
    drawn = {
        "fig07": figures.ball_over_time(log("7", "without"), log("7", "with")),
        "fig08": figures.servo_over_time(log("8", "without"), log("8", "with")),
        "fig10": figures.release_scatter(log("10", "without"), log("10", "with"), centres, side),
        "fig11": figures.servo_over_time(
            log("11", "without"), log("11", "with"), panels=("(a)", "(b)")
        ),
        "fig12": figures.pushed_scatter(log("12", "without"), pushed["12"], "without", side),
        "fig13": figures.pushed_scatter(log("13", "with"), pushed["13"], "with", side),
        "fig14": figures.eight_runs(eight["without"], eight["with"]),
        "play_estimates": figures.play_estimates([log("13", "with")], plant_play_deg(rig)),
        "grid_error": figures.play_map(
            grid, "settled_error", "RMS distance from the centre after settling", "cm"
        ),
        "grid_servo": figures.play_map(grid, "servo_activity", "servo activity", "rad"),
        "grid_centroid": figures.play_map(grid, "distance", "distance of the centroid", "cm"),
    }
    return {name: save(figure, out, name, _VIRTUAL) for name, figure in drawn.items()}


def unfinished(study: Study) -> list[str]:
    """One sentence for each run of the figures that did not complete."""
    return [
        f"Fig. {figure} {arm}: {run.folder.name} ended as '{run.outcome}'; what is shown of it "
        "is a part, not a whole run."
        for figure, arms in study.items()
        if figure not in ("8", "11")  # the runs of 7 and 10
        for arm, runs in arms.items()
        for run in runs
        if run.outcome != "completed"
    ]


def plant_play_deg(rig: Rig) -> dict[str, float]:
    """Play of the simulated plant's x axis, full width [deg], for "gear" and "joint".

    Used for scoring alone.
    """
    found = {}
    for place in ("gear", "joint"):
        values = rig.effects.get(f"{place}_backlash", {}).get("x", {})
        found[place] = degrees(values.get("play_rad", 0.0))
    return found


def _summary(results: dict, rig: Rig) -> list[str]:
    words = {True: "hold", False: "fail", None: "undecided"}
    tally = [f"{w}: {sum(c['holds'] is v for c in results['claims'])}" for v, w in words.items()]
    plays = plant_play_deg(rig)
    camera = results["camera"]
    seen = (
        f"The runs of Figs. 10 to 14 went through rendered camera frames. All others used a "
        f"statistical camera with the noise fitted to those frames: "
        f"{1000 * camera['noise_m']:.3f} mm RMS a coordinate, {100 * camera['dropout']:.2f} % of "
        f"the frames without a ball (n = {camera['samples']} frames); the rig file has "
        f"{1000 * rig.camera.noise_m:.1f} mm. Noise acts as dither, so that matters."
    )
    return [
        f"{len(results['claims'])} tests of the paper's claims on this table: {', '.join(tally)}. "
        f"Its x axis has {plays['gear']:.1f} deg of play in the gear and {plays['joint']:.1f} deg "
        'in the joint (full width at the servo). "With" is the controller with play compensation, '
        'the paper\'s "backlash model"; "without" the same controller without it.',
        seen
        if camera["frames"]
        else "No frames were rendered: all runs used a statistical camera.",
        regime_sentence(rig),
        regime_sentence(little_friction(rig), "On the table with little friction, further below"),
    ]


def claims_section(claims: Sequence[Mapping]) -> Section:
    """Section with the table of the paper's claims and how each was tested.

    claims: as of `experiments.paper.claims.judge`.
    """
    text = (
        "Each claim is tested on paired seeds, every seed another unit of the same kind (gain, "
        "lag, friction, offset, level and tachometer within the spread of real units). The "
        "improvement is without - with. A claim holds only if its whole 95 % interval lies above "
        "the smallest that matters, and fails if it lies below; that was fixed beforehand: a "
        "pixel of the paper's camera (0.0625 cm), an encoder count (0.0879 deg). The "
        "interval decides; p is shown, corrected for all tests, and decides nothing. A pair in "
        "which a run did not complete is left out. "
        "Before its release the ball is held while the controller already tilts the plate."
    )
    verdicts = [VERDICT_WORDS[c["holds"]] for c in claims]
    rows = [_claim_row(c, verdict) for c, verdict in zip(claims, verdicts, strict=True)]
    head = ["Fig.", "claim", "verdict", "without", "with", "improvement [95 %]"]
    head += ["smallest that matters", "pairs", "p (Holm)"]
    table = Table(head, rows, words=3, marks=dict(enumerate(verdicts)))
    return Section("What the paper claims, and what this rig says", [text, table])


def _claim_row(c: Mapping, verdict: str) -> list[str]:
    """Cells of one claim: angles in degrees, as everywhere on the page and in its figures."""
    factor, unit = shown_unit(c["unit"])

    def cells(*keys: str) -> list[str]:
        return [f"{factor * c[key]:+.3f}" for key in keys]

    effect, low, high = cells("effect", "low", "high")
    return [
        c["figure"],
        c["claim"],
        verdict,
        f"{factor * c['mean_without']:.3f} {unit}",
        f"{factor * c['mean_with']:.3f} {unit}",
        f"{effect} [{low}, {high}] {unit}",
        f"{factor * c['relevant']:.3g} {unit}",
        f"{c['runs']}" + (f" ({c['left_out']} left out)" if c["left_out"] else ""),
        f"{c['p_holm']:.2g}",
    ]


def _figure_sections(shown: dict[str, Path]) -> list[Section]:
    captions = {
        "fig07": "Fig. 7. Ball position over time, free release from a corner.",
        "fig08": "Fig. 8. Servo angles: without and with play compensation, and desired.",
        "fig10": "Fig. 10. Ball positions with centroids; the inset magnifies.",
        "fig11": "Fig. 11. Servo angles of the same runs, (a) x and (b) y.",
        "fig12": "Fig. 12. Without play compensation.",
        "fig13": "Fig. 13. With play compensation.",
        "fig14": "Fig. 14. a: without, b: with; the middle of the plate.",
    }

    def pictures(*names: str) -> Pictures:
        return Pictures([Picture(shown[name], captions[name]) for name in names])

    pushes = (
        "Push times and directions are drawn from the seed and are the same for both controllers."
    )
    return [
        Section("Simulation: Figs. 7 and 8", [pictures("fig07", "fig08")]),
        Section("Free release: Figs. 10 and 11", [pictures("fig10", "fig11")]),
        Section(
            "Pushed away again and again: Figs. 12 and 13", [pushes, pictures("fig12", "fig13")]
        ),
        Section("Eight runs: Fig. 14", [pictures("fig14")]),
    ]


def _means(cells: list[dict], gear: float, joint: float) -> str:
    cell = next(c for c in cells if (c["gear_deg"], c["joint_deg"]) == (gear, joint))
    found = cell["settled_error"]
    return f"{found['mean_without']:.2f} cm without and {found['mean_with']:.2f} cm with it"


def _grid_section(results: dict, shown: dict[str, Path]) -> Section:
    cells, tally = results["grid"], {}
    most = max(cell["gear_deg"] for cell in cells)
    both = "of both" if most else "in the joints (the servos' own loops hold their gears)"
    for cell in cells:
        word = verdict_word(cell["settled_error"])
        tally.setdefault(word, []).append(f"{cell['gear_deg']:g}/{cell['joint_deg']:g}")
    lines = [
        f"Play compensation on {results['grid_pairs']} paired seeds a cell, free release. Judged "
        "by the RMS distance from the centre after settling; cells as gear/joint play in degrees. "
        "The table keeps its dry friction everywhere, so a part of the effect is not play: with "
        f"none at all (0/0) the distances are {_means(cells, 0, 0)}, with 3 degrees {both} "
        f"{_means(cells, most, 3)}."
    ]
    said = {"neutral": "is neutral", "unclear": "has no clear effect"}
    lines += [
        f"It {said.get(word, word)} in {len(c)} of {len(cells)} cells: {', '.join(c)}."
        for word, c in tally.items()
    ]
    maps = [
        Picture(shown["grid_error"], "Effect on the distance kept (green-blue: it helps)."),
        Picture(
            shown["grid_servo"], "Effect on the servos' activity (green-blue: calmer with it)."
        ),
        Picture(shown["grid_centroid"], "Effect on the centroid's distance (whole run)."),
    ]
    return Section(
        "Where play compensation helps, is neutral, or hurts", [*lines, Pictures(maps, wide=True)]
    )


def play_words(rig: Rig) -> str:
    """What the figure of the estimated plays shows, and what is taken off them."""
    explained = 2 * rig.drive.joint_friction_nm / rig.drive.joint_stiffness_nm_rad
    return (
        "The estimators start every run at zero play and see readings and applied volts alone; the "
        "dotted line is the table's true play, opened here for scoring. What the shafts twist "
        "under friction, as far as the rig file's (assumed) values explain it, is taken off "
        f"({degrees(explained):.2g} deg in the joints): of shafts that are softer than that, the "
        "rest counts as play. An asymmetric play shows its width; its middle cannot be told from "
        "an error of the level."
    )


def _play_section(rig: Rig, shown: dict[str, Path]) -> Section:
    caption = "Estimated play in the run of Fig. 13; bands: 2 standard deviations to each side."
    estimates = Pictures([Picture(shown["play_estimates"], caption)])
    return Section("What the observers learnt about the play", [play_words(rig), estimates])


def _runs_section(study: Study, numbers: dict) -> Section:
    rows = []
    for figure in ("7", "10", "12", "13", "14"):
        for arm in study[figure]:
            for found in numbers[figure][arm]["runs_list"]:
                rows.append(run_row(f"Fig. {figure} {arm}", found))
    return Section("Every run of the figures", [Table(RUN_HEAD, rows, SETTLED)])
