"""The file of a lab's own effect: read beside the rig file, held against itself, kept as text."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from rig import foreign_call, own_effects
from rig.own_effects import read_effect
from rig.parameters import Rig, Servo
from rig.rigfile import from_dict, own_names, read_rig, to_record, write_rig
from tests.support.gap.own_effects import EXAMPLES, example, written

GOOD = (EXAMPLES / "hanging_arm.py").read_text(encoding="utf-8")


@pytest.fixture(name="lab")
def fixture_lab(tmp_path: Path) -> Path:
    """A folder with the file of an effect, mine.py."""
    (tmp_path / "mine.py").write_text(GOOD)
    return tmp_path


def rig_of(folder: Path, text: str) -> Rig:
    (folder / "rig.toml").write_text(text)
    return read_rig(folder / "rig.toml")


@pytest.mark.parametrize(
    "text",
    [
        '[effects]\nown = "mine.py"\n[effects.hanging_arm]\nx.weight_V = 0.3\n',
        '[effects]\nown = ["mine.py"]\nhanging_arm.x.weight_V = 0.3\n',
    ],
)
def test_a_rig_file_names_the_file_and_sets_the_effect(lab: Path, text: str):
    rig = rig_of(lab, text)
    assert rig.effects == {"hanging_arm": {"x": {"weight_V": 0.3}}}
    assert list(rig.catalogue)[-1] == "hanging_arm"
    assert rig.own[0].file == str(lab / "mine.py")


def test_where_no_effect_is_set_the_file_stands_alone(lab: Path):
    rig = rig_of(lab, 'effects = "mine.py"\n')
    assert rig.effects == {}
    assert [one.effect.name for one in rig.own] == ["hanging_arm"]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("x.weight_V = 61.0", "no table is like that"),
        ("x.weight = 0.1", "has no key 'weight'"),
        ("xy.weight_V = 0.1", "has no axis 'xy'"),
        ("weight_V = 0.1", r"write it as \[effects.hanging_arm\] x.weight_V"),
    ],
)
def test_its_values_are_checked_as_those_of_the_catalogue(lab: Path, text: str, says: str):
    with pytest.raises(ValueError, match=says) as error:
        rig_of(lab, f'[effects]\nown = "mine.py"\n[effects.hanging_arm]\n{text}\n')
    assert "\n" not in str(error.value)


def test_a_written_rig_is_read_again(lab: Path, tmp_path: Path):
    rig = rig_of(lab, '[effects]\nown = "mine.py"\nhanging_arm.y.angle_rad = 0.2\n')
    (tmp_path / "elsewhere").mkdir()
    write_rig(rig, tmp_path / "elsewhere" / "rig.toml")
    assert read_rig(tmp_path / "elsewhere" / "rig.toml") == rig


def test_a_recording_keeps_the_text_and_runs_none_of_it(lab: Path):
    rig = rig_of(lab, '[effects]\nown = "mine.py"\nhanging_arm.y.weight_V = 0.2\n')
    record = json.loads(json.dumps(to_record(rig)))
    assert record["own_effects"] == [{"name": "hanging_arm", "file": "mine.py", "text": GOOD}]
    (lab / "trace").unlink(missing_ok=True)
    record["own_effects"][0]["text"] = f"open({str(lab / 'trace')!r}, 'w')"
    again = from_dict(record)
    assert own_names(record) == {"hanging_arm": "mine.py"}
    assert (again.own, again.effects) == ((), {})
    assert not (lab / "trace").exists()
    assert "own_effects" not in to_record(Rig())


def test_servos_that_take_an_angle_have_no_effect_of_volts(lab: Path):
    servo = Servo(kind="position")
    rig = Rig(servo=servo, own=(example("hanging_arm"),))
    assert "hanging_arm" in rig.catalogue
    with pytest.raises(ValueError, match="is not one of position servos"):
        replace(rig, effects={"hanging_arm": {"x": {"weight_V": 0.1}}})


BAD = {
    "no entry": (GOOD.replace("EFFECT =", "OTHER ="), "it has no EFFECT = Effect"),
    "no equation": (GOOD.replace("def equation", "def other"), "it has no function equation"),
    "too few arguments": (
        GOOD.replace(", angle_rad):", "):").replace(" + angle_rad", ""),
        r"its keys ask for equation\(angle_rad, speed_rad_s, t_s, weight_V, angle_rad\)",
    ),
    "arguments in another order": (
        GOOD.replace("weight_V, angle_rad):", "angle_rad, weight_V):"),
        "its keys ask for",
    ),
    "a name of the catalogue": (
        GOOD.replace('"hanging_arm"', '"cogging"'),
        "'cogging' is a name of the catalogue",
    ),
    "no name": (GOOD.replace('"hanging_arm"', '"Hanging arm"'), "write it in small letters"),
    "no side": (GOOD.replace('"servo"', '"camera"'), "must be 'servo'"),
    "no tolerance": (GOOD.replace("0.02,", "0.0,"), "tolerance = 0.0: must lie above 0"),
    "no range": (GOOD.replace("-2.0, 2.0", "2.0, -2.0"), "low <= null <= high"),
    "raises": (
        GOOD.replace("    return", "    if theta_rad > 0.5:\n        raise ValueError\n    return"),
        "raises ValueError",
    ),
    "NaN": (GOOD.replace("sin(", "0.0 / (0.0 * "), "must give a finite number"),
    "no null": (GOOD.replace("-weight_V *", "1.0 + weight_V *"), "its null value, it must give 0"),
    "not compilable": (
        GOOD.replace("sin(theta", "pull(theta") + "\n\ndef pull(angle):\n    return sin(angle)\n",
        "cannot be compiled by numba: .*pull",
    ),
    "no Python": (GOOD + "\nif", "SyntaxError"),
    "fails": (GOOD + "\n1 / 0", "ZeroDivisionError"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_file_that_is_no_good_is_one_clear_line(tmp_path: Path, case: str):
    text, says = BAD[case]
    (tmp_path / "mine.py").write_text(text)
    (tmp_path / "rig.toml").write_text('effects = "mine.py"\n')
    with pytest.raises(ValueError, match=says) as error:
        read_rig(tmp_path / "rig.toml")
    said = str(error.value)
    assert said.startswith(f"{tmp_path / 'rig.toml'}: effect file {tmp_path / 'mine.py'}: ")
    assert "\n" not in said


def test_missing_files_and_wrong_keys_are_one_clear_line(lab: Path):
    with pytest.raises(ValueError, match="cannot be read: No such file"):
        rig_of(lab, 'effects = "other.py"\n')
    with pytest.raises(ValueError, match=r"effects.own = 5: write \[effects\] own = "):
        rig_of(lab, "[effects]\nown = 5\n")
    with pytest.raises(ValueError, match="'hanging_arm' is there already"):
        rig_of(lab, 'effects = ["mine.py", "mine.py"]\n')
    files = [written(lab, f"one{i}", "size_V * u").name for i in range(5)]
    with pytest.raises(ValueError, match="5 effects of one's own: a rig takes at most 4"):
        rig_of(lab, f"effects = {json.dumps(files)}\n")


def test_another_process_finds_the_effect_without_the_file(tmp_path: Path):
    import pickle

    file = written(tmp_path, "gone", "size_V * u")
    sent = pickle.dumps(Rig(own=(read_effect(file),)))
    file.unlink()
    again = pickle.loads(sent)
    assert again.catalogue["gone"].parameters[0].key == "size_V"
    assert str(again.own[0].address).encode() not in sent


HANGS = GOOD.replace("return -weight_V", "while t_s > 99.0:\n        pass\n    return -weight_V")
SPINS = GOOD.replace(
    "EFFECT =",
    """import numba


@numba.njit
def spin(t):
    while t > 99.0:
        t += 1.0
    return t


EFFECT =""",
).replace("return -weight_V", "return -spin(t_s) * 0.0 - weight_V")
HOARDS = f"{GOOD}\nkept = [bytearray(1 << 24) for _ in range(1 << 20)]\n"


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (f"{GOOD}\nwhile True:\n    pass\n", "it did not return within 0.5 s"),
        (HANGS, r"equation.*100.0, .* did not return within 0.5 s"),
        (HOARDS, "MemoryError"),
        (f"{GOOD}\nimport sys\nsys.exit(0)\n", "SystemExit: 0"),
        (SPINS, r"compiled, equation did not return within 0.7 s"),
        (f"{SPINS}\nspin(100.0)\n", r"executed, it did not return within 0.7 s"),
        (f"{GOOD}\nimport os\nos._exit(0)\n", r"executed, it left the program \(exit code 0\)"),
        (f"{GOOD}\nimport os\nos.abort()\n", r"executed, it crashed the program \(signal 6\)"),
    ],
    ids=[
        "hangs",
        "equation hangs",
        "hoards",
        "leaves",
        "compiled helper hangs",
        "compiled helper hangs at once",
        "leaves at once",
        "crashes",
    ],
)
def test_a_file_that_hangs_hoards_or_leaves_is_one_line(lab: Path, monkeypatch, text, says):
    read_effect(lab / "mine.py")  # what it imports is there: that takes longer than half a second
    if "MemoryError" in says:
        monkeypatch.setattr(foreign_call, "MEMORY_SHARE", 0.01)
    else:
        monkeypatch.setattr(own_effects, "LONGEST_S", 0.5)
        monkeypatch.setattr(own_effects, "GRACE_S", 0.2)
    (lab / "mine.py").write_text(text)
    with pytest.raises(ValueError, match=says) as error:
        read_effect(lab / "mine.py")
    assert "mine.py" in str(error.value)
    assert "\n" not in str(error.value)


def test_what_a_file_prints_is_not_the_programs_answer(lab: Path, capsys):
    (lab / "mine.py").write_text(f"print('read')\n{GOOD}")
    read_effect(lab / "mine.py")
    told = capsys.readouterr()
    assert (told.out, told.err) == ("", "read\n")


def test_what_is_no_file_or_too_large_is_not_read(lab: Path):
    (lab / "folder.py").mkdir()
    (lab / "zero.py").symlink_to("/dev/zero")
    (lab / "large.py").write_bytes(b"#" * (own_effects.LARGEST_BYTES + 1))
    for name, says in (("folder", "is no file"), ("zero", "is no file"), ("large", "is larger")):
        with pytest.raises(ValueError, match=rf"{name}.py {says}"):
            read_effect(lab / f"{name}.py")
