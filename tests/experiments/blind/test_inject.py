"""What is hidden in a recorded log is hidden exactly: the effect's own equation undoes it."""

from collections.abc import Mapping

import numpy as np
import pytest

from experiments.blind import inject as hide
from experiments.blind.draws import TrialPlan, draw_trial
from experiments.blind.inject import NOT_POSSIBLE, inject, possible
from experiments.blind.logs import own_run
from rig.effects import effects_of
from rig.log import Log
from rig.plant import effect_equations as equations

RATIO = 2 * 0.0254 / 0.275


@pytest.fixture(scope="module")
def log() -> Log:
    whole = own_run(draw_trial(TrialPlan(1, 1, 3), 1, "nothing"), "steps", 5).log
    return whole.where(slice(0, 4000))


def forward(name: str, p: Mapping[str, float], v: float, theta: float, t: float) -> float:
    """The catalogue's equation on the volts."""
    if name == "dead_zone":
        return equations.dead_zone(v, p["positive_V"], p["negative_V"])
    if name == "gain_asymmetry":
        return equations.gain_asymmetry(v, p["fraction"])
    if name == "voltage_offset":
        return equations.voltage_offset(v, p["offset_V"])
    if name == "gain_drift":
        return equations.gain_drift(v, t, p["rate_1_s"])
    return equations.cogging(v, theta, p["amplitude_V"], p["phase_rad"], p["periods_per_turn"])


VOLTS = {
    "dead_zone": {"positive_V": 0.03, "negative_V": 0.05},
    "gain_asymmetry": {"fraction": -0.03},
    "voltage_offset": {"offset_V": 0.1},
    "gain_drift": {"rate_1_s": 0.01},
    "cogging": {"amplitude_V": 0.1, "phase_rad": 0.3, "periods_per_turn": 24.0},
}


@pytest.mark.parametrize("name", VOLTS)
def test_the_effect_turns_the_told_volts_into_those_that_acted(log: Log, name: str):
    told = inject(log, {name: {"y": VOLTS[name]}})
    columns = (told["voltage_y_V"], told["theta_y_rad"], told["t_s"])
    acted = [forward(name, VOLTS[name], *row) for row in zip(*columns, strict=True)]
    np.testing.assert_allclose(acted, log["voltage_y_V"], atol=1e-12)
    assert np.abs(told["voltage_y_V"] - log["voltage_y_V"]).max() > 0.01
    np.testing.assert_array_equal(told["voltage_x_V"], log["voltage_x_V"])
    np.testing.assert_array_equal(told["ball_x_m"], log["ball_x_m"])


def test_sag_and_delay_are_exact_too(log: Log):
    told = inject(log, {"supply_sag": {"xy": {"drop_1_V": 0.03}}})
    pair = told["voltage_x_V"], told["voltage_y_V"]
    acted = [equations.supply_sag(x, x, y, 0.03) for x, y in zip(*pair, strict=True)]
    np.testing.assert_allclose(acted, log["voltage_x_V"], atol=1e-12)
    late = inject(log, {"input_delay": {"x": {"delay_s": 0.006}}})
    assert len(late) == len(log) - 3
    np.testing.assert_array_equal(late["voltage_x_V"][:-3], log["voltage_x_V"][3:-3])
    np.testing.assert_array_equal(late["voltage_y_V"], log["voltage_y_V"][:-3])
    np.testing.assert_array_equal(late["theta_x_rad"], log["theta_x_rad"][:-3])


@pytest.mark.parametrize(
    ("name", "values"),
    [
        (
            "transmission_ripple",
            {"amplitude_rad": 0.02, "phase_rad": 1.0, "periods_per_turn": 13.0},
        ),
        ("linkage_quadratic", {"coefficient_1_rad": 0.5}),
        ("linkage_cubic", {"coefficient_1_rad2": -2.0}),
    ],
)
def test_the_plate_feels_the_true_angle(log: Log, name: str, values: dict):
    told = inject(log, {name: {"x": values}})
    error = getattr(equations, name)
    felt = [theta + error(theta, *values.values()) for theta in told["theta_x_rad"]]
    np.testing.assert_allclose(felt, log["theta_x_rad"], atol=1e-12)
    assert not told.has("voltage_x_V")
    assert np.abs(told["theta_x_rad"] - log["theta_x_rad"]).max() > 1e-4


def test_a_level_error_is_an_encoders_wrong_zero(log: Log):
    told = inject(log, {"level_offset": {"x": {"slope_rad": 0.002}}}, ratio=RATIO)
    slope = RATIO * np.sin(told["theta_x_rad"]) + 0.002
    np.testing.assert_allclose(slope, RATIO * np.sin(log["theta_x_rad"]), atol=1e-14)
    assert told.has("voltage_x_V")


def test_a_wrong_camera_is_undone_by_its_map(log: Log):
    for name, values in (
        ("camera_scale", {"fraction": 0.05}),
        ("camera_yaw", {"angle_rad": -0.04}),
        ("lens_distortion", {"k1_1_m2": 3.0}),
    ):
        told = inject(log, {name: {"xy": values}})
        arguments = [values.get(key, 0.0) for key in ("fraction", "angle_rad", "k1_1_m2")]
        pairs = zip(told["ball_x_m"], told["ball_y_m"], strict=True)
        back = np.array([equations.camera_unmap(x, y, *arguments) for x, y in pairs])
        np.testing.assert_allclose(back[:, 0], log["ball_x_m"], atol=1e-12)
        assert np.nanmax(np.abs(told["ball_x_m"] - log["ball_x_m"])) > 1e-5


def test_a_late_camera_stamps_late_and_shows_nothing_before_its_stamp(log: Log):
    told = inject(log, {"camera_delay": {"xy": {"extra_s": 0.0137}}})
    (t, xy), (late, same) = log.ball(), told.ball()
    np.testing.assert_allclose(late, t[: len(late)] + 0.0137, atol=1e-12)
    np.testing.assert_array_equal(same, xy[: len(same)])
    assert len(xy) - len(same) <= 2
    row = ~np.isnan(told["ball_x_m"])
    assert (told["t_s"][row] >= told["ball_exposed_s"][row]).all()


def test_a_log_without_stamps_gets_those_that_its_rig_file_implies(log: Log):
    bare = Log.from_columns(
        {n: v for n, v in log.columns.items() if n != "ball_exposed_s" and log.has(n)}
    )
    told = inject(bare, {"camera_delay": {"xy": {"extra_s": 0.01}}}, delay_s=0.012)
    np.testing.assert_allclose(told.ball(0.012)[0], bare.ball(0.012)[0][:-1] + 0.01, atol=2e-3)


def test_everything_in_the_catalogue_is_possible_or_has_a_reason(log: Log):
    assert set(possible(log)) | set(NOT_POSSIBLE) == {
        effect.name for effect in effects_of("voltage")
    }
    assert not set(possible(log)) & set(NOT_POSSIBLE)
    for name in NOT_POSSIBLE:
        with pytest.raises(ValueError, match=f"{name} cannot be hidden"):
            inject(log, {name: {}})


def test_a_log_with_one_channel_takes_what_its_channel_can_show(log: Log):
    servo = Log.from_columns({n: log[n] for n in ("t_s", "voltage_x_V", "theta_x_rad")})
    assert set(possible(servo)) == {*hide._VOLTS, "input_delay"}
    assert hide.axes_with(servo, "dead_zone") == ["x"]
    beam = Log.from_columns({n: log[n] for n in ("t_s", "theta_x_rad", "ball_x_m")})
    assert "camera_yaw" not in possible(beam)
    assert "camera_scale" in possible(beam)
    scaled = inject(beam, {"camera_scale": {"xy": {"fraction": 0.1}}})
    np.testing.assert_allclose(scaled["ball_x_m"], 1.1 * beam["ball_x_m"], atol=1e-15)


def test_what_has_no_inverse_at_this_size_is_refused(log: Log):
    wild = {"amplitude_rad": 0.1, "phase_rad": 0.0, "periods_per_turn": 30.0}
    with pytest.raises(ValueError, match="no inverse"):
        inject(log, {"transmission_ripple": {"x": wild}})
    with pytest.raises(ValueError, match="cannot give"):
        inject(log, {"supply_sag": {"xy": {"drop_1_V": 0.4}}})
