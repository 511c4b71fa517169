"""A set: equal seeds give equal bytes, the hash holds, and nothing of the truth leaves the seal."""

import json
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from experiments.benchmark import design
from experiments.benchmark import make as making
from experiments.benchmark.design import Case
from experiments.benchmark.make import make_case, make_set, rounded
from experiments.benchmark.score import truth_of
from experiments.blind.trial import BlindTrial
from experiments.gap.input import read_evidence
from experiments.runs.protocol import read_protocol
from rig.effects import BY_NAME
from rig.log import CONTRACT
from tests.support.parts import need

LOGS = 6


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("benchmark") / "set"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(making, "engines_here", lambda: {"own": 1, "foreign": 1, "positions": 1})
        found = make_set(out, seed=3, logs=LOGS, jobs=1)
    assert found.logs == len(list((out / "cases").iterdir())) <= LOGS
    return out


def bytes_of(folder: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def test_the_same_seed_gives_the_same_bytes(made: Path, tmp_path: Path, monkeypatch):
    monkeypatch.setattr(making, "engines_here", lambda: {"own": 1, "foreign": 1, "positions": 1})
    make_set(tmp_path / "again", seed=3, logs=LOGS, jobs=1)
    assert bytes_of(tmp_path / "again") == bytes_of(made)
    with pytest.raises(ValueError, match="holds a benchmark already"):
        make_set(made, seed=3, logs=LOGS, jobs=1)


@pytest.mark.parametrize("failure", [OSError(28, "No space left on device"), KeyboardInterrupt()])
def test_half_a_set_stands_in_the_way_of_no_other(failure, tmp_path: Path, monkeypatch):
    """Of a full disk or Ctrl-C nothing is left that `make` would refuse to go over."""
    monkeypatch.setattr(making, "engines_here", lambda: {"foreign": 1})
    written, write = [], making.write_log

    def fails(log, path: Path) -> None:
        write(log, path)
        written.append(path)
        if len(written) == 2:
            raise failure

    with monkeypatch.context() as full:
        full.setattr(making, "write_log", fails)
        with pytest.raises(type(failure)):
            make_set(tmp_path, seed=3, logs=LOGS, jobs=1)
    assert len(written) == 2
    assert list(tmp_path.iterdir()) == []
    assert make_set(tmp_path, seed=3, logs=LOGS, jobs=1).logs > 0


def test_what_is_handed_out_tells_nothing_of_the_truth(made: Path):
    """Names, seeds and hidden numbers stand below sealed/ alone; the metadata are empty."""
    trials = truth_of(made)
    handed = {k: v for k, v in bytes_of(made).items() if not k.startswith("sealed")}
    for trial in trials:
        case = {k: v for k, v in handed.items() if trial.name in k}
        assert sorted(Path(k).name for k in case) == ["log-1.parquet", "rig.toml"]
        everything = b"".join(case.values())
        for number in (*trial.seeds, *numbers_of(trial)):
            assert repr(number).encode() not in everything
        file = pq.ParquetFile(made / "cases" / trial.name / "log-1.parquet")
        assert set(file.schema_arrow.names) <= set(CONTRACT)
        assert set(file.metadata.metadata or {}) <= {b"ARROW:schema"}
        for word in (*BY_NAME, "stranger", "own", "foreign", "mujoco"):
            assert word not in str(file.schema_arrow)
        assert not file.schema_arrow.metadata
    assert set(handed) - {k for k in handed if k.startswith("cases")} == {"rules.md", "seal.json"}
    assert set(json.loads(handed["seal.json"])) == {"sha256", "trials"}


def numbers_of(trial: BlindTrial) -> list[float]:
    return [v for by in trial.hidden.values() for values in by.values() for v in values.values()]


def test_one_kind_of_table_has_one_rig_file_whatever_is_hidden_in_it(tmp_path: Path):
    for number, kind in enumerate(design.KINDS, 1):
        make_case(Case(number, "foreign", kind), 5, tmp_path)
    files = {path.read_bytes() for path in tmp_path.rglob("rig.toml")}
    assert len(files) == 1
    lengths = {}
    for number in range(1, len(design.KINDS) + 1):
        trial = design.draw_case(Case(number, "foreign", list(design.KINDS)[number - 1]), 5)
        log = pq.read_table(tmp_path / trial.name / "log-1.parquet")
        lengths.setdefault(trial.protocols[0], set()).add(log.num_rows)
    for protocol, rows in lengths.items():  # a stranger's log is as long as the others
        assert max(rows) <= round(500 * read_protocol(protocol).duration_s)


def test_rig_gap_reads_every_case(made: Path):
    for folder in sorted((made / "cases").iterdir()):
        inputs = read_evidence([folder / "log-1.parquet"], folder / "rig.toml")
        assert len(inputs.logs[0]) > 4000
        assert inputs.rig.effects == {}


def test_what_is_written_is_rounded_as_the_rules_say():
    values = np.array([0.123456789, np.nan])
    assert rounded("voltage_x_V", values)[0] == 0.123
    assert rounded("ball_y_m", values)[0] == 0.123457
    assert rounded("t_s", values)[0] == 0.123457
    assert rounded("command_x_rad", values)[0] == 0.1235
    assert rounded("theta_x_rad", values)[0] == 0.123456789
    assert np.isnan(rounded("ball_x_m", values)[1])


def test_without_mujoco_its_logs_are_left_out_and_told(tmp_path: Path, monkeypatch):
    monkeypatch.setattr(design, "find_spec", lambda name: None)
    monkeypatch.setattr(
        making, "make_case", lambda case, seed, folder: design.draw_case(case, seed)
    )
    found = make_set(tmp_path / "set", seed=1, logs=40, jobs=1)
    assert found.logs == 32
    assert (
        found.left_out == "8 logs of the engine mujoco are left out: install the extra 'benchmark'"
    )


@pytest.mark.slow
def test_a_set_of_mujoco_has_the_same_bytes_twice(tmp_path: Path):
    need("mujoco")
    for place in ("one", "two"):
        make_case(Case(2, "mujoco", "one effect, real size"), 8, tmp_path / place)
    assert bytes_of(tmp_path / "one") == bytes_of(tmp_path / "two")
