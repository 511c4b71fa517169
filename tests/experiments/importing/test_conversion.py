"""The map does what it says, and a map that does not fit says so."""

from pathlib import Path

import numpy as np
import pytest

from experiments.importing.conversion import convert
from experiments.importing.import_map import ImportMap, merged, read_map, stated, write_map
from experiments.importing.proposal import propose
from experiments.importing.recording import BadFileError, Stream
from tests.support import DATA

T = np.arange(100) * 0.02


def made(time: dict | None = None, calibration: str | None = None, **signals) -> ImportMap:
    time = time or {"column": "t", "unit": "s"}
    return ImportMap.model_validate({"time": time, "signals": signals, "calibration": calibration})


def test_value_is_sign_times_scale_times_what_is_beyond_the_offset():
    stream = Stream({"t": T, "a": 90 + 10 * T, "x": 100 * T})
    log = convert(
        stream,
        made(
            command_x_rad={"column": "a", "unit": "deg", "sign": -1, "offset": 90},
            ball_x_m={"column": "x", "unit": "mm", "absent": [0.0]},
        ),
    )[0]
    np.testing.assert_allclose(log["command_x_rad"], -np.radians(10 * T))
    assert np.isnan(log["ball_x_m"][0])
    np.testing.assert_allclose(log["ball_x_m"][1:], 0.1 * T[1:])


def test_the_ball_is_absent_only_where_both_coordinates_say_so():
    x, y = np.array([0.0, 0, 1, 2] * 25), np.array([0.0, 1, 0, np.nan] * 25)
    keys = {"unit": "m", "absent": [0.0]}
    found = made(ball_x_m={"column": "x", **keys}, ball_y_m={"column": "y", **keys})
    log = convert(Stream({"t": T, "x": x, "y": y}), found)[0]
    np.testing.assert_array_equal(np.isnan(log["ball_x_m"]), [True, False, False, True] * 25)


def test_counts_a_turn_pulse_widths_and_shares_of_a_supply():
    stream = Stream({"t": T, "n": np.full(100, 1024.0), "w": np.full(100, 2000.0), "d": T * 0 + 51})
    log = convert(
        stream,
        made(
            theta_x_rad={"column": "n", "unit": "turn/4096"},
            command_x_rad={"column": "w", "unit": "us", "offset": 1500, "scale": np.pi / 2000},
            voltage_x_V={"column": "d", "unit": "1/255", "scale": 12.0},
        ),
    )[0]
    assert log["theta_x_rad"][0] == pytest.approx(np.pi / 2)
    assert log["command_x_rad"][0] == pytest.approx(np.pi / 4)
    assert log["voltage_x_V"][0] == pytest.approx(2.4)


def test_a_speed_becomes_an_angle_and_a_current_becomes_volts():
    speed = 60 * np.cos(T)  # rpm
    stream = Stream({"t": T, "w": speed, "i": 500 + 0 * T})
    log = convert(
        stream,
        made(
            theta_x_rad={"column": "w", "unit": "rpm"},
            voltage_x_V={
                "column": "i",
                "unit": "mA",
                "resistance_ohm": 2.0,
                "back_emf_V_s_rad": 0.5,
            },
        ),
    )[0]
    np.testing.assert_allclose(log["theta_x_rad"], 2 * np.pi * np.sin(T), atol=2e-3)
    np.testing.assert_allclose(log["voltage_x_V"], 1.0 + np.pi * np.cos(T), atol=0.05)


def test_commands_hold_and_angles_are_bridged_over_short_holes_alone():
    values = T.copy()
    values[10:13] = values[40:60] = np.nan
    found = made(
        command_x_rad={"column": "a", "unit": "rad"}, theta_x_rad={"column": "a", "unit": "rad"}
    )
    log = convert(Stream({"t": T, "a": values}), found)[0]
    assert log["command_x_rad"][12] == T[9]
    assert log["command_x_rad"][59] == T[39]
    np.testing.assert_allclose(log["theta_x_rad"][10:13], T[10:13])
    assert np.isnan(log["theta_x_rad"][41:59]).all()


@pytest.mark.parametrize("unit", ["s", "ms", "us", "ns", "min"])
def test_every_time_unit_from_an_epoch(unit: str):
    size = {"s": 1, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60}[unit]
    stream = Stream({"t": (1.7e9 + T) / size, "a": T})
    log = convert(stream, made({"column": "t", "unit": unit}, theta_x_rad=RAD))[0]
    np.testing.assert_allclose(log["t_s"], T, atol=1e-6)


RAD = {"column": "a", "unit": "rad"}


def test_sessions_by_a_falling_time_a_hole_and_a_column():
    time = np.concatenate((T, T, T + 30))
    stream = Stream({"t": time, "a": time, "episode": np.repeat([0.0, 0, 1, 2, 3, 3], 50)})
    assert len(convert(stream, made(theta_x_rad=RAD))) == 3
    by_column = made({"rate_hz": 50.0, "session": "episode"}, theta_x_rad=RAD)
    assert [len(log) for log in convert(stream, by_column)] == [100, 50, 50, 100]


def test_rows_that_repeat_a_stamp_are_left_out_or_spread():
    coarse = np.floor(T / 0.1 + 1e-9) * 0.1
    stream = Stream({"t": coarse, "a": T})
    with pytest.raises(BadFileError, match="clock=even"):
        convert(stream, made(theta_x_rad=RAD))
    log = convert(stream, made({"column": "t", "clock": "even"}, theta_x_rad=RAD))[0]
    np.testing.assert_allclose(np.diff(log["t_s"]), 0.02, rtol=0.05)
    once = T.copy()
    once[50] = once[49]
    log = convert(Stream({"t": once, "a": T}), made(theta_x_rad=RAD))[0]
    assert len(log) == 99
    assert "1 rows" in log.notes[0]


def test_an_exposure_is_on_the_clock_of_the_rows():
    stream = Stream({"t": 1e6 + 1000 * T, "e": 1e6 / 1000 + T - 0.03, "a": T})
    found = made(
        {"column": "t", "unit": "ms"}, theta_x_rad=RAD, ball_exposed_s={"column": "e", "unit": "s"}
    )
    log = convert(stream, found)[0]
    np.testing.assert_allclose(log["ball_exposed_s"] - log["t_s"], -0.03, atol=1e-6)


def test_pixels_by_a_calibration():
    from calibration.bundle import load

    path = DATA / "today" / "calibration.json"
    bundle = load(path)
    xy = np.column_stack((0.05 * np.cos(T), 0.05 * np.sin(T)))
    uv = np.array([bundle.view.silhouette_from_ball(one, bundle.ball_radius_m)[:2] for one in xy])
    stream = Stream({"t": T, "u": uv[:, 0], "v": uv[:, 1]})
    pixel = {"unit": "px"}
    found = made(
        None,
        str(path),
        ball_x_m={"column": "u", **pixel},
        ball_y_m={"column": "v", **pixel},
    )
    log = convert(stream, found)[0]
    np.testing.assert_allclose(log["ball_x_m"], xy[:, 0], atol=1e-5)
    np.testing.assert_allclose(log["ball_y_m"], xy[:, 1], atol=1e-5)


def test_a_map_reads_back_as_it_was_written(tmp_path: Path):
    found = made(
        {"column": "t", "unit": "ms", "session": "n"},
        ball_x_m={"column": "x", "unit": "mm", "absent": [-1.0]},
        voltage_y_V={"column": "u", "unit": "1/255", "scale": 12.0, "sign": -1},
    )
    write_map(tmp_path / "import.toml", found)
    assert read_map(tmp_path / "import.toml") == found
    changed = merged(found, stated(["ball.unit=cm", "voltage.scale=24", "time.unit=s"]))
    assert changed.signals["ball_x_m"].unit == "cm"
    assert changed.signals["voltage_y_V"].scale == 24
    assert changed.time.unit == "s"
    assert "voltage_y_V" not in merged(found, stated(["voltage_y_V.column=none"])).signals


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[time]\ncolumn='t'\nfoo=1\n[signals.ball_x_m]\ncolumn='x'\nunit='m'", "foo"),
        ("[time]\ncolumn='t'\n[signals.ball_z_m]\ncolumn='x'\nunit='m'", "ball_z_m"),
        ("[time]\ncolumn='t'\n[signals.ball_x_m]\ncolumn='x'\nunit='V'", "known are m"),
        ("[time]\ncolumn='t'\n[signals.ball_x_m]\ncolumn='x'\nunit='px'", "scale"),
        ("[time]\ncolumn='t'\n[signals.voltage_x_V]\ncolumn='i'\nunit='A'", "resistance_ohm"),
        ("[time]\n[signals.ball_x_m]\ncolumn='x'\nunit='m'", "rate_hz"),
        ("[time]\ncolumn='t'\n[signals.ball_x_m]\ncolumn='x'\nunit='m'\nsign=2", "sign"),
        ("[time]\ncolumn='t'\n[signals]\n", "none is mapped"),
        ("what", "TOML|Expected|expected"),
    ],
)
def test_a_wrong_map_gets_one_line(text: str, says: str, tmp_path: Path):
    path = tmp_path / "import.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match=says) as caught:
        read_map(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "text", ["ball", "ball.unit", "ball.colour=1", "wheel.unit=m", "ball.scale=a"]
)
def test_a_wrong_statement_gets_one_line(text: str):
    with pytest.raises(ValueError, match="--set"):
        stated([text])


@pytest.mark.parametrize("rate_hz", ["0", "-50", "nan"])
def test_a_rate_that_is_none_gets_one_line(rate_hz: str):
    stream = Stream({"x": np.sin(T), "y": np.cos(T)})
    with pytest.raises(ValueError, match="the map: time: rate_hz"):
        propose(stream, stated([f"time.rate_hz={rate_hz}"]))
