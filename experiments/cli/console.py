"""What a terminal shows: progress bars and tables."""

import sys
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from math import inf
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from experiments.progress import ProgressCall
from rig.files import printable
from rig.loop.signals import leave_if_told

if TYPE_CHECKING:
    from rig.effects import Effect


LINE_S = 30.0  # chosen: who looks into a log sees that it lives


@contextmanager
def bars() -> Iterator[ProgressCall]:
    """Show progress bars on standard error; gives the function that updates them.

    Each stage has its own bar; where no terminal draws them, a line now and then. Nothing is
    drawn before the first update. An update leaves the program by a signal that was swallowed.
    """
    columns = (
        TextColumn("{task.description:34s}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
    )
    console = Console(stderr=True)
    if not console.is_terminal:
        yield _lines(console)
        return
    progress = Progress(*columns, console=console)
    tasks: dict[str, int] = {}

    def show(stage: str, done: int, total: int) -> None:
        leave_if_told()
        stage = printable(stage)  # it may hold the name of a file or a protocol from elsewhere
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


def _lines(console: Console) -> ProgressCall:
    """Progress in a file or a pipe: a line where a stage begins and ends, and every LINE_S."""
    told: dict[str, tuple[float, int]] = {}

    def show(stage: str, done: int, total: int) -> None:
        leave_if_told()
        stage = printable(stage)  # it may hold the name of a file or a protocol from elsewhere
        name = stage.partition(": ")[0]
        now_s = time.monotonic()
        since_s, before = told.get(name, (-LINE_S, -1))
        if now_s - since_s >= LINE_S or (done >= total > before):
            told[name] = now_s, done
            with suppress(OSError):  # nobody reads it
                print(f"{stage}: {done} of {total}", file=console.file, flush=True)

    return show


def tell_of_compiling() -> None:
    """Say on standard error that what follows the ball has to be compiled first, where it has."""
    from vision.compiled import is_compiled

    if not is_compiled("detection"):
        with suppress(OSError):  # nobody reads it
            print("compiling what finds the ball: once only, about a minute", file=sys.stderr)


COLUMNS = (
    "In a rig file: a section named effects.NAME with lines AXIS.KEY = a value of the range. "
    "null: the value without the effect. tolerance: so much of the first key a well-kept rig may "
    "have."
)


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
    table.caption = COLUMNS
    # A pipe or a narrow terminal gets whole names all the same.
    console = Console()
    Console(width=max(console.width, 150), markup=False).print(table)
