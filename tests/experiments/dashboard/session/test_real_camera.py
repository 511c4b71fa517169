"""A real table's camera on the page: calibrated with pictures that grow, looked through, lent.

The camera is a user's class in a file; it shows rendered pictures of the sheet, or the level plate
with a ball at (0.02, -0.03) m.
"""

import re
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calibration.bundle import load
from experiments.dashboard.app import App
from experiments.dashboard.server.server import open_server
from experiments.dashboard.session.calibration_tasks import CalibrationRequest, calibration_step
from experiments.dashboard.session.real_camera import RealCamera
from experiments.dashboard.session.worker_process import ProgressSender
from experiments.dashboard.view.camera_view import view_of
from experiments.runs.live_eye import open_ball, watching
from rig.linkage import Linkage
from rig.parameters import Rig
from rig.rigfile import write_rig
from tests.support.waiting import wait_for
from vision.sources.sources import open_source

pytestmark = pytest.mark.realtime

CAMERA = """
import time
from itertools import cycle

import numpy as np

from calibration.camera.sheet import Sheet
from calibration.camera.virtual import sheet_pictures
from experiments.runs.assemble import virtual_scene
from rig.linkage import Linkage
from rig.parameters import Rig
from vision.synthetic.synthetic import Renderer, virtual_view


class _Shows:
    def open(self):
        made = Renderer(virtual_scene(Rig()), virtual_view(), np.random.default_rng(3))
        self.images = cycle(self.pictures(made))

    def read(self):
        time.sleep(0.1)
        return next(self.images), time.monotonic()

    def close(self):
        self.images = None


class Sheets(_Shows):
    def pictures(self, made):
        return list(sheet_pictures(made, Sheet(), 40, np.random.default_rng(4)))


class Plate(_Shows):
    def pictures(self, made):
        return [made.render(np.eye(3), None) for _ in range(4)]


class Ball(_Shows):
    def pictures(self, made):
        return [made.render(np.eye(3), (0.02, -0.03)) for _ in range(4)]
"""


class Heard(ProgressSender):
    """What a task tells, kept."""

    def __init__(self) -> None:
        super().__init__(self._keep)
        self.show_through: list[set[str]] = []

    def _keep(self, word) -> None:
        kind, what = word
        if kind == "shown":
            assert all(one.path.is_file() for one in what)
            self.show_through.append({one.path.name for one in what})


@pytest.fixture(scope="module")
def lab(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("lab")
    (folder / "own.py").write_text(CAMERA)
    return folder


def rig_of(lab: Path, camera: str, calibration: str = "") -> Rig:
    """A table with this class as its camera; nothing is ever asked of the table itself."""
    table = replace(
        Rig().table,
        kind="serial",
        port="nowhere",
        camera=f"{lab / 'own.py'}:{camera}",
        calibration=calibration or str(lab / "made" / "calibration.json"),
    )
    return replace(Rig(), table=table)


def measured(lab: Path, step: str, camera: str, **more) -> tuple[Heard, list]:
    rig, heard = rig_of(lab, camera), Heard()
    write_rig(rig, lab / "lab.toml")
    return heard, calibration_step(
        CalibrationRequest(step, rig, lab / "made", rig_file=lab / "lab.toml", **more), heard
    )


@pytest.fixture(scope="module")
def bundle(lab: Path) -> Path:
    """The calibration of the lab's camera, made as the page makes it."""
    heard, pictures = measured(lab, "camera", "Sheets")
    assert {"coverage.png"} in heard.show_through  # before there was anything to fit
    both = {"coverage.png", "residuals.png"}
    assert (
        sum(both <= show_through for show_through in heard.show_through) >= 2
    )  # then both, again and again
    assert [one.path.name for one in pictures][-1] == "camera.png"
    _, pictures = measured(lab, "table", "Plate")
    assert [one.path.name for one in pictures] == ["plate.png"]
    return lab / "made" / "calibration.json"


@pytest.fixture(scope="module")
def eye(lab: Path, bundle: Path) -> Iterator[RealCamera]:
    """One for several tests, each of which leaves its camera open or free."""
    one = RealCamera(rig_of(lab, "Ball", str(bundle)))
    try:
        yield one
    finally:
        one.close()


def seen_through(eye: RealCamera, seconds: float = 60.0) -> tuple[np.ndarray, str]:
    """The first picture in which the tracker has the ball."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        eye.request(None)
        preview = eye.newest()
        if preview is not None and "Ball followed at" in preview[1]:
            return preview
        time.sleep(0.05)
    raise AssertionError("no picture with the ball came")


@pytest.mark.slow
def test_the_camera_is_calibrated_with_pictures_that_grow(bundle: Path):
    made = load(bundle)
    assert made.source == "measured"
    assert made.view.camera_from_plate[2, 3] == pytest.approx(0.75, abs=0.005)


@pytest.mark.slow
def test_the_page_looks_through_the_tables_camera_between_runs(eye: RealCamera):
    image, words = seen_through(eye)
    assert image.shape == (240, 320, 3)
    assert re.search(r"Ball followed at x \+(2\.0|1\.99)", words)
    red = image[:, :, 0].astype(int) - image[:, :, 2]
    assert (red > 80).sum() > 100  # the orange ball, as RGB


@pytest.mark.slow
def test_who_needs_the_camera_gets_it_and_the_page_sees_through_its_eye(lab, bundle, eye):
    seen_through(eye)
    rig = rig_of(lab, "Ball", str(bundle))
    with eye.lend() as show_through, watching(rig, open_ball) as runs:
        assert not eye._holds_camera
        show_through(runs)
        seen_through(eye)
        with pytest.raises(ValueError, match="wait until it has ended"), eye.lend():
            pass
        assert eye._run_eye is runs
    assert eye._run_eye is None
    seen_through(eye)  # and again by itself


@pytest.mark.slow
def test_an_eye_nobody_looks_through_is_let_go(eye: RealCamera):
    seen_through(eye)
    eye.release()
    wait_for("the camera's release", lambda: not eye._holds_camera)


@pytest.mark.slow
def test_a_camera_that_cannot_be_opened_is_told_and_a_closed_page_lets_go(lab, bundle):
    eye = RealCamera(rig_of(lab, "Nobody", str(bundle)))
    eye.request(None)
    wait_for("a reason", lambda: bool(eye._error))
    with pytest.raises(OSError, match="Nobody"):
        eye.newest()
    eye.close()
    assert not eye._thread.is_alive()


def test_what_a_real_table_cannot_be_asked_is_refused_with_the_way_out(lab: Path):
    with pytest.raises(ValueError, match="come from its runs"):
        measured(lab, "servo", "Plate")
    with pytest.raises(ValueError, match="record one with the ball"):
        measured(lab, "level", "Plate")
    rig = replace(rig_of(lab, ""), table=replace(rig_of(lab, "").table, camera=""))
    with pytest.raises(ValueError, match=r"set table\.camera"):
        calibration_step(
            CalibrationRequest("camera", rig, lab / "none", rig_file=lab / "lab.toml"), Heard()
        )


def test_the_virtual_camera_hangs_as_high_as_its_plate_is_large():
    linkages = (
        Linkage(plate_side_m=0.275),
        Linkage(plate_side_m=0.55),
        Linkage(x={"plate_side_m": 0.55}),
    )
    views = [view_of(Rig(linkage=linkage), real=False) for linkage in linkages]
    small, *large = [view.camera_from_plate[2, 3] for view in views]
    assert large == pytest.approx([2 * small, 2 * small])


@pytest.mark.slow
def test_the_frustum_hangs_where_the_calibration_says(lab: Path, bundle: Path):
    rig = rig_of(lab, "Ball", str(bundle))
    calibrated = view_of(rig, real=True)
    assert np.array_equal(calibrated.camera_from_plate, load(bundle).view.camera_from_plate)
    unknown = view_of(rig_of(lab, "Ball", str(lab / "missing.json")), real=True)
    assert np.array_equal(unknown.camera_from_plate, view_of(rig, real=False).camera_from_plate)
    with open_source(rig.table.camera) as frames:
        assert next(iter(frames)).image.shape[1] == calibrated.camera.width_px


@pytest.mark.slow
def test_on_the_page_a_step_borrows_the_camera_that_was_looked_through(lab, bundle, tmp_path):
    rig = rig_of(lab, "Plate", str(bundle))
    write_rig(rig, lab / "page.toml")
    server, _ = open_server("127.0.0.1", 0, "a-token-of-some-length-for-tests")
    app = App(server, rig, tmp_path, rig_file=lab / "page.toml")
    try:
        app.camera.set_wanted(True)
        wait_for("the image", lambda: "<img" in app.camera._picture.content)
        assert "The ball is" in app.camera._picture.content
        eye = app.eye
        assert isinstance(eye, RealCamera)
        tab = app.calibrate
        assert set(tab._buttons) == {"camera", "table", "time", "level"}
        (tmp_path / "calibration").mkdir()
        (tmp_path / "calibration" / "calibration.json").write_bytes(bundle.read_bytes())
        tab.begin(("table",))
        with pytest.raises(ValueError, match="a step is on"):
            tab.begin(("level",))
        with pytest.raises(ValueError, match="a run or a calibration has the camera"):
            eye.check_free()
        wait_for("the verdict", lambda: tab._state["table"] == "accepted")
        assert "accepted" in tab._verdict.content
        assert "copy it to" in tab._found.content
        tab.begin(("level",))
        wait_for("the refusal", lambda: tab._state["level"] == "refused")
        assert "record one with the ball" in tab._verdict.content
        wait_for("the page's own eye again", lambda: eye._idle_eye is not None)
    finally:
        app.close()
        server.stop()
