"""Protocols as data: the shipped ones, a user's own, and one clear line for every mistake."""

from pathlib import Path

import numpy as np
import pytest

from experiments.runs.protocol import course, read_protocol, shipped
from rig.parameters import Linkage, Rig

SHIPPED = (
    "circle", "free-release", "hold", "pushed", "servo-squares", "sine-sweep", "slow-triangle",
    "steps",
)  # fmt: skip


def test_the_promised_protocols_are_shipped():
    assert shipped() == sorted(SHIPPED)


@pytest.mark.parametrize("name", SHIPPED)
def test_a_shipped_protocol_makes_a_course_within_the_rig(name: str):
    rig, protocol = Rig(), read_protocol(name)
    way = course(protocol, rig, 5)
    assert way.targets_m.shape == way.pushes_m_s2.shape == (round(500 * protocol.duration_s), 2)
    reach = rig.servo.angle_limit_rad if protocol.servo_only else rig.linkage.plate_side_m / 2
    assert np.abs(way.targets_m).max() < reach
    on_plate = max(map(abs, way.start_m)) < rig.linkage.plate_side_m / 2
    assert on_plate is not protocol.servo_only  # servos alone: the ball lies beside the plate


def test_arms_of_a_seed_share_the_course_and_seeds_differ():
    protocol = read_protocol("pushed")
    one, same, other = (course(protocol, Rig(), seed) for seed in (1, 1, 2))
    assert np.array_equal(one.pushes_m_s2, same.pushes_m_s2)
    assert one.start_m == same.start_m
    assert not np.array_equal(one.pushes_m_s2, other.pushes_m_s2)
    assert one.start_m != other.start_m


def test_drawn_pushes_have_the_speed_asked_for_and_come_in_antipodal_pairs():
    protocol = read_protocol("pushed")
    opposite = total = 0
    for seed in range(20):
        push = course(protocol, Rig(), seed).pushes_m_s2
        on = np.abs(push).sum(axis=1) > 0
        begins = np.flatnonzero(np.diff(on.astype(int), prepend=0) > 0)
        assert len(begins) >= 4
        directions = push[begins] / np.linalg.norm(push[begins], axis=1, keepdims=True)
        length = on.sum() / len(begins) / 500
        assert np.allclose(np.linalg.norm(push[begins], axis=1) * length, 0.2)
        turned = (directions[1:] * directions[:-1]).sum(axis=1)
        opposite += (turned < -0.999).sum()
        total += len(turned)
    assert 0.3 < opposite / total < 0.7


def test_a_users_own_file(tmp_path: Path):
    path = tmp_path / "mine.toml"
    path.write_text(
        'title = "mine"\nduration_s = 3\n[reference]\nshape = "circle"\nradius = 0.03\n'
    )
    protocol = read_protocol(str(path))
    assert protocol.name == "mine"
    assert np.allclose(np.linalg.norm(course(protocol, Rig(), 1).targets_m, axis=1), 0.03)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('title = "a"\nduration_s = 3\nspeed = 1', ["unknown key 'speed'", "duration_s"]),
        ('title = "a"\nduration_s = 3\n[start]\nz = 1', ["start.z", "x_m, y_m"]),
        ('title = "a"\nduration_s = -3', ["duration_s", "greater than"]),
        ('title = "a"', ["duration_s", "missing"]),
        ('title = "a"\nduration_s = 3\n[reference]\nshape = "star"', ["'star'", "circle"]),
        ('title = "a"\nduration_s = 3\n[reference]\nshape = "circle"\nr = 1', ["reference", "r"]),
        ('title = "a"\nduration_s = 3\narms = ["maybe"]', ["arms", "'maybe'", "without, with"]),
        ('title = "a"\nduration_s = 3\n[pushes]\nkind = "often"', ["pushes.kind", "at-centre"]),
        ("title = ", ["not a TOML file"]),
    ],
)
def test_a_mistake_is_one_clear_line(tmp_path: Path, text: str, words: list[str]):
    path = tmp_path / "mine.toml"
    path.write_text(text)
    with pytest.raises(ValueError, match=r"mine\.toml") as caught:
        read_protocol(str(path))
    assert "\n" not in str(caught.value)
    for word in words:
        assert word in str(caught.value)


def test_unknown_names_list_the_known_ones(tmp_path: Path):
    with pytest.raises(ValueError, match="free-release"):
        read_protocol("freerelease")
    with pytest.raises(ValueError, match="not found"):
        read_protocol("nowhere.toml")
    folder = tmp_path / "folder.toml"
    folder.mkdir()
    with pytest.raises(ValueError, match="no ordinary file"):
        read_protocol(str(folder))


def test_a_start_off_the_plate_is_refused():
    small = Rig(linkage=Linkage(plate_side_m=0.2))
    with pytest.raises(ValueError, match="off the plate"):
        course(read_protocol("free-release"), small, 1)


@pytest.mark.parametrize(
    ("shape", "key", "value"),
    [
        ("circle", "period_s", "1e-320"), ("triangle", "period_s", "1e-320"),
        ("steps", "every_s", "1e-9"), ("steps", "amplitude", "1e308"),
        ("sine-sweep", "low_hz", "1e308"), ("sine-sweep", "high_hz", "1e308"),
        ("sine-sweep", "low_hz", "1e-320"), ("constant", "x", "-1e308"),
    ],
)  # fmt: skip
def test_a_reference_that_nobody_can_compute_is_refused(tmp_path: Path, shape, key, value):
    """Its targets would be no numbers, or take all memory: a run would end at its first tick."""
    path = tmp_path / "mine.toml"
    path.write_text(
        f'title = "a"\nduration_s = 3\n[reference]\nshape = "{shape}"\n{key} = {value}\n'
    )
    with pytest.raises(ValueError, match=rf"mine\.toml: reference\.{key} = "):
        read_protocol(str(path))


def test_a_sweep_from_one_frequency_to_the_same_is_a_sine(tmp_path: Path):
    path = tmp_path / "mine.toml"
    path.write_text(
        'title = "a"\nduration_s = 3\n[reference]\nshape = "sine-sweep"\namplitude = 0.04\n'
        "low_hz = 0.5\nhigh_hz = 0.5\n"
    )
    way = course(read_protocol(str(path)), Rig(), 1)
    t_s = np.arange(1500) / 500
    np.testing.assert_allclose(way.targets_m[:, 0], 0.04 * np.sin(np.pi * t_s), atol=1e-12)


def test_a_sweep_beyond_half_of_the_tick_rate_is_refused(tmp_path: Path):
    """At 500 ticks a second 400 Hz are 100 Hz."""
    path = tmp_path / "fast.toml"
    for high_hz, fits in ((249.0, True), (400.0, False)):
        path.write_text(
            'title = "a"\nduration_s = 3.0\n[reference]\nshape = "sine-sweep"\n'
            f"low_hz = 0.5\nhigh_hz = {high_hz}\n"
        )
        if fits:
            assert np.isfinite(course(read_protocol(str(path)), Rig(), 1).targets_m).all()
        else:
            with pytest.raises(ValueError, match=r"reference\.high_hz = 400 is more than half"):
                course(read_protocol(str(path)), Rig(), 1)


def test_an_arm_named_twice_is_refused(tmp_path: Path):
    path = tmp_path / "twice.toml"
    path.write_text('title = "a"\nduration_s = 3.0\narms = ["with", "with"]\n')
    with pytest.raises(ValueError, match=r"name each once"):
        read_protocol(str(path))


@pytest.mark.parametrize("kind", ["drawn", "at-centre"])
def test_a_push_that_is_shorter_than_a_tick_is_refused(kind: str):
    """It would be none, and the run one without pushes."""
    asked = read_protocol("pushed")
    short = asked.pushes.model_copy(update={"kind": kind, "seconds": 1e-5})
    with pytest.raises(ValueError, match=r"pushes\.seconds = 1e-05 is less than a tick"):
        course(asked.model_copy(update={"pushes": short}), Rig(), 1)
