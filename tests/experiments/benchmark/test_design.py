"""What a set holds: the shares add up, the seed decides, the order tells nothing."""

from collections import Counter

import numpy as np
import pytest

from experiments.benchmark.design import (
    ENGINES,
    KINDS,
    Case,
    cases_of,
    draw_case,
    engine_of,
    kind_of,
)
from experiments.blind.sizes import FACTORS, REAL_FACTORS, smallest
from rig.effects import BY_NAME, check, check_servos


def test_three_hundred_logs_are_shared_out_as_stated():
    cases = cases_of(300, 1)
    assert [case.number for case in cases] == list(range(1, 301))
    engines, kinds = Counter(c.engine for c in cases), Counter(c.kind for c in cases)
    for name, share in ENGINES.items():
        assert abs(engines[name] - 300 * share) <= len(KINDS)
    for name, kind in KINDS.items():
        assert abs(kinds[name] - 300 * kind.share) <= len(ENGINES)
    assert sum(ENGINES.values()) == pytest.approx(1)
    assert sum(kind.share for kind in KINDS.values()) == pytest.approx(1)


def test_the_seed_decides_the_order():
    assert cases_of(60, 4) == cases_of(60, 4)
    assert cases_of(60, 4) != cases_of(60, 5)
    kinds = [list(KINDS).index(case.kind) for case in cases_of(300, 4)]
    # A random order: the kinds do not follow the numbers (|r| of 300 is below 0.2 by 3.5 sigma).
    assert abs(np.corrcoef(kinds, np.arange(300))[0, 1]) < 0.2
    assert len(cases_of(7, 1)) == 7


@pytest.mark.parametrize("engine", ["own", "foreign", "positions"])
@pytest.mark.parametrize("kind", list(KINDS))
def test_a_case_is_what_it_says(engine: str, kind: str):
    for number in range(1, 4):
        trial = draw_case(Case(number, engine, kind), 12)
        assert (engine_of(trial), kind_of(trial)) == (engine, kind)
        assert trial.name == f"case-{number:04d}"
        assert len(trial.protocols) == len(trial.seeds) == 1
        count = {"two effects": 2, "five effects": 5, "healthy": 0, "an effect without a name": 0}
        assert len(trial.hidden) == count.get(kind, 1)
        check(trial.plant["effects"])
        check_servos(trial.hidden, trial.plant["servo"]["kind"])
        assert trial.believed["effects"] == {}
        if len(trial.hidden) == 1 and "saturation" not in trial.hidden:
            [(name, by_axis)] = trial.hidden.items()
            key = BY_NAME[name].parameters[0].key
            low, high = REAL_FACTORS if "real" in kind else FACTORS
            for values in by_axis.values():
                size = values.get(key, values.get("positive_V", 0.0))
                assert low - 1e-9 <= abs(size) / smallest(name) <= high + 1e-9


def test_another_attempt_draws_everything_anew():
    case = Case(5, "foreign", "two effects")
    assert draw_case(case, 3) == draw_case(case, 3)
    assert draw_case(case, 3).seeds != draw_case(case, 3, attempt=1).seeds
