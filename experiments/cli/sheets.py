"""The commands `rig sheet` and `rig check`: lab exercises on a virtual table of one's own."""

from pathlib import Path
from typing import Annotated

import typer

from experiments.cli.say import say


def sheet(
    name: Annotated[str, typer.Argument(help="play, servo, camera or missing.")],
    student: Annotated[str, typer.Option(help="Name or number; it draws the table.")],
    out: Annotated[Path | None, typer.Option("--out", help="Default: out/sheet-NAME.")] = None,
) -> None:
    """Hand out a lab sheet. Runs of a table of the student's own, and the results file."""
    from experiments.cli.console import bars
    from experiments.records.run_folder import writable
    from experiments.sheets.catalogue import sheet_named
    from experiments.sheets.handout import EXERCISE, RESULTS, hand_out, next_commands
    from experiments.sheets.tables import seed_of

    wanted = sheet_named(name)
    seed_of(name, student)
    folder = out or Path(f"out/sheet-{name}")
    try:
        with bars() as progress:
            runs = hand_out(wanted, student, writable(folder), progress=progress)
    except FileExistsError as error:
        raise ValueError(str(error)) from None
    say(f"{wanted.title}: {len(runs)} runs of your table in {folder / 'runs'}")
    say(f"what to do, and the questions: {folder / EXERCISE}")
    say(f"rig file: {folder / 'rig.toml'}   your answers: {folder / RESULTS}")
    say(f"next: {next_commands(wanted, folder)[0]}")


def check(
    name: Annotated[str, typer.Argument(help="play, servo, camera or missing.")],
    results: Annotated[Path, typer.Argument(help="Your results.toml.")],
) -> None:
    """Say which answers of a lab sheet are right. Exit code 1 where one is not."""
    from experiments.sheets.catalogue import sheet_named
    from experiments.sheets.check import RIGHT, WRONG
    from experiments.sheets.check import check as work

    found = work(sheet_named(name), results)
    for one in found:
        why = f"   ({one.hint})" if one.state == WRONG and one.hint else ""
        say(f"{one.question.key:18s} {one.state}{why}")
    right = sum(one.state == RIGHT for one in found)
    say(f"{right} of {len(found)} answers are right")
    if right < len(found):
        raise typer.Exit(1)
