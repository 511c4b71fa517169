"""Parquet files of strangers: what of them is read."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pyarrow.parquet import ParquetFile

LONGEST_VALUE = 16  # bytes of a value of fixed length: those of a decimal number
_SIZED = ("BOOLEAN", "INT32", "INT64", "INT96", "FLOAT", "DOUBLE")


def numbers_of(file: "ParquetFile", most: int) -> list[str]:
    """Paths of the columns, those in structs and lists included, that hold numbers or times.

    Others are not read: text that a file of 1 MB names a million times unpacks to many GB.
    ValueError (one line): together they hold more than `most` values.
    """
    about = file.metadata
    paths, places = [], []
    for i in range(len(file.schema)):
        column = file.schema.column(i)
        short = column.physical_type == "FIXED_LEN_BYTE_ARRAY" and column.length <= LONGEST_VALUE
        if short or column.physical_type in _SIZED:
            paths.append(column.path)
            places.append(i)
    groups = (about.row_group(i) for i in range(about.num_row_groups))
    values = sum(group.column(i).num_values for group in groups for i in places)
    if values > most:
        raise ValueError(f"it holds {values} numbers (limit: {most}): cut it in parts")
    return paths
