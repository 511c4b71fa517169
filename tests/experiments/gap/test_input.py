"""`rig gap` takes every kind of log, says what is odd, and refuses in one line what is no log."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from experiments.gap.input import read_evidence
from experiments.records.exporting import export_log
from experiments.records.recording import Recorder, write_run
from experiments.records.run_folder import read_meta, replace_json
from rig.log import INDEX
from rig.parameters import CameraTiming, Gains, Linkage, Servo
from rig.rigfile import to_dict, write_rig
from tests.support.gap.logs import RIG, log_of, table_log

SLOW = [HealthCheck.too_slow, HealthCheck.function_scoped_fixture]


def run_folder(folder, columns=None, *, rig=RIG, seed=1, **more):
    """A run folder as `rig run` leaves it."""
    start = {
        "source": "simulated",
        "protocol": {"name": "steps", "title": "t", "duration_s": 12.0},
        "arm": "with",
        "seed": seed,
        "rig": to_dict(rig),
        **more,
    }
    write_run(folder, start, log_of(columns or table_log(seed=seed)))
    return folder


def csv(tmp_path, columns, name="log.csv"):
    return export_log(log_of(columns), tmp_path / name)


def refused(path, words, rig_file=None):
    with pytest.raises((ValueError, FileNotFoundError), match=words) as caught:
        read_evidence([path] if not isinstance(path, list) else path, rig_file)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_a_run_folder_says_what_is_known(tmp_path):
    rig = replace(RIG, gains=Gains(proportional_rad_m=2.0), control_rate_hz=400.0)
    found = read_evidence([run_folder(tmp_path / "run", rig=rig)])
    assert found.sources == ("run folder",)
    assert found.arms == ("with",)
    assert found.seeds == (1,)
    assert found.names == ("run",)
    assert found.protocols[0] is not None
    assert found.protocols[0]["name"] == "steps"
    assert found.rigs[0] == found.rig == rig
    assert found.notes == ()
    assert len(found.logs[0]) == 6000


def test_a_run_that_is_still_being_recorded_says_so(tmp_path):
    start = {"source": "simulated", "protocol": "steps", "rig": to_dict(RIG)}
    recorder = Recorder(tmp_path / "run", start)
    for row in log_of(table_log(seed=1)).rows:
        recorder.append(row)
    found = read_evidence([tmp_path / "run"])
    assert found.notes[0] == "run: still being recorded: these are its rows so far"
    recorder.finish("done")
    assert not read_evidence([tmp_path / "run"]).notes


def test_what_comes_before_a_time_is_left_out_of_files_and_said(tmp_path):
    columns = table_log(seed=3)
    columns["t_s"] = columns["t_s"] + 100.0
    path = csv(tmp_path, columns)
    whole, later = read_evidence([path]), read_evidence([path], None, 2.0)
    assert later.logs[0]["t_s"][0] == pytest.approx(102.0)
    np.testing.assert_array_equal(later.logs[0].rows, whole.logs[0].rows[1000:])
    assert "log.csv: its first 2 s are left out, as was asked for" in later.notes
    with pytest.raises(ValueError, match=r"log.csv: --from 900 is beyond its end, 12 s"):
        read_evidence([path], None, 900.0)
    with pytest.raises(ValueError, match="--from nan is beyond its end"):
        read_evidence([path], None, float("nan"))
    with pytest.raises(ValueError, match="--from is for files of other programs"):
        read_evidence([run_folder(tmp_path / "run")], None, 2.0)


def test_the_truth_is_never_opened(tmp_path):
    folder = run_folder(tmp_path / "run")
    (folder / "truth.json").mkdir()  # opening it would be an error
    assert read_evidence([folder]).notes == ()


@pytest.mark.parametrize("form", ["csv", "parquet"])
def test_several_runs_in_one_file_are_several_logs(tmp_path, form: str):
    runs = [table_log(seed=seed) for seed in (1, 2)]
    both = {name: np.concatenate([run[name] for run in runs]) for name in runs[0]}
    found = read_evidence([export_log(log_of(both), tmp_path / f"two.{form}")])
    assert found.names == (f"two.{form} run 1", f"two.{form} run 2")
    for log, run in zip(found.logs, runs, strict=True):
        np.testing.assert_allclose(log["theta_x_rad"], run["theta_x_rad"], atol=1e-9)


def test_a_time_that_stutters_is_no_new_run(tmp_path):
    columns = table_log(seed=1)
    columns["t_s"][100] = columns["t_s"][98]
    refused(csv(tmp_path, columns), "time does not grow in row 101")


def test_files_and_run_folders_go_together(tmp_path):
    folder = run_folder(tmp_path / "run")
    other = csv(tmp_path, table_log(seed=2))
    found = read_evidence([folder, other])
    assert found.sources == ("run folder", "file")
    assert found.arms == ("with", None)
    assert found.notes == ("log.csv: taken to be of the rig of run",)
    assert len(found.logs) == len(found.rigs) == 2


def test_a_rig_file_is_believed_and_keeps_its_effects(tmp_path):
    effects = {"joint_backlash": {"x": {"play_rad": 0.02}}}
    believed = replace(RIG, linkage=Linkage(arm_radius_m=0.03), effects=effects)
    write_rig(believed, tmp_path / "rig.toml")
    run = run_folder(tmp_path / "run", rig=replace(RIG, gains=Gains(derivative_rad_s_m=1.0)))
    found = read_evidence([run], tmp_path / "rig.toml")
    assert found.rig == believed
    assert found.rigs[0].gains.derivative_rad_s_m == 1.0
    assert found.rigs[0].linkage == believed.linkage
    assert "another rig file (linkage.arm_radius_m = 0.03 and 0.0254)" in found.notes[0]
    (tmp_path / "rig.toml").write_text("[linkage]\nplate_side_m = 0.3\n")
    assert read_evidence([run], tmp_path / "rig.toml").rig.linkage.arm_radius_m == 0.0254


def test_a_faster_camera_than_the_runs_loop_is_no_crash(tmp_path):
    slow = replace(RIG, camera=CameraTiming(rate_hz=30.0), control_rate_hz=50.0)
    write_rig(RIG, tmp_path / "rig.toml")
    found = read_evidence([run_folder(tmp_path / "run", rig=slow)], tmp_path / "rig.toml")
    assert found.rigs[0].control_rate_hz == 500.0


def test_the_default_table_is_assumed_aloud(tmp_path):
    found = read_evidence([csv(tmp_path, table_log())])
    assert found.rig == RIG
    assert "default table" in found.notes[0]


def test_runs_of_two_rigs_are_refused_unless_a_rig_is_given(tmp_path):
    one = run_folder(tmp_path / "one")
    other = run_folder(tmp_path / "two", rig=replace(RIG, servo=Servo(gain_rad_s_V=1.7)), seed=2)
    said = refused([one, other], "different rigs")
    assert "servo.gain_rad_s_V = 1.53 and 1.7" in said
    write_rig(RIG, tmp_path / "rig.toml")
    assert len(read_evidence([one, other], tmp_path / "rig.toml").logs) == 2


def test_files_of_two_encoders_are_refused(tmp_path):
    columns = table_log(seed=2)
    for axis in "xy":
        step = 2 * np.pi / 1000
        theta = columns[f"theta_{axis}_rad"]
        columns[f"theta_{axis}_rad"] = step * np.round(theta / step)
    two = [csv(tmp_path, table_log(), "one.csv"), csv(tmp_path, columns, "two.csv")]
    refused(two, "one.csv and two.csv are of different rigs: theta_x_rad moves in steps")


def test_one_log_twice_is_refused(tmp_path):
    path = csv(tmp_path, table_log())
    refused([path, path], "named twice")
    refused([path, csv(tmp_path, table_log(), "copy.csv")], "hold the same rows")
    refused([], "no log given")


def test_names_of_logs_differ(tmp_path):
    paths = [csv(tmp_path / str(seed), table_log(seed=seed)) for seed in (1, 2)]
    assert read_evidence(paths).names == ("1/log.csv", "2/log.csv")


def test_the_hand_that_holds_the_ball_is_not_the_table(tmp_path):
    columns = table_log()
    columns["phase"] = np.where(columns["t_s"] < 2.0, 1.0, 2.0)
    columns["ball_exposed_s"] = np.where(
        np.isnan(columns["ball_x_m"]), np.nan, columns["t_s"] - 0.012
    )
    found = read_evidence([run_folder(tmp_path / "run", columns)]).logs[0]
    assert len(found) == 6000
    times, _ = found.ball()
    assert times[0] >= 2.0
    assert 590 < len(times) == np.sum(columns["ball_exposed_s"] >= 2.0)


def test_rejected_runs_are_left_out(tmp_path):
    bad, good = run_folder(tmp_path / "bad"), run_folder(tmp_path / "good", seed=2)
    replace_json(bad / "run.json", read_meta(bad) | {"rejected": "the table was bumped"})
    found = read_evidence([bad, good])
    assert found.names == ("good",)
    assert found.notes == ("bad was rejected (the table was bumped) and is left out",)
    refused(bad, "no log left.*bumped")


def test_a_run_that_ended_at_once_does_not_stop_the_others(tmp_path):
    short = {name: values[:100] for name, values in table_log(seed=3).items()}
    one, other = csv(tmp_path, short, "lost.csv"), csv(tmp_path, table_log())
    found = read_evidence([one, other])
    assert found.names == ("log.csv",)
    assert len(found.logs) == len(found.rigs) == 1
    assert found.notes[1] == "lost.csv is left out: too short: 0.198 s (limit: 1 s); record longer"
    assert read_evidence([other, one]).names == ("log.csv",)
    refused(
        [one, csv(tmp_path, {k: v[50:] for k, v in short.items()}, "b.csv")], "b.csv: too short"
    )


def test_folders_that_are_no_runs_are_refused(tmp_path):
    refused(tmp_path, "no run folder")
    run_folder(tmp_path / "study" / "a")
    refused(tmp_path / "study", r"no run.json; name the 1 inside it \(a \.\.\.\)")
    whole = read_meta(tmp_path / "study/a")
    replace_json(tmp_path / "study/a/run.json", {"schema": 1})
    refused(tmp_path / "study" / "a", "source is None")
    replace_json(tmp_path / "study/a/run.json", whole | {"rig": {"servo": {"gain": 1}}})
    refused(tmp_path / "study" / "a", "unknown key 'servo.gain'")
    refused(tmp_path / "nothing.csv", "does not exist")
    refused(csv(tmp_path, table_log()), "rig file .* not found", tmp_path / "no.toml")


@pytest.mark.parametrize(
    ("kept", "says"),
    [
        (("voltage", "theta"), "ball_x_m, ball_y_m"),
        (("theta", "ball"), "voltage_x_V, voltage_y_V"),
        (("voltage_x", "theta_x", "ball_x"), "voltage_y_V, theta_y_rad, ball_y_m"),
    ],
)
def test_channels_and_axes_may_be_missing(tmp_path, kept, says):
    columns = {k: v for k, v in table_log().items() if k.startswith(("t_s", *kept))}
    found = read_evidence([csv(tmp_path, columns)])
    assert f"no values of {says}: what needs them is skipped" in found.notes[1]


def test_missing_rows_and_jitter_are_fine(tmp_path):
    columns = table_log()
    rng = np.random.default_rng(3)
    keep = np.sort(rng.choice(6000, 5500, replace=False))
    columns = {name: values[keep] for name, values in columns.items()}
    columns["t_s"] = columns["t_s"] + rng.uniform(-2e-4, 2e-4, 5500)
    assert len(read_evidence([csv(tmp_path, columns)]).notes) == 1


def test_a_few_blank_rows_are_bridged_and_said(tmp_path):
    columns = table_log()
    columns["voltage_x_V"][17] = np.nan
    columns["theta_y_rad"][400:403] = np.nan
    found = read_evidence([csv(tmp_path, columns)])
    assert len(found.logs[0]) == 5996
    assert np.isfinite(found.logs[0].rows[:, [INDEX["voltage_x_V"], INDEX["theta_y_rad"]]]).all()
    assert "left out row 18 and 3 more of 6000" in found.notes[1]
    columns["voltage_x_V"][100:200] = np.nan
    refused(csv(tmp_path, columns), r"voltage_x_V is blank in row 18 and 100 more .limit: 1 %")


@settings(max_examples=20, suppress_health_check=SLOW)
@given(
    rate_hz=st.sampled_from([10.0, 33.3, 200.0, 1000.0, 5000.0]),
    frame_hz=st.sampled_from([5.0, 30.0, 120.0]),
    held=st.booleans(),
    suffix=st.sampled_from(["csv", "parquet", "mat"]),
    order=st.randoms(use_true_random=False),
    seed=st.integers(0, 99),
)
def test_any_rate_format_and_order_reads_the_same(
    tmp_path_factory, rate_hz, frame_hz, held, suffix, order, seed
):
    """Held samples are thinned: the ball's observations are those of the blank log."""
    columns = table_log(rate_hz=rate_hz, frame_hz=frame_hz, seed=seed, seconds=8.0)
    blank = log_of(columns)
    if held:
        last = np.maximum.accumulate(
            np.where(np.isnan(columns["ball_x_m"]), 0, np.arange(len(blank)))
        )
        for axis in "xy":
            columns[f"ball_{axis}_m"] = columns[f"ball_{axis}_m"][last]
    names = list(columns)
    order.shuffle(names)
    path = tmp_path_factory.mktemp("gap") / f"log.{suffix}"
    write_shuffled(path, {name: columns[name] for name in names})
    found = read_evidence([path])
    for mine, theirs in zip(found.logs[0].ball(), blank.ball(), strict=True):
        np.testing.assert_array_equal(mine, theirs)
    np.testing.assert_array_equal(found.logs[0]["theta_y_rad"], blank["theta_y_rad"])


def write_shuffled(path, columns):
    """Write columns in their own order, as another program would."""
    if path.suffix == ".csv":
        lines = [",".join(columns)]
        lines += [",".join(map(repr, row)) for row in np.array([*columns.values()]).T.tolist()]
        path.write_text("\n".join(lines).replace("nan", "") + "\n")
    elif path.suffix == ".parquet":
        import pyarrow as pa
        import pyarrow.parquet as pq

        pq.write_table(pa.table(columns), path)
    else:
        from scipy.io import savemat

        savemat(path, columns)
