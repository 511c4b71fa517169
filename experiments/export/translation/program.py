"""Compiled functions of the rig as one C file, made from their Python source.

Numba and C see the same text, so the equations are written once. The order of every operation is
kept; products and sums are not to be contracted (-ffp-contract=off), as numba does not either.
What is translated: numbers, tuples, records, arrays of a fixed shape, `if`, `for ... in range`,
calls of other compiled functions. Anything else is an error that shows the Python.
"""

from typing import Any

from experiments.export.translation.c_types import Record, Tuple, Type, declared, struct_of
from experiments.export.translation.statements import Function

PRELUDE = """#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

/* Python's min and max of two numbers, its square, and 2^n for a whole n in [-1022, 1023]. */
static inline double least(double a, double b) { return b < a ? b : a; }
static inline double greatest(double a, double b) { return b > a ? b : a; }
static inline double square(double a) { return a * a; }
static inline double two_to(double n) { return ldexp(1.0, (int)n); }
"""


class Program:
    """Collects functions, with all that they call; `text` is the C."""

    def __init__(self, record: Record) -> None:
        self._record = record
        self._functions: dict[tuple[Any, tuple[Type, ...]], Function] = {}
        self._names: dict[tuple[Any, tuple[Type, ...]], str] = {}
        self._tuples: dict[str, Tuple] = {}

    def add(self, function: Any, arguments: tuple[Type, ...]) -> tuple[str, Type]:
        """Translate a compiled function for arguments of these types, once; its name and result.

        NotTranslatedError: it uses Python that the translation does not know.
        """
        key = (function, arguments)
        if key not in self._functions:
            name = f"rig_{function.py_func.__name__.lstrip('_')}"  # C's own have no such names
            if name in self._names.values():
                name += f"_{len(self._names)}"
            self._names[key] = name
            self._functions[key] = Function(function, name, arguments, self.add, self._tuple)
        made = self._functions[key]
        return self._names[key], made.result or Tuple(())

    def _tuple(self, found: Tuple) -> None:
        for item in found.items:
            if isinstance(item, Tuple):
                self._tuple(item)
        self._tuples.setdefault(found.name, found)

    @property
    def text(self) -> str:
        """The C file: structs, then every function after those that it calls."""
        tuples = []
        for name, found in self._tuples.items():
            fields = " ".join(f"{declared(t, f'e{i}')};" for i, t in enumerate(found.items))
            tuples.append(f"typedef struct {{ {fields} }} {name};")
        parts = [PRELUDE, "\n".join(struct_of(self._record)), "\n".join(tuples)]
        return "\n\n".join([*parts, *(f.text for f in self._functions.values())]) + "\n"
