"""Workbooks, written by the format's own library, and what is no table in them."""

from collections.abc import Callable, Mapping, Sequence
from datetime import datetime, timedelta
from importlib import import_module
from pathlib import Path
from typing import Any
from zipfile import ZIP_DEFLATED, ZipFile

import numpy as np
import pytest

from experiments.importing.formats import workbooks
from experiments.importing.formats.choose import read_recording
from experiments.importing.recording import BadFileError
from tests.support.command import told
from tests.support.parts import needs

pytestmark = needs("openpyxl")

SHEET = "xl/worksheets/sheet1.xml"

K = np.arange(60)
HEAD = ["Zeit [s]", "x [mm]", "y [mm]"]


def saved(path: Path, sheets: Mapping[str, Sequence[Sequence[Any]]]) -> Path:
    """A workbook with these sheets: title -> rows of cells."""
    book = import_module("openpyxl").Workbook(write_only=True)
    for title, rows in sheets.items():
        sheet = book.create_sheet(title)
        for row in rows:
            sheet.append(row)
    book.save(path)
    return path


def rows_of(shift: float = 0.0) -> list[list[Any]]:
    """A table of three columns with numbers of all kinds below their names."""
    return [HEAD, *([k / 50, float(np.sin(k)) + shift, int(k)] for k in K)]


def test_a_sheet_is_read_as_the_same_table_of_text_is(tmp_path: Path):
    text = "\n".join("\t".join(map(str, row)) for row in rows_of())
    (tmp_path / "a.tsv").write_text(text)
    sheets = {"Messung": [["Lab 3", None, "Meier"], [], *rows_of()], "Notizen": [["ein Text"]]}
    recording = read_recording(saved(tmp_path / "a.xlsx", sheets))
    other = read_recording(tmp_path / "a.tsv").stream
    assert [*recording.stream.columns] == HEAD == [*other.columns]
    for name in HEAD:
        np.testing.assert_allclose(recording.stream.columns[name], other.columns[name], 1e-14)
    assert len(recording.notes) == 1
    assert recording.notes[0].startswith("sheet Notizen, left out: no rows of numbers")


def test_blank_cells_times_and_truths(tmp_path: Path):
    begin = datetime(2026, 3, 1, 10, 0, 0)
    rows: list[list[Any]] = [["stamp", "since", "x", "seen", "note"]]
    for k in K:
        since = timedelta(milliseconds=int(20 * k))
        here = None if k % 7 == 0 else 0.5 * k
        rows.append([begin + since, since, here, bool(k % 2), 'a "quoted"\tword; 1,5'])
    stream = read_recording(saved(tmp_path / "a.xlsx", {"Run": rows})).stream
    stamp, since = stream.columns["stamp"], stream.columns["since"]
    np.testing.assert_allclose(np.diff(stamp), 0.02, atol=1e-3)
    np.testing.assert_allclose(since, K / 50, atol=1e-6)
    np.testing.assert_array_equal(np.isnan(stream.columns["x"]), K % 7 == 0)
    np.testing.assert_array_equal(stream.columns["seen"], K % 2)


def test_sheets_with_the_same_columns_are_sessions(tmp_path: Path):
    sheets = {"Run 1": rows_of(), "Run 2": rows_of(9.0)}
    stream = read_recording(saved(tmp_path / "a.xlsx", sheets)).stream
    assert stream.session == "sheet"
    np.testing.assert_array_equal(stream.columns["sheet"], np.repeat([0.0, 1.0], len(K)))
    shift = np.diff(stream.columns["x [mm]"].reshape(2, -1), axis=0)
    np.testing.assert_allclose(shift, 9.0)


def test_columns_of_sheets_that_differ_bear_their_names(tmp_path: Path):
    servo = [["Zeit [s]", "alpha [deg]"], *([k / 50, float(np.cos(k))] for k in K)]
    stream = read_recording(saved(tmp_path / "a.xlsx", {"Ball": rows_of(), "Servo": servo})).stream
    assert {"Ball/x [mm]", "Servo/alpha [deg]"} <= {*stream.columns}
    assert len(stream) == len(K)


def test_a_sheet_that_bears_the_name_of_anothers_series_replaces_none(tmp_path: Path):
    """Series of a table in long form have a clock of their own, which bears its sheet's name."""
    series: list[list[Any]] = [["time", "signal", "value"]]
    series += [[k / 50, name, float(k)] for k in K for name in ("ball_x", "ball_y")]
    other = [["t", "a", "b"], *([k / 50, 0.5 * k, 2.0 * k] for k in K)]
    stream = read_recording(saved(tmp_path / "a.xlsx", {"Run": series, "Run 1": other})).stream
    wanted = ["Run/time", "Run/ball_x", "Run 1/ball_y", "Run 1/t", "Run 1/a", "Run 1/b"]
    assert [*stream.columns] == wanted
    assert stream.time == "Run/time"


def test_a_cell_far_away_is_no_table_of_so_many_columns(tmp_path: Path):
    book = import_module("openpyxl").Workbook()
    sheet = book.worksheets[0]
    for row in rows_of():
        sheet.append(row)
    sheet["XFD1048576"] = 1.0
    book.save(tmp_path / "a.xlsx")
    with pytest.raises(BadFileError, match="16384 columns"):
        read_recording(tmp_path / "a.xlsx")


def _changed(path: Path, part: str, change: Callable[[bytes], bytes]) -> Path:
    """The workbook with another text in one of its parts."""
    with ZipFile(path) as old:
        texts = {one: old.read(one) for one in old.namelist()}
    with ZipFile(path, "w", ZIP_DEFLATED) as new:
        for one, text in texts.items():
            new.writestr(one, change(text) if one == part else text)
    return path


@pytest.mark.parametrize(
    "is_said",
    [
        b'<row r="30"><c r="XFD30" s="0"/>',  # a format, but no number
        b'<mergeCells count="1"><mergeCell ref="A1:XFD9"/></mergeCells><row r="30">',
    ],
)
def test_what_a_sheet_says_of_places_makes_it_no_larger(tmp_path: Path, is_said: bytes):
    path = saved(tmp_path / "a.xlsx", {"Run": rows_of()})
    _changed(path, SHEET, lambda text: text.replace(b'<row r="30">', is_said))
    stream = read_recording(path).stream
    np.testing.assert_array_equal(stream.columns["y [mm]"], K)


@pytest.mark.parametrize("number", [b"2000000000", b"1e300"])
def test_a_row_of_a_number_that_no_sheet_has_is_told_in_a_line(tmp_path: Path, number: bytes):
    """Each row up to 2 000 000 000 was read: the import was busy for hours."""
    path = saved(tmp_path / "a.xlsx", {"Run": rows_of()})
    _changed(path, SHEET, lambda text: text.replace(b'<row r="30">', b'<row r="%s">' % number))
    with pytest.raises(BadFileError, match=r"limit: 1048576|invalid literal"):
        read_recording(path)


@pytest.mark.parametrize("limit", ["MAX_ELEMENTS", "MAX_OTHER_ELEMENTS"])
def test_more_parts_than_a_recording_has_are_told_in_a_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, limit: str
):
    """A million styles took gigabytes."""
    monkeypatch.setattr(workbooks, limit, 9)
    path = saved(tmp_path / "a.xlsx", {"Run": rows_of()})
    with pytest.raises(BadFileError, match=r"cells, rows, styles .*limit: 9\): save the sheet"):
        read_recording(path)


def test_many_rows_that_end_far_away_are_refused(tmp_path: Path):
    """A million rows of one blank cell each, 16 384 columns away, were read for hours."""
    path = saved(tmp_path / "a.xlsx", {"Run": rows_of()})
    rows = b"".join(b'<row r="%d"><c r="XFD%d" s="0"/></row>' % (i, i) for i in range(100, 2100))
    _changed(path, SHEET, lambda text: text.replace(b"</sheetData>", rows + b"</sheetData>"))
    with pytest.raises(BadFileError, match=r"cells, rows, styles .*limit: 30000000"):
        read_recording(path)


def test_a_sheet_named_a_thousand_times_is_refused(tmp_path: Path):
    """Each name of it cost the time of reading it."""
    path = saved(tmp_path / "a.xlsx", {"Run": rows_of()})
    again = [b'<sheet name="Run %d" sheetId="%d" r:id="rId1"/>' % (i, i) for i in range(2, 900)]
    spaces = b' xmlns:r="http://schemas.openxmlformats.org/officeDocument/2006/relationships"'
    _changed(
        path,
        "xl/workbook.xml",
        lambda text: text.replace(b"</sheets>", b"".join(again) + b"</sheets>").replace(
            b"<sheets", b"<sheets" + spaces
        ),
    )
    with pytest.raises(BadFileError, match="names one sheet twice"):
        read_recording(path)


def test_words_may_be_longer_than_a_row(tmp_path: Path):
    path = saved(tmp_path / "a.xlsx", {"Run": [[*row, "state"] for row in rows_of()]})
    more = b"<si><t>" + 100 * b"word " + b"</t></si>"
    _changed(
        path,
        "xl/sharedStrings.xml",
        lambda text: text.replace(b"</sst>", 25_000 * more + b"</sst>"),
    )
    assert len(read_recording(path).stream) == len(K)


def test_dates_since_1904_and_words_kept_apart(tmp_path: Path):
    book = import_module("openpyxl").Workbook()
    book.epoch = import_module("openpyxl.utils.datetime").MAC_EPOCH
    sheet, begin = book.worksheets[0], datetime(2026, 3, 1, 10, 0, 0)
    sheet.append(["stamp", "x", "state"])
    for k in K:
        sheet.append([begin + timedelta(seconds=int(k)), 0.5 * k, "tracked" if k % 2 else "lost"])
    book.save(tmp_path / "a.xlsx")
    stream = read_recording(tmp_path / "a.xlsx").stream
    np.testing.assert_allclose(np.diff(stream.columns["stamp"]), 1.0)
    utc = np.datetime64("2026-03-01T10:00:00") - np.datetime64("1970-01-01T00:00:00")
    assert abs(stream.columns["stamp"][0] - utc / np.timedelta64(1, "s")) < 86400  # or its zone's
    assert stream.unreadable["state"].words == len(K)


def test_a_hidden_sheet_is_told_of(tmp_path: Path):
    path = saved(tmp_path / "a.xlsx", {"Run 1": rows_of(), "Run 2": rows_of(9.0)})
    hides = (b'name="Run 2"', b'name="Run 2" state="veryHidden"')
    _changed(
        path, "xl/workbook.xml", lambda text: text.replace(b' state="visible"', b"").replace(*hides)
    )
    notes = read_recording(path).notes
    assert notes == ("sheet Run 2 is hidden in the workbook, and read like any other",)


def _not_packed(path: Path) -> None:
    path.write_bytes(b"PK")


def _no_workbook(path: Path) -> None:
    with ZipFile(path, "w") as parts:
        parts.writestr("a.txt", "t,x,y")


def _of_words(path: Path) -> None:
    saved(path, {"Notes": [["a", "b"]], "More": [["c"]]})


def _with_part(name: str, *parts: bytes) -> Callable[[Path], None]:
    """A workbook in which a part is these bytes: begin, what is repeated for 60 MB, end."""
    begin, middle, end = parts

    def spoil(path: Path) -> None:
        saved(path, {"Run": rows_of()})
        with ZipFile(path) as old:
            kept = {one: old.read(one) for one in old.namelist() if one != name}
        with ZipFile(path, "w", ZIP_DEFLATED) as new:
            for one, data in kept.items():
                new.writestr(one, data)
            new.writestr(name, begin + middle * (60_000_000 // len(middle)) + end)

    return spoil


SHEET_BEGIN = (
    b'<worksheet xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main"><sheetData>'
)
SHEET_END = b"</sheetData></worksheet>"


@pytest.mark.parametrize(
    ("spoilt", "says"),
    [
        (_not_packed, "not readable as a workbook"),
        (_no_workbook, "not readable as a workbook"),
        (_of_words, "sheet Notes, left out: no rows of numbers"),
        (_with_part("xl/sharedStrings.xml", b"<sst>", b"<si/>", b"</sst>"), "limit: 50000000"),
        (_with_part(SHEET, SHEET_BEGIN, b"<row/>", SHEET_END), "rows (limit: 1048576)"),
        (_with_part(SHEET, SHEET_BEGIN + b"<row>", b"<c/>", b"</row>" + SHEET_END), "longest row"),
        (_with_part(SHEET, SHEET_BEGIN + b"<row><c>", b"a", b"</c></row>" + SHEET_END), "longest"),
        (_with_part(SHEET, SHEET_BEGIN + b'<row a="', b"a", b'"/>' + SHEET_END), "longest tag"),
    ],
)
def test_what_is_no_table_is_told_in_a_line(
    tmp_path: Path, spoilt: Callable[[Path], None], says: str
):
    spoilt(tmp_path / "a.xlsx")
    with pytest.raises(BadFileError) as error:
        read_recording(tmp_path / "a.xlsx")
    assert says in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("cut", [200, 2000, 4000])
def test_a_workbook_that_was_cut_off_is_told_in_a_line(tmp_path: Path, cut: int):
    whole = saved(tmp_path / "a.xlsx", {"Run": rows_of()}).read_bytes()
    (tmp_path / "a.xlsx").write_bytes(whole[:cut])
    with pytest.raises(BadFileError, match=r"^[^\n]*not readable as a workbook[^\n]*$"):
        read_recording(tmp_path / "a.xlsx")


def test_from_a_workbook_to_a_log(tmp_path: Path):
    """A ball that rolls as the plate's measured angles ask it to."""
    t = np.arange(4500) / 50.0
    angles = np.array([0.05 * np.sin(2.0 * t), 0.04 * np.cos(1.3 * t)])
    pull = 5.0 / 7.0 * 9.81 * 2.0 * 0.0254 / 0.275
    ball = -pull * angles / np.array([[2.0], [1.3]]) ** 2
    names = ["t_s", "theta_x_rad", "theta_y_rad", "ball_x_m", "ball_y_m"]
    table = np.column_stack([t, *angles, *ball])
    saved(tmp_path / "a.xlsx", {"Run": [names, *table.tolist()]})
    out = tmp_path / "run.csv"
    code, _, error = told("import", tmp_path / "a.xlsx", "--out", out, "--yes")
    assert code == 0, error
    log = np.genfromtxt(out, delimiter=",", names=True)
    np.testing.assert_allclose(log["ball_x_m"], ball[0], atol=1e-6)
