"""Values of sliders that a person kept under a name; they are in a file and outlive the program."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from experiments.records.run_folder import replace_json
from rig.files import json_of, put_aside

LONGEST_NAME = 40  # characters; chosen: what a list shows
MOST_KEPT = 100  # chosen


def preset_name(value: object) -> str:
    """The name, without space at its ends; "" for none yet. ValueError: it is no name."""
    name = " ".join(value.split()) if isinstance(value, str) else None
    if name is None or len(name) > LONGEST_NAME or not name.isprintable():
        raise ValueError(f"a name has up to {LONGEST_NAME} letters, digits and signs")
    return name


class KeptPresets(Mapping[str, Sequence[float]]):
    """Name -> values, kept in the JSON file `path`; count: how many values a preset has.

    What the file holds that is no such preset is left out; a file that cannot be read is empty, and
    kept as NAME.1, NAME.2 ... at the next change. Before that it is read anew: another program may
    have changed it.
    """

    def __init__(self, path: Path, count: int) -> None:
        self._path, self._count = path, count
        self._kept = self._read()

    def _content(self) -> dict[str, object] | None:
        """What is in the file; None: it cannot be read."""
        try:
            return dict(json_of(self._path))
        except FileNotFoundError:
            return {}
        except (OSError, ValueError, TypeError):
            return None

    def _read(self) -> dict[str, list[float]]:
        return {
            name: [float(value) for value in values]  # pyright: ignore[reportGeneralTypeIssues]
            for name, values in (self._content() or {}).items()
            if _is_preset(name, values, self._count)
        }

    def __getitem__(self, name: str) -> Sequence[float]:
        return self._kept[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._kept)

    def __len__(self) -> int:
        return len(self._kept)

    def keep(self, name: str, values: Sequence[float]) -> None:
        """Keep the values under the name. ValueError: there are too many; OSError: no room."""
        kept = self._read()
        if name not in kept and len(kept) >= MOST_KEPT:
            raise ValueError(f"{MOST_KEPT} presets are kept already: forget one first")
        self._write({**kept, name: list(values)})

    def forget(self, name: str) -> None:
        """Forget the preset. KeyError: it was not kept; OSError: the file cannot be written."""
        _ = self._kept[name]
        self._write({one: values for one, values in self._read().items() if one != name})

    def _write(self, kept: dict[str, list[float]]) -> None:
        if self._content() is None:
            put_aside(self._path)
        replace_json(self._path, kept)
        self._kept = kept


def _is_preset(name: object, values: object, count: int) -> bool:
    try:
        named = isinstance(name, str) and preset_name(name) == name != ""
    except ValueError:
        return False
    numbers = isinstance(values, list) and all(
        isinstance(one, int | float) and abs(one) < float("inf") for one in values
    )
    return named and numbers and len(values) == count  # pyright: ignore[reportArgumentType]
