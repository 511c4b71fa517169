"""What a terminal shows: progress bars and tables."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from math import inf
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from experiments.progress import ProgressCall

if TYPE_CHECKING:
    from rig.effects import Effect


@contextmanager
def bars() -> Iterator[ProgressCall]:
    """Show progress bars on standard error; gives the function that updates them.

    Each stage has its own bar. Nothing is drawn before the first update.
    """
    columns = (
        TextColumn("{task.description:34s}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
    )
    progress = Progress(*columns, console=Console(stderr=True))
    tasks: dict[str, int] = {}

    def show(stage: str, done: int, total: int) -> None:
        if not tasks:  # bad input stays one line: nothing is drawn before there is something to see
            progress.start()
        name = stage.partition(": ")[0]
        if name not in tasks:
            tasks[name] = progress.add_task(stage, total=total)
        progress.update(tasks[name], description=stage, completed=done, total=total)  # pyright: ignore

    try:
        yield show
    finally:
        if tasks:
            progress.stop()


def effects_table(effects: "Iterable[Effect]") -> None:
    """Print effects as a table on standard output."""
    table = Table("name", "axis", "key", "unit", "range", "null", "tolerance", "what it is")
    for effect in effects:
        for i, p in enumerate(effect.parameters):
            first = i == 0
            table.add_row(
                effect.name if first else "",
                "/".join(effect.axes) if first else "",
                p.key,
                p.unit,
                f"{p.low:g} .. {p.high:g}",
                "none" if p.null == inf else f"{p.null:g}",
                f"{effect.tolerance:g}" if first and effect.tolerance else "",
                effect.sentence if first else "",
            )
    # A pipe or a narrow terminal gets whole names all the same.
    console = Console()
    Console(width=max(console.width, 150), markup=False).print(table)
