"""Names of run folders are times, and a clock that cannot be right is told."""

from datetime import UTC, datetime, timedelta

from experiments.records.run_folder import clock_note, new_run_folder


def test_a_clock_that_was_set_back_is_told(tmp_path):
    """By it the newest run was the oldest, to `rig watch`, say, without a word."""
    now = datetime(2026, 11, 29, 12, 0, 0, tzinfo=UTC)
    assert clock_note(tmp_path / "runs", now) == ""
    for minutes in (-5, 0, 1):
        new_run_folder(tmp_path, "hold", "with", now + timedelta(minutes=minutes))
    (tmp_path / "99990101-notes").mkdir()
    (tmp_path / "29990101T000000-hold-with.txt").write_text("no run")
    assert clock_note(tmp_path, now) == ""
    later = new_run_folder(tmp_path, "hold", "with", now + timedelta(minutes=2))
    assert later.name in clock_note(tmp_path, now)
    assert "is this computer's clock right?" in clock_note(tmp_path, now)
