"""Python that numba compiles and its C give the same numbers, and what is not known is refused."""

import ctypes
import subprocess
from math import ceil, floor, inf, nan
from pathlib import Path

import numpy as np
import pytest

from experiments.export.translation.c_types import DOUBLE, INT, Array, Record
from experiments.export.translation.expressions import NotTranslatedError
from experiments.export.translation.program import Program
from rig.compiled import compiled
from rig.plant.effect_equations import camera_unmap, friction_volts, stick
from rig.plant.elementary_functions import decaying, sine_cosine
from tests.support.parts import need

need("cc")
NONE = Record("nothing", np.dtype([("unused", np.float64)]))
LEVELS = (0.5, 1.5, 2.5)


@compiled
def swapped(x, y):
    x, y = y, x + y
    return x, y


@compiled
def whole(x, y):
    return (floor(x) + ceil(y)) * 1.0 + int(round(x)) - np.floor(y)


@compiled
def branches(x, y):
    if 0.0 < x <= 1.0 and not y > 2.0:
        return LEVELS[int(y)]
    total = 0.0
    for i in range(3, 0, -1):
        total += i * x - (y if i != 2 else -y) ** 2
    return total


@compiled
def rows(x, y):
    m = np.empty((2, 3))
    for i in range(2):
        for k in range(3):
            m[i, k] = x * i - y * k
    kept = m[1].copy()
    m[1, 0] = 9.0  # after the copy
    shifted = kept + x
    kept[:] = m[0]
    return shifted[0] * kept[1] + m[1, 0]


@compiled
def limits(x, y):
    return max(x, y, 0.0) + min(x, -y) + abs(x - y)


def in_c(function, count: int, tmp_path: Path):
    """The function of `count` doubles as C; tuples give their items."""
    program = Program(NONE)
    name, result = program.add(function, (DOUBLE,) * count)
    items = getattr(result, "items", (result,))
    args = ", ".join(f"double a{i}" for i in range(count))
    call = f"{name}({', '.join(f'a{i}' for i in range(count))})"
    fill = (
        "out[0] = r;"
        if result in (DOUBLE, INT)
        else " ".join(f"out[{i}] = r.e{i};" for i in range(len(items)))
    )
    kind = getattr(result, "name", "double")
    text = f"{program.text}\nvoid run({args}, double *out) {{ {kind} r = {call}; {fill} }}\n"
    source, library = tmp_path / "f.c", tmp_path / "f.so"
    source.write_text(text)
    flags = ["-O2", "-std=c99", "-ffp-contract=off", "-shared", "-fPIC"]
    subprocess.run(["cc", *flags, "-o", library, source, "-lm"], check=True)
    run = ctypes.CDLL(str(library)).run
    run.argtypes, run.restype = [ctypes.c_double] * count + [ctypes.c_void_p], None

    def call_it(*values: float) -> tuple[float, ...]:
        out = np.zeros(len(items))
        run(*values, out.ctypes.data)
        return tuple(out)

    return call_it


@pytest.mark.parametrize(
    ("function", "count"),
    [
        (swapped, 2),
        (whole, 2),
        (branches, 2),
        (limits, 2),
        pytest.param(rows, 2, marks=pytest.mark.slow),  # numba takes 10 s for its arrays
        (sine_cosine, 1),
        (decaying, 1),
        (stick, 2),
        (friction_volts, 4),
        (camera_unmap, 5),
    ],
    ids=lambda v: getattr(v, "__name__", None),
)
def test_c_gives_the_bits_of_the_compiled_function(function, count: int, tmp_path: Path):
    made, rng = in_c(function, count, tmp_path), np.random.default_rng(3)

    @compiled
    def called(values):
        return function(*values)

    for _ in range(200):
        values = tuple(float(v) for v in rng.uniform(0.0, 3.0, count))
        expected = np.atleast_1d(called(values))
        assert np.array_equal(made(*values), expected), values


def test_the_greater_of_a_number_and_an_undefined_one_is_pythons(tmp_path: Path):
    made = in_c(limits, 2, tmp_path)
    assert made(inf, 1.0)[0] == limits.py_func(inf, 1.0)
    assert np.isnan(made(nan, 1.0)[0])


def test_python_that_is_not_known_is_refused_with_its_text():
    @compiled
    def listed(x):
        return len([x, x])

    with pytest.raises(NotTranslatedError, match="List"):
        Program(NONE).add(listed, (DOUBLE,))


def test_an_array_is_not_returned():
    @compiled
    def made(a):
        return a

    with pytest.raises(NotTranslatedError, match="let the caller give the array"):
        Program(NONE).add(made, (Array((2,)),))
