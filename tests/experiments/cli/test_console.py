"""Progress where nobody draws bars: a log that grows tells that the work goes on."""

from experiments.cli import console


def test_a_stage_is_told_as_it_begins_and_ends_and_now_and_then(capsys, monkeypatch):
    now_s = [100.0]
    monkeypatch.setattr(console.time, "monotonic", lambda: now_s[0])
    with console.bars() as progress:
        for done in range(7):
            progress("baseline: fitting", done, 6)
            now_s[0] += 10.0
        progress("report", 0, 2)
        progress("report", 2, 2)
        progress("report", 2, 2)
    told = capsys.readouterr().err.splitlines()
    assert told == [
        "baseline: fitting: 0 of 6",
        "baseline: fitting: 3 of 6",
        "baseline: fitting: 6 of 6",
        "report: 0 of 2",
        "report: 2 of 2",
    ]


def test_what_has_to_be_compiled_first_is_said_once(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    console.tell_of_compiling()
    assert "compiling" in capsys.readouterr().err
    kept = tmp_path / "detection_0123" / "outline.trace_rays-1.py311.nbi"
    kept.parent.mkdir()
    kept.touch()
    console.tell_of_compiling()
    assert capsys.readouterr() == ("", "")


def test_a_stages_name_moves_no_cursor(capsys):
    """A protocol of somebody else's names it."""
    with console.bars() as show:
        show("run \x1b[2Jmine\x07", 0, 1)
    assert capsys.readouterr().err == "run ?[2Jmine?: 0 of 1\n"
