"""The FMU as an importer sees it: valid, the simulator's own bits, parameters, errors."""

import importlib
import json
import subprocess
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from experiments.export.export_model import export_model
from experiments.export.intervals import read_intervals
from experiments.runs.assemble import load_rig
from rig.discrepancy import Discrepancy
from rig.parameters import Rig, Walls
from tests.support.exported_models import MORE, MOST, course, in_fmi, ours, with_effects
from tests.support.parts import need

need("cc", "fmpy")
fmpy: Any = importlib.import_module("fmpy")
validation: Any = importlib.import_module("fmpy.validation")
START = (0.01, -0.02)
DEFAULT = load_rig(Path("default"))
UNNAMED = Discrepancy(
    ball_map_x=(0.02, -0.01, *(0.005,) * 14),
    ball_speed_y=(0.01, 0.02, 0.0, 0.01),
    ball_rhythm_x=(0.05, 0.02),
    ball_rhythm_hz=1.3,
    servo_map_x=(0.1, 0.0, 0.05, 0.0),
    servo_segment=(0.1, 0.1),
    servo_segment_s=(0.1, 0.3),
)
EVERYTHING = replace(
    with_effects(DEFAULT, MOST, MORE), unknown=UNNAMED, walls=Walls(present=True, restitution=0.2)
)


@pytest.mark.parametrize(
    "rig",
    [
        pytest.param(DEFAULT, id="default", marks=pytest.mark.slow),
        pytest.param(EVERYTHING, id="everything"),
        pytest.param(load_rig(Path("hobby-two-servos")), id="two rods", marks=pytest.mark.slow),
        pytest.param(load_rig(Path("three-arms")), id="three arms", marks=pytest.mark.slow),
    ],
)
def test_an_importer_gets_the_bits_of_our_simulator(rig: Rig, tmp_path: Path):
    driven = course(rig, 1.0)
    own, found = ours(rig, driven, START), in_fmi(rig, driven, tmp_path, START)
    assert np.ptp(own.ball[:, 0]) > 1e-3  # it moves
    for part in ("arms", "sines", "ball"):
        assert np.array_equal(getattr(own, part), getattr(found, part)), part
    assert validation.validate_fmu(str(tmp_path / "table.fmu")) == []


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("fmu") / "default.fmu"
    export_model(DEFAULT, "default", "fmu", out)
    return out


def test_a_parameter_that_is_set_is_the_rig_files(made: Path, tmp_path: Path):
    effects = DEFAULT.effects | {"joint_backlash": {"x": {"play_rad": 0.04}}}
    servo = replace(DEFAULT.servo, gain_rad_s_V=1.6)
    other = replace(DEFAULT, servo=servo, effects=effects)
    driven = course(DEFAULT, 0.6)
    own = ours(other, driven)
    set_to = {
        "servo.gain_rad_s_V": 1.6,
        "effects.joint_backlash.x.play_rad": 0.04,
        "effects.joint_backlash.y.play_rad": 0.0,
    }
    rows = [(k * 0.002, *told, 0.0, 0.0, False) for k, told in enumerate(driven)]
    names = ["time", "voltage_x_V", "voltage_y_V", "push_x_m_s2", "push_y_m_s2"]
    signal = np.array(rows, dtype=[*((n, float) for n in names), ("held", bool)])
    found = fmpy.simulate_fmu(
        str(made), stop_time=0.6, step_size=0.002, output_interval=0.002, input=signal,
        start_values=set_to, output=["ball_x_m", "ball_y_m"],
    )  # fmt: skip
    ball = np.column_stack([found["ball_x_m"], found["ball_y_m"]])[1:]
    assert np.array_equal(ball, own.ball)


def test_its_c_agrees_with_the_standards_own_headers(made: Path, tmp_path: Path):
    headers = Path(fmpy.__file__).parent / "c-code"
    with zipfile.ZipFile(made) as archive:
        archive.extract("sources/balancing_table.c", tmp_path)
    strict = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-fsyntax-only"]
    command = ["cc", *strict, "-include", str(headers / "fmi3Functions.h")]
    source = str(tmp_path / "sources/balancing_table.c")
    done = subprocess.run([*command, source], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[:500]


def opened(made: Path, tmp_path: Path) -> tuple[Any, dict[str, int]]:
    """An initialized instance, and its value references by name."""
    fmi3: Any = importlib.import_module("fmpy.fmi3")
    described = fmpy.read_model_description(str(made))
    folder = fmpy.extract(str(made), str(tmp_path))
    places = {v.name: v.valueReference for v in described.modelVariables}
    table = fmi3.FMU3Slave(
        guid=described.guid, unzipDirectory=folder, modelIdentifier="balancing_table"
    )
    table.instantiate()
    table.enterInitializationMode()
    table.exitInitializationMode()
    return table, places


def test_a_state_that_is_kept_is_returned_to(made: Path, tmp_path: Path):
    table, places = opened(made, tmp_path)
    table.setFloat64([places["voltage_x_V"]], [3.0])
    table.doStep(0.0, 0.02)
    kept = table.getFMUState()
    table.doStep(0.02, 0.02)
    theta = table.getFloat64([places["theta_x_rad"]])
    table.setFMUState(table.deserializeFMUState(table.serializeFMUState(kept)))
    table.doStep(0.02, 0.02)
    assert table.getFloat64([places["theta_x_rad"]]) == theta
    assert theta[0] > 0.01
    with pytest.raises(Exception, match="DoStep"):
        table.doStep(0.04, 0.0033)  # no multiple of the tick
    with pytest.raises(Exception, match="SetFloat64"):
        table.setFloat64([places["servo.gain_rad_s_V"]], [1.0])  # too late
    table.terminate()
    table.freeInstance()


@pytest.mark.parametrize("delay_s", [0.5, -0.01, float("inf")])
def test_a_delay_that_the_model_does_not_remember_is_refused(made: Path, delay_s: float):
    with pytest.raises(Exception, match="ExitInitializationMode"):
        fmpy.simulate_fmu(
            str(made), stop_time=0.01, step_size=0.002, output_interval=0.002,
            start_values={"effects.input_delay.x.delay_s": delay_s},
        )  # fmt: skip


@pytest.mark.parametrize("step_s", [1e18, 1e300, float("inf"), -0.002])
def test_a_step_without_an_end_is_refused(made: Path, tmp_path: Path, step_s: float):
    table, _ = opened(made, tmp_path)
    with pytest.raises(Exception, match="DoStep"):
        table.doStep(0.0, step_s)
    table.terminate()
    table.freeInstance()


def answer(low: float | None, value: float, high: float | None) -> dict:
    play = {"play_rad": {"value": value, "low": low, "high": high}}
    gain = {"value": 1.73, "low": 1.72, "high": 1.74}
    return {
        "effects": [{"name": "joint_backlash", "parameters": {"x": play, "y": {}}}],
        "calibrated": {"gain_x_rad_s_V": gain, "gain_y_rad_s_V": gain | {"high": 1.75}},
    }


def test_the_intervals_of_an_answer_are_least_and_greatest_values(tmp_path: Path):
    (tmp_path / "gap.json").write_text(json.dumps(answer(0.025, 0.02618, 0.027)))
    out = tmp_path / "t.fmu"
    export_model(DEFAULT, "t", "fmu", out, intervals=tmp_path / "gap.json")
    found = {v.name: v for v in fmpy.read_model_description(str(out)).modelVariables}
    play = found["effects.joint_backlash.x.play_rad"]
    assert (float(play.min), float(play.start), float(play.max)) == (0.025, 0.02618, 0.027)
    assert (float(found["servo.gain_rad_s_V"].max), found["servo.gain_rad_s_V"].unit) == (
        1.75,
        "rad/(s.V)",
    )
    assert found["effects.joint_backlash.y.play_rad"].min is None
    (tmp_path / "gap.json").write_text(json.dumps(answer(None, 0.026, 0.027)))
    intervals, told = read_intervals(tmp_path / "gap.json", DEFAULT)
    assert "effects.joint_backlash.x.play_rad" not in intervals
    assert any("joint_backlash.x.play_rad is open" in line for line in told)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (json.dumps(answer(0.03, 0.035, 0.04)), "outside its interval 0.03 to 0.04"),
        ("[1]", "not what `rig gap LOG... --json FILE` writes"),
        ("{", r"not a JSON file \(Expecting"),
        ("[" * 100_000, r"not a JSON file \(its brackets are too deep"),
        (
            json.dumps(answer(0.01, 0.02, 10**400)),
            r"not a JSON file \(a number has too many digits",
        ),
        (
            json.dumps(answer(0.01, 0.02, 0.03)).replace("joint_", r"\ud800"),
            r"not a JSON file \(.* no Unicode",
        ),
        (
            json.dumps(answer(0.01, 0.02, 0.03)).replace("1.72", '"1.72 V"'),
            r"not what .*\(a part is of another kind",
        ),
    ],
)
def test_intervals_that_do_not_fit_are_one_line(text: str, said: str, tmp_path: Path):
    file = tmp_path / "gap.json"
    file.write_text(text)
    with pytest.raises(ValueError, match=said) as error:
        export_model(DEFAULT, "t", "fmu", tmp_path / "t.fmu", intervals=file)
    assert "\n" not in str(error.value)


def test_names_from_elsewhere_leave_the_description_xml(tmp_path: Path):
    """The rig file's name and the answer's own names are whatever somebody gave them."""
    (tmp_path / "gap.json").write_text(
        json.dumps(answer(0.02, 0.026, 0.03)).replace("joint_", r"\u0001\u001b]0;\n<x y=\"")
    )
    out = tmp_path / "t.fmu"
    name = 'a"><b>--\x01\n\ud800\ufffe'
    told = export_model(DEFAULT, name, "fmu", out, intervals=tmp_path / "gap.json")
    found = fmpy.read_model_description(str(out))
    assert found.modelName == 'a"><b>--? ??'
    assert 'effects.??]0; <x y="backlash' in found.description
    assert all(line.isprintable() for line in told)


def test_without_a_compiler_there_is_one_clear_line(tmp_path: Path, monkeypatch):
    monkeypatch.setenv("CC", "no-such-compiler")
    with pytest.raises(ValueError, match=r"needs a C compiler .* not found"):
        export_model(DEFAULT, "t", "fmu", tmp_path / "t.fmu")


def test_what_is_not_in_it_is_said_in_the_file_and_aloud(tmp_path: Path):
    effects = {"camera_scale": {"xy": {"fraction": 0.01}}}
    told = export_model(replace(DEFAULT, effects=effects), "t", "fmu", tmp_path / "t.fmu")
    assert any("camera_scale" in line for line in told)
    said = fmpy.read_model_description(str(tmp_path / "t.fmu")).description
    assert all(line in said for line in told)
