"""The report tells people what was found, in their units, and says what was not done."""

import html
import re
import tomllib
from dataclasses import replace
from itertools import pairwise
from math import inf, nan
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.text import Text

from calibration.gap.decision_rule import MAX_EFFECTS
from calibration.gap.findings import (
    ClosedLoopRow,
    Findings,
    Gap,
    Interval,
    Named,
    PlateMap,
    Profile,
    ProofRow,
    RankedEffect,
    Step,
)
from calibration.gap.report.units import interval_words, key_words, parameter_unit, sig
from experiments.gap import figures
from experiments.gap.report import NOISES, write_findings, write_gap_report
from experiments.gap.short_answer import details
from experiments.gap.stages import name_stage
from experiments.gap.summary import summary_lines
from experiments.gap.when import when_words
from experiments.gap.words import (
    added_toml,
    closed_loop_words,
    closed_share,
    farther_note,
    floors,
    percent,
    smallest_words,
    spoken,
)
from experiments.reports.units import unbroken
from rig.effects import CATALOGUE
from rig.parameters import CHANNELS, Rig
from rig.prediction.innovations import NOISE
from rig.rigfile import from_dict, read_rig, refuse_own
from tests.support.gap.findings import (
    ALL,
    RANKING,
    around,
    named,
    no_motion,
    nothing,
    rivals,
    unknown,
)


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    """Every kind of findings as text of its page, and its folder."""
    found = {}
    for name, make in ALL.items():
        folder = tmp_path_factory.mktemp(name)
        path = write_gap_report(make(), folder, names=["a <log>.csv", "20261120-steps-with"])
        assert path == folder / "gap.html"
        found[name] = path.read_text(encoding="utf-8"), folder
    return found


def of_bursts(*gaps: float, axis: str = "ball_x") -> Findings:
    """Findings of a log of 40 s whose gap is 1 but in its first seconds, a second each."""
    gap = np.ones(40)
    gap[: len(gaps)] = gaps
    time = Profile(axis, "time", "s", np.arange(41.0), gap, np.full(40, 60))
    return replace(unknown(), profiles=(time,))


def test_a_hand_at_the_ball_is_told_by_when_and_what_to_do(tmp_path: Path):
    hand = of_bursts(1.0, 5.0, 4.0)
    said = (
        "Most of the ball's error lies in 1.0 to 2.0 s of 40 (a hand?): leave it out with --from 2."
    )
    lines = summary_lines(hand, recorded_here=False, logs=1)
    assert lines[1] == f"  when       {said}"
    page = write_gap_report(hand, tmp_path, names=["run.csv"], recorded_here=False)
    assert "lies in 1.0 to 2.0 s of 40 (a hand?): leave it out with --from 2." in html.unescape(
        words(page.read_text(encoding="utf-8"))
    ).replace("\u00a0", " ")
    assert "was the table touched then" in details(hand, logs=1)[0]
    late = of_bursts(*np.ones(30), 5.0)
    assert "cut it out of the log" in "".join(summary_lines(late, recorded_here=False, logs=1))


@pytest.mark.parametrize(
    ("found", "logs"),
    [
        (of_bursts(5.0), 2),  # whose times are not one
        (of_bursts(*np.tile((4.0, 1.0), 20)), 1),  # all along
        (of_bursts(1.2), 1),  # hardly an error
        (of_bursts(5.0, axis="servo_x"), 1),  # no hand's
        (nothing(), 1),
    ],
)
def test_errors_that_come_all_along_are_not_told_by_when(found: Findings, logs: int):
    assert when_words(found, logs=logs, files=True) == ""


def test_the_page_names_the_rig_file_or_says_that_none_was_given(tmp_path, pages):
    path = write_gap_report(named(), tmp_path, names=["log.csv"], rig_file=Path("lab/<my>.toml"))
    assert "Rig file: lab/&lt;my&gt;.toml." in path.read_text(encoding="utf-8")
    assert all("Rig file: none was given" in page for page, _ in pages.values())


def test_a_page_that_stands_alone_says_whose_table_it_is_of(tmp_path, pages):
    assert all("results.json" not in words(page) for page, _ in pages.values())
    told = {"origin": "demo, virtual rig", "remark": "Hidden: joint play x 2.01 deg."}
    path = write_gap_report(named(), tmp_path, names=["log"], **told)
    text = words(path.read_text(encoding="utf-8"))
    assert "demo, virtual rig" in text
    assert "Hidden: joint play x 2.01 deg." in text


def test_every_noise_has_its_words_and_a_unit_that_people_read(pages):
    assert set(NOISES) == set(NOISE.names or ())
    page = next(page for page, _ in pages.values() if "noise, as estimated" in page)
    rows = re.findall(r"<tr[^>]*><td[^>]*>(.*?)</td><td[^>]*>(.*?)</td><td[^>]*>(.*?)</td>", page)
    found = {tuple(re.sub(r"<[^>]+>", "", html.unescape(cell)) for cell in row) for row in rows}
    assert ("ball's place as seen", "0.310", "mm") in found
    assert ("servo's speed, random walk", "11.5", "deg/s per root of a second") in found


def words(page):
    """The page without pictures and tags, on one line."""
    page = re.sub(r'src="data:[^"]*"', "", page.split("</style>")[1])
    return " ".join(re.sub(r"<[^>]+>", " ", page).split())


@pytest.mark.parametrize("name", ALL)
def test_a_page_is_whole_and_self_contained(pages, name):
    page, folder = pages[name]
    pictures = sorted(folder.glob("*.png"))
    assert page.count('src="data:image/png;base64,') == len(pictures)
    assert page.count("src=") == len(pictures)
    assert "<script" not in page
    assert "http" not in page
    assert "a &lt;log&gt;.csv" in page
    assert not re.search(r"\bnan\b|\binf\b|None", words(page))
    for title in ("Locate", "Name", "Add", "Prove", "Next"):
        assert re.search(rf"<h2[^>]*><span class=\"n\">\d</span>{title}</h2>", page)
    assert unbroken(spoken(ALL[name]().sentence)) in page
    assert all(path.stat().st_size > 8000 for path in pictures)


def test_a_named_effect_is_told_in_degrees_and_millimetres(pages):
    text = words(pages["named"][0])
    assert "joint play x play 2.01 [1.93, 2.09] deg 0.08 deg 0 to 5.73 deg" in text
    assert "ball x 7.90 2.53 mm 0.320 mm" in text
    assert "ball x 7.90 1.04 99 %" in text
    assert "servo x 1.03 1.02 no gap to close" in text
    assert "named: joint play 1.02 1.01 1.04 1.06 2.4" in text
    assert "limit cycle period x s 1.82 - 1.79" in text
    assert "limit cycle amplitude x mm 8.10 0.400 7.90 nearer" in text
    assert "Recalibrate the servo: gain x is off by +5.2 %" in text
    assert "[effects.joint_backlash.x] play_rad = 0.035012" in text
    assert "saturation the volts stay below 3.1 V limit 3.10 V" in text
    assert "No experiment is proposed: no two names are left that a run could tell apart." in text
    assert "predicted to within 2.40 mm instead of 6.10 mm" in text


def test_the_answer_stands_in_one_table_below_its_sentence(pages):
    head = words(pages["named"][0]).split("Looked at")[0]
    assert "missing what it is x [95 %] y [95 %] sure joint play Free play in the joints" in head
    assert head.endswith("2.01 [1.93, 2.09] deg 1.15 [1.10, 1.19] deg 98 % ")
    assert "one of these what it is" in words(pages["rivals"][0])
    assert "what it is" not in words(pages["unknown"][0]) + words(pages["nothing"][0])


def test_stages_that_did_not_run_say_so(pages):
    assert words(pages["no_motion"][0]).count("This stage did not run") == 4
    assert pages["no_motion"][0].count('<h2 class="off">') == 4
    assert "Recalibrate" not in words(pages["nothing"][0])
    assert "instead of" not in words(pages["nothing"][0])
    assert pages["named"][0].count('<h2 class="off">') == 1  # no next experiment


def test_what_has_no_name_is_described(pages):
    text = words(pages["unknown"][0])
    assert "Something is left that no name explains, in ball x: a rhythm of 1.3 Hz" in text
    assert "[unknown] ball_rhythm_x = [0.02, -0.01] ball_rhythm_hz = 1.3" in text
    besides = replace(named(), unknown=unknown().unknown)
    assert "that no name explains" not in words(pages["named"][0])
    assert summary_lines(besides)[4].startswith("  unnamed    ball x: a rhythm")


def test_rivals_get_an_experiment_and_its_command(pages):
    text = words(pages["rivals"][0])
    assert "camera delay (57 %) or linkage cubic (41 %): these logs do not tell" in text
    assert "steps (30 s on the rig): it separates camera delay from linkage cubic" in text
    assert "expected separation is 27.0 (10 decides)" in text
    assert "rig run steps --arm with --rig rig.toml" in text
    assert "structural twins: a pure delay from encoder to plate" in text


def test_of_more_than_two_names_the_sentence_says_which_are_rivals(tmp_path):
    found = rivals()
    found = replace(found, effects=(*named().effects, *found.effects))
    assert found.sentence in name_stage(found, tmp_path).blocks


@pytest.mark.parametrize("make", [named, unknown, nothing])
def test_the_toml_of_what_was_added_is_read_by_the_rig(make):
    found = make()
    text = added_toml(found)
    if make is nothing:
        assert text == ""
        return
    rig = from_dict(tomllib.loads(text))
    for name, by_axis in found.rig_after.effects.items():
        for axis, pairs in by_axis.items():
            assert rig.effects[name][axis] == pytest.approx(pairs, rel=1e-4)
    assert rig.unknown == found.rig_after.unknown


def test_the_toml_of_a_name_alone_needs_no_rigs():
    found = replace(named(), rig_before=None, rig_after=None)
    assert tomllib.loads(added_toml(found))["effects"]["joint_backlash"]["y"]["play_rad"] == 0.02
    assert added_toml(replace(found, verdict="undecided")) == ""


def test_a_name_that_is_not_certain_is_marked_where_its_numbers_are_written(tmp_path):
    sure, doubted = named(), replace(named().effects[0], name="joint_backlash", probability=0.5)
    write_findings(sure, tmp_path, names=["a"])
    assert "Not certain" not in (tmp_path / "rig.toml").read_text()
    page = write_findings(replace(sure, effects=(doubted,)), tmp_path, names=["a"]).read_text()
    mark = "# Not certain (50 %): joint_backlash; the notes of gap.html say why."
    assert mark in (tmp_path / "rig.toml").read_text()
    assert mark in html.unescape(page)
    assert read_rig(tmp_path / "rig.toml") == sure.rig_after
    refuse_own(tmp_path / "rig.toml")  # made by this program all the same


def test_a_summary_is_short_and_says_the_same(pages):
    for make in ALL.values():
        lines = summary_lines(make())
        assert 2 <= len(lines) <= 15
        sure = r"( \([<> \d]+ %( to [<> \d]+ %)? sure\))?"
        assert re.fullmatch(f"{make().verdict}{sure}: {re.escape(make().sentence)}", lines[0])
        assert all("\n" not in line for line in lines)
    lines = "\n".join(summary_lines(named()))
    assert lines.startswith("named (98 % sure): ")
    two = replace(named().effects[0], probability=0.86), *named().effects
    assert summary_lines(replace(named(), effects=two))[0].startswith("named (86 % to 98 % sure): ")
    assert "joint_backlash (98 %): x play 2.01 [1.93, 2.09] deg, y play 1.15 [1.10, 1.19]" in lines
    assert "ball x 7.90 -> 1.04" in lines
    assert "6.10 -> 2.40 mm (fitted to these data: 2.20)" in lines
    assert "recalibrate the servo: gain_x_rad_s_V = 1.61 (+5 %)" in lines
    assert "4.1" not in lines
    assert "rig run steps (30 s) tells camera_delay from linkage_cubic" in "\n".join(
        summary_lines(rivals())
    )


def test_owners_of_files_are_told_what_to_record(tmp_path):
    lines = "\n".join(summary_lines(rivals(), recorded_here=False))
    assert "a recording like the protocol steps (30 s) tells camera_delay" in lines
    page = write_gap_report(rivals(), tmp_path, names=["old.csv"], recorded_here=False)
    text = words(page.read_text(encoding="utf-8"))
    assert "record the like of it: random steps" in text
    assert "rig gap LOG... NEW --rig rig.toml" in text
    assert "rig run" not in text.partition("Which experiment")[2]


def test_many_notes_are_counted():
    lines = summary_lines(replace(no_motion(), notes=tuple("abcdefg")))
    assert lines[-1] == "  note       4 more in the report"


def test_the_gap_over_time_shows_where_a_run_ends_and_which_is_next():
    time = Profile("ball_x", "time", "s", np.arange(41.0), np.ones(40), np.full(40, 60))
    two = replace(time, starts_s=np.array([0.0, 16.5]))

    def shown(*of) -> tuple[list[float], list[str]]:
        (axis,) = figures.over_time(*of).axes
        upright = [float(x[0]) for x, y in (line.get_data() for line in axis.lines) if y[0] != y[1]]
        (above,) = axis.child_axes or (None,)
        labels = [t.get_text() for t in above.get_xticklabels()] if above else []
        return upright, labels

    assert shown([time], ["run.csv"]) == ([], [])
    assert shown([two], ["steps-with", "hold-with"]) == ([16.5], ["steps-with", "hold-with"])
    assert shown([two], []) == ([16.5], ["1", "2"])
    many = replace(time, starts_s=np.arange(40.0))
    assert shown([many], [f"a-run-{i}" for i in range(40)])[1][:3] == ["1", "", "3"]


def test_odd_findings_still_make_a_page(tmp_path):
    """Empty bins, one channel, a gap of nothing, a name of tomorrow's catalogue."""
    gone = np.full(4, np.nan)
    profile = Profile("ball_x", "time", "s", np.arange(5.0), gone, np.zeros(4))
    other = Profile("servo_y", "voltage", "V", np.arange(5.0), gone, np.zeros(4))
    empty = PlateMap(np.arange(3.0), np.arange(3.0), np.full((2, 2, 2), np.nan), np.zeros((2, 2)))
    found = Findings(
        verdict="named",
        sentence="x",
        effects=(Named("bad_karma", 1.0, (), {"x": {"size_m": around(0.001)}}),),
        gap=Gap({"ball_x": np.nan}, {"ball_x": 1.0}),
        profiles=(profile, other),
        maps=(empty,),
        ranking=(replace(RANKING[0], probability=0.0),),
        steps=(Step("", {"ball_x": np.nan}), Step("bad_karma", {"ball_x": 1000.0})),
        proof=(ProofRow("nothing added", {}, None), ProofRow("named: bad_karma", {}, 0.0)),
        calibrated={
            "gain_x_rad_s_V": Interval(22.0, 22.0, 22.0),
            "time_constant_x_s": around(0.99999 * Rig().servo.time_constant_s),
        },
        rig_before=Rig(),
    )
    page = words(write_gap_report(found, tmp_path, names=[]).read_text(encoding="utf-8"))
    assert "bad_karma x size" in page
    assert "22.0 [22.0, 22.0] rad/s/V" in page
    assert "+0.0 %" in page
    assert "-0.0 %" not in page
    assert summary_lines(found)


ENLARGED_PX = 868  # of a picture that is enlarged on the dashboard's page of 1280 px; reports: 1056


def texts_inside(figure):
    """Every text of a figure lies in the picture as it is saved, no tick labels overlap, and its
    letters have 9 points where it is enlarged.
    """
    figure.canvas.draw()
    tight = figure.get_tightbbox()
    for axis in figure.axes:
        boxes = [t.get_window_extent() for t in axis.get_xticklabels() if t.get_text()]
        shown = [b for b in boxes if b.width]
        for left, right in pairwise(shown):
            assert left.x1 <= right.x0 + 1, "labels overlap"
        assert axis.get_xlabel() or axis.get_xticklabels()
    assert tight.width < 1.25 * figure.get_figwidth()
    letters = [t.get_fontsize() for t in figure.findobj(Text) if t.get_text() and t.get_visible()]
    assert min(letters) * ENLARGED_PX / (96 * tight.width) >= 9.0


def test_letters_of_figures_have_9_points_on_a_sheet():
    """Printed, a figure is at most 186 mm wide and 85 mm high (style.css)."""
    sides = [[p for p in named().profiles if p.channel.startswith(s)] for s in ("servo", "ball")]
    over = [figures.over_state([p for p in side if p.quantity != "time"]) for side in sides]
    steps = [Step(n, dict.fromkeys(CHANNELS, 2.0)) for n in ("", *(e.name for e in CATALOGUE[:6]))]
    rows = [ProofRow("named: joint_backlash", {}, 3.0)]
    others = figures.shrinking(steps), figures.ranking(RANKING, []), figures.ahead(rows, 2.0)
    for figure in (*over, *others, *map(figures.plate_map, named().maps)):
        figure.canvas.draw()
        high_in, wide_in = (
            x + 0.16 for x in (figure.get_tightbbox().height, figure.get_figwidth())
        )
        letters = [t.get_fontsize() for t in figure.findobj(Text) if t.get_text()]
        assert min(letters) * min(1.0, 186 / 25.4 / wide_in, 85 / 25.4 / high_in) >= 8.9


def test_figures_have_room_for_their_words():
    names = [e.name for e in CATALOGUE[:6]]
    steps = [Step("", dict.fromkeys(CHANNELS, 60.0))]
    steps += [Step(f"{n} x", dict.fromkeys(CHANNELS, 20.0 / (i + 1))) for i, n in enumerate(names)]
    texts_inside(figures.shrinking(steps))
    texts_inside(figures.shrinking(steps[:3]))
    texts_inside(figures.over_state([p for p in named().profiles if p.quantity != "time"]))
    time = Profile("ball_x", "time", "s", np.arange(81.0), np.ones(80), np.full(80, 60))
    logs = [f"20261129T2119{i:02d}-servo-squares-without" for i in range(80)]
    for runs in (1, 4, 7, 80):
        starts = np.linspace(0.0, 80.0, runs, endpoint=False)
        texts_inside(figures.over_time([replace(time, starts_s=starts)], logs[:runs]))
    long = [replace(c, twins=("encoder_to_plate_delay", "asymmetric_play")) for c in RANKING]
    texts_inside(figures.ranking(long, ["joint_backlash"]))
    rows = [ProofRow("named: transmission_ripple + joint_backlash + level_offset", {}, 3.0)]
    texts_inside(figures.ahead(rows, 2.0))


LONGEST = sorted((e.name for e in CATALOGUE), key=len)[-MAX_EFFECTS:]
AXIS_BY_AXIS = "gear_backlash coulomb_friction voltage_offset joint_backlash level_offset".split()


@pytest.mark.parametrize("names", [LONGEST, 2 * AXIS_BY_AXIS[:4] + AXIS_BY_AXIS[4:]])
def test_steps_of_as_many_names_as_there_can_be_do_not_touch(names: list[str]):
    figure = figures.shrinking([Step(n, dict.fromkeys(CHANNELS, 12.3)) for n in ("", *names)])
    figure.canvas.draw()
    axis = figure.axes[0]
    for texts in (axis.get_xticklabels(), sorted(axis.texts, key=lambda one: one.get_position())):
        spans = [(one.get_window_extent().x0, one.get_window_extent().x1) for one in texts]
        assert all(left < right for (_, left), (right, _) in pairwise(spans))


@pytest.mark.parametrize("largest", [1.0, 3.5, 8123.0])
@pytest.mark.parametrize("steps", [2, 8])
def test_the_numbers_above_the_bars_lie_in_the_frame(steps: int, largest: float):
    gaps = np.geomspace(largest, 1.0, steps)
    names = ["", *(e.name for e in CATALOGUE[: steps - 1])]
    shown = [Step(n, dict.fromkeys(CHANNELS, g)) for n, g in zip(names, gaps, strict=True)]
    figure = figures.shrinking(shown)
    figure.canvas.draw()
    axis = figure.axes[0]
    top = max(text.get_window_extent().y1 for text in axis.texts)
    assert 0.8 * axis.get_window_extent().y1 < top < axis.get_window_extent().y1 + 0.5


def test_every_parameter_of_the_catalogue_has_a_unit_and_words():
    for effect in CATALOGUE:
        for p in effect.parameters:
            unit, factor = parameter_unit(effect.name, p.key)
            assert "rad" not in unit or "1/rad" in unit
            assert factor >= 1
            assert not re.search(r"_(rad|V|s|m)\b", key_words(p.key))
    assert smallest_words("camera_delay", {"extra_s": 0.0034}) == "extra 3.40 ms"
    assert smallest_words("camera_scale", {"fraction": 0.014}) == "fraction 1.40 %"
    assert smallest_words("joint_backlash", {"x.play_rad": 0.0045}) == "x.play 0.258 deg"


def test_numbers_for_people():
    assert [sig(v) for v in (1234567.0, 0.00001, 0.0, float("nan"), None)] == [
        "1230000", "1.0e-05", "0", "-", "-",
    ]  # fmt: skip
    # What is told beside 1.52 is not told as 1.5.
    assert [sig(v) for v in (1.5, 0.02, 12.0, 123.4, 99.96)] == [
        "1.50", "0.0200", "12.0", "123", "100",
    ]  # fmt: skip
    assert [percent(p) for p in (1.0, 0.985, 0.004, float("nan"))] == [
        "> 99 %",
        "98 %",
        "< 1 %",
        "-",
    ]
    assert [floors(g) for g in (1.0, 41.26, 412.3, None)] == ["1.00", "41.3", "412", "-"]
    assert closed_share(1.04, 1.0) == "no gap to close"
    assert closed_share(3.0, 1.1) == "95 %"
    assert closed_share(1.0, 1.21) == "grew by 0.21"
    assert closed_share(1.04, 1.07) == closed_share(0.5, 0.8) == "no gap to close"
    assert closed_share(2.0, inf) == "no gap to close"


@given(value=st.floats(-1e3, 1e3), half=st.floats(1e-6, 1e3))
def test_an_interval_in_words_is_the_interval(value, half):
    text = interval_words(Interval(value, value - half, value + half), "V", 1.0)
    shown = [float(n) for n in re.findall(r"-?[\d.]+", text)]
    assert shown == pytest.approx([value, value - half, value + half], abs=0.26 * half)


def test_a_refused_name_has_no_probability_in_the_figure():
    refused = RankedEffect("plate_bowl", 90.0, 0.0, refused=True)
    figure = figures.ranking([RankedEffect("viscous_drag", 120.0, 0.87), refused], ["viscous_drag"])
    told = [text.get_text() for text in figure.axes[0].texts]
    assert told == ["87 %", "refused, see the notes"]
    assert [bar.get_width() for bar in figure.axes[0].patches] == [87.0, 0.0]


@pytest.mark.parametrize(
    ("before", "after", "how"),
    [
        (1.16, 1.68, "farther"),
        (1.68, 1.16, "nearer"),
        (1.16, 1.12, "alike"),
        (1.0, 1.3, "alike"),
        (nan, 1.0, ""),
    ],
)
def test_the_closed_loop_says_which_model_is_nearer(before: float, after: float, how: str):
    assert ClosedLoopRow("settling time", "s", 1.15, before, after).nearer == how


def test_a_model_that_is_farther_in_closed_loop_is_told_in_a_note():
    worse = ClosedLoopRow("spread", "mm", 7.9, 7.24, 5.53)
    better = ClosedLoopRow("settling time", "s", 1.15, 1.68, 1.16)
    assert farther_note((worse, better)) == farther_note(()) == ()
    assert farther_note((worse,)) == (
        "in closed loop the extended model is farther from the recording than the one before: "
        "spread 7.90 mm recorded, 7.24 before, 5.53 after",
    )
    nearer = "nearer to the recording than the one before in 1 of {} numbers, farther in {}."
    assert nearer.format(2, "spread") in closed_loop_words((worse, better))
    assert nearer.format(1, "none") in closed_loop_words((better,))
    assert closed_loop_words(()) == ""


def test_names_are_spoken_and_what_stands_in_a_file_is_not():
    assert (
        spoken("joint_backlash (x 2 deg), or camera_delay")
        == "joint play (x 2 deg), or camera delay"
    )
    assert (
        spoken("effects.my_joint_backlash and coulomb") == "effects.my_joint_backlash and coulomb"
    )
