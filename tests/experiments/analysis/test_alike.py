"""Which runs may be compared: those that differ in nothing but the controller."""

import json
from dataclasses import replace
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from experiments.analysis.alike import difference, difference_words, groups
from experiments.records.made_with import entries
from experiments.records.run_folder import plain
from experiments.runs.assemble import load_rig
from rig.parameters import Gains, Rig
from rig.rigfile import to_record

RIG = load_rig(None)


def made(folder: Path, rig: Rig = RIG, *, truth: Rig | None = None, **more) -> dict:
    """Entries of a run of this rig; truth: the plant's, of a simulated run."""
    if truth is not None:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "truth.json").write_text(json.dumps({"rig": plain(to_record(truth))}), "utf-8")
    source = "measured" if truth is None else "simulated"
    protocol = {"name": "hold", "title": "words", "seed": 1, "duration_s": 60.0}
    meta = {"source": source, "rig": plain(to_record(rig)), "protocol": protocol} | more
    return entries(folder, meta)


def test_words_and_seed_of_a_protocol_make_no_difference(tmp_path: Path):
    one = made(tmp_path)
    other = made(tmp_path, protocol={"name": "hold", "title": "other", "seed": 7})
    assert difference(one, other) == []
    longer = made(tmp_path, protocol={"name": "hold", "duration_s": 90.0})
    assert difference(one, longer) == ["protocol.duration_s (60, 90)"]


def test_tables_of_two_kinds_differ_and_the_first_entries_are_told(tmp_path: Path):
    words = difference_words(made(tmp_path), made(tmp_path, load_rig(Path("bus-servos"))))
    assert words.startswith("servo.kind (voltage, position), ")
    assert words.endswith(" more")
    assert groups([made(tmp_path), made(tmp_path, load_rig(Path("bus-servos")))]) == [0, 1]


@given(share=st.floats(-0.5, 0.5))
def test_a_measured_table_may_be_calibrated_anew(share: float):
    gain = RIG.servo.gain_rad_s_V * (1.0 + share)
    anew = replace(RIG, servo=replace(RIG.servo, gain_rad_s_V=gain))
    same = not difference(made(Path("none")), made(Path("none"), anew))
    assert same == (abs(share) <= 0.1 * max(1.0, 1.0 + share))


def test_other_gains_are_another_controller(tmp_path: Path):
    softer = replace(RIG, gains=Gains(proportional_rad_m=3.4))
    assert difference(made(tmp_path), made(tmp_path, softer)) != []


def test_a_simulated_table_is_compared_by_its_own_numbers(tmp_path: Path):
    """The controller knows nothing of the play: run.json is the same with any."""
    loose = {"joint_backlash": {"x": {"play_rad": 0.05}}}
    one = made(tmp_path / "a", truth=replace(RIG, effects={}))
    other = made(tmp_path / "b", truth=replace(RIG, effects=loose))
    assert difference(one, other) == ["effects.joint_backlash.x.play_rad (none, 0.05)"]
    assert difference(other, one) == ["effects.joint_backlash.x.play_rad (0.05, none)"]
    slower = replace(RIG, gains=Gains(proportional_rad_m=2.0))
    assert difference(one, made(tmp_path / "a", slower, truth=replace(RIG, effects={})))


def test_what_a_record_of_another_version_does_not_say_is_not_compared(tmp_path: Path):
    rig = {"ball": {"mass_kg": RIG.ball.mass_kg}}
    old = entries(tmp_path, {"source": "measured", "protocol": "hold", "rig": rig})
    assert difference(old, made(tmp_path)) == []
