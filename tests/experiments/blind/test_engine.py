"""The disturbed run: without a disturbance the house's own, with one another one."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from experiments.blind import engine, uncatalogued_effects
from experiments.blind.draws import TrialPlan, draw_trial
from experiments.blind.logs import own_run, process, spoiled
from experiments.blind.trial import Noise
from experiments.runs.assemble import known, load_rig
from experiments.runs.protocol import course, read_protocol
from rig.control.controllers import COMPENSATORS
from rig.parameters import Rig
from rig.simulation.simulate import draw, simulate

RIG = load_rig(None)
STEPS = TrialPlan(1, 1, 3, protocols=("steps",))


def short(seconds: float = 4.0):
    return read_protocol("steps").model_copy(update={"duration_s": seconds})


TABLES = ("hobby-two-servos", "bus-servos", "three-arms")
RUNS = [(RIG, "steps"), (RIG, "free-release"), (RIG, "pushed")]
RUNS += [(load_rig(Path(name)), "steps") for name in TABLES]


@pytest.mark.parametrize(("rig", "name"), RUNS, ids=["steps", "free-release", "pushed", *TABLES])
def test_undisturbed_it_is_the_houses_own_run_bit_for_bit(rig: Rig, name: str):
    way = course(read_protocol(name).model_copy(update={"duration_s": 7.0}), rig, 5)
    draws = draw(np.random.default_rng(1), rig, way)
    own = simulate(rig, known(rig), COMPENSATORS["without"], way, draws)
    quiet = np.zeros((len(draws.tachometer), 4))
    other = engine.disturbed(rig, known(rig), COMPENSATORS["without"], way, draws, noise=quiet)
    assert own.outcome == other.outcome
    np.testing.assert_array_equal(own.log.rows, other.log.rows)


def test_noise_of_another_length_is_refused():
    way = course(short(), RIG, 5)
    draws = draw(np.random.default_rng(1), RIG, way)
    with pytest.raises(ValueError, match="noise has shape"):
        engine.disturbed(RIG, RIG, 0, way, draws, noise=np.zeros((3, 4)))


@pytest.mark.parametrize("name", uncatalogued_effects.NAMES)
def test_every_stranger_changes_the_run(name: str):
    trial = draw_trial(STEPS, 4, "nothing")
    trial = replace(trial, noise=Noise())
    stranger = uncatalogued_effects.draw(name, 3.0, np.random.default_rng(2), seconds=30.0)
    with_it = replace(trial, stranger=stranger)
    one, other = (own_run(t, "steps", 11) for t in (trial, with_it))
    assert one.outcome == other.outcome == "completed"
    channel = ("theta_{}_rad" if name == "cable" else "ball_{}_m").format("xy"[stranger["axis"]])
    seen = ~np.isnan(one.log[channel])
    moved = np.abs(one.log[channel] - other.log[channel])[seen]
    assert moved.max() > (0.01 if name == "cable" else 0.001)
    if name == "once":  # nothing before it begins
        before = one.log["t_s"][seen] < stranger["from_s"]
        assert before.any()
        assert moved[before].max() == 0.0


def pull(stranger: dict, x: float, y: float, t: float = 0.0, steps: int = 1):
    """What a stranger does to a ball at rest at (x, y): (4,); and the heavy side after."""
    from rig.plant import plant, plant_record

    g, out = uncatalogued_effects.disturbance_record(stranger), np.zeros(4)
    own = g["heavy_side"].copy()
    s, p = plant.rest((x, y)), plant_record.pack(RIG)
    for _ in range(steps):
        out[:] = 0.0
        engine.meddle(g, own, s, p, t, 0.002, out)
    return out, own


def base(name: str, **more) -> dict:
    drawn = uncatalogued_effects.draw(name, 2.0, np.random.default_rng(0), seconds=30.0)
    return drawn | {"place_m": [0.01, 0.0], "direction": [1.0, 0.0]} | more


def test_a_dent_pulls_towards_its_place_most_at_its_width():
    dent = base("dent", width_m=0.02)
    assert pull(dent, 0.01, 0.0)[0][0] == 0.0
    assert pull(dent, 0.03, 0.0)[0][0] == pytest.approx(-dent["size"])
    assert pull(dent, -0.01, 0.0)[0][0] == pytest.approx(dent["size"])
    assert abs(pull(dent, 0.13, 0.0)[0][0]) < 1e-5


def test_a_rhythm_has_its_frequency_and_a_cable_one_side():
    rhythm = base("rhythm", hz=2.0, phase_rad=0.0)
    assert pull(rhythm, 0, 0, 0.125)[0][0] == pytest.approx(rhythm["size"])
    assert pull(rhythm, 0, 0, 0.625)[0][0] == pytest.approx(rhythm["size"])
    slack = base("cable", axis=0, bend_rad=0.01)
    assert pull(slack, 0, 0)[0][2] == 0.0
    tight = base("cable", axis=0, bend_rad=-0.01)
    assert pull(tight, 0, 0)[0][2] == pytest.approx(-0.01 * tight["size"])


def test_the_wind_blows_on_its_side():
    wind = base("draught")
    assert pull(wind, 0.1, 0.0)[0][0] < 0.9 * -wind["drag_1_m"] * wind["size"] ** 2
    assert abs(pull(wind, -0.1, 0.0)[0][0]) < 1e-4


def test_an_unbalanced_ball_falls_to_its_heavy_side_which_turns_with_it():
    from rig.plant import plant, plant_record

    ball = base("unbalanced_ball", heavy_side=[1.0, 0.0, 0.0])
    out, _ = pull(ball, 0, 0)
    assert out[0] == pytest.approx(RIG.ball.rolling_factor * 9.81 * ball["size"])
    # Rolling a quarter turn towards +x brings the heavy side down.
    g, p, s = uncatalogued_effects.disturbance_record(ball), plant_record.pack(RIG), plant.rest()
    own, quarter = g["heavy_side"].copy(), 0.5 * np.pi * RIG.ball.radius_m
    s[plant.BALL_W, 0] = 0.05
    for _ in range(round(quarter / 0.05 / 1e-4)):
        engine.meddle(g, own, s, p, 0.0, 1e-4, np.zeros(4))
    np.testing.assert_allclose(own, [0.0, 0.0, -1.0], atol=2e-3)


def test_process_noise_has_one_power_at_every_rate_and_a_coloured_camera_its_size():
    rng = np.random.default_rng(0)
    slow, fast = process(rng, 40000, 100, 1.0), process(rng, 40000, 400, 1.0)
    np.testing.assert_allclose(slow.var(axis=0) / 100, fast.var(axis=0) / 400, rtol=0.05)
    white = np.column_stack([rng.standard_normal((40000, 2)), rng.random(40000)])
    coloured = spoiled(white, Noise(colour=0.6), rng)[:, :2]
    np.testing.assert_allclose(coloured.std(axis=0), 1.0, rtol=0.05)
    rho = np.mean(coloured[1:] * coloured[:-1], axis=0)
    np.testing.assert_allclose(rho, 0.6, atol=0.03)


def test_dropped_frames_come_in_bursts_too():
    trial = replace(draw_trial(STEPS, 4, "nothing"), noise=Noise(dropped=0.2))
    log = own_run(trial, "steps", 11).log
    exposed = log["ball_exposed_s"][~np.isnan(log["ball_exposed_s"])]
    assert len(exposed) / (30 * 60) == pytest.approx(0.8, abs=0.05)
    assert np.diff(exposed).max() > 4.5 / 60
