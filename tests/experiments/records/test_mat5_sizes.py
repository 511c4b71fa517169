"""MAT files of 200 bytes whose dimensions lie are refused before memory is taken for them."""

import struct

import pytest

from experiments.records.mat_files import MOST_BYTES, check_inflated

HEAD = b"MATLAB 5.0 MAT-file".ljust(116) + bytes(8) + struct.pack("<H", 0x100) + b"IM"


def element(kind, data):
    return struct.pack("<II", kind, len(data)) + data + bytes(-len(data) % 8)


def matrix(kind, count, more):
    flags = element(6, struct.pack("<II", kind, 0))
    return element(14, flags + element(5, struct.pack("<2i", 1, count)) + element(1, b"t_s") + more)


FIELD = element(5, struct.pack("<i", 8)) + element(1, b"a".ljust(8, b"\0"))
NO_FIELD = element(5, struct.pack("<i", 8)) + element(1, b"")


@pytest.mark.parametrize(
    ("kind", "more"), [(1, b""), (2, FIELD), (2, NO_FIELD), (4, element(16, b"")), (6, b"")]
)
@pytest.mark.parametrize("nested", [False, True])
def test_dimensions_that_lie_are_refused(tmp_path, kind, more, nested):
    one = matrix(kind, 2_000_000_000, more)
    (tmp_path / "a.mat").write_bytes(HEAD + (matrix(1, 1, one) if nested else one))
    with pytest.raises(ValueError, match=r"claims|ends before"):
        check_inflated(tmp_path / "a.mat", MOST_BYTES)


NUMBERS = b"\0" * 8 * 30


@pytest.mark.parametrize("type_", [0, 8, 10, 11, 14, 15, 19, 25, 137, 8201, 65000])
def test_numbers_of_a_type_that_there_is_not_are_refused(tmp_path, type_):
    """One flipped bit makes such a type of that of doubles: scipy ended the whole program."""
    (tmp_path / "a.mat").write_bytes(HEAD + matrix(6, 30, element(type_, NUMBERS)))
    with pytest.raises(ValueError, match=f"of a type {type_} that there is not"):
        check_inflated(tmp_path / "a.mat", MOST_BYTES)


@pytest.mark.parametrize(("type_", "size"), [(9, 8), (7, 4), (3, 2), (2, 1), (13, 8)])
def test_numbers_of_the_types_that_there_are_pass(tmp_path, type_, size):
    path = tmp_path / "a.mat"
    path.write_bytes(HEAD + matrix(6, 240 // size, element(type_, NUMBERS)))
    check_inflated(path, MOST_BYTES)
    path.write_bytes(HEAD + matrix(6, 240 // size + 1, element(type_, NUMBERS)))
    with pytest.raises(ValueError, match=f"its bytes hold {240 // size}"):
        check_inflated(path, MOST_BYTES)
