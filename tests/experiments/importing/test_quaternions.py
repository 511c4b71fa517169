"""A plate's attitude as a quaternion: of a motion capture, a ROS message, an inertial sensor."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from experiments.importing.columns.quaternions import with_tilts
from experiments.importing.conversion import convert
from experiments.importing.import_map import stated
from experiments.importing.proposal import propose
from experiments.importing.recording import Stream
from tests.support.other_labs.bench import run

X, Y = (run(axis, control_hz=50, noise=0.0002, ratio=1.0, delay=0.0) for axis in (0, 1))
LETTERS = "xyzw"  # scipy's order


def attitude(first: str, second: str, turned: float = 0.0, up: str = "z") -> dict[str, np.ndarray]:
    """Quaternion of a plate that tilts the ball's x about `second`, its y about -`first`, and
    stands turned about `up`."""
    tilted = Rotation.from_euler(second + first, np.column_stack((X.angle, -Y.angle)))
    return dict(zip(LETTERS, (Rotation.from_euler(up, turned) * tilted).as_quat().T, strict=True))


def lab(parts: dict[str, np.ndarray], ball=("ball_x_m", "ball_y_m")) -> Stream:
    places = dict(zip(ball, (X.seen, Y.seen), strict=True))
    return with_tilts(Stream({"t": X.t, **places, **parts}))


@pytest.mark.parametrize(
    "name",
    ["plate.orientation.{}", "/plate/pose/orientation/{}", "q{}", "quat_{}", "Rotation {}"],
)
@pytest.mark.parametrize("turned", [0.0, 1.2])
def test_a_quaternion_is_two_measured_angles(name: str, turned: float):
    parts = {name.format(k): v for k, v in attitude("x", "y", turned).items()}
    found = propose(lab(parts))
    (log,) = convert(lab(parts), found.map())
    np.testing.assert_allclose(log["theta_x_rad"], X.angle, atol=2e-3)
    np.testing.assert_allclose(log["theta_y_rad"], Y.angle, atol=2e-3)


@pytest.mark.parametrize("turned", [0.0, 2.0, -1.7])
@pytest.mark.parametrize(("first", "order"), [(0, "wxyz"), (0, "xyzw"), (1, "wxyz")])
def test_numbered_parts_begin_with_w_unless_the_first_is_small(
    first: int, order: str, turned: float
):
    parts = attitude("x", "y", turned)
    stream = lab({f"q{first + i}": parts[k] for i, k in enumerate(order)})
    (log,) = convert(stream, propose(stream).map())
    np.testing.assert_allclose(log["theta_x_rad"], X.angle, atol=2e-3)


def test_an_axis_that_stands_upright_is_found():
    parts = {f"Rotation {k.upper()}": v for k, v in attitude("x", "z", up="y").items()}
    stream = lab(parts, ("Position X", "Position Z"))
    found = propose(stream)
    assert [(d.place, d.options) for d in found.doubts[:1]] == [
        ("ball_y_m", ("Position Z", "none"))
    ]
    said = stated(["ball_y_m.column=Position Z", "ball.unit=m"])
    (log,) = convert(stream, propose(stream, said).map())
    np.testing.assert_allclose(np.abs(log["theta_x_rad"]), np.abs(X.angle), atol=2e-3)
    np.testing.assert_allclose(np.abs(log["theta_y_rad"]), np.abs(Y.angle), atol=2e-3)


def test_what_is_no_plates_attitude_is_left_as_it_is():
    still = {f"pose.{k}": np.full(len(X.t), float(k == "w")) for k in LETTERS}
    rolled = Rotation.from_rotvec(np.outer(X.t, (1.0, 2.0, 0.0))).as_quat().T
    ball = {f"ball.orientation.{k}": v for k, v in attitude("x", "y").items()}
    box = {f"box.{k}": 100 + X.t for k in LETTERS}
    for parts in (still, dict(zip(("qx", "qy", "qz", "qw"), rolled, strict=True)), ball, box):
        assert {*parts} <= {*lab(parts).columns}


def test_an_attitude_that_was_asked_for_is_a_command():
    asked = {f"setpoint.orientation.{k}": v for k, v in attitude("x", "y").items()}
    assert {name.split("_")[0] for name in propose(lab(asked)).draft["signals"]} >= {"command"}
