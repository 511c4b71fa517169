"""The study from end to end, small: its numbers can be recomputed from the recorded runs."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from experiments.analysis.metrics import run_metrics
from experiments.analysis.numbers import MEASURES, measures, recorded
from experiments.analysis.regime import KEEPS
from experiments.paper.claims import CLAIMS, judge
from experiments.paper.reproduce import reproduce
from experiments.paper.study_report import unfinished
from experiments.records.exporting import export_run
from experiments.records.importing import read_log
from experiments.records.recording import read_run
from experiments.runs.assemble import known, load_rig
from experiments.runs.protocol import Protocol, read_protocol
from experiments.runs.runner import RunRequest, simulate_run
from rig.rigfile import to_dict

pytestmark = pytest.mark.slow
MOST_S = 24.0


def short(name: str) -> Protocol:
    protocol = read_protocol(name)
    return protocol.model_copy(update={"duration_s": min(MOST_S, protocol.duration_s)})


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict]:
    """As shipped, but for the time that its runs take."""
    out = tmp_path_factory.mktemp("study")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("experiments.paper.reproduce.read_protocol", short)
        reproduce(load_rig(None), out, seed=1, frames=False, pairs=6, grid_pairs=6)
    return out, json.loads((out / "results.json").read_text())


def test_the_promised_files_are_there(study):
    out, _ = study
    for figure in ("07", "08", "10", "11", "12", "13", "14"):
        assert (out / f"fig{figure}.png").stat().st_size > 10_000
        assert (out / f"fig{figure}.svg").stat().st_size > 10_000
    page = (out / "report.html").read_text()
    assert page.count("data:image/png;base64,") >= 11
    assert "<script" not in page
    assert page.count(KEEPS) == 2  # with little friction too


def test_results_have_the_contracts_shape(study):
    _, results = study
    assert results["source"] == "simulated"
    figures = results["figures"]
    assert set(figures) == {"7", "8", "10", "11", "12", "13", "14"}
    assert set(figures["10"]) == {"with", "without"}
    assert set(figures["12"]) == {"without"}
    assert set(figures["13"]) == {"with"}
    for arm in ("with", "without"):
        entry = figures["10"][arm]
        assert len(entry["centroid_cm"]) == len(entry["servo_rms_rad"]) == 2
        assert entry["runs"] == 1
        assert set(entry["settled"]) >= {"centroid_cm", "distance_cm", "spread_cm"}
        assert len(figures["14"][arm]["runs_list"]) == figures["14"][arm]["runs"] == 4
    for claim in results["claims"]:
        assert claim["holds"] in (True, False, None)
        assert claim["low"] <= claim["effect"] <= claim["high"]
        assert claim["runs"] == 6
        assert claim["unit"] in ("cm", "rad", "s")


def test_figure_numbers_are_recomputed_from_an_exported_run(study, tmp_path: Path):
    out, results = study
    for figure in ("10", "12", "13", "14"):
        for entry in results["figures"][figure].values():
            for run in entry["runs_list"]:
                path = export_run(out / "runs" / run["folder"], tmp_path / f"{run['folder']}.csv")
                log = read_log(path)
                rows = log["phase"] == 2
                xy = np.column_stack([log["ball_x_m"], log["ball_y_m"]])[rows]
                xy = 100 * xy[~np.isnan(xy[:, 0])]
                assert xy.mean(axis=0) == pytest.approx(run["centroid_cm"], abs=1e-6)
                assert np.hypot(*xy.mean(axis=0)) == pytest.approx(run["distance_cm"], abs=1e-6)
                theta = np.column_stack([log["theta_x_rad"], log["theta_y_rad"]])[rows]
                rms = np.sqrt((theta**2).mean(axis=0))
                assert rms == pytest.approx(run["servo_rms_rad"], abs=1e-9)


def test_claims_are_recomputed_from_the_run_folders(study):
    out, results = study
    runs = [read_run(folder) for folder in (out / "runs").iterdir()]
    paired = [run for run in runs if run.meta["seed"] >= 1000]
    assert len(paired) == 36
    for claim in results["claims"]:
        values = {"with": {}, "without": {}}
        for run in paired:
            if run.meta["protocol"]["name"] == claim["protocol"]:
                number = measures(run_metrics(run.log))[claim["measure"]]
                values[run.meta["arm"]][run.meta["seed"]] = number
        effect = np.mean([values["without"][s] - values["with"][s] for s in values["with"]])
        assert effect == pytest.approx(claim["effect"], rel=1e-9, abs=1e-12)
        assert MEASURES[claim["measure"]][0] == claim["unit"]


def test_the_grid_covers_gear_and_joint_play_from_0_to_3_degrees(study):
    _, results = study
    cells = {(cell["gear_deg"], cell["joint_deg"]) for cell in results["grid"]}
    assert {0.0, 3.0} <= {g for g, _ in cells}
    assert len(cells) == 16
    effect = {
        (c["gear_deg"], c["joint_deg"]): c["settled_error"]["effect"] for c in results["grid"]
    }
    for gear in (0.0, 1.0, 2.0, 3.0):
        assert effect[gear, 3.0] > effect[gear, 0.0]  # more joint play, more to gain


def test_the_runs_of_a_study_are_those_that_it_needs(study):
    """12 of the figures, 2 simulated ones, 6 pairs of 3 protocols; none twice, none unfinished."""
    out, results = study
    runs = {folder.name: read_run(folder).meta["outcome"] for folder in (out / "runs").iterdir()}
    assert len(runs) == 12 + 2 + 36
    assert set(runs.values()) == {"completed"}
    named = {run["folder"] for f in results["figures"].values() for a in f.values()
             for run in a["runs_list"]}  # fmt: skip
    assert named <= set(runs)
    assert len(named) == 14


def test_rivals_are_compared_on_both_frictions(study):
    _, results = study
    for friction in ("friction as it is", "little friction"):
        arms = results["rivals"][friction]["arms"]
        assert set(arms) == {"without", "with", "sham", "misplaced", "retuned", "no play, without"}
        for arm, table in arms.items():
            assert table["settled_error"]["n"] == 6
            assert arm == "with" or table["settled_error"]["against_with"]["n"] == 6
    little = {a: t["settled_error"]["value"] for a, t in
              results["rivals"]["little friction"]["arms"].items()}  # fmt: skip
    assert little["with"] < little["without"] < little["sham"]


def test_controllers_of_other_units_know_the_kind_alone(study):
    """run.json of a paired run says nothing of the unit that was drawn."""
    out, _ = study
    kind = to_dict(known(load_rig(None)))
    for folder in (out / "runs").iterdir():
        meta = read_run(folder).meta
        if meta["seed"] >= 1000:
            assert meta["rig"]["servo"] == kind["servo"]
            assert meta["rig"]["drive"] == kind["drive"]
            assert "tachometer_scale" in (folder / "truth.json").read_text()


def test_claims_of_runs_that_did_not_complete_are_left_open():
    rows = [dict.fromkeys(MEASURES, float("nan"))] * 2
    table = {name: {"with": rows, "without": rows} for name in {c.protocol for c in CLAIMS}}
    for claim in judge(table, 1):
        assert (claim["holds"], claim["runs"], claim["left_out"]) == (None, 0, 2)


def test_runs_of_figures_that_did_not_complete_are_named():
    log = simulate_run(RunRequest(load_rig(None), short("free-release"), "with", 1, Path())).log
    runs = [recorded(Path(name), log, name) for name in ("completed", "ball-lost")]
    (said,) = unfinished({"10": {"with": runs}})
    assert said.startswith("Fig. 10 with: ball-lost ended as 'ball-lost'")
    assert "is a part, not a whole run" in said


@pytest.mark.slow
def test_a_study_of_a_table_that_loses_its_ball_says_so_and_claims_nothing(tmp_path: Path):
    rig = load_rig(None)
    wild = replace(rig, gains=replace(rig.gains, proportional_rad_m=9.0, derivative_rad_s_m=0.3))
    reproduce(wild, tmp_path, frames=False, pairs=2, grid_pairs=2)
    results = json.loads((tmp_path / "results.json").read_text())
    assert all(claim["holds"] is None and claim["runs"] == 0 for claim in results["claims"])
    assert all(claim["left_out"] == 2 for claim in results["claims"])
    ends = {run["outcome"] for run in results["figures"]["10"]["with"]["runs_list"]}
    assert "completed" not in ends
    assert "is a part, not a whole run" in (tmp_path / "report.html").read_text()
