"""Sine, cosine and decaying exponential as plain arithmetic, without a call or a branch.

The compiler can then work on several runs at once (`vectorized_plants.py`), and one run and many
give the same bits. Within 1 ulp or so: ranges are reduced by Cody and Waite's splitting of pi/2 and
ln 2, the polynomials for sine and cosine are fdlibm's (Sun Microsystems, 1993), that of exp is
Taylor's.
"""

from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

from rig.compiled import inlined

PER_HALF_PI = 0.6366197723675814
HALF_PI_HIGH, HALF_PI_LOW = 1.5707963267341256, 6.077100506506192e-11  # high: 33 bits, n*high exact
S3, S5, S7 = -1.66666666666666324348e-01, 8.33333333332248946124e-03, -1.98412698298579493134e-04
S9, S11, S13 = 2.75573137070700676789e-06, -2.50507602534068634195e-08, 1.58969099521155010221e-10
C4, C6, C8 = 4.16666666666666019037e-02, -1.38888888888741095749e-03, 2.48015872894767294178e-05
C10, C12, C14 = -2.75573143513906633035e-07, 2.08757232129817482790e-09, -1.13596475577881948265e-11

PER_LN2, LN2_HIGH, LN2_LOW = (
    1.4426950408889634,
    6.93147180369123816490e-01,
    1.90821492927058770002e-10,
)
E2, E3, E4, E5, E6, E7 = 1 / 2, 1 / 6, 1 / 24, 1 / 120, 1 / 720, 1 / 5040
E8, E9, E10, E11, E12, E13 = (
    1 / 40320,
    1 / 362880,
    1 / 3628800,
    1 / 39916800,
    1 / 479001600,
    1 / 6227020800,
)
SMALLEST_EXPONENT = 708.0  # exp(-708) = 3e-308 is the last normal number
WHOLE = 6755399441055744.0  # 1.5 * 2^52: adding it leaves a whole number in the last bits


def _fma(typingctx, a, b, c):
    """a * b + c, rounded once: said in the source, so that it is the same everywhere."""

    def generate(context, builder, signature, args):
        return builder.fma(*args)

    return types.float64(types.float64, types.float64, types.float64), generate


def _power(typingctx, n):
    """2.0**n for a whole number n in [-1022, 1023], written into the exponent's bits."""

    def generate(context, builder, signature, args):
        double, word = ir.DoubleType(), ir.IntType(64)
        whole = builder.fadd(args[0], ir.Constant(double, WHOLE + 1023.0))
        bits = builder.shl(builder.bitcast(whole, word), ir.Constant(word, 52))
        return builder.bitcast(bits, double)

    return types.float64(types.float64), generate


fma: Any = intrinsic(_fma)  # Any: callers leave the first argument out
_two_to: Any = intrinsic(_power)


@inlined
def sine_cosine(x):
    """(sin(x), cos(x)) for |x| < 1e5, x in rad; within about 1 ulp."""
    n = np.floor(x * PER_HALF_PI + 0.5)
    r = fma(-n, HALF_PI_LOW, fma(-n, HALF_PI_HIGH, x))
    z = r * r
    s = fma(z, fma(z, fma(z, fma(z, fma(z, S13, S11), S9), S7), S5), S3)
    s = fma(z * r, s, r)
    c = fma(z, fma(z, fma(z, fma(z, fma(z, C14, C12), C10), C8), C6), C4)
    c = fma(z, fma(z, c, -0.5), 1.0)
    half = 0.5 * n
    pair = np.floor(half)
    odd = half != pair
    back = 0.5 * pair != np.floor(0.5 * pair)
    sine = c if odd else s
    cosine = s if odd else c
    return -sine if back else sine, -cosine if back != odd else cosine


@inlined
def sine(x):
    """sin(x) for |x| < 1e5, x in rad."""
    return sine_cosine(x)[0]


@inlined
def cosine(x):
    """cos(x) for |x| < 1e5, x in rad."""
    return sine_cosine(x)[1]


@inlined
def decaying(x):
    """exp(-x) for x >= 0; x above SMALLEST_EXPONENT is taken as SMALLEST_EXPONENT."""
    x = min(x, SMALLEST_EXPONENT)
    n = np.floor(x * PER_LN2 + 0.5)
    r = fma(n, LN2_LOW, fma(n, LN2_HIGH, -x))
    e = fma(r, fma(r, fma(r, fma(r, fma(r, E13, E12), E11), E10), E9), E8)
    e = fma(r, fma(r, fma(r, fma(r, fma(r, fma(r, e, E7), E6), E5), E4), E3), E2)
    return fma(r * r, e, r + 1.0) * _two_to(-n)
