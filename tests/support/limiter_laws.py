"""What the limiter promises, as one function of a limiter: for the real one and for its mutants."""

from itertools import product
from math import copysign, inf, isclose, isfinite, nan

V, ANGLE, SLEW, STALE_S, TAPER = 6.0, 0.5, 3.0, 0.05, 0.04
STOPS = DELAY_S, TAU_S, TOP = (0.02, 0.1, 9.0)  # also as `Braking`, for who asks by name
WISHES = (nan, inf, -inf, 0.0, 1e-3, -1e-3, 2.5, -2.5, 3.0, -3.0, 6.0, -6.0, 6.5, -6.5, 1e9, -1e9)
THETAS = (nan, inf, 0.0, 0.3, -0.3, 0.47, -0.47, 0.5, -0.5, 0.52, -0.52, 0.6, -0.6, 4.0, -4.0)
RATES = (nan, -inf, 0.0, 0.5, -0.5, 2.0, -2.0, 7.0, -7.0, 20.0, -20.0, 1e3, -1e3)
LASTS = (nan, inf, 0.0, 1.0, -1.0, 4.0, -4.0, 6.0, -6.0, 9.0)
AGES = (0.0, STALE_S, 0.0501, inf, nan)


def expected(wish, theta, rate, last, age_s, free=0.0) -> float:
    """The promise in words, not in the limiter's own formulas."""
    if not all(map(isfinite, (wish, theta, rate, last))) or not age_s <= STALE_S:
        return 0.0  # unclear or stale
    most = {}
    for side in (1.0, -1.0):  # towards either limit
        towards = max(side * rate, side * free, 0.0)  # a motor in its play is not seen
        way = DELAY_S * towards + TAU_S * towards**2 / (2 * TOP + towards)
        room = ANGLE - side * theta - way
        most[side] = V if room >= TAPER else max(room / TAPER, -1.0) * V
    volts = max(min(wish, most[1.0]), -most[-1.0])
    grown = abs(last) if last * volts > 0.0 else 0.0
    return copysign(min(abs(volts), grown + SLEW), volts)


def laws(limit, stops) -> None:
    """AssertionError where `limit` breaks its promise on a grid that holds every edge.

    stops: STOPS as the limiter's `Braking`.
    """
    for wish, theta, rate, last in product(WISHES, THETAS, RATES, LASTS):
        told = limit(wish, theta, rate, last, V, ANGLE, SLEW, stops)
        right = expected(wish, theta, rate, last, 0.0)
        assert isclose(told, right, rel_tol=1e-9, abs_tol=1e-9), (wish, theta, rate, last, told)
    for wish, theta, rate, free in product(WISHES, THETAS, RATES[1:6], RATES[2:-2]):
        told = limit(wish, theta, rate, 1.0, V, ANGLE, SLEW, stops, 0.0, free)
        right = expected(wish, theta, rate, 1.0, 0.0, free)
        assert isclose(told, right, rel_tol=1e-9, abs_tol=1e-9), (wish, theta, rate, free, told)
    for wish, age_s in product(WISHES, AGES):
        told = limit(wish, 0.1, 0.0, 2.0, V, ANGLE, SLEW, stops, age_s)
        assert told == expected(wish, 0.1, 0.0, 2.0, age_s), (wish, age_s, told)
    assert limit(9.0, 0.0, 0.0, 0.0, 2.0, 1.0, inf, stops) == 2.0  # another table's limits
    assert limit(-9.0, 0.9, 0.0, 0.0, 2.0, 1.0, inf, stops) == -2.0
    assert limit(9.0, 1e300, 1e300, 0.0, 2.0, inf, inf, stops) == 2.0  # a table without a limit


def angle_laws(limit_angle) -> None:
    """AssertionError where `limit_angle` breaks its promise on a grid that holds every edge."""
    angles = (nan, inf, -inf, 0.0, 0.1, -0.1, 0.5, -0.5, 0.9, -0.9)
    for wish, last, age_s in product(angles, angles, AGES):
        held = last if isfinite(last) else 0.0  # the servo stays where it was told to go
        told = wish if isfinite(wish) and age_s <= STALE_S else held
        right = min(max(told, -ANGLE), ANGLE)
        found = limit_angle(wish, last, ANGLE, age_s)
        assert found == right, (wish, last, age_s, found)
    assert limit_angle(0.3, 0.1, ANGLE) == 0.3  # an estimate of now


def late_laws(limits) -> None:
    """AssertionError where the module `limits` reckons otherwise with ticks that come late."""
    assert limits.lateness(0.0, 0.001, 0.002) == 0.0  # half a tick is none
    assert limits.lateness(0.0, 0.0011, 0.002) == 0.0011
    assert limits.lateness(0.004, 0.001, 0.002) == 0.97 * 0.004  # forgotten by and by
    assert limits.lateness(0.01, 0.005, 0.002) == 0.97 * 0.01
    assert limits.lateness(0.0, inf, 0.002) == STALE_S  # older estimates give no volts at all
    stops = limits.delayed(limits.Braking(*STOPS), 0.004)
    assert isclose(stops.delay_s, DELAY_S + 2.5 * 0.004)
    assert stops[1:] == STOPS[1:]
