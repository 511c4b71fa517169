"""`rig export-model`: a table for other simulators."""

from pathlib import Path
from typing import Annotated

import typer

from experiments.cli.say import say


def export_model(
    rig: Annotated[
        Path, typer.Argument(metavar="RIG", help="rig.toml, or a shipped table's name.")
    ],
    kind: Annotated[str, typer.Option("--as", help="mjcf (MuJoCo XML) or fmu (FMI 3.0).")],
    out: Annotated[Path, typer.Option("--out", help="File ending in .xml (mjcf) or .fmu.")],
    intervals: Annotated[
        Path | None, typer.Option(help="Answer of `rig gap --json`: min and max (fmu).")
    ] = None,
) -> None:
    """Write a table as a model for MuJoCo or any FMI importer. Its effects are included."""
    from experiments.export.export_model import export_model as write
    from experiments.runs.assemble import load_rig

    for line in write(load_rig(rig), rig.stem, kind, out, intervals=intervals):
        say(f"note: {line}")
    say(str(out))
