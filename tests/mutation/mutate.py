"""Small changes to a source file, one at a time, and which of them a test suite lets live.

A mutant is the module with one comparison, constant, operator, boolean, branch, `min`/`max` or
return changed. It runs as plain Python (`compiled` is the identity), in memory: no file is touched.
"""

# pyright: reportAttributeAccessIssue=false
# What fields a node has, its class has said just before.
import ast
import sys
from collections.abc import Callable, Collection, Iterator
from copy import deepcopy
from pathlib import Path
from types import ModuleType
from typing import Any

COMPARISONS = {
    ast.Lt: (ast.LtE, ast.GtE),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
}
OPERATORS = {
    ast.Add: (ast.Sub,),
    ast.Sub: (ast.Add,),
    ast.Mult: (ast.Div,),
    ast.Div: (ast.Mult,),
}
SWAPS = {"min": "max", "max": "min", "any": "all", "all": "any"}


def _changes(node: ast.AST) -> Iterator[tuple[str, Callable[[ast.AST], ast.AST]]]:
    """(what changes, how) for one node; the change gets a copy of it."""
    if isinstance(node, ast.Compare):
        for i, op in enumerate(node.ops):
            for other in COMPARISONS.get(type(op), ()):

                def compare(n, i=i, other=other):
                    n.ops[i] = other()
                    return n

                yield f"{type(op).__name__} -> {other.__name__}", compare
    elif isinstance(node, ast.BinOp):
        for other in OPERATORS.get(type(node.op), ()):

            def operate(n, other=other):
                n.op = other()
                return n

            yield f"{type(node.op).__name__} -> {other.__name__}", operate
    elif isinstance(node, ast.BoolOp):
        other = ast.Or if isinstance(node.op, ast.And) else ast.And
        yield f"-> {other.__name__}", lambda n: ast.BoolOp(other(), n.values)
    elif isinstance(node, ast.UnaryOp):
        yield f"{type(node.op).__name__} dropped", lambda n: n.operand
    elif isinstance(node, ast.Constant):
        yield from _constants(node)
    elif isinstance(node, ast.IfExp):
        yield "branches swapped", lambda n: ast.IfExp(n.test, n.orelse, n.body)
    elif isinstance(node, ast.Name) and node.id in SWAPS and isinstance(node.ctx, ast.Load):
        yield f"{node.id} -> {SWAPS[node.id]}", lambda n: ast.Name(SWAPS[n.id], n.ctx)
    yield from _statements(node)


def _constants(node: ast.Constant):
    if isinstance(node.value, bool):
        yield f"-> {not node.value}", lambda n: ast.Constant(not n.value)
    elif isinstance(node.value, int | float):
        for value in (node.value + 1, node.value * 0.9 if node.value else -1):
            yield f"{node.value} -> {value}", lambda n, value=value: ast.Constant(value)


def _statements(node: ast.AST):
    if isinstance(node, ast.If):
        for value in (True, False):

            def force(n, value=value):
                n.test = ast.Constant(value)
                return n

            yield f"if {value}", force
    elif isinstance(node, ast.Return) and ast.unparse(node) not in ("return", "return None"):
        yield "returns None", lambda n: ast.Return(ast.Constant(None))
    elif isinstance(node, ast.Assign):
        yield "dropped", lambda n: ast.Pass()


class _At(ast.NodeTransformer):
    """Applies a change to the node with a number."""

    def __init__(self, number: int, change) -> None:
        self.number, self.change, self.count = number, change, -1

    def visit(self, node: ast.AST) -> ast.AST:
        self.count += 1
        if self.count == self.number:
            return ast.copy_location(self.change(node), node)
        return self.generic_visit(node)


class _InOrder(ast.NodeVisitor):
    def __init__(self) -> None:
        self.nodes: list[ast.AST] = []

    def visit(self, node: ast.AST) -> None:
        self.nodes.append(node)
        self.generic_visit(node)


def mutants(path: Path, only: Collection[str] = ()) -> Iterator[tuple[str, Any]]:
    """(name, tree) of every mutant; the name is the line, the part of it and the change.

    only: the classes and functions to change; none: the whole file.
    """
    text = path.read_text(encoding="utf-8")
    lines, tree = text.splitlines(), ast.parse(text)
    order = _InOrder()
    order.visit(tree)
    inside = {
        id(node)
        for part in tree.body
        if not only or getattr(part, "name", "") in only
        for node in ast.walk(part)
    }
    for number, node in enumerate(order.nodes):
        if id(node) not in inside:
            continue
        for what, change in _changes(node):
            line = getattr(node, "lineno", 1)
            part = ast.get_source_segment(text, node) or ""
            name = f"{path.name}: {lines[line - 1].strip()}  [{part.splitlines()[:1]}: {what}]"
            changed = ast.fix_missing_locations(_At(number, change).visit(deepcopy(tree)))
            yield name, changed


def load(tree: ast.Module, path: Path, **replaced) -> ModuleType:
    """Run a tree as a module of its own; `replaced` names stand for what it imports."""
    module = ModuleType("mutant_" + path.stem)
    sys.modules[module.__name__] = module  # dataclasses look their module up
    kept = [
        n for n in tree.body
        if not (isinstance(n, ast.ImportFrom) and any(a.name in replaced for a in n.names))
    ]  # fmt: skip
    module.__dict__.update(replaced, __file__=str(path))
    exec(compile(ast.Module(kept, []), str(path), "exec"), module.__dict__)
    return module


def survivors(
    path: Path, check: Callable[[ModuleType], None], only: Collection[str] = (), **replaced
) -> tuple[int, list[str]]:
    """How many mutants there are (see `mutants`), and the names of those `check` does not notice.

    Whatever `check` raises is noticed; so is a mutant that cannot even be loaded, or lacks a name
    that others import.
    """
    whole = load(ast.parse(path.read_text(encoding="utf-8")), path, **replaced)
    check(whole)
    count, alive = 0, []
    for name, tree in mutants(path, only):
        count += 1
        try:
            mutant = load(tree, path, **replaced)
            if not set(vars(whole)) <= set(vars(mutant)):
                continue
            check(mutant)
        except KeyboardInterrupt:
            raise
        except BaseException:  # dead; pytest's own failures are no Exception
            continue
        alive.append(name)
    return count, alive
