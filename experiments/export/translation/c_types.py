"""The types that the compiled functions use, as C knows them."""

from dataclasses import dataclass
from math import prod
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Scalar:
    """A number: "double" or "int64_t" (truth values are whole numbers)."""

    name: str


@dataclass(frozen=True)
class Tuple:
    """A tuple of `items`, in C a struct with the fields e0, e1 ..."""

    items: tuple

    @property
    def name(self) -> str:
        """The struct's name, made of the items' letters."""
        letters = (item.name if isinstance(item, Tuple) else item.name[0] for item in self.items)
        return f"tuple_{len(self.items)}_{''.join(letters)}"


@dataclass(frozen=True)
class Array:
    """Doubles of a fixed `shape`, one row after the other; in C a pointer to the first."""

    shape: tuple[int, ...]

    @property
    def size(self) -> int:
        """How many numbers it holds."""
        return prod(self.shape)


@dataclass(frozen=True)
class Record:
    """One record of a numpy dtype, in C a pointer to a struct of the name `name`."""

    name: str
    dtype: np.dtype

    def field(self, name: str) -> "Type":
        """Type of the field `name`. KeyError: there is none."""
        fields: Any = self.dtype.fields
        return field_type(name, fields[name][0])


Type = Scalar | Tuple | Array | Record
DOUBLE, INT = Scalar("double"), Scalar("int64_t")


def field_type(name: str, dtype: np.dtype) -> Type:
    """Type of a record's field of this dtype; a record within it bears the field's name."""
    if dtype.fields is not None:
        return Record(name, dtype)
    if dtype.subdtype is not None:
        return Array(dtype.subdtype[1])
    return INT if dtype.kind == "i" else DOUBLE


def wider(a: Type, b: Type) -> Type:
    """The type that holds values of both. TypeError: there is none."""
    if a == b:
        return a
    if isinstance(a, Scalar) and isinstance(b, Scalar):
        return DOUBLE
    if isinstance(a, Tuple) and isinstance(b, Tuple) and len(a.items) == len(b.items):
        return Tuple(tuple(wider(x, y) for x, y in zip(a.items, b.items, strict=True)))
    raise TypeError(f"{a} and {b} have no type in common")


def declared(type_: Type, name: str) -> str:
    """C's declaration of a variable or an argument `name` of this type."""
    if isinstance(type_, Array):
        return f"double *{name}"
    if isinstance(type_, Record):
        return f"struct {type_.name} *{name}"
    return f"{type_.name} {name}"


def struct_of(record: Record) -> list[str]:
    """C's definitions of a record's struct, those of the records within it first."""
    before, lines = [], [f"struct {record.name} {{"]
    for name in record.dtype.names or ():
        found = record.field(name)
        if isinstance(found, Record):
            before += struct_of(found)
            lines.append(f"    struct {found.name} {name};")
        elif isinstance(found, Array):
            lines.append(f"    double {name}[{found.size}];")
        else:
            lines.append(f"    {declared(found, name)};")
    return [*before, *lines, "};"]
