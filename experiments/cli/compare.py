"""The command `rig compare`: every play compensation in every cell of a grid."""

from pathlib import Path
from typing import Annotated

import typer

from experiments.cli.say import say


def compare(
    rig: Annotated[
        Path | None, typer.Option("--rig", help="rig.toml; without it the default virtual table.")
    ] = None,
    out: Annotated[Path, typer.Option("--out", help="Folder for what is made.")] = Path(
        "out/compare"
    ),
    grid: Annotated[Path | None, typer.Option(help="Your own grid (TOML).")] = None,
    seeds: Annotated[int | None, typer.Option(min=6, max=1000, help="Paired seeds a cell.")] = None,
    jobs: Annotated[int | None, typer.Option(min=1, help="Processes; default: all cores.")] = None,
    cluster: Annotated[str | None, typer.Option(help="Address of a Dask scheduler.")] = None,
) -> None:
    """Which play compensation helps, and when. Arms x play x friction x protocol.

    All arms run on the same paired seeds.

    Interrupted, it goes on where it stopped when called again with the same --out.
    """
    from experiments.cli.console import bars
    from experiments.cli.out_folder import out_folder
    from experiments.compare.compare import run_comparison

    folder = out_folder(out)
    with bars() as progress:
        results = run_comparison(
            rig,
            folder,
            grid_file=grid,
            seeds=seeds,
            jobs=jobs,
            cluster=cluster,
            progress=progress,
            note=lambda text: typer.echo(f"note: {text}", err=True),
        )
    for line in results["words"]:
        say(line)
    say(f"report: {out / 'report.html'}   numbers: {out / 'results.json'}")
