"""One decorator for every compiled function of the rig; `vision.compiled` keeps their cache.

No fast-math: the loop calls the functions one by one, the batch kernel inlines them, and both must
give the same bits.
"""

from functools import partial

import numba

import vision.compiled  # the cache's folder is named before the first function is compiled

assert vision.compiled

_options = {"error_model": "numpy", "nogil": True, "no_cfunc_wrapper": True}
compiled = partial(numba.njit, cache=True, **_options)()
# For what stands inside a kernel's innermost loop: a call there would keep the compiler from
# working on several runs at once. It lives in its callers' cache.
inlined = partial(numba.njit, forceinline=True, **_options)()
