"""What the limiter promises, as one function of a limiter: for the real one and for its mutants."""

from itertools import product
from math import copysign, inf, isfinite, nan

V, ANGLE, SLEW, AHEAD_S, STALE_S = 6.0, 0.5, 3.0, 0.03, 0.05
WISHES = (nan, inf, -inf, 0.0, 1e-3, -1e-3, 2.5, -2.5, 3.0, -3.0, 6.0, -6.0, 6.5, -6.5, 1e9, -1e9)
THETAS = (nan, inf, 0.0, 0.3, -0.3, 0.5, -0.5, 0.501, -0.501, 4.0, -4.0)
RATES = (nan, -inf, 0.0, 2.0, -2.0, 7.0, -7.0, 20.0, -20.0, 1e3, -1e3)
LASTS = (nan, inf, 0.0, 1.0, -1.0, 4.0, -4.0, 6.0, -6.0, 9.0)
AGES = (0.0, STALE_S, 0.0501, inf, nan)


def expected(wish: float, theta: float, rate: float, last: float, age_s: float) -> float:
    """The promise in words, not in the limiter's own formulas."""
    if not all(map(isfinite, (wish, theta, rate, last))) or not age_s <= STALE_S:
        return 0.0  # unclear or stale
    size = min(abs(wish), V)
    grown = abs(last) if last * wish > 0.0 else 0.0
    size = min(size, grown + SLEW)
    side = copysign(1.0, wish)
    outermost = max(side * theta, side * (theta + AHEAD_S * rate))
    return 0.0 if outermost > ANGLE else side * size


def laws(limit) -> None:
    """AssertionError where `limit` breaks its promise on a grid that holds every edge."""
    for wish, theta, rate, last in product(WISHES, THETAS, RATES, LASTS):
        told = limit(wish, theta, rate, last, V, ANGLE, SLEW)
        assert told == expected(wish, theta, rate, last, 0.0), (wish, theta, rate, last, told)
    for wish, age_s in product(WISHES, AGES):
        told = limit(wish, 0.1, 0.0, 2.0, V, ANGLE, SLEW, age_s)
        assert told == expected(wish, 0.1, 0.0, 2.0, age_s), (wish, age_s, told)
    assert limit(9.0, 0.0, 0.0, 0.0, 2.0, 1.0, inf) == 2.0  # another table's limits
    assert limit(-9.0, 0.9, 0.0, 0.0, 2.0, 1.0, inf) == -2.0
