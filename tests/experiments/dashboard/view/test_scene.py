"""The 3-D view: what stands beside the balls, and the lines behind them."""

import numpy as np
import pytest

from experiments.dashboard.server.server import open_server
from experiments.dashboard.view.ghost import ANCHOR_S, SPEED_FROM, noise_alone_m
from experiments.dashboard.view.scene import TableScene
from rig.parameters import Rig


def test_noise_alone_is_the_error_of_a_speed_from_noisy_places():
    rig, rng = Rig(), np.random.default_rng(1)
    t_s = np.arange(SPEED_FROM) / rig.camera.rate_hz
    seen_m = rig.camera.noise_m * rng.standard_normal((SPEED_FROM, 2, 4000))
    speeds = np.polyfit(t_s, seen_m.reshape(SPEED_FROM, -1), 1)[0].reshape(2, -1)
    far_m = ANCHOR_S * np.hypot(*speeds)
    assert noise_alone_m(rig) == pytest.approx(float(np.sqrt(np.mean(far_m**2))), rel=0.03)


def test_the_models_distance_says_what_noise_makes_and_each_ball_has_its_trail():
    server, _ = open_server("127.0.0.1", 0, "a-token-of-some-length-for-tests")
    try:
        scene = TableScene(server, Rig())
        scene.compare(np.array([0.01, 0.0]), np.array([0.021, 0.0]))
        assert scene.gap_label.text == "model 11.0 mm off\n(noise alone: 6 mm)"
        label = np.array(scene.gap_label.position)
        scene.compare(np.array([-0.1, 0.1]), np.array([-0.09, 0.1]))
        assert scene.gap_label.position == pytest.approx(label)  # it hides nothing, wherever
        scene.draw_trails({"with": np.zeros((3, 2)), "without": np.ones((5, 2))})
        assert [len(scene.trails[name].points) for name in ("with", "without")] == [2, 4]
        unseen = np.array([[np.nan, np.nan], [0.0, 0.0], [0.01, 0.0]])  # before it was seen first
        scene.draw_trail(unseen, None)
        assert np.isfinite(scene.trail.points).all()
        scene.draw_trails({})
        assert [len(trail.points) for trail in scene.trails.values()] == [1, 1]
    finally:
        server.stop()
