"""The command `rig gap`: find where model and table disagree, name it, add it, prove it."""

from collections.abc import Sequence
from os import cpu_count
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from experiments.cli.say import say

if TYPE_CHECKING:
    from calibration.gap.findings import Findings

# Sections of the help.
OWN = "Your recording"
DEMO = "Demo: a joint play is hidden in simulated runs"
BLIND = "Blind trials: effects are hidden, sought and scored"

Logs = Annotated[
    list[Path] | None,
    typer.Argument(
        help="Run folders, .csv, .parquet or .mat files of one table.", rich_help_panel=OWN
    ),
]
RigOption = Annotated[
    Path | None,
    typer.Option("--rig", help="rig.toml: the model as it is believed.", rich_help_panel=OWN),
]
Out = Annotated[Path, typer.Option("--out", help="Folder for what is made.", rich_help_panel=OWN)]
Json = Annotated[
    Path | None,
    typer.Option("--json", help="Write the answer here as JSON, too.", rich_help_panel=OWN),
]
_STAGES = (
    "Last stage: locate (where is it?), name (what?), add (to the model), prove (on other data) "
    "or next (what to record next)."
)
Until = Annotated[str, typer.Option(help=_STAGES, rich_help_panel=OWN)]
_LEFT = "Of files: the first so many seconds are left out (a hand at the ball, say)."
FromS = Annotated[float, typer.Option("--from", min=0.0, help=_LEFT, rich_help_panel=OWN)]
_CLEAN = "The logs are five or more clean runs: learn tolerances."
Tolerances = Annotated[bool, typer.Option("--tolerances-from", help=_CLEAN, rich_help_panel=OWN)]
Demo = Annotated[bool, typer.Option("--demo", help="Hide it and find it.", rich_help_panel=DEMO)]
_GUESS = "With --demo: guess the hidden play before the analysis does."
Guess = Annotated[bool, typer.Option("--guess", help=_GUESS, rich_help_panel=DEMO)]
_DRAWN = "With --blind-trial or --demo: seed of what is drawn."
Seed = Annotated[int | None, typer.Option(min=0, help=_DRAWN, rich_help_panel=DEMO)]
_TRIALS = "Hide effects, find them, open the seal, score."
BlindTrial = Annotated[bool, typer.Option("--blind-trial", help=_TRIALS, rich_help_panel=BLIND)]
Trials = Annotated[
    int, typer.Option(min=1, help="How many trials have an effect.", rich_help_panel=BLIND)
]
Effects = Annotated[str, typer.Option(help="Only these, comma-separated.", rich_help_panel=BLIND)]
Pairs = Annotated[
    bool, typer.Option("--pairs", help="Blind trials with two effects each.", rich_help_panel=BLIND)
]
Onto = Annotated[
    bool,
    typer.Option("--onto", help="Hide the effects of blind trials in LOGS.", rich_help_panel=BLIND),
]
Cluster = Annotated[
    str | None, typer.Option(help="Address of a Dask scheduler.", rich_help_panel=BLIND)
]
Jobs = Annotated[
    int | None,
    typer.Option(min=1, help="Processes; default: all cores.", rich_help_panel=BLIND),
]


def gap(
    logs: Logs = None,
    rig: RigOption = None,
    out: Out = Path("out/gap"),
    json_file: Json = None,
    until: Until = "next",
    from_s: FromS = 0.0,
    tolerances_from: Tolerances = False,
    demo: Demo = False,
    guess: Guess = False,
    seed: Seed = None,
    blind_trial: BlindTrial = False,
    trials: Trials = 100,
    effects: Effects = "",
    pairs: Pairs = False,
    onto: Onto = False,
    cluster: Cluster = None,
    jobs: Jobs = None,
) -> None:
    """Name the effect that the model lacks. Says where it is wrong, shows the gap shrink."""
    given = [*(logs or [])]
    if from_s and (blind_trial or not given):
        raise ValueError(f"--from {from_s:g}: is for LOG... that are files, and no trial's")
    if (pairs or onto) and not blind_trial:
        raise ValueError(f"--{'pairs' if pairs else 'onto'}: is for --blind-trial")
    if blind_trial:
        _blind(
            given,
            onto=onto,
            rig_file=rig,
            out=out,
            trials=trials,
            seed=seed,
            jobs=jobs,
            cluster=cluster,
            effects=[name for name in effects.split(",") if name],
            pairs=pairs,
        )
    elif tolerances_from:
        _tolerances(given, rig_file=rig, out=out, from_s=from_s)
    elif demo or guess:
        if given or rig is not None or not demo:
            raise ValueError(_no_demo(given, rig))
        play = _guess if guess else _demo
        play(out=out, json_file=json_file, seed=seed, until=until)
    else:
        _investigate_and_report(
            given, rig_file=rig, out=out, json_file=json_file, until=until, from_s=from_s
        )


def _check_request(
    json_file: Path | None,
    until: str,
    out: Path,
    logs: Sequence[Path] = (),
    rig_file: Path | None = None,
) -> None:
    """ValueError for what would be found out after all the work, or would be lost by it; `out` is
    made by the command."""
    from calibration.gap.investigation import STAGES
    from experiments.records.run_folder import refuse_input, refuse_other_results
    from rig.rigfile import refuse_own

    refuse_own(out / "rig.toml")
    refuse_input("--out", out / "rig.toml", [rig_file] if rig_file else [], "rig file")
    refuse_other_results(out)
    if json_file is not None:
        refuse_input("--json", json_file, logs)
        refuse_input("--json", json_file, [rig_file] if rig_file else [], "rig file")

    if until not in STAGES:
        raise ValueError(f"--until {until}: known stages: {', '.join(STAGES)}")
    if json_file is not None and json_file.is_dir():
        raise ValueError(f"--json {json_file}: is a folder; name a file")
    if json_file is None or json_file.absolute().parent in (out, out.absolute()):
        return
    if not json_file.absolute().parent.is_dir():
        raise ValueError(f"--json {json_file}: no such folder {json_file.parent}")


def _investigate_and_report(
    logs: Sequence[Path],
    *,
    rig_file: Path | None,
    out: Path,
    json_file: Path | None,
    until: str,
    from_s: float = 0.0,
    truth: str = "",
) -> "Findings":
    """truth: what the demo hid, for the page. ValueError, OSError: bad input or an unwritable
    folder, before any work."""
    from experiments.cli.console import bars
    from experiments.cli.out_folder import out_folder
    from experiments.gap.gap import investigate
    from experiments.gap.report import origin_words, write_findings
    from experiments.gap.summary import summary_lines
    from experiments.records.run_folder import write_json

    _check_request(json_file, until, out, logs, rig_file)
    folder = out_folder(out)
    with bars() as progress:
        threads = cpu_count() or 1
        found = investigate(
            logs, rig_file, from_s=from_s, until=until, threads=threads, progress=progress
        )
    if json_file is not None:
        write_json(json_file, found.to_json())
    names, origin = [path.name for path in logs], origin_words(logs, demo=bool(truth))
    here = any(path.is_dir() or path.suffix == ".mcap" for path in logs)
    page = write_findings(
        found,
        folder,
        names=names,
        rig_file=rig_file,
        origin=origin,
        remark=truth,
        recorded_here=here,
    )
    for line in summary_lines(found, recorded_here=here, logs=len(logs)):
        say(line)
    say(f"report: {page}   numbers: {folder / 'results.json'}")
    return found


def _tolerances(logs: Sequence[Path], *, rig_file: Path | None, out: Path, from_s: float) -> None:
    """Learn tolerances and floors of a table from clean runs; write them into OUT/rig.toml."""
    from calibration.gap.tolerances import learn
    from experiments.cli.out_folder import out_folder
    from experiments.gap.input import read_evidence
    from experiments.records.run_folder import refuse_input
    from rig.rigfile import refuse_own, write_rig

    refuse_own(out / "rig.toml")
    refuse_input("--out", out / "rig.toml", [rig_file] if rig_file else [], "rig file")
    inputs, folder = read_evidence(list(logs), rig_file, from_s), out_folder(out)
    learned = learn(inputs.logs, inputs.rig)
    write_rig(learned, folder / "rig.toml")
    for name, value in (*learned.tolerances.items(), *learned.floors.items()):
        say(f"{name:22s} {value:.4g}")
    say(
        f"from {len(inputs.logs)} clean runs; written to {folder / 'rig.toml'} [tolerances] "
        "(half width of the first parameter) and [floors] (RMS, rad or m)"
    )


def _no_demo(logs: Sequence[Path], rig_file: Path | None) -> str:
    """Why the demo cannot be done as it was asked for."""
    if logs:
        return "--demo, with or without --guess, makes its own logs; leave yours out"
    if rig_file is not None:
        return "--demo has a table of its own; leave --rig out"
    return "--guess is a game of the demo: add --demo"


def _demo(*, out: Path, json_file: Path | None, seed: int | None, until: str) -> None:
    _check_request(json_file, until, out)
    from experiments.cli.out_folder import out_folder
    from experiments.gap.beside import truth_lines
    from experiments.gap.demo import demo_runs, hidden_words

    runs = demo_runs(out_folder(out), seed=1 if seed is None else seed)
    say("A play is hidden in the joints of a simulated table; the analysis does not know of it.")
    found = _investigate_and_report(
        runs, rig_file=None, out=out, json_file=json_file, until=until, truth=hidden_words()
    )
    for line in (hidden_words(), *truth_lines(found, runs)):
        say(line)


def _guess(*, out: Path, json_file: Path | None, seed: int | None, until: str) -> None:
    """A person guesses what is hidden, then the analysis; who was nearer is told."""
    _check_request(json_file, until, out)
    import secrets

    from experiments.cli.out_folder import out_folder
    from experiments.gap import guess
    from experiments.gap.beside import found_values
    from experiments.gap.demo import demo_runs, hidden_words

    drawn = secrets.randbelow(10**6) if seed is None else seed
    hidden = guess.draw_plays(drawn)
    runs = demo_runs(out_folder(out), seed=drawn, plays_rad=hidden)
    say("Somewhere between encoder and plate the joints have play. How much?")
    for line in guess.clues(runs, seed=drawn):
        say(line)
    yours = {axis: typer.prompt(f"play of {axis} [degrees]", type=float) for axis in "xy"}
    found = _investigate_and_report(
        runs, rig_file=None, out=out, json_file=json_file, until=until, truth=hidden_words(hidden)
    )
    sizes = {place: one.value for place, one in found_values(found).items()}
    for line in guess.score(hidden, yours, sizes):
        say(line)
    say(f"the same game again: --seed {drawn}")


def _blind(
    logs: Sequence[Path],
    *,
    onto: bool,
    rig_file: Path | None,
    out: Path,
    trials: int,
    seed: int | None,
    jobs: int | None,
    cluster: str | None,
    effects: Sequence[str],
    pairs: bool,
) -> None:
    """Blind trials, in the house's simulator or onto the user's logs; prints the table."""
    if logs and not onto:
        raise ValueError("--blind-trial makes its own logs; with --onto it takes yours")
    if onto and not logs:
        raise ValueError("--onto: name the logs to hide effects in")
    from experiments.blind.command import blind_trial
    from experiments.blind.results_table import rows, show
    from experiments.cli.console import bars
    from experiments.cli.out_folder import out_folder

    with bars() as progress:
        results = blind_trial(
            trials=trials,
            out=out_folder(out),
            seed=seed,
            effects=effects,
            pairs=pairs,
            onto=logs,
            rig_file=rig_file,
            cluster=cluster,
            jobs=jobs,
            say=say,
            progress=progress,
        )
    if not logs:
        show(rows(results), "Blind trials")
    say(f"table: {out / 'table.md'}   numbers: {out / 'results.json'}")
