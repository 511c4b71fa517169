"""The commands `rig benchmark ...`: sealed logs for anybody's method, and the score of answers."""

from pathlib import Path
from typing import Annotated

import typer

from experiments.cli.say import say

benchmark = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode=None,
    help="Sealed logs for any method that names what is missing. And its score.",
)

SetArgument = Annotated[Path, typer.Argument(help="Folder that `rig benchmark make` made.")]
JobsOption = Annotated[int | None, typer.Option(min=1, help="Processes; default: one per core.")]
FirstOption = Annotated[
    int | None, typer.Option(min=1, help="So many cases alone, in the set's order.")
]


@benchmark.command()
def make(
    out: Annotated[Path, typer.Option("--out", help="Folder for the set; must hold none yet.")],
    seed: Annotated[
        int | None, typer.Option(min=0, help="Default: drawn, and told to nobody.")
    ] = None,
    logs: Annotated[int, typer.Option(min=1, max=9999, help="How many logs.")] = 300,
    jobs: JobsOption = None,
) -> None:
    """Make logs with something hidden. A rig file each, the rules, and the sealed truth."""
    import secrets

    from experiments.benchmark.make import make_set
    from experiments.cli.console import bars

    chosen = secrets.randbits(64) if seed is None else seed
    with bars() as progress:
        made = make_set(out, seed=chosen, logs=logs, jobs=jobs, progress=progress)
    if made.left_out:
        say(made.left_out)
    say(f"{made.logs} logs, {made.size_bytes / 1e6:.1f} MB, rules: {out / 'rules.md'}")
    say(f"truth sealed, SHA-256 {made.sha256}; hand out all but {out / 'sealed'}")


@benchmark.command()
def answer(
    folder: SetArgument,
    out: Annotated[Path, typer.Option("--out", help="Folder for the answers; it grows.")],
    first: FirstOption = None,
    jobs: JobsOption = None,
    cluster: Annotated[
        str | None, typer.Option(help="Address of a Dask scheduler, in place of processes.")
    ] = None,
) -> None:
    """Answer with `rig gap`; interrupted, it goes on where it stopped."""
    from experiments.benchmark.answers import answer_set
    from experiments.cli.application import WorkFailedError
    from experiments.cli.console import bars

    with bars() as progress:
        failed = answer_set(folder, out, first=first, jobs=jobs, cluster=cluster, progress=progress)
    say(f"answers: {out}   score them: rig benchmark score {folder} {out}")
    if failed:
        raise WorkFailedError(f"{failed} logs got no answer; their files say why")


@benchmark.command()
def score(
    folder: SetArgument,
    answers: Annotated[
        list[Path], typer.Argument(help="Folders with one JSON of `rig gap` a case.")
    ],
    first: FirstOption = None,
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder for results.json and table.md.")
    ] = None,
) -> None:
    """Open the seal and score the answers. Of one entry, or of several side by side."""
    from experiments.benchmark.score import score_set
    from experiments.benchmark.table import entry_names, page_of, show
    from experiments.records.run_folder import (
        refuse_input,
        refuse_other_results,
        writable,
        write_results,
    )
    from rig.files import printable, write_whole

    if out is not None:
        refuse_input("--out", out / "results.json", answers, "answers")
        refuse_other_results(out)
    named = zip(entry_names(answers), answers, strict=True)
    results = {name: score_set(folder, one, first=first) for name, one in named}
    for name, found in results.items():
        show(f"{name} to {printable(folder.resolve().name)}", found)
    if out is not None:
        write_whole(writable(out) / "table.md", page_of(results).encode())
        write_results(out, results)
