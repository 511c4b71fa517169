"""A compiled function's statements as C, with the types of its variables found on the way."""

import ast
import inspect
import textwrap
from collections.abc import Callable
from typing import Any

import numpy as np

from experiments.export.translation.c_types import (
    DOUBLE,
    INT,
    Array,
    Scalar,
    Tuple,
    Type,
    declared,
    wider,
)
from experiments.export.translation.expressions import Expressions, NotTranslatedError, Value

_SIGNS = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*"}


class Function:
    """One compiled function for arguments of these types, as C.

    result: type of what it returns, None for nothing; head, text: its prototype and its definition.
    """

    def __init__(
        self,
        function: Any,
        name: str,
        arguments: tuple[Type, ...],
        call: Callable[[Any, tuple[Type, ...]], tuple[str, Type]],
        tuple_type: Callable[[Tuple], None],
    ) -> None:
        python = function.py_func
        tree = ast.parse(textwrap.dedent(inspect.getsource(python))).body[0]
        assert isinstance(tree, ast.FunctionDef)
        names = [a.arg for a in tree.args.args]
        self._given = dict(zip(names, arguments, strict=True))
        self.variables: dict[str, Type] = dict(self._given)
        self.result: Type | None = None
        self._expressions = Expressions(python.__globals__, self.variables, call, tuple_type)
        self._declare = tuple_type
        body = tree.body[1:] if ast.get_docstring(tree) else tree.body
        before, lines = None, []
        while before != (before := (dict(self.variables), self.result)):  # until no type changes
            lines = self._block(body, 1)
        what = "void" if self.result is None else declared(self.result, "").strip()
        arguments_c = ", ".join(declared(t, n) for n, t in self._given.items())
        self.head = f"static inline {what} {name}({arguments_c})"
        own = [(n, t) for n, t in self.variables.items() if n not in self._given]
        declarations = [f"    {_local(t, n)};" for n, t in own]
        self.text = "\n".join([f"{self.head} {{", *declarations, *lines, "}"])

    def _set_type(self, name: str, found: Type) -> None:
        known = self.variables.get(name)
        new = found if known is None else wider(known, found)
        if name in self._given and new != known:
            raise NotTranslatedError(f"the argument {name} changes its type")
        if isinstance(new, Tuple):
            self._declare(new)
        self.variables[name] = new

    def _block(self, body: list[ast.stmt], depth: int) -> list[str]:
        lines = []
        for node in body:
            method = getattr(self, f"_{type(node).__name__.lower()}", None)
            if method is None:
                raise NotTranslatedError(ast.unparse(node))
            lines += ["    " * depth + line if depth else line for line in method(node)]
        return lines

    # --- one method a kind of statement, each giving lines -----------------------------------

    def _pass(self, node: ast.Pass) -> list[str]:
        return [";"]

    def _expr(self, node: ast.Expr) -> list[str]:
        return [f"{self._expressions.of(node.value).code};"]

    def _return(self, node: ast.Return) -> list[str]:
        if node.value is None:
            return ["return;"]
        value = self._expressions.of(node.value)
        if isinstance(value.type, Array):
            raise NotTranslatedError(f"{ast.unparse(node)}: let the caller give the array")
        self.result = value.type if self.result is None else wider(self.result, value.type)
        return [f"return {value.code};"]

    def _if(self, node: ast.If) -> list[str]:
        test = self._expressions.of(node.test).code
        lines = [f"if ({test}) {{", *self._block(node.body, 1)]
        if node.orelse:
            lines += ["} else {", *self._block(node.orelse, 1)]
        return [*lines, "}"]

    def _for(self, node: ast.For) -> list[str]:
        if not (
            isinstance(node.iter, ast.Call)
            and self._expressions.constant(node.iter.func) is range
            and isinstance(node.target, ast.Name)
        ):
            raise NotTranslatedError(ast.unparse(node.iter))
        ends = [self._expressions.of(a).code for a in node.iter.args]
        start, stop = ("INT64_C(0)", ends[0]) if len(ends) == 1 else ends[:2]
        step = 1 if len(ends) < 3 else self._expressions.constant(node.iter.args[2])
        name = node.target.id if node.target.id != "_" else f"turn_{node.lineno}"
        self._set_type(name, INT)
        sign = "<" if step > 0 else ">"
        head = f"for ({name} = {start}; {name} {sign} {stop}; {name} += {step}) {{"
        return [head, *self._block(node.body, 1), "}"]

    def _augassign(self, node: ast.AugAssign) -> list[str]:
        target = self._expressions.of(_read(node.target))
        return [f"{target.code} {_SIGNS[type(node.op)]}= {self._expressions.of(node.value).code};"]

    def _assign(self, node: ast.Assign) -> list[str]:
        target = node.targets[0]
        if not isinstance(target, ast.Tuple):
            return self._store(target, node.value)
        if isinstance(node.value, ast.Tuple) and any(map(_makes_array, node.value.elts)):
            pairs = zip(target.elts, node.value.elts, strict=True)
            return [line for t, v in pairs for line in self._store(t, v)]
        value = self._expressions.of(node.value)
        assert isinstance(value.type, (Tuple, Array))
        if isinstance(value.type, Array):
            items = [Value(DOUBLE, f"{value.code}[{i}]") for i in range(value.type.size)]
            return [ln for t, v in zip(target.elts, items, strict=True) for ln in self._put(t, v)]
        held = f"held_{node.lineno}_{node.col_offset}"  # all is read before anything is written
        lines = [f"const {value.type.name} {held} = {value.code};"]
        for i, one in enumerate(target.elts):
            if not (isinstance(one, ast.Name) and one.id == "_"):
                lines += self._put(one, Value(value.type.items[i], f"{held}.e{i}"))
        return ["{", *("    " + line for line in lines), "}"]

    def _store(self, target: ast.expr, node: ast.expr) -> list[str]:
        """target = node, where either may be an array."""
        if isinstance(node, ast.Call) and self._is(node, np.empty, np.zeros):
            shape = self._expressions.constant(node.args[0])
            found = Array(shape if isinstance(shape, tuple) else (shape,))
            assert isinstance(target, ast.Name)
            self._set_type(target.id, found)
            return [f"memset({target.id}, 0, sizeof(double) * {found.size});"]
        if _is_copy(node):
            assert isinstance(target, ast.Name)
            value = self._expressions.of(node.func.value)  # pyright: ignore
            self._set_type(target.id, value.type)
            return _copied(target.id, value)
        if isinstance(target, ast.Subscript) and isinstance(target.slice, ast.Slice):
            return _copied(self._expressions.of(_read(target)).code, self._expressions.of(node))
        if isinstance(node, ast.BinOp) and not self._expressions.constant(node):
            left = self._expressions.of(node.left)
            if isinstance(left.type, Array):
                return self._shifted(target, left, node)
        return self._put(target, self._expressions.of(node))

    def _shifted(self, target: ast.expr, left: Value, node: ast.BinOp) -> list[str]:
        """name = array (+ - *) number."""
        right = self._expressions.of(node.right)
        assert isinstance(target, ast.Name)
        assert isinstance(right.type, Scalar)
        assert isinstance(left.type, Array)
        self._set_type(target.id, left.type)
        sign = _SIGNS[type(node.op)]
        lines = [f"{left.code}[{i}] {sign} {right.code};" for i in range(left.type.size)]
        return [f"{target.id}[{i}] = {line}" for i, line in enumerate(lines)]

    def _put(self, target: ast.expr, value: Value) -> list[str]:
        """target = value, both of them numbers or tuples."""
        if isinstance(target, ast.Name):
            self._set_type(target.id, value.type)
            return [f"{target.id} = {value.code};"]
        return [f"{self._expressions.of(_read(target)).code} = {value.code};"]

    def _is(self, node: ast.Call, *functions: Any) -> bool:
        return self._expressions.constant(node.func) in functions


def _makes_array(node: ast.expr) -> bool:
    return _is_copy(node) or (isinstance(node, ast.Call) and "np.empty" in ast.unparse(node.func))


def _is_copy(node: ast.expr) -> bool:
    return (
        isinstance(node, ast.Call)
        and isinstance(node.func, ast.Attribute)
        and node.func.attr == "copy"
    )


def _read(target: ast.expr) -> Any:
    """The place that is written, as an expression that is read."""
    return ast.parse(ast.unparse(target), mode="eval").body


def _copied(to: str, value: Value) -> list[str]:
    assert isinstance(value.type, Array)
    return [f"memcpy({to}, {value.code}, sizeof(double) * {value.type.size});"]


def _local(type_: Type, name: str) -> str:
    return f"double {name}[{type_.size}]" if isinstance(type_, Array) else declared(type_, name)
