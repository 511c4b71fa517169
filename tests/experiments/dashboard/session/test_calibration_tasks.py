"""The page's calibration jobs in a folder that somebody else made."""

from pathlib import Path
from zipfile import ZipFile

from experiments.dashboard.session.calibration_tasks import print_sheets
from rig.parameters import Rig


def test_the_sheets_lie_over_no_link_and_nothing_else_is_packed(tmp_path: Path):
    notes, secret, out = tmp_path / "notes.txt", tmp_path / "secret.txt", tmp_path / "sheets"
    notes.write_text("my notes")
    secret.write_text("my secret")
    out.mkdir()
    for name in ("sheets.zip", "table.toml", "charuco.pdf", "plate.png"):
        (out / name).symlink_to(notes)
    (out / "a.pdf").symlink_to(secret)
    packed = print_sheets(Rig(), out, lambda *step: None)
    assert notes.read_text() == "my notes"
    with ZipFile(packed) as archive:
        assert sorted(archive.namelist()) == ["charuco.pdf", "fixed.pdf", "plate.pdf"]
