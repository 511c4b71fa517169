"""`rig dashboard`: the operator's page in the browser."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from experiments.cli.say import output_aside


def dashboard(
    rig: Annotated[
        Path | None, typer.Option("--rig", help="rig.toml; without it the default virtual table.")
    ] = None,
    port: Annotated[int, typer.Option(min=0, max=65535, help="0: any free one.")] = 7644,
    host: Annotated[
        str, typer.Option(help="Address to listen at; 0.0.0.0 for the whole network.")
    ] = "127.0.0.1",
    out: Annotated[Path, typer.Option("--out", help="Folder for what is made.")] = Path(
        "out/dashboard"
    ),
    foxglove: Annotated[
        int | None,
        typer.Option(min=0, max=65535, help="Also stream to Foxglove, on this port of 127.0.0.1."),
    ] = None,
) -> None:
    """A page to run, watch, calibrate and diagnose the table.

    Prints the link to open. Only who has the link gets in; Ctrl-C ends it and levels the table.
    """
    from experiments.records.run_folder import writable
    from experiments.runs.assemble import load_rig

    known, folder = load_rig(rig), writable(out)
    print("The page is being prepared; its link follows.", file=sys.stderr, flush=True)
    from experiments.dashboard.serve import serve_dashboard

    with output_aside() as say:
        serve_dashboard(known, rig, folder, host=host, port=port, foxglove_port=foxglove, say=say)
