"""The command `rig watch`: has a table changed since its model was accepted?"""

import shlex
from pathlib import Path
from typing import Annotated

import typer

from experiments.cli.say import say


def watch(
    folder: Annotated[Path, typer.Argument(help="Folder that holds the run folders of one table.")],
    rig: Annotated[
        Path | None,
        typer.Option("--rig", help="rig.toml: the table as believed; default: the accepted run's."),
    ] = None,
    accept: Annotated[
        list[str] | None,
        typer.Option(help="Accepted run; again for several. Default: the first that counts."),
    ] = None,
    out: Annotated[Path, typer.Option("--out", help="Folder for what is made.")] = Path(
        "out/watch"
    ),
) -> None:
    """Say whether a table has changed from run to run. What, since when and how much."""
    from experiments.cli.console import bars
    from experiments.cli.out_folder import out_folder
    from experiments.watch.report import write_watch
    from experiments.watch.runs import runs_of
    from experiments.watch.watch import ACCEPTED, SKIPPED
    from experiments.watch.watch import watch as work
    from experiments.watch.words import run_words, sentence, statistic_words

    runs_of(folder)
    made = out_folder(out)
    with bars() as progress:
        found = work(folder, rig, accepted=accept or (), progress=progress)
    options = [*(("--rig", rig) if rig else ()), "--out", out]
    options += [word for name in accept or () for word in ("--accept", name)]
    command = shlex.join(map(str, ("rig", "watch", folder, *options)))
    page = write_watch(found, made, command=command)
    if not accept:
        first = next(one.run.name for one in found.runs if one.state == ACCEPTED)
        say(f"taken as accepted: {first}, the first run that counts (another: --accept RUN)")
    for one in found.runs:
        said = "; ".join(filter(None, (run_words(found, one), statistic_words(found, one))))
        say(f"{one.run.name}  {one.state:9s}  {said}".rstrip())
    skipped = sum(one.state == SKIPPED for one in found.runs)
    say(sentence(found) + (f" ({skipped} skipped)" if skipped else ""))
    say(f"report: {page}   numbers: {out / 'results.json'}")
