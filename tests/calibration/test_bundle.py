"""The calibration file: complete, strict, and enough to measure with."""

import json
from datetime import UTC, datetime

import numpy as np
import pytest

from calibration.bundle import BundleError, Draft, calibrate_virtual, load, load_draft
from calibration.camera.lens_fit import PARAMETERS
from calibration.records import DataFile, SectionRecord, fingerprint
from vision.synthetic.synthetic import Renderer, Scene, virtual_view

MADE = datetime(2024, 5, 1, 12, 0, tzinfo=UTC)
RADIUS_M = 0.019625


@pytest.fixture(scope="module")
def made():
    renderer = Renderer(Scene(), virtual_view(), np.random.default_rng(1))
    renderer.render(np.eye(3), (0, 0))
    bundle = calibrate_virtual(renderer, np.random.default_rng(2), made=MADE)
    return renderer, bundle


def test_virtual_calibration_recovers_the_camera_within_its_uncertainty(made):
    renderer, bundle = made
    truth = [*renderer.view.camera.pinhole, *renderer.view.camera.lens]
    found = [*bundle.view.camera.pinhole, *bundle.view.camera.lens]
    for name, t, f in zip(PARAMETERS, truth, found, strict=True):
        assert abs(f - t) <= 4 * bundle.lens.std[name]
    assert bundle.lens.std["fx"] / bundle.lens.matrix[0][0] < 0.001
    assert bundle.plate.residual_mm < 0.1
    assert bundle.source == "simulated"


def test_ball_is_measured_right_with_the_calibrated_view(made):
    """Pixels from the true view, metres from the calibrated one: the error of the calibration."""
    renderer, bundle = made
    grid = np.linspace(-0.13, 0.13, 7)
    errors = []
    for x in grid:
        for y in grid:
            u, v, _ = renderer.view.silhouette_from_ball((x, y), RADIUS_M)
            xy, _ = bundle.view.ball_from_silhouette((u, v), bundle.ball_radius_m)
            errors.append(xy - (x, y))
    assert np.abs(errors).max() < 1e-4
    assert np.sqrt(np.mean(np.square(errors))) < 5e-5


def test_file_holds_everything_and_comes_back(made, tmp_path):
    _, bundle = made
    path = tmp_path / "camera.json"
    bundle.save(path)
    again = load(path)
    assert again == bundle
    assert again.made == MADE
    assert np.array_equal(again.view.camera_from_plate, bundle.view.camera_from_plate)
    assert np.array_equal(again.view.camera.distortion, bundle.view.camera.distortion)
    assert again.layout.dictionary == "DICT_4X4_50"
    assert np.array_equal(again.layout.corners_m, Scene().layout.corners_m)
    assert again.ball_radius_m == RADIUS_M
    assert again.plate_side_m == 0.275
    assert again.lens.flags == ["CALIB_FIX_K3"]
    assert again.view.pose_cov is not None


def broken(bundle, path, change):
    data = json.loads(bundle.model_dump_json())
    change(data)
    path.write_text(json.dumps(data), encoding="utf-8")
    return path


def timing(delay_s):
    value = {"value": delay_s, "low": -np.inf, "high": np.inf}
    return {"delay_s": value, "play_rad": {"x": 0, "y": 0}, "frames": 9, "source": "ball"}


def posed(data, at, value):
    data["plate"]["camera_from_plate"][at[0]][at[1]] = value


def mirrored(data):
    for row in data["plate"]["camera_from_plate"]:
        row[0] *= -1.0


def corners(data, change):
    data["markers"]["corners_m"] = change(np.array(data["markers"]["corners_m"])).tolist()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d.update(bal_radius_m=0.02), "unknown key 'bal_radius_m'; known: .*ball_rad"),
        (lambda d: d["lens"].update(focal=3), r"unknown key 'lens\.focal'; known: matrix"),
        (lambda d: d.pop("ball_radius_m"), "key 'ball_radius_m' is missing"),
        (
            lambda d: d.update(ball_radius_m=-1),
            "ball_radius_m = -1: Input should be greater",
        ),
        (lambda d: d.update(schema_version=2), "schema_version"),
        (lambda d: d["lens"].update(distortion=[0, 0]), "lens.distortion"),
        (lambda d: d["markers"].update(dictionary="DICT_NONE"), "no marker dictionary"),
        (lambda d: d["markers"].update(dictionary="__class__"), "no marker dictionary"),
        (lambda d: d["markers"].update(ids=[1]), "need corners of shape"),
        (lambda d: d["markers"]["ids"].__setitem__(0, 10**30), "markers.ids.0 = 1000"),
        (lambda d: d["plate"].update(side_m=275), "plate.side_m = 275: .* 5 m"),
        (lambda d: d.update(ball_radius_m=np.inf), "ball_radius_m = inf"),
        (lambda d: d["lens"].update(matrix=[[0, 0, 0], [0, 1, 0], [0, 0, 1]]), "focal"),
        (lambda d: d["plate"].update(camera_from_plate=[[1], [1], [1], [1]]), "is not 4 x 4"),
        (lambda d: posed(d, (0, 3), np.inf), "plate.camera_from_plate.0.3 = inf: .* finite"),
        (lambda d: posed(d, (0, 0), np.nan), "plate.camera_from_plate.0.0 = nan: .* finite"),
        (lambda d: posed(d, (2, 3), -1.0), "behind the camera"),
        (lambda d: mirrored(d), "no turn and shift of a rigid plate"),
        (lambda d: posed(d, (0, 0), 2.0), "no turn and shift of a rigid plate"),
        (lambda d: d["lens"]["matrix"][0].__setitem__(0, np.inf), "lens.matrix.0.0 = inf"),
        (lambda d: d["lens"]["distortion"].__setitem__(4, np.nan), "lens.distortion.4 = nan"),
        (lambda d: d["plate"]["covariance"][2].__setitem__(2, -1.0), "variances of 0 and more"),
        (lambda d: d["plate"]["covariance"][2].pop(), "plate.covariance is not 6 x 6"),
        (lambda d: d.update(timing=timing(12.0)), "timing.delay_s.value = 12: at most 10 s"),
        (lambda d: d.update(timing=timing(np.nan)), "timing.delay_s.value = nan: at most 10 s"),
        (lambda d: corners(d, lambda xy: 0.0 * xy), "marker without an area"),
        (lambda d: corners(d, lambda xy: 1e3 * xy), "beyond a plate of 0.275 m; give metres"),
        (lambda d: corners(d, lambda xy: np.nan * xy), "corners_m.0.0.0 = nan: .* finite"),
        (lambda d: corners(d, lambda xy: xy[:, :3]), "not four"),
    ],
)
def test_a_wrong_file_is_one_clear_line(made, tmp_path, change, message):
    path = broken(made[1], tmp_path / "camera.json", change)
    with pytest.raises(BundleError, match=message) as caught:
        load(path)
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)


def test_not_json_and_missing_files(tmp_path):
    path = tmp_path / "camera.json"
    path.write_text("lens: 3", encoding="utf-8")
    with pytest.raises(BundleError, match=r"camera\.json"):
        load(path)
    with pytest.raises(OSError, match="none"):
        load(tmp_path / "none.json")


def test_refuses_another_picture_size(made):
    made[1].check_size(640, 480)
    with pytest.raises(BundleError, match="1280x720"):
        made[1].check_size(1280, 720)


def test_a_file_grows_section_by_section(made, tmp_path):
    """Lens first, plate later: until both are there it serves nobody who measures."""
    _, bundle = made
    path = tmp_path / "camera.json"
    section = SectionRecord(made=MADE, data=[DataFile(name="a.png", sha256="00", size_bytes=1)])
    draft = Draft(made=MADE, source="measured").with_section("lens", section, lens=bundle.lens)
    draft.save(path)
    assert load_draft(path) == draft
    with pytest.raises(BundleError, match="no plate yet: run rig calibrate table"):
        load(path)
    whole = draft.with_section(
        "plate", section, plate=bundle.plate, markers=bundle.markers, ball_radius_m=RADIUS_M
    )
    whole.save(path)
    again = load(path)
    assert set(again.sections) == {"lens", "plate"}
    assert again.sections["lens"].data[0].name == "a.png"
    assert np.array_equal(again.view.camera_from_plate, bundle.view.camera_from_plate)


def test_maps_on_the_plate_are_kept(made):
    lens = made[1].lens
    assert np.shape(lens.uncertainty_mm) == (9, 9)
    assert np.max(lens.uncertainty_mm) == pytest.approx(lens.plate_std_mm)
    assert np.percentile(lens.half_set_map_mm, 95) == pytest.approx(lens.half_set_mm)


def test_files_are_named_with_their_hashes(tmp_path):
    (tmp_path / "set").mkdir()
    (tmp_path / "set" / "one.png").write_bytes(b"abc")
    (tmp_path / "two.csv").write_bytes(b"")
    files = fingerprint([tmp_path / "set", tmp_path / "two.csv"])
    assert [file.name for file in files] == ["set/one.png", "two.csv"]
    assert files[0].sha256 == "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
    assert files[0].size_bytes == 3
