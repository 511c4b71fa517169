"""The command `rig gap`: find where model and table disagree, name it, add it, prove it."""

from pathlib import Path
from typing import Annotated

import typer

Logs = Annotated[
    list[Path] | None,
    typer.Argument(help="Run folders, .csv, .parquet or .mat files of one table."),
]


def gap(
    logs: Logs = None,
    rig: Annotated[
        Path | None, typer.Option("--rig", help="rig.toml: the model as it is believed.")
    ] = None,
    out: Annotated[Path, typer.Option("--out", help="Folder for what is made.")] = Path("out/gap"),
    json_file: Annotated[
        Path | None, typer.Option("--json", help="Write the answer here as JSON, too.")
    ] = None,
    until: Annotated[
        str, typer.Option(help="Last stage: locate, name, add, prove or next.")
    ] = "next",
    tolerances_from: Annotated[
        bool,
        typer.Option(
            "--tolerances-from", help="The logs are five or more clean runs: learn tolerances."
        ),
    ] = False,
    demo: Annotated[
        bool, typer.Option(help="Hide a joint play in simulated runs; find it.")
    ] = False,
    blind_trial: Annotated[
        bool, typer.Option(help="Hide effects, find them, open the seal, score.")
    ] = False,
    trials: Annotated[int, typer.Option(min=1, help="Blind trials with an effect.")] = 100,
    effects: Annotated[str, typer.Option(help="Only these, comma-separated.")] = "",
    pairs: Annotated[bool, typer.Option(help="Two effects at once.")] = False,
    onto: Annotated[bool, typer.Option(help="Hide effects in the given logs.")] = False,
    cluster: Annotated[str | None, typer.Option(help="Address of a Dask scheduler.")] = None,
    jobs: Annotated[int | None, typer.Option(min=1, help="Processes; default: all cores.")] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Of everything that is drawn.")] = None,
) -> None:
    """Say where the model is wrong, name the missing effect, add it, show the gap shrink."""
    from experiments import gap_work

    given = [*(logs or [])]
    if blind_trial:
        if given and not onto:
            raise ValueError("--blind-trial makes its own logs; with --onto it takes yours")
        if onto and not given:
            raise ValueError("--onto: name the logs to hide effects in")
        gap_work.blind(
            given, rig_file=rig, out=out, trials=trials, seed=seed, jobs=jobs, cluster=cluster,
            effects=[name for name in effects.split(",") if name], pairs=pairs,
        )  # fmt: skip
    elif tolerances_from:
        gap_work.tolerances(given, rig_file=rig, out=out)
    elif demo:
        if given:
            raise ValueError("--demo makes its own logs; leave yours out")
        gap_work.demo(out=out, json_file=json_file, seed=1 if seed is None else seed)
    else:
        gap_work.investigate_and_report(
            given, rig_file=rig, out=out, json_file=json_file, until=until
        )
