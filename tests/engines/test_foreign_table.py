"""Logs of the foreign table: what is asked is done, what is hidden is what was asked for."""

import numpy as np
import pytest

from experiments.benchmark.engines.foreign.parts import packed
from experiments.benchmark.engines.foreign.plant import RADIUS_M, _roll
from experiments.benchmark.engines.foreign.protocols import PROTOCOLS
from experiments.benchmark.engines.foreign.table import (
    CAMERA_DELAY_S,
    NOISE_M,
    NOMINAL_GAIN,
    NOMINAL_TAU,
    SERVO_SPREAD,
    completed,
    hidden,
    make_log,
    write_csv,
)
from experiments.benchmark.engines.foreign.truth import BOXES, STRANGERS, plant_and_eye
from experiments.records.importing import read_log
from rig.effects import check, effects_of
from tests.support.foreign.runs import nothing_odd

DEG = np.pi / 180
LARGE = {  # about six times what a minute of data shows
    "coulomb_friction": {"x": {"friction_V": 0.09}},
    "stribeck_friction": {"y": {"extra_V": 0.15, "speed_rad_s": 0.12}},
    "dead_zone": {"x": {"half_width_V": 0.06}},
    "gain_asymmetry": {"y": {"fraction": -0.05}},
    "viscous_asymmetry": {"x": {"fraction_1": 0.12}},
    "voltage_offset": {"x": {"offset_V": 0.12}},
    "saturation": {"y": {"limit_V": 1.0}},
    "input_delay": {"x": {"delay_s": 0.012}},
    "cogging": {"y": {"amplitude_V": 0.1, "phase_rad": 1.0, "periods_per_turn": 13.0}},
    "gain_drift": {"x": {"rate_1_s": 0.004}},
    "supply_sag": {"xy": {"drop_1_V": 0.03}},
    "gear_backlash": {"y": {"play_rad": 2 * DEG}},
    "joint_backlash": {"x": {"play_rad": 2.5 * DEG}},
    "transmission_ripple": {
        "y": {"amplitude_rad": 2 * DEG, "phase_rad": 2.0, "periods_per_turn": 11.0}
    },
    "linkage_quadratic": {"x": {"coefficient_1_rad": 0.6}},
    "linkage_cubic": {"y": {"coefficient_1_rad2": -2.0}},
    "cross_coupling": {"x": {"fraction": 0.15}},
    "level_offset": {"y": {"slope_rad": 0.12 * DEG}},
    "level_drift": {"x": {"rate_rad_s": 1e-4}},
    "plate_bowl": {"xy": {"stiffness_1_s2": -0.4}},
    "rolling_resistance": {"xy": {"deceleration_m_s2": 0.018}},
    "viscous_drag": {"xy": {"rate_1_s": 0.25}},
    "camera_delay": {"xy": {"extra_s": 0.03}},
    "camera_scale": {"xy": {"fraction": -0.12}},
    "camera_yaw": {"xy": {"angle_rad": 6 * DEG}},
    "lens_distortion": {"xy": {"k1_1_m2": -2.0}},
}


def test_the_catalogue_is_complete_and_spelled_alike():
    assert list(LARGE) == [effect.name for effect in effects_of("voltage")]
    check(LARGE)
    with pytest.raises(ValueError, match="no effect"):
        make_log("hold", effects={"camera_yaw": {"x": {"angle_rad": 0.1}}}, seed=1)
    with pytest.raises(ValueError, match="known"):
        make_log("dance", seed=1)
    with pytest.raises(ValueError, match="known"):
        make_log("hold", stranger=("ghost", 1.0), seed=1)


@pytest.mark.parametrize("name", LARGE)
def test_the_ball_stays_on_the_plate_and_the_effect_shows(name: str):
    moved = []
    for protocol in ("steps", "corner", "pushed"):
        log = make_log(protocol, effects={name: LARGE[name]}, seed=4)
        assert completed(log, protocol)
        plain = make_log(protocol, seed=4)
        moved += [np.abs(log[c] - plain[c]).max() for c in ("theta_x_rad", "theta_y_rad")]
    assert max(moved) > 0.003  # two counts of the encoder
    assert np.nanmedian(np.hypot(log["ball_x_m"], log["ball_y_m"])) < 0.06


@pytest.mark.parametrize("name", STRANGERS)
def test_strangers_leave_the_ball_on_the_plate(name: str):
    stranger = (name, STRANGERS[name][1])
    for seed in range(3):
        log, plain = (make_log("steps", seed=seed, stranger=s) for s in (stranger, None))
        assert completed(log, "steps")
        both = [c[f"ball_{a}_m"] for c in (log, plain) for a in "xy"]
        assert np.nanmax(np.abs(np.subtract(both[:2], both[2:]))) > 3 * NOISE_M


@pytest.mark.parametrize("protocol", PROTOCOLS)
@pytest.mark.parametrize("rate_hz", [10.0, 37.0, 500.0, 5000.0])
def test_every_protocol_at_every_rate(protocol: str, rate_hz: float):
    log = make_log(protocol, seed=2, rate_hz=rate_hz, duration_s=4.0, tachometer=True)
    assert completed(log, protocol, 4.0)
    np.testing.assert_allclose(np.diff(log["t_s"]), 1 / rate_hz)
    volts = np.array([log["voltage_x_V"], log["voltage_y_V"]])
    assert 0.01 < np.abs(volts).max() <= 6.0
    for name, column in log.items():
        blank = name.startswith(("ball", "target")) if protocol == "squares" else "ball" in name
        assert np.isfinite(column).all() or blank, name
    if protocol != "squares":
        new = np.isfinite(log["ball_x_m"])
        assert new.sum() == pytest.approx(min(60.0, rate_hz) * 4, abs=4)
        late = (log["t_s"] - log["ball_exposed_s"])[new] - CAMERA_DELAY_S
        assert late.min() > -1e-8
        assert late.max() < 1 / rate_hz
    assert (log["push"].sum() / rate_hz > 0.05) == (protocol == "pushed")


def test_pushes_are_a_fifth_of_a_metre_a_second():
    log = make_log("pushed", seed=7, imperfect=False, process_scale=0.0, noise_scale=0.0)
    starts = np.flatnonzero(np.diff(log["push"]) == 1) + 1
    assert len(starts) >= 3
    quick = []
    for i in starts[:3]:
        new = np.flatnonzero(np.isfinite(log["ball_x_m"]))
        before, after = new[new < i][-1], new[new > i + 56][0]  # what follows 0.1 s and 12 ms
        a, b = (
            np.array([[log[f"ball_{n}_m"][k] for n in "xy"] for k in (j, new[new > j][0])])
            for j in (before, after)
        )
        quick.append(np.linalg.norm((np.diff(b, axis=0) - np.diff(a, axis=0)) * 60))
    np.testing.assert_allclose(quick, 0.2, rtol=0.2)


def test_the_same_seed_gives_the_same_log_and_what_is_hidden_changes_nothing_else():
    one, again, other = (make_log("steps", seed=s, duration_s=4.0) for s in (1, 1, 2))
    assert all(np.array_equal(one[n], again[n], equal_nan=True) for n in one)
    assert not np.array_equal(one["target_x_m"], other["target_x_m"])
    effect = make_log("steps", seed=1, duration_s=4.0, effects=LARGE)
    np.testing.assert_array_equal(one["target_x_m"], effect["target_x_m"])


def test_small_imperfections_stay_in_their_boxes_and_give_way_to_what_is_hidden():
    common = {"seconds": 10.0, "stranger": None}
    drawn = [hidden(effects=None, seed=s, **common) for s in range(200)]
    for name, (key, low, high) in BOXES.items():
        found = [v[key] for d in drawn for v in d.effects[name].values()]
        assert low <= min(found) < low + 0.05 * (high - low)
        assert high - 0.05 * (high - low) < max(found) <= high
    gains = np.array([d.gain for d in drawn]) / NOMINAL_GAIN
    assert 0.9 * SERVO_SPREAD < np.abs(gains - 1).max() <= SERVO_SPREAD
    one = hidden(effects=LARGE, seed=3, **common)
    assert one.effects["dead_zone"]["x"] == {"half_width_V": 0.06}
    assert one.effects["dead_zone"]["y"] == drawn[3].effects["dead_zone"]["y"]
    plain = hidden(effects=LARGE, seed=3, imperfect=False, **common)
    assert plain.effects == LARGE
    np.testing.assert_array_equal([plain.gain, plain.tau], [NOMINAL_GAIN, NOMINAL_TAU])


def still_noise(**camera) -> np.ndarray:
    """What the camera says of a ball (frames, 2) on a table without any process noise."""
    log = make_log("circle", seed=5, imperfect=False, process_scale=0.0, **camera)
    calm = make_log("circle", seed=5, imperfect=False, process_scale=0.0, noise_scale=0.0)
    xy, true = (np.column_stack([c["ball_x_m"], c["ball_y_m"]]) for c in (log, calm))
    found = (xy - true)[np.isfinite(true[:, 0])]
    return found - found.mean(axis=0)


@pytest.mark.parametrize(("scale", "colour"), [(1.0, 0.0), (2.0, 0.0), (1.0, 0.6)])
def test_the_cameras_noise_has_its_size_and_colour(scale: float, colour: float):
    """1440 frames, 2 axes: 2 % and 0.02; the loop, which answers the noise, moves the ball too."""
    noise = still_noise(noise_scale=scale, colour=colour)
    step = np.diff(noise, axis=0)  # nearly rid of what the ball did
    expected = scale * NOISE_M * np.sqrt(2 * (1 - colour))
    assert step.std() == pytest.approx(expected, rel=0.08)


def test_dropped_frames_are_missing():
    log = make_log("steps", seed=5, dropout=0.2)
    assert np.isfinite(log["ball_x_m"]).sum() == pytest.approx(0.8 * 1800, abs=60)


def test_the_csv_is_the_contract_and_is_read_back(tmp_path):
    log = make_log("pushed", seed=1, duration_s=3.0, tachometer=True)
    write_csv(tmp_path / "log.csv", log)
    back = read_log(tmp_path / "log.csv")
    assert not back.notes
    for name, column in log.items():
        np.testing.assert_allclose(back[name], column, rtol=1e-8, atol=1e-12)
    write_csv(tmp_path / "servo.csv", make_log("squares", seed=1))
    assert np.isnan(read_log(tmp_path / "servo.csv")["ball_x_m"]).all()


def test_on_a_moving_plate_the_ball_is_mujocos():
    """The plate's motion of a MuJoCo run under 5 Hz, steps of 2 ms: below a tenth of the noise.

    Gravity alone misses by more than the camera's noise.
    """
    from tests.support.mujoco_engine.comparison import (
        TICK_S,
        Start,
        by_mujoco,
        multisine,
        table_with,
    )

    run = by_mujoco(table_with(dry=False), multisine(), Start((0.03, -0.03)))
    plant, _ = plant_and_eye({}, (1.53,) * 2, (0.025,) * 2, delay_s=0.0, factor=0.6)
    parts, s = (packed(plant), packed(nothing_odd())), np.sin(run.plate_rad)
    path, flat = [], []
    for radius_share, found in ((1.0, path), (0.0, flat)):
        b = (0.03, -0.03, 0.0, 0.0, 0.0)
        for i in range(len(s) - 1):
            found.append(b[:2])
            end = s[i + 1] if radius_share else s[i]
            b, _ = _roll(*parts, b, s[i], end, (0.0, 0.0, 0.0), i * TICK_S, TICK_S)
    assert np.abs(np.array(path) - run.ball_m[:-1]).max() < 0.1 * NOISE_M
    assert np.abs(np.array(flat) - run.ball_m[:-1]).max() > NOISE_M
    assert table_with().ball.radius_m == RADIUS_M
