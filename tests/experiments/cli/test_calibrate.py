"""`rig calibrate` from the command line: what it takes, what it writes, how it ends."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from calibration.bundle import load, load_draft
from calibration.camera.sheet import Sheet
from calibration.camera.virtual import sheet_pictures
from calibration.records import BacklashRecord, fingerprint
from experiments.calibrate.folder import CalibrationFolder
from experiments.calibrate.views import pick
from experiments.records.recording import read_run
from experiments.runs.assemble import load_rig
from experiments.runs.protocol import read_protocol
from experiments.runs.runner import RunRequest, keep_simulated, run, simulate_run
from rig.parameters import Rig
from rig.rigfile import read_rig
from tests.support.command import call
from vision.frames import Frame
from vision.synthetic.synthetic import Renderer, Scene, virtual_view


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> Path:
    """A folder with everything measured on the virtual table."""
    out = tmp_path_factory.mktemp("calibration")
    for command in ("camera", "table", "servo", "level"):
        assert call("calibrate", command, "--out", out) == 0
    assert call("calibrate", "time", "--out", out, "--seconds", "4") == 0
    return out


@pytest.fixture(scope="module")
def shots() -> list[np.ndarray]:
    renderer = Renderer(Scene(), virtual_view(), np.random.default_rng(3))
    return list(sheet_pictures(renderer, Sheet(), 22, np.random.default_rng(4)))


@pytest.fixture(scope="module")
def pictures(shots, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("pictures")
    for i, shot in enumerate(shots):
        cv2.imwrite(str(folder / f"{i}.png"), shot)
    return folder


def test_one_file_holds_all_and_says_where_it_came_from(made: Path):
    bundle = load(made / "calibration.json")
    assert set(bundle.sections) == {"lens", "plate", "timing", "level", "servo"}
    assert bundle.source == "simulated"
    assert bundle.made.tzinfo is not None
    for section in bundle.sections.values():
        assert section.pictures
        for picture in section.pictures:
            assert cv2.imread(str(made / picture)) is not None
    names = {file.name for file in bundle.sections["servo"].data}
    assert names == {"servo_ramps.csv", "servo_pulses.csv"}
    assert bundle.sections["servo"].data == fingerprint(
        [made / "servo_ramps.csv", made / "servo_pulses.csv"]
    )
    assert np.shape(bundle.lens.uncertainty_mm) == (9, 9)
    assert bundle.lens.half_set_mm < 0.2


def test_numbers_are_the_tables(made: Path):
    bundle, rig = load(made / "calibration.json"), load_rig(None)
    assert bundle.timing is not None
    assert bundle.level is not None
    assert bundle.servo is not None
    assert bundle.timing.delay_s.value == pytest.approx(rig.camera.delay_s, abs=0.0005)
    slope = rig.effects["level_offset"]["x"]["slope_rad"]
    assert bundle.level.slope_rad["x"].value == pytest.approx(slope, abs=1e-4)
    assert bundle.servo.x.breakaway_positive_V.value == pytest.approx(0.354, abs=0.005)
    believed = read_rig(made / "rig.toml")
    assert believed.servo.gain_rad_s_V == pytest.approx(rig.servo.gain_rad_s_V, rel=0.02)
    assert believed.camera.delay_s == bundle.timing.delay_s.value
    truth = rig.effects["coulomb_friction"]["x"]["friction_V"]
    found = believed.effects["coulomb_friction"]["x"]["friction_V"]
    assert found == pytest.approx(truth, abs=0.005)
    assert "gear_backlash" not in believed.effects


@pytest.mark.slow
def test_the_calibration_serves_a_run_through_frames(made: Path, tmp_path: Path):
    hold = read_protocol("hold").model_copy(update={"duration_s": 1.0})
    bundle = made / "calibration.json"
    done = run(RunRequest(load_rig(None), hold, "without", 1, tmp_path, bundle))
    assert done.ending.outcome == "completed"
    error = done.pairs[:, 3:] - done.pairs[:, 1:3]
    assert np.nanmax(np.abs(error)) < 5e-4
    assert not [e for e in read_run(done.folder).events if "moved camera" in e["text"]]


@pytest.mark.slow
def test_a_knock_is_said_in_the_run(made: Path, tmp_path: Path):
    """The bundle's plate lies 4 mm beside where the camera sees it now."""
    whole = json.loads((made / "calibration.json").read_text())
    whole["plate"]["camera_from_plate"][0][3] += 0.004
    moved = tmp_path / "moved.json"
    moved.write_text(json.dumps(whole))
    hold = read_protocol("hold").model_copy(update={"duration_s": 3.5})
    done = run(RunRequest(load_rig(None), hold, "without", 1, tmp_path, moved))
    said = [e["text"] for e in read_run(done.folder).events if "moved camera" in e["text"]]
    assert len(said) == 1
    assert "rig calibrate table" in said[0]


def test_pictures_from_a_folder(pictures: Path, tmp_path: Path, capsys):
    assert call("calibrate", "camera", pictures, "--out", tmp_path) == 0
    draft = load_draft(tmp_path / "calibration.json")
    assert draft.source == "measured"
    assert draft.lens is not None
    assert draft.lens.matrix[0][0] == pytest.approx(1086, abs=3)
    assert len(draft.sections["lens"].data) == 22
    assert "half sets" in capsys.readouterr().out
    # A simulated table's numbers do not join a measured camera's.
    assert call("calibrate", "servo", "--out", tmp_path) == 2
    assert "holds a measured calibration" in capsys.readouterr().err
    assert call("calibrate", "table", tmp_path / "none", "--out", tmp_path) == 2
    # A sheet that is held over the plate does not check its print's scale.
    assert call("calibrate", "table", pictures, "--out", tmp_path) == 0
    assert "scale was not checked" in capsys.readouterr().err


def test_a_video_gives_its_best_pictures(shots, tmp_path: Path):
    """Each pose is held for some frames and blurred on the way; one picture of each is taken."""
    frames = []
    for shot in shots:
        frames += [cv2.blur(shot, (9, 1)), shot, shot.copy(), shot.copy()]
    picker = pick((Frame(f, i / 30, i) for i, f in enumerate(frames)), Sheet(), most=40)
    assert len(picker.views) >= 18
    assert len(picker.views) <= len(shots)
    assert all(view.index % 4 == 1 for view in picker.views)
    assert len(picker.samples) < 24


@pytest.mark.slow
def test_a_video_file(shots, tmp_path: Path):
    path = tmp_path / "sheet.avi"
    fourcc = cv2.VideoWriter.fourcc(*"MJPG")
    film = cv2.VideoWriter(str(path), fourcc, 10, (640, 480))
    for shot in shots:
        film.write(shot)
    film.release()
    assert call("calibrate", "camera", path, "--out", tmp_path / "out") == 0
    lens = load_draft(tmp_path / "out" / "calibration.json").lens
    assert lens is not None
    assert lens.matrix[0][0] == pytest.approx(1086, abs=4)


def test_refusals_name_the_fault_and_write_nothing(pictures: Path, tmp_path: Path, capsys):
    for options, name in (
        (("--squares", "8x11"), "swapped board"),
        (("--dictionary", "DICT_4X4_50"), "wrong dictionary"),
        (("--square-mm", "27"), "wrong square size"),
    ):
        assert call("calibrate", "camera", pictures, "--out", tmp_path, *options) == 2
        message = capsys.readouterr().err
        assert message.startswith("rig: ")
        assert name in message
        assert message.count("\n") == 1
    assert not (tmp_path / "calibration.json").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("camera", "/no/such/folder"), "no such file"),
        (("camera", "--squares", "11"), "write columns x rows"),
        (("camera", "--dictionary", "DICT_NONE"), "no marker dictionary"),
        (("camera", "--distance-mm", "inf"), "--distance-mm inf: must be 50 to 20000"),
        (("camera", "--distance-mm", "nan"), "--distance-mm nan: must be 50 to 20000"),
        (("camera", "--distance-mm", "-750"), "--distance-mm -750: must be 50 to 20000"),
        (("camera", "--distance-mm", "0"), "--distance-mm 0: must be 50 to 20000"),
        (("camera", "--square-mm", "inf"), "than its squares (inf mm)"),
        (("table",), "no lens yet"),
        (("time",), "no lens yet"),
        (("time", "--video", "a.mp4"), "name the run, too"),
        (("time", "/no/such/run"), "no such run folder"),
        (("level", "/no/such/run"), "no such run folder"),
        (("sheet", "--paper", "a9"), "known papers"),
        (("servo", "--rig", "/no/such.toml"), "not found"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(arguments, message, tmp_path: Path, capsys):
    assert call("calibrate", *arguments, "--out", tmp_path) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


@pytest.mark.parametrize("step", ["camera", "table"])
def test_a_missing_source_is_told_before_a_folder_of_the_virtual_table(step, tmp_path, capsys):
    CalibrationFolder(tmp_path, "simulated", Rig()).keep("play", play=BacklashRecord(plays={}))
    assert call("calibrate", step, "nosuch.png", "--out", tmp_path) == 2
    assert capsys.readouterr().err.startswith("rig: nosuch.png: no such file or folder")


@pytest.mark.parametrize("step", ["camera", "table", "time", "level", "servo", "play"])
@pytest.mark.parametrize("takes", ["voltage", "position"])
def test_a_real_tables_numbers_are_never_the_virtual_ones(step, takes, tmp_path: Path, capsys):
    rig_file, out = tmp_path / "lab.toml", tmp_path / "out"
    rig_file.write_text(
        f'[table]\nkind = "quanser"\n[servo]\nkind = "{takes}"\nangle_measured = true\n'
    )
    assert call("calibrate", step, "--rig", rig_file, "--out", out) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert 'table.kind = "quanser": this would measure the virtual table, not yours' in error
    assert not out.exists()


def test_numbers_of_the_virtual_table_say_so(tmp_path: Path, capsys):
    assert call("calibrate", "level", "--out", tmp_path, "--seconds", "30") == 0
    assert "calibration.json (of the virtual table)   pictures" in capsys.readouterr().out


def test_level_and_time_from_a_recorded_run(tmp_path: Path):
    """A run on disk: what it was made from comes back."""
    steps = read_protocol("sine-sweep").model_copy(update={"duration_s": 25.0})
    rig = replace(load_rig(None), effects={"level_offset": {"x": {"slope_rad": 0.003}}})
    order = RunRequest(rig, steps, "without", 5, tmp_path / "runs")
    folder = keep_simulated(order, simulate_run(order))
    assert call("calibrate", "level", folder, "--out", tmp_path / "out") == 0
    assert call("calibrate", "time", folder, "--out", tmp_path / "out") == 0
    draft = load_draft(tmp_path / "out" / "calibration.json")
    assert draft.source == "simulated"
    assert draft.level is not None
    assert draft.timing is not None
    assert draft.level.slope_rad["x"].value == pytest.approx(0.003, abs=1.5e-4)
    delay = draft.timing.delay_s
    assert draft.timing.source == "ball"
    assert delay.low <= rig.camera.delay_s <= delay.high
    assert {file.name.split("/")[0] for file in draft.sections["level"].data} == {folder.name}


def test_sheets_are_written(tmp_path: Path):
    assert call("calibrate", "sheet", "--out", tmp_path) == 0
    written = {path.name for path in tmp_path.iterdir()}
    assert {"charuco.pdf", "plate.pdf", "fixed.pdf", "charuco.png", "plate-2.png"} <= written
    assert (tmp_path / "charuco.pdf").read_bytes().startswith(b"%PDF")


def test_help_is_instant():
    code = (
        "import sys\nsys.argv = ['rig', 'calibrate', 'camera', '--help']\n"
        "from experiments.cli import main\ntry:\n    main()\nexcept SystemExit:\n    pass\n"
        "heavy = {'cv2', 'numpy', 'numba', 'scipy', 'matplotlib'}\n"
        "print('HEAVY', sorted(heavy & set(sys.modules)))"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "HEAVY []" in out.stdout


@pytest.mark.slow
@pytest.mark.parametrize("seed", [31, 32])  # none of those that the interval was made from
def test_a_released_balls_delay_lies_in_its_interval_and_a_run_counts_once(
    tmp_path: Path, capsys, seed: int
):
    assert call("run", "free-release", "--arm", "without", "--seed", seed, "--out", tmp_path) == 0
    (run,) = (tmp_path / "runs").iterdir()
    assert call("calibrate", "time", run, "--out", tmp_path / "c") == 0
    timing = load_draft(tmp_path / "c" / "calibration.json").timing
    assert timing is not None
    assert timing.delay_s.low <= 0.012 <= timing.delay_s.high
    capsys.readouterr()
    assert call("calibrate", "level", run, run, "--out", tmp_path / "d") == 2
    assert "is named twice" in capsys.readouterr().err
