"""Python expressions of a compiled function as C expressions with their types."""

import ast
import builtins
import math
from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np

from experiments.export.translation.c_types import (
    DOUBLE,
    INT,
    Array,
    Record,
    Tuple,
    Type,
    wider,
)

_IN_C: dict[Any, str] = {
    getattr(room, name): made
    for room in (math, np)
    for name, made in {
        "sin": "sin", "cos": "cos", "sqrt": "sqrt", "exp": "exp", "tanh": "tanh",
        "atan2": "atan2", "acos": "acos", "asin": "asin", "arcsin": "asin", "arccos": "acos",
    }.items()
    if hasattr(room, name)
}  # fmt: skip
_WHOLE = {math.floor: "floor", math.ceil: "ceil"}  # give whole numbers; numpy's give doubles
_COMPARED = {
    ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!=",
}  # fmt: skip
_REDUCED = {min: "least", max: "greatest"}


@dataclass(frozen=True)
class Value:
    """A C expression and its type."""

    type: Type
    code: str


_TOTAL = 3  # the argument of `with_own` to which it adds


class NotTranslatedError(NotImplementedError):
    """The function uses Python that the translation does not know."""


class Expressions:
    """Translates expressions; `variables` are the types of the function's own names so far.

    call(function, types) gives the name and the result's type of a compiled function in C;
    tuple_type(type) has a tuple's struct declared.
    """

    def __init__(
        self,
        globals_: dict[str, Any],
        variables: dict[str, Type],
        call: Callable[[Any, tuple[Type, ...]], tuple[str, Type]],
        tuple_type: Callable[[Tuple], None],
    ) -> None:
        self._globals, self._variables = globals_, variables
        self._call_compiled, self._declare = call, tuple_type

    def constant(self, node: ast.expr) -> Any:
        """What `node` is, where names of the module alone say it; None else."""
        if isinstance(node, ast.Constant):
            return node.value
        if isinstance(node, ast.Name) and node.id not in self._variables:
            return self._globals.get(node.id, getattr(builtins, node.id, None))
        if isinstance(node, ast.Attribute):
            base = self.constant(node.value)
            return getattr(base, node.attr) if isinstance(base, ModuleType) else None
        if isinstance(node, ast.BinOp | ast.UnaryOp | ast.Tuple):
            parts = [n for n in ast.iter_child_nodes(node) if isinstance(n, ast.expr)]
            if not any(self.constant(n) is None for n in parts):
                return eval(compile(ast.Expression(node), "constant", "eval"), self._globals)
        return None

    def of(self, node: ast.expr) -> Value:
        """The C expression of `node`. NotTranslatedError."""
        known = self.constant(node)
        if isinstance(known, bool | int | float | tuple):
            return self._number(known)
        kind = type(node).__name__
        method = getattr(self, f"_{kind.lower()}", None)
        if method is None:
            raise NotTranslatedError(f"{ast.unparse(node)} ({kind})")
        return method(node)

    def _number(self, value: Any) -> Value:
        if isinstance(value, tuple):
            return self.tuple([self._number(v) for v in value])
        if isinstance(value, bool | int):
            return Value(INT, f"INT64_C({int(value)})" if value >= 0 else f"(-INT64_C({-value}))")
        if math.isnan(value):
            return Value(DOUBLE, "NAN")
        if math.isinf(value):
            return Value(DOUBLE, "INFINITY" if value > 0 else "(-INFINITY)")
        return Value(DOUBLE, repr(value) if value >= 0 else f"({value!r})")

    def tuple(self, values: list[Value]) -> Value:
        """A tuple of these values."""
        found = Tuple(tuple(v.type for v in values))
        self._declare(found)
        return Value(found, f"(({found.name}){{{', '.join(v.code for v in values)}}})")

    def _tuple(self, node: ast.Tuple) -> Value:
        return self.tuple([self.of(e) for e in node.elts])

    def _name(self, node: ast.Name) -> Value:
        if node.id not in self._variables:
            raise NotTranslatedError(f"{node.id} has no value here")
        return Value(self._variables[node.id], node.id)

    def _binop(self, node: ast.BinOp) -> Value:
        a, b = self.of(node.left), self.of(node.right)
        if isinstance(node.op, ast.Pow):
            if self.constant(node.right) != 2:
                raise NotTranslatedError(f"{ast.unparse(node)}: only squares")
            return Value(DOUBLE, f"square({a.code})")
        signs = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/"}
        sign = signs.get(type(node.op))
        if sign is None or not {a.type, b.type} <= {DOUBLE, INT}:
            raise NotTranslatedError(ast.unparse(node))
        if sign == "/":
            return Value(DOUBLE, f"((double){a.code} / (double){b.code})")
        return Value(wider(a.type, b.type), f"({a.code} {sign} {b.code})")

    def _unaryop(self, node: ast.UnaryOp) -> Value:
        one = self.of(node.operand)
        if isinstance(node.op, ast.Not):
            return Value(INT, f"(!{one.code})")
        if isinstance(node.op, ast.USub):
            return Value(one.type, f"(-{one.code})")
        raise NotTranslatedError(ast.unparse(node))

    def _boolop(self, node: ast.BoolOp) -> Value:
        sign = " && " if isinstance(node.op, ast.And) else " || "
        return Value(INT, f"({sign.join(f'(int64_t){self.of(v).code}' for v in node.values)})")

    def _compare(self, node: ast.Compare) -> Value:
        sides = [self.of(n).code for n in (node.left, *node.comparators)]
        parts = [
            f"{sides[i]} {_COMPARED[type(op)]} {sides[i + 1]}" for i, op in enumerate(node.ops)
        ]
        return Value(INT, f"({' && '.join(f'({p})' for p in parts)})")

    def _ifexp(self, node: ast.IfExp) -> Value:
        test, a, b = self.of(node.test), self.of(node.body), self.of(node.orelse)
        return Value(wider(a.type, b.type), f"({test.code} ? {a.code} : {b.code})")

    def _attribute(self, node: ast.Attribute) -> Value:
        base = self.of(node.value)
        if not isinstance(base.type, Record):
            raise NotTranslatedError(ast.unparse(node))
        found = base.type.field(node.attr)
        place = f"{base.code}->{node.attr}"
        return Value(found, f"(&{place})" if isinstance(found, Record) else place)

    def _subscript(self, node: ast.Subscript) -> Value:
        if isinstance(node.value, ast.Attribute) and node.value.attr == "shape":
            shape = self.of(node.value.value).type
            at = self.constant(node.slice)
            assert isinstance(shape, Array)
            return self._number(shape.shape[at])
        base = self.of(node.value)
        if isinstance(base.type, Tuple):
            return self._item(node, base)
        if not isinstance(base.type, Array):
            raise NotTranslatedError(ast.unparse(node))
        return self._element(node, base, base.type)

    def _item(self, node: ast.Subscript, base: Value) -> Value:
        """An item, or the first items, of a tuple."""
        assert isinstance(base.type, Tuple)
        items = base.type.items
        if isinstance(node.slice, ast.Slice):
            at = range(len(items))[
                slice(*(None if n is None else self.constant(n) for n in _ends(node.slice)))
            ]
            return self.tuple([Value(items[i], f"{base.code}.e{i}") for i in at])
        at = self.constant(node.slice)
        if at is not None:
            return Value(items[at], f"{base.code}.e{range(len(items))[at]}")
        if set(items) != {DOUBLE}:
            raise NotTranslatedError(ast.unparse(node))
        numbers = ", ".join(f"{base.code}.e{i}" for i in range(len(items)))
        return Value(DOUBLE, f"((const double[]){{{numbers}}})[{self.of(node.slice).code}]")

    def _element(self, node: ast.Subscript, base: Value, array: Array) -> Value:
        """A number of an array, a row of it or a part of a row."""
        if isinstance(node.slice, ast.Slice):
            low, high = (self.constant(n) if n is not None else None for n in _ends(node.slice)[:2])
            at = range(array.shape[0])[slice(low, high)]
            return Value(Array((len(at), *array.shape[1:])), f"({base.code} + {at.start})")
        indices = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        place = " + ".join(
            f"{self.of(n).code} * {math.prod(array.shape[k + 1 :])}" for k, n in enumerate(indices)
        )
        left = array.shape[len(indices) :]
        if left:
            return Value(Array(left), f"({base.code} + ({place}))")
        return Value(DOUBLE, f"{base.code}[{place}]")

    def _call(self, node: ast.Call) -> Value:
        function = self.constant(node.func)
        name = getattr(function, "__name__", "")
        args = [self.of(n) for n in node.args]
        code = ", ".join(a.code for a in args)
        if function in _REDUCED:
            found, made = args[0].type, args[0].code
            for a in args[1:]:
                found, made = wider(found, a.type), f"{_REDUCED[function]}({made}, {a.code})"
            # both are functions of doubles: whole numbers below 2^53 go through them unchanged
            return Value(found, made if found == DOUBLE else f"((int64_t){made})")
        if function is abs:
            return Value(args[0].type, f"{'fabs' if args[0].type == DOUBLE else 'llabs'}({code})")
        if function in (int, round):
            return Value(INT, f"((int64_t){'' if function is int else 'rint'}({code}))")
        if function is np.floor:
            return Value(DOUBLE, f"floor({code})")
        if function in _WHOLE:
            return Value(INT, f"((int64_t){_WHOLE[function]}({code}))")
        if function in _IN_C:
            return Value(DOUBLE, f"{_IN_C[function]}({code})")
        if name in ("_fma", "_power"):  # made of machine code by the compiler, not of Python
            return Value(DOUBLE, f"{'fma' if name == '_fma' else 'two_to'}({code})")
        if name == "with_own":  # calls an equation that is compiled in Python's process
            return args[_TOTAL]
        if not hasattr(function, "py_func"):
            raise NotTranslatedError(ast.unparse(node))
        made, found = self._call_compiled(function, tuple(a.type for a in args))
        return Value(found, f"{made}({code})")


def _ends(node: ast.Slice) -> tuple[ast.expr | None, ...]:
    return node.lower, node.upper, node.step
