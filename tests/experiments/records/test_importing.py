"""What was exported is read back bit for bit; what others wrote is checked and explained."""

import os
import shutil

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from scipy.io import savemat

from experiments.records.exporting import export_log, export_run
from experiments.records.importing import GAPLESS, MOST_ROWS, ONE_OF, read_log, read_logs
from experiments.records.mat_files import MOST_BYTES
from experiments.records.recording import Recorder, write_run
from experiments.records.row_checks import check_clock
from experiments.records.samples_file import LONGEST_S, SHORTEST_S
from rig.log import COLUMNS, INDEX, NAMES, Log

FINITE = st.floats(allow_nan=False, allow_infinity=False, width=64)
ANY = st.one_of(FINITE, st.just(np.nan), st.sampled_from([np.inf, -np.inf, -0.0, 5e-324]))
TIME = st.floats(SHORTEST_S, LONGEST_S).map(lambda t_s: t_s or 0.0)  # 0 and -0 are one time
BALL = st.one_of(FINITE, st.just(np.nan))
SUFFIXES = ["csv", "parquet", "mat"]


@st.composite
def logs(draw):
    """Any log that an import accepts: whole or missing angles and volts, the rest as it likes."""
    times = sorted(draw(st.lists(TIME, min_size=1, max_size=6, unique=True)))
    columns = {"t_s": np.array(times)}
    for name in NAMES[1:]:
        values = FINITE if name in GAPLESS else BALL if name.startswith("ball") else ANY
        missing = draw(st.booleans())
        size = len(times)
        column = draw(st.lists(values, min_size=size, max_size=size)) if not missing else np.nan
        columns[name] = np.broadcast_to(np.asarray(column, float), (size,))
    log = Log.from_columns(columns)
    assume(any(log.has(name) for name in ONE_OF))
    return log


def same(a, b):
    return np.ascontiguousarray(a.rows).tobytes() == np.ascontiguousarray(b.rows).tobytes()


@pytest.mark.parametrize("suffix", [*SUFFIXES, "run"])
@settings(max_examples=25, suppress_health_check=[HealthCheck.too_slow])
@given(log=logs())
def test_export_then_import_is_the_same_log_bit_for_bit(tmp_path_factory, suffix, log):
    path = tmp_path_factory.mktemp("log") / f"log.{suffix}"
    if suffix == "run":
        write_run(path, {"source": "simulated"}, log)
    else:
        export_log(log, path)
    assert same(read_log(path), log)


def test_a_run_folder_and_its_exports_are_one_log(tmp_path):
    rows = np.random.default_rng(4).normal(size=(3000, len(COLUMNS)))
    rows[:, 0] = np.arange(3000) / 500
    write_run(tmp_path / "run", {"source": "measured"}, Log.from_rows(rows))
    log = read_log(tmp_path / "run")
    assert log.notes == ()
    assert same(read_log(tmp_path / "run/samples.mcap"), log)
    for suffix in SUFFIXES:
        export_run(tmp_path / "run", tmp_path / f"log.{suffix}")
        assert same(read_log(tmp_path / f"log.{suffix}"), log)


def test_a_cut_recording_is_read_and_says_so(tmp_path):
    recorder = Recorder(tmp_path / "run", {"source": "measured"})
    recorder.append(np.zeros(len(COLUMNS)))
    growing = read_log(tmp_path / "run")
    shutil.copytree(tmp_path / "run", tmp_path / "cut")  # which nobody writes
    cut = read_log(tmp_path / "cut")
    recorder.finish("done")
    assert len(growing) == len(cut) == 1
    assert growing.notes[0] == "still being recorded: these are its rows so far"
    assert "cut off" in cut.notes[0]
    assert not any("recorded" in note for note in read_log(tmp_path / "run").notes)


def write(path, columns):
    """Write `columns` in the format of `path`'s suffix, as another program would."""
    if path.suffix == ".csv":
        rows = zip(*columns.values(), strict=True)
        lines = [",".join(columns), *(",".join(map(str, row)) for row in rows)]
        path.write_text("\n".join(lines) + "\n")
    elif path.suffix == ".parquet":
        pq.write_table(pa.table(columns), path)
    else:
        savemat(path, columns)
    return path


@pytest.fixture(params=SUFFIXES)
def save(request, tmp_path):
    return lambda **columns: write(tmp_path / f"log.{request.param}", columns)


def test_time_and_one_angle_are_enough(save):
    path = save(t_s=np.arange(3), theta_y_rad=np.array([1.0, 2.0, 3.0]), mood=np.zeros(3))
    log = read_log(path)
    np.testing.assert_array_equal(log["t_s"], [0.0, 1.0, 2.0])
    np.testing.assert_array_equal(log["theta_y_rad"], [1.0, 2.0, 3.0])
    assert log.notes[0] == "unknown columns left out: mood"
    assert log.notes[1].startswith("no values of voltage_x_V, voltage_y_V, theta_x_rad, ball_x_m")
    assert len(log.notes) == 2


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        ({"time": [0.0, 1.0], "theta_x_rad": [0.0, 0.0]}, "no column t_s.*time, theta_x_rad"),
        ({"t_s": [0.0, 1.0], "voltage_x_V": [0.0, 0.0]}, "theta_x_rad, theta_y_rad, ball_x_m"),
        ({"t_s": [0.0, 1.0], "ball_x_m": [np.nan, np.nan]}, "no values in any of"),
        ({"t_s": [0.0, np.nan, 2.0], "ball_x_m": [0.0] * 3}, "t_s is blank or not finite in row 2"),
        ({"t_s": [0.0, 1.0, 0.5, 0.4], "ball_x_m": [0.0] * 4}, "row 3 and 1 more .from 1.0 to 0.5"),
        ({"t_s": [0.0, 1.0, 1.0], "ball_x_m": [0.0] * 3}, "time does not grow in row 3"),
        ({"t_s": [0.0, 1.0], "theta_x_rad": [np.nan, 0.0]}, "theta_x_rad is blank in row 1"),
        ({"t_s": [0.0, 1.0], "ball_x_m": [np.inf, 0.0]}, "ball_x_m is infinite in row 1"),
    ],
)
def test_bad_logs_are_refused_in_one_line(save, columns, words):
    path = save(**{name: np.array(values) for name, values in columns.items()})
    with pytest.raises(ValueError, match=words) as caught:
        read_log(path)
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)


def test_times_beyond_all_measure_cost_no_warning(save):
    with pytest.raises(ValueError, match="t_s is blank or not finite in row 1 and 1 more"):
        read_logs(save(t_s=np.array([np.inf, np.inf]), theta_x_rad=np.zeros(2)))
    (log,) = read_logs(save(t_s=np.array([-1e308, 1e308]), theta_x_rad=np.zeros(2)))
    with pytest.raises(ValueError, match="rows come every inf s"):
        check_clock(log["t_s"])


def test_csv_of_other_programs(tmp_path):
    path = tmp_path / "log.csv"
    text = "t_s; theta_x_rad ;ball_x_m;comment\r\n0;0.5;;start\r\n\r\n1e-3; -0.5;NaN;\r\n"
    path.write_bytes(b"\xef\xbb\xbf" + text.encode())
    log = read_log(path)
    np.testing.assert_array_equal(log["theta_x_rad"], [0.5, -0.5])
    np.testing.assert_array_equal(log["t_s"], [0.0, 0.001])
    assert not log.has("ball_x_m")
    assert "comment" in log.notes[0]


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "no column t_s"),
        (b"t_s,theta_x_rad\n", "no rows"),
        (b"t_s,theta_x_rad\n0,1\n1\n", "line 3 has 1 cells, not 2"),
        (b"t_s,theta_x_rad\n0,0.5 rad\n", "row 1: theta_x_rad is '0.5 rad'"),
        (b"t_s;theta_x_rad\n0;0,5\n", "decimal point"),
        (b"t_s,theta_x_rad,t_s\n0,1,2\n", "twice: t_s; rename one"),
        (b"t_s,theta_x_rad\n\xff\xfe\n", "UTF-8"),
        (b't_s,theta_x_rad\n0,"' + b"1" * 200_000 + b'"\n', "field limit"),
    ],
)
def test_bad_csv_is_refused_in_one_line(tmp_path, content, words):
    path = tmp_path / "log.csv"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=words) as caught:
        read_log(path)
    assert "\n" not in str(caught.value)


def test_parquet_of_other_programs(tmp_path):
    """Integers, single precision, nulls, a folder that looks like a partition."""
    path = tmp_path / "t_s=7" / "log.parquet"
    path.parent.mkdir()
    table = {
        "t_s": pa.array([0, 1, 2], pa.int64()),
        "ball_x_m": pa.array([None, 0.5, None], pa.float32()),
        "push": pa.array([True, False, None]),
        "operator": pa.array(["a", "b", None]),
    }
    pq.write_table(pa.table(table), path)
    log = read_log(path)
    np.testing.assert_array_equal(log["t_s"], [0, 1, 2])
    np.testing.assert_array_equal(log["ball_x_m"], [np.nan, 0.5, np.nan])
    np.testing.assert_array_equal(log["push"], [1, 0, np.nan])
    pq.write_table(pa.table({"t_s": ["zero"], "ball_x_m": [1.0]}), path)
    with pytest.raises(ValueError, match="column 't_s' holds no numbers"):
        read_log(path)


def test_a_parquet_file_of_some_kB_that_holds_more_rows_than_memory_is_refused(tmp_path):
    column = pa.array(np.zeros(MOST_ROWS + 1, np.int8))
    path = tmp_path / "bomb.parquet"
    pq.write_table(pa.table({"t_s": column, "theta_x_rad": column}), path, compression="zstd")
    assert path.stat().st_size < 100_000
    with pytest.raises(ValueError, match=f"it has {MOST_ROWS + 1} rows"):
        read_log(path)


@pytest.mark.parametrize(
    ("rows", "words"),
    [(MOST_ROWS + 1, "rows"), (MOST_BYTES // 8, "unpacks to more than")],
)
def test_a_mat_file_of_some_kB_that_holds_more_rows_than_memory_is_refused(tmp_path, rows, words):
    path = tmp_path / "bomb.mat"
    savemat(path, {"t_s": np.zeros(rows, np.int8)}, do_compression=True)
    if rows * 8 >= MOST_BYTES:  # the same variable again and again: what is tested is their sum
        packed = path.read_bytes()
        path.write_bytes(packed + 8 * packed[128:])
    assert path.stat().st_size < 1_000_000
    with pytest.raises(ValueError, match=words):
        read_log(path)


def test_mat_of_other_programs(tmp_path):
    """Row vectors, integers, and a struct that holds the columns."""
    path = tmp_path / "log.mat"
    columns = {"t_s": np.arange(3, dtype=np.int32), "theta_x_rad": np.ones((3, 1), np.float32)}
    savemat(path, {**columns, "note": "hello"})
    assert len(read_log(path)) == 3
    savemat(path, {"gain": 1.5, "log": columns})
    np.testing.assert_array_equal(read_log(path)["t_s"], [0, 1, 2])
    for wrong in ("text", np.ones((3, 2)), np.ones(3) * 1j):
        savemat(path, {**columns, "theta_x_rad": wrong})
        with pytest.raises(ValueError, match="theta_x_rad is no column of numbers"):
            read_log(path)


@pytest.mark.parametrize("suffix", ["parquet", "mat"])
def test_damaged_files_are_refused_in_one_line(tmp_path, suffix):
    log = Log.from_columns({"t_s": np.arange(50.0), "ball_x_m": np.arange(50.0)})
    whole = export_log(log, tmp_path / f"whole.{suffix}").read_bytes()
    path = tmp_path / f"log.{suffix}"
    for cut in (0, 3, 60, 130, 200, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:cut])
        with pytest.raises(ValueError, match="log") as caught:
            read_log(path)
        assert "\n" not in str(caught.value)


def test_lengths_that_differ_are_refused(tmp_path):
    savemat(tmp_path / "log.mat", {"t_s": np.arange(3.0), "ball_x_m": np.arange(4.0)})
    with pytest.raises(ValueError, match="one length"):
        read_log(tmp_path / "log.mat")


def test_what_is_not_there_or_no_log_is_said(tmp_path):
    with pytest.raises(FileNotFoundError, match="does not exist"):
        read_log(tmp_path / "log.csv")
    with pytest.raises(FileNotFoundError, match="no run folder"):
        read_log(tmp_path)
    (tmp_path / "log.txt").write_text("t_s")
    with pytest.raises(ValueError, match=r"run folder or a file \.csv"):
        read_log(tmp_path / "log.txt")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="the system has no pipes with a name")
def test_a_pipe_is_refused_and_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "log.csv")
    with pytest.raises(ValueError, match="is no file but a pipe or a device"):
        read_log(tmp_path / "log.csv")


def test_every_column_is_known_by_its_name(tmp_path):
    rows = np.arange(2.0 * len(COLUMNS)).reshape(2, -1)
    path = write(tmp_path / "log.csv", {name: rows[:, INDEX[name]] for name in NAMES})
    assert same(read_log(path), Log.from_rows(rows))
