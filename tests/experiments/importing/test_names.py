"""What a column's name and unit say in the languages that labs write."""

import pytest

from experiments.importing.names import hint, hints


@pytest.mark.parametrize(
    ("name", "role", "axis", "unit"),
    [
        ("Sollwinkel X [mrad]", "command", "x", "mrad"),
        ("Istwinkel Y [°]", "theta", "y", "deg"),
        ("Kugelposition Y [mm]", "ball", "y", "mm"),
        ("Tijd (s)", "time", None, "s"),
        ("Servo Y gewenst (graden)", "command", "y", "deg"),
        ("hoek_x_gemeten", "theta", "x", None),
        ("referencia_x_mm", "target", "x", "mm"),
        ("posx_mm", "ball", "x", "mm"),
        ("Comando motore 1 [gradi]", "command", "x", "deg"),
        ("Ángulo servo Y (grados)", "angle", "y", "deg"),
        ("raw_rotation", "angle", None, None),
        ("Neigung X gemessen (Grad)", "theta", "x", "deg"),
        ("Stellgröße Y", "command", "y", None),
        ("pulse1", "command", "x", None),
        ("touch_y_adc", "ball", "y", "counts"),
        ("ball_px_y", "ball", "y", "px"),
        ("x_px", "ball", "x", "px"),
        ("ball_px", "ball", "x", None),
        ("px", "ball", "x", None),
        ("Angolo comandato X (gradi)", "command", "x", "deg"),
        ("posizioni_y_misurate", "ball", "y", None),
        ("u_deg[1]", "command", "x", "deg"),
        ("u_px", "ball", "x", "px"),
        ("x_real", "ball", "x", None),
        ("act", None, None, None),
        ("joint_state.position[0]", "theta", None, None),
        ("ball_likelihood", "likelihood", None, None),
        ("detection.score", "likelihood", None, None),
        ("servo_confidence", "other", None, None),
        ("ball_lost", "unseen", None, None),
        ("ball_radius_mm", "size", None, "mm"),
    ],
)
def test_compounds_and_spelled_units(
    name: str, role: str | None, axis: str | None, unit: str | None
):
    found = hint(name)
    assert (found.role, found.axis, found.unit) == (role, axis, unit)


def test_beside_an_angle_in_degrees_a_pulse_is_a_command():
    found = hints(["servo_x_us", "tilt_x_deg"], {})
    assert [one.role for one in found.values()] == ["command", "angle"]
    assert hints(["servo_x_us", "servo_y_us"], {})["servo_x_us"].role == "angle"


def test_beside_a_present_position_a_position_is_a_servos():
    found = hints(["goal_pos_1", "present_pos_1", "ball_goal_pos_x", "ball_pos_x"], {})
    assert [one.role for one in found.values()] == ["command", "theta", "target", "ball"]
    assert hint("goal_pos_1").role == "target"


def test_a_bare_set_is_the_balls_target():
    """`setX` was a commanded angle, beside `servo1` then taken for the measured one."""
    assert hint("setX").role == hint("x_set").role == "target"
    assert hint("set_angle_x_deg").role == hint("servo_x_set").role == "command"


@pytest.mark.parametrize(
    ("names", "roles", "unit"),
    [
        (("時間[ms]", "ボールX[mm]", "目標X[mm]", "サーボX指令[度]", "実測角度X[度]"), 5, "deg"),
        (("时间(s)", "小球X(mm)", "目标X(mm)", "舵机X指令(rad)", "实测角度X(rad)"), 5, "rad"),
        (("Время, с", "Шар X, мм", "Задание X, мм", "Угол серво X (задание), град"), 4, "deg"),
        (("czas [s]", "kulka X [mm]", "wartość zadana X [mm]", "kąt zadany serwa X [°]"), 4, "deg"),
        (("zaman(ms)", "top_x(mm)", "hedef_x(mm)", "servo_x_komut(derece)"), 4, "deg"),
    ],
)
def test_names_in_other_letters(names: tuple[str, ...], roles: int, unit: str):
    found = [hint(name) for name in names]
    assert [one.role for one in found] == ["time", "ball", "target", "command", "theta"][:roles]
    assert [one.axis for one in found] == [None, *["x"] * (roles - 1)]
    assert [one.unit for one in found[1:4]] == ["mm", "mm", unit]


@pytest.mark.parametrize("name", ["温度", "X軸", "скорость X, м/с", "θ_x"])
def test_other_letters_that_are_no_ball(name: str):
    assert hint(name).role != "ball"
