"""A calibration's folder that two programs write into at once."""

import os
import threading
from dataclasses import replace
from pathlib import Path

import pytest

from calibration.bundle import load_draft
from calibration.records import BacklashRecord, TimingRecord, Value
from experiments.calibrate.folder import FILE, LOCK_FILE, RIG_FILE, CalibrationFolder
from experiments.records.recording import lock
from experiments.runs.assemble import virtual_scene
from rig.parameters import Rig
from rig.rigfile import read_rig
from tests.support.exact_bundle import exact_bundle
from vision.synthetic.synthetic import virtual_view

TIMING = TimingRecord(
    delay_s=Value.around(0.01, 0.001), play_rad={"x": 0.0, "y": 0.0}, frames=9, source="markers"
)
PLAY = BacklashRecord(plays={}, not_seen={"gear": "no strike"})


def quicker(rig: Rig) -> Rig:
    return replace(rig, servo=replace(rig.servo, gain_rad_s_V=2.0))


def later(rig: Rig) -> Rig:
    return replace(rig, camera=replace(rig.camera, delay_s=0.02))


def test_what_is_another_in_the_rig_file_is_said(tmp_path: Path, capsys):
    CalibrationFolder(tmp_path, "simulated", Rig()).believe(None, quicker)
    assert capsys.readouterr().out.endswith("\nchanged: servo.gain_rad_s_V = 2 (was 1.735)\n")


def test_what_two_programs_measure_at_once_is_kept_of_both(tmp_path: Path):
    one, other = (CalibrationFolder(tmp_path, "simulated", Rig()) for _ in range(2))
    one.keep("timing", timing=TIMING)
    one.believe(None, later)
    other.keep("play", play=PLAY)
    other.believe(None, quicker)
    draft, rig = load_draft(tmp_path / FILE), read_rig(tmp_path / RIG_FILE)
    assert (draft.timing, draft.play, set(draft.sections)) == (TIMING, PLAY, {"timing", "play"})
    assert (rig.camera.delay_s, rig.servo.gain_rad_s_V) == (0.02, 2.0)


def test_a_measured_and_a_simulated_calibration_begun_at_once_do_not_mix(tmp_path: Path):
    one = CalibrationFolder(tmp_path, "simulated", Rig())
    other = CalibrationFolder(tmp_path, "measured", Rig())
    one.keep("timing", timing=TIMING)
    with pytest.raises(ValueError, match="holds a simulated calibration, this one is measured"):
        other.keep("play", play=PLAY)
    assert load_draft(tmp_path / FILE).play is None


def test_what_was_seen_through_another_lens_is_not_kept(tmp_path: Path):
    """It stood beside a lens that another program measured meanwhile, and did not fit it."""
    exact = exact_bundle(virtual_view(), virtual_scene(Rig()))
    other_lens = exact.lens.model_copy(update={"rms_px": 0.1})
    one, other = (CalibrationFolder(tmp_path, "simulated", Rig()) for _ in range(2))
    one.keep("lens", lens=exact.lens, plate=None)
    with pytest.raises(ValueError, match=r"has another lens now, .* measure it again"):
        other.keep("plate", plate=exact.plate)
    assert load_draft(tmp_path / FILE).plate is None
    one.keep("plate", plate=exact.plate)
    third = CalibrationFolder(tmp_path, "simulated", Rig())
    one.keep("lens", lens=other_lens, plate=None)
    with pytest.raises(ValueError, match="has another lens now"):
        third.keep("timing", timing=TIMING)
    assert load_draft(tmp_path / FILE).timing is None


@pytest.mark.skipif(os.name == "nt", reason="locks of POSIX")
def test_a_program_that_writes_is_waited_for(tmp_path: Path):
    folder = CalibrationFolder(tmp_path, "simulated", Rig())
    with (tmp_path / LOCK_FILE).open("a") as held:
        assert lock(held.fileno())
        keeps = threading.Thread(target=lambda: folder.keep("timing", timing=TIMING))
        keeps.start()
        keeps.join(0.3)
        assert not (tmp_path / FILE).exists()
    keeps.join(20.0)
    assert load_draft(tmp_path / FILE).timing == TIMING


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes of POSIX")
def test_a_pipe_or_a_link_in_the_place_of_the_lock_is_removed(tmp_path: Path):
    """A folder may be somebody else's: a pipe was waited for, a link's target was made."""
    for i in range(2):
        where, elsewhere = tmp_path / f"{i}", tmp_path / "elsewhere"
        folder = CalibrationFolder(where, "simulated", Rig())
        where.mkdir(exist_ok=True)
        if i:
            os.mkfifo(where / LOCK_FILE)
        else:
            (where / LOCK_FILE).symlink_to(elsewhere)
        folder.keep("timing", timing=TIMING)
        assert load_draft(where / FILE).timing == TIMING
        assert not elsewhere.exists()
