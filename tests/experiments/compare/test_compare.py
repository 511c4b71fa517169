"""The comparison itself, small: resumed, in any number of processes, and told in words."""

import json
from pathlib import Path

import pytest

from experiments.compare import compare as bench
from experiments.compare.grid import Grid, cells, read_grid
from experiments.compare.words import words
from experiments.progress import silent
from experiments.runs.assemble import load_rig
from tests.support.parts import need

SMALL = {
    "title": "small",
    "seeds": 6,
    "arms": ["without", "with", "neural"],
    "paper": {"play": "joint 2", "friction": "own", "protocol": "hold"},
    "plays": {"joint 2": {"joint_deg": 2.0}},
    "frictions": {"own": {}},
    "courses": [{"protocol": "hold", "duration_s": 4.0}],
    "retuned": [{"proportional_rad_m": 4.5, "derivative_rad_s_m": 5.0}],
    "robustness": {"plays": ["joint 2"], "faults": {"late": {"camera_late_s": 0.03}}},
}
GRID = Grid.model_validate(SMALL)
RIG = load_rig(None)


def rows(folder: Path, jobs: int = 1, calls: list | None = None, note=lambda text: None):
    count = calls if calls is not None else []
    return bench.all_rows(RIG, GRID, folder, jobs=jobs, cluster=None, note=note,
                          progress=lambda stage, done, total: count.append(done))  # fmt: skip


def test_an_interrupted_comparison_goes_on_and_gives_the_same(tmp_path):
    whole = rows(tmp_path)
    kept = (tmp_path / bench.ROWS_FILE).read_text().splitlines()
    assert len(kept) == len(bench.plan(GRID)) == 7
    (tmp_path / bench.ROWS_FILE).write_text("\n".join(kept[:3]) + '\n{"key": "cut o')
    done: list = []
    assert json.dumps(rows(tmp_path, calls=done)) == json.dumps(whole)
    assert done == [3, 4, 5, 6, 7]
    judged = bench.judge(GRID, whole)
    assert [cell["key"] for cell in judged] == [cell.key for cell in cells(GRID)]
    said = words({"cells": judged, "grid": SMALL, "measure": "settled_error"})
    assert any("paper's claim is one cell" in line for line in said)
    assert any(line.startswith("With late") for line in said)
    json.dumps(judged)


def test_what_was_kept_for_another_grid_or_rig_counts_for_nothing(tmp_path):
    (tmp_path / bench.ROWS_FILE).write_text(json.dumps({"key": "0" * 24, "rows": []}) + "\n")
    done: list = []
    table = rows(tmp_path, calls=done)
    assert done[0] == 0
    assert len(table[cells(GRID)[0].key]["with"]) == 6


def test_a_protocol_that_was_edited_starts_afresh(tmp_path):
    mine, said = tmp_path / "mine.toml", []
    other = tmp_path / "other.toml"
    text = 'title = "mine"\nduration_s = 3.0\n[reference]\nshape = "circle"\nradius = {}\n'
    mine.write_text(text.format(0.01))
    other.write_text(text.format(0.02))
    names = [str(mine), str(other)]
    told = SMALL | {
        "arms": ["without", "with"],
        "courses": [{"protocol": name} for name in names],
        "paper": SMALL["paper"] | {"protocol": names[0]},
        "retuned": [],
        "robustness": {"plays": ["joint 2"], "faults": {}},
    }
    grid = Grid.model_validate(told)

    def made(folder: Path) -> str:
        return json.dumps(
            bench.all_rows(
                RIG, grid, folder, jobs=1, cluster=None, progress=silent, note=said.append
            )
        )

    first = made(tmp_path)
    assert made(tmp_path) == first
    mine.write_text(text.format(0.05))
    edited = made(tmp_path)
    (tmp_path / "anew").mkdir()
    assert edited == made(tmp_path / "anew") != first
    ends = f"arms in cells are kept from an earlier call ({tmp_path / 'rows.jsonl'})"
    assert said == [f"4 of 4 {ends}", f"2 of 4 {ends}"]


def test_strangers_rows_count_for_nothing_and_a_link_is_not_written_through(tmp_path):
    whole = rows(tmp_path)
    path = tmp_path / bench.ROWS_FILE
    kept = [json.loads(line) for line in path.read_text().splitlines()]
    for one, bad in zip(kept, (3, {"a": 1}, [1], [{}], [{"a": "b"}], "x", [None]), strict=True):
        one["rows"] = bad
    path.write_bytes(b"\xff\xfe\n[[[\n" + "\n".join(map(json.dumps, kept)).encode())
    done: list = []
    told: list[str] = []
    assert json.dumps(rows(tmp_path, calls=done, note=told.append)) == json.dumps(whole)
    assert done[0] == 0
    assert told == [f"9 of 9 lines of {path} cannot be read: what they held is run again"]

    kept = [json.loads(line) for line in path.read_bytes().splitlines()[-len(kept) :]]
    kept[0]["rows"].pop()  # a seed is missing
    path.write_text("\n".join(map(json.dumps, kept)) + "\n")
    assert json.dumps(rows(tmp_path, calls=done)) == json.dumps(whole)

    mine = tmp_path / "mine.txt"
    mine.write_text("mine\n")
    path.unlink()
    path.symlink_to(mine)
    with pytest.raises(ValueError, match=r"rows.jsonl is a link: remove it"):
        rows(tmp_path)
    assert mine.read_text() == "mine\n"


@pytest.mark.slow
def test_two_processes_give_the_same_bits(tmp_path):
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    assert json.dumps(rows(tmp_path / "a")) == json.dumps(rows(tmp_path / "b", jobs=2))


@pytest.mark.slow
@pytest.mark.filterwarnings("default")  # what a cluster warns of at its end is its own
def test_a_dask_cluster_of_two_processes_gives_the_same_bits(tmp_path):
    need("distributed")
    import distributed

    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    here = rows(tmp_path / "a")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None
    ) as cluster:
        there = bench.all_rows(RIG, GRID, tmp_path / "b", jobs=None,
                               cluster=cluster.scheduler_address, progress=silent)  # fmt: skip
    assert json.dumps(here) == json.dumps(there)


def test_the_shipped_grid_is_read_and_silent_progress_is_silent():
    assert read_grid(None).title
    assert silent("x", 1, 2) is None
