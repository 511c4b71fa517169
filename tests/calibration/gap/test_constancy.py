"""What the model takes for a constant, and changes: logs of an independent table whose columns are
altered as a change would."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from calibration.gap import constancy
from calibration.gap.constancy import changing
from calibration.gap.model.change import Change
from calibration.gap.model.fit import evaluate
from calibration.gap.model.parameters import BALL, NominalModel
from calibration.gap.model.state import State, refit
from calibration.gap.name.stepwise import Accepted, settled_baseline
from rig.log import Log
from tests.support.gap.tables import RIG, evidence_of, foreign, released, without_columns
from tests.support.worlds.logs import table_log

SECONDS = 40.0


def change_of(*logs: Log) -> Change | None:
    """The change on logs beside which only what a healthy table may have is fitted."""
    state = released(evidence_of(*logs))
    base = settled_baseline(state.evidence, state.nominal)
    return changing(refit(base, base.bounds(base.evidence.outputs)))


def altered(log: Log, **columns: np.ndarray) -> Log:
    return Log.from_columns({**log.columns, **columns})


def heating(log: Log, share: float) -> Log:
    """Motors whose gain falls evenly by `share`: the motion took more volts."""
    more = 1.0 + share * np.linspace(0.0, 1.0, len(log))
    volts = {n: v * more for n, v in log.columns.items() if n.startswith("voltage")}
    return altered(log, **volts)


def late_camera(log: Log, late_s: float) -> Log:
    """A camera that from the middle of the run is `late_s` later."""
    t, ball = log.columns["t_s"], {}
    late = np.interp(t, [0.0, t[-1] / 2, t[-1] / 2 + 0.01], [0.0, 0.0, late_s])
    for name in ("ball_x_m", "ball_y_m"):
        here = log.columns[name]
        seen = np.isfinite(here)
        ball[name] = np.where(seen, np.interp(t - late, t[seen], here[seen]), np.nan)
    return altered(log, **ball)


@pytest.mark.parametrize(("on_y_rad", "told"), [(5e-6, ""), (0.0176, "its size on y")])
def test_a_size_that_is_not_told_is_not_asked_whether_it_is_constant(
    on_y_rad: float, told: str, monkeypatch: pytest.MonkeyPatch
):
    """A play of x alone was doubted since nearly nothing on y changed by 3600 times itself."""
    nominal = NominalModel(RIG, load_friction=False)
    setting = {"gear_backlash.play_rad.x": 0.0176, "gear_backlash.play_rad.y": on_y_rad}
    monkeypatch.setattr(constancy, "_slopes", lambda state, output: None)
    monkeypatch.setattr(constancy, "_ramps", lambda state, output: [("angle", np.zeros(1))])
    found = {"x": SimpleNamespace(chance=0.5, sizes=np.zeros(1))}
    other = SimpleNamespace(chance=0.0, sizes=np.array([0.018]))
    monkeypatch.setattr(
        constancy,
        "_beside",
        lambda state, output, slopes, names, along: found.get(names[0][-1], other),
    )
    state: Any = SimpleNamespace(
        nominal=nominal, fit=SimpleNamespace(setting=setting), bounds=lambda outputs: setting
    )
    play = Accepted("gear_backlash", ("x", "y"), 9.0, ())
    assert constancy.inconstancy(state, play, "servo_y").startswith(told)
    assert bool(constancy.inconstancy(state, play, "servo_y")) == bool(told)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"felt_m_s2": 0.06}, "with the ball's place along x"),
        ({"rolling_m_s2": 0.04}, ""),
    ],
)
def test_what_brakes_on_one_half_of_the_plate_is_no_constant(changes: dict[str, float], told: str):
    """From the centre outwards the mean of both halves is even."""
    log = Log.from_columns(table_log(np.random.default_rng(11), {}, changes, {}))
    state = released(evidence_of(log), ("rolling_resistance", "xy"))
    state = refit(state, state.bounds((BALL,)))
    one = Accepted("rolling_resistance", ("xy",), 99.0, ())
    assert constancy.inconstancy(state, one, BALL).endswith(told)
    assert bool(constancy.inconstancy(state, one, BALL)) == bool(told)


@pytest.mark.parametrize("seed", range(3))
def test_a_healthy_table_has_constants(seed: int):
    assert change_of(foreign("steps", seed=seed, effects={}, duration_s=SECONDS)) is None


@pytest.mark.parametrize("share", [0.04, 0.16])
def test_motors_that_heat_up_change_their_gain_where_they_leave_their_tolerance(share: float):
    log = heating(foreign("steps", seed=5, effects={}, duration_s=SECONDS), share)
    change = change_of(log)
    if share < 0.05:
        assert change is None
        return
    assert change is not None
    assert change.channel.startswith("servo")
    assert change.parameter.key == "gain_rad_s_V"
    assert change.end / change.begin == pytest.approx(1.0 / (1.0 + share), rel=0.03)


def test_a_camera_that_becomes_late_changes_its_delay():
    log = foreign("steps", seed=6, effects={}, duration_s=2 * SECONDS)
    change = change_of(late_camera(log, 0.03))
    assert change is not None
    assert change.parameter.name == "camera_delay.extra_s.xy"
    assert change.end - change.begin == pytest.approx(0.03, abs=0.01)


def test_a_level_that_differs_between_runs_is_told_of_the_runs():
    levels = [{}, {"level_offset": {"x": {"slope_rad": 0.004}}}]
    logs = [foreign("steps", seed=7 + i, effects=e, duration_s=20.0) for i, e in enumerate(levels)]
    change = change_of(*(without_columns(log, "voltage") for log in logs))
    assert change is not None
    assert (change.parameter.effect, change.runs) == ("level_offset", 2)
    assert change.channel == "ball_x"
    assert change.end - change.begin == pytest.approx(0.004, rel=0.3)


@pytest.mark.parametrize("lacks", ["weight", "freedom"])
def test_what_nothing_is_known_of_has_no_change(lacks: str):
    evidence = evidence_of(foreign("steps", seed=1, effects={}, duration_s=5.0))
    moving = () if lacks == "weight" else (BALL,)
    masks = {o: m * (o in moving) for o, m in evidence.masks.items()}
    evidence = replace(evidence, masks=masks)
    fixed = dict.fromkeys(released(evidence).nominal.catalogue, 0.0)
    nominal = NominalModel(RIG, load_friction=False, tolerances=fixed)
    state = State(evidence, nominal, evaluate(evidence, nominal, {}, moving))
    assert evidence.outputs == moving
    assert not state.bounds((BALL,))
    assert changing(state) is None
