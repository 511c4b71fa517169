"""The command line `rig`: parses, calls, turns errors into one line and the right exit code.

Exit codes: 0 done, 1 the work failed, 2 bad input, 130 interrupted, 128 + n ended by
signal n. Heavy imports happen inside the commands, so that `--help` answers at once.
"""

import errno
import os
import sys
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from experiments.cli.benchmark import benchmark
from experiments.cli.calibrate import calibrate
from experiments.cli.compare import compare
from experiments.cli.dashboard import dashboard
from experiments.cli.doctor import doctor
from experiments.cli.error_words import error_words, usage_words
from experiments.cli.export_model import export_model
from experiments.cli.gap import gap
from experiments.cli.home import home
from experiments.cli.importing import EPILOG, import_
from experiments.cli.say import say, saying_aside
from experiments.cli.sections import OptionSections, Sections
from experiments.cli.serve import serve
from experiments.cli.sheets import check, sheet
from experiments.cli.watch import watch

INTERRUPTED = 130
# What the system says of a name that no file can have, of a folder in a file's place, and of a
# place that takes no file.
NO_FILES = (errno.EISDIR, errno.ENOTDIR, errno.EROFS)
BAD_NAMES = (errno.ENAMETOOLONG, errno.ELOOP, errno.EINVAL, *NO_FILES)
NO_THREAD = "can't start new thread"  # Python's own words
LONGEST_LINE = 1000  # characters; chosen: a page of a terminal
SHIPPED = (Path(__file__).parents[1] / "protocols").glob("*.toml")
PROTOCOLS = ", ".join(sorted(path.stem for path in SHIPPED))
app = typer.Typer(
    cls=Sections,
    add_completion=False,
    no_args_is_help=True,
    rich_markup_mode=None,  # plain help in a third of the time
    pretty_exceptions_enable=False,
    help="An experiment rig for a 2-DOF ball balancing table with play in its drives.",
)

RigOption = Annotated[
    Path | None, typer.Option("--rig", help="rig.toml; without it the default virtual table.")
]
SeedOption = Annotated[int, typer.Option(min=0, help="Seed of everything that is drawn.")]
OutOption = Annotated[Path, typer.Option("--out", help="Folder for what is made.")]


def _tell_version(asked: bool) -> None:
    if asked:
        from experiments.reports.program import program_words

        say(program_words("rig"))
        raise typer.Exit


VERSION = typer.Option("--version", callback=_tell_version, is_eager=True, help="Tell the version.")


@app.callback()
def _options(version: Annotated[bool, VERSION] = False) -> None: ...


class WorkFailedError(Exception):
    """The work failed though the input was good: exit code 1."""


@app.command()
def reproduce(
    rig: RigOption = None,
    out: OutOption = Path("out"),
    seed: SeedOption = 1,
    frames: Annotated[
        bool, typer.Option(help="Runs of Figs. 10 to 14 through rendered camera frames.")
    ] = True,
) -> None:
    """Reproduce the paper's study on the virtual rig. Makes its figures, a
    report and results.json."""
    from experiments.cli.console import bars
    from experiments.cli.out_folder import out_folder
    from experiments.paper.claims import VERDICT_WORDS
    from experiments.paper.reproduce import reproduce as work
    from experiments.runs.assemble import load_rig

    table, folder = load_rig(rig), out_folder(out)
    with bars() as progress:
        results = work(table, folder, seed=seed, frames=frames, progress=progress)
    for claim in results["claims"]:
        say(_claim_line(claim))
    verdicts = [claim["holds"] for claim in results["claims"]]
    told = ", ".join(f"{word} {verdicts.count(holds)}" for holds, word in VERDICT_WORDS.items())
    say(f"claims of the paper: {told} (improvement: without - with compensation [95 %])")
    say(f"report: {out / 'report.html'}   numbers: {out / 'results.json'}")


def _claim_line(claim: dict) -> str:
    from experiments.paper.claims import VERDICT_WORDS
    from experiments.reports.figures import shown_unit

    word = VERDICT_WORDS[claim["holds"]]
    if not claim["runs"]:
        told = "no completed pair of runs gives this measure on this table"
        return f"{word:9s} Fig. {claim['figure']:>2s}  {claim['claim']}: {told}"
    factor, unit = shown_unit(claim["unit"])
    effect, low, high = (f"{factor * claim[key]:+.3f}" for key in ("effect", "low", "high"))
    numbers = f"{effect} [{low}, {high}] {unit}"
    told = f"{numbers} (matters from {factor * claim['relevant']:.2g}), n = {claim['runs']}"
    return f"{word:9s} Fig. {claim['figure']:>2s}  {claim['claim']}: {told}"


@app.command()
def run(
    protocol: Annotated[str, typer.Argument(help=f"{PROTOCOLS}, or your own .toml file.")],
    arm: Annotated[
        str, typer.Option(help="Play compensation: with, without, both, or a compensator by name.")
    ] = "both",
    rig: RigOption = None,
    out: OutOption = Path("out/run"),
    seed: Annotated[int | None, typer.Option(min=0, help="Default: the protocol's own.")] = None,
    repetitions: Annotated[
        int | None, typer.Option(min=1, max=1000, help="Default: the protocol's.")
    ] = None,
    camera: Annotated[str, typer.Option(help="statistical, or frames (rendered).")] = "statistical",
    yes: Annotated[bool, typer.Option("--yes", help="Do not ask before a real table is armed.")] = (
        False
    ),
) -> None:
    """Run a protocol and record it. On the virtual table or the rig file's; prints the folders."""
    from experiments.cli.console import bars
    from experiments.cli.out_folder import out_folder
    from experiments.records.run_folder import clock_note
    from experiments.runs.assemble import load_rig
    from experiments.runs.protocol import read_protocol
    from experiments.runs.runs import run_protocol
    from rig.control.controllers import COMPENSATORS

    plan = read_protocol(protocol)
    if arm not in (*COMPENSATORS, "own", "both"):
        raise ValueError(f"--arm {arm}: must be {', '.join(COMPENSATORS)}, own or both")
    if camera not in ("statistical", "frames"):
        raise ValueError(f"--camera {camera}: must be statistical or frames")
    table, folder = load_rig(rig), out_folder(out, shared=True)
    if note := clock_note(folder / "runs"):
        say(note)
    how = {
        "arms": plan.arms if arm == "both" else [arm],
        "out": folder,
        "seed": plan.seed if seed is None else seed,
        "repetitions": repetitions or plan.repetitions,
    }
    if rig is not None and table.table.kind != "simulated":
        from experiments.runs.hardware import consent
        from experiments.runs.runs import measure_protocol

        ask = partial(consent, yes=yes)
        with saying_aside() as aside:
            done = measure_protocol(table, rig, plan, **how, arm_table=ask, say=aside)
    else:
        with bars() as progress:
            done = run_protocol(table, plan, **how, frames=camera == "frames", progress=progress)
    for one in done:
        reason = f" ({one.ending.reason})" if one.ending.reason else ""
        say(f"{one.folder}  {one.ending.outcome}{reason}")
    if plan.servo_only and not table.servo.has_angle:
        say(
            "note: on this table nothing measures servo angles (servo.angle_measured = false), "
            "and the protocol has no ball: only what the servos were told is recorded. To see what "
            "they did lead a ball about (rig run circle), then rig calibrate servo RUN"
        )
    if any(one.ending.outcome != "completed" for one in done):
        raise WorkFailedError("not every run was completed; what was recorded is kept")


@app.command()
def report(
    runs: Annotated[list[Path], typer.Argument(help="Run folders.")],
    out: OutOption = Path("out/report"),
) -> None:
    """Figures and numbers of recorded runs as one HTML page. Simulated runs or measured ones."""
    from experiments.cli.console import bars
    from experiments.cli.out_folder import out_folder
    from experiments.reports.report_runs import report_runs

    with bars() as progress:
        page = report_runs(runs, out_folder(out), progress=progress)
    say(str(page))


@app.command()
def track(
    video: Annotated[str, typer.Argument(help="Video file, image folder or stream address.")],
    out: OutOption = Path("out/track"),
    calibration: Annotated[
        Path | None,
        typer.Option(help="calibration.json that `rig calibrate` made: places in metres too."),
    ] = None,
    ball_colour: Annotated[
        str | None, typer.Option(help="Name or #rrggbb; default: found.")
    ] = None,
    ball_at: Annotated[
        str | None, typer.Option(help="U,V or U,V,RADIUS in px in the first frame; default: found.")
    ] = None,
) -> None:
    """Track a ball in real footage. Makes track.csv, a film with overlay, a contact sheet."""
    from experiments.cli.console import bars, tell_of_compiling
    from experiments.cli.out_folder import out_folder
    from experiments.track.track import place_of, track_video
    from experiments.track.words import summary_words
    from rig.loop.signals import leave_if_told

    bundle = None
    if calibration is not None:
        from calibration.bundle import load

        if not calibration.is_file():
            raise FileNotFoundError(f"--calibration {calibration}: no such file")
        bundle = load(calibration)
    place = None if ball_at is None else place_of(ball_at)
    how = {"calibration": bundle, "ball_colour": ball_colour, "ball_at": place}
    with bars() as progress:

        def told(done: int, total: int | None) -> None:
            leave_if_told()  # a stream has no total, and no bar
            if done == 0:
                tell_of_compiling()
            if total:
                progress("frames", done, max(done, total))

        summary = track_video(video, out_folder(out), **how, progress=told)
    for line in summary_words(summary, out):
        say(line)


@app.command()
def effects(
    rig: Annotated[
        Path | None, typer.Argument(help="rig.toml: its own effects, too; only what it can have.")
    ] = None,
) -> None:
    """List the effects that the model knows. Name, keys, unit, range, tolerance, meaning."""
    from experiments.cli.console import effects_table
    from rig.effects import CATALOGUE, effects_of

    if rig is None:
        effects_table(CATALOGUE)
        return
    from experiments.runs.assemble import load_rig

    table = load_rig(rig)
    effects_table(effects_of(table.servo.kind, table.catalogue.values()))


@app.command()
def export(
    run: Annotated[Path, typer.Argument(help="Run folder.")],
    out: Annotated[Path, typer.Option(help="File ending in .csv, .parquet or .mat.")],
) -> None:
    """Write a run's log as CSV, Parquet or MAT."""
    from experiments.records.exporting import check_place, export_log
    from experiments.records.recording import read_run
    from experiments.records.run_folder import lost_words

    check_place(out)
    whole = read_run(run)
    say(str(export_log(whole.log, out)))
    if lost := lost_words(whole.meta):
        typer.echo(f"note: {run}: {lost}", err=True)
    if whole.growing:
        typer.echo(f"note: {run}: {whole.part}", err=True)
    elif whole.meta["truncated"]:
        raise WorkFailedError(
            f"{run} is cut short: {len(whole.log)} of {whole.meta.get('rows') or 'unknown'} rows "
            "were left and exported; the rest is lost"
        )


@app.command()
def recover(run: Annotated[Path, typer.Argument(help="Run folder that was cut off.")]) -> None:
    """Mend a recording that a kill or a full disk cut off."""
    from experiments.records.recording import recover as mend

    mended = mend(run)
    say(f"{run}: {len(mended.log)} rows, outcome {mended.meta['outcome']}")
    for kept in sorted(run.glob("samples.damaged*.mcap")):
        say(f"{kept}: the file before, which held more than could be read")


@app.command()
def reject(
    run: Annotated[Path, typer.Argument(help="Run folder.")],
    reason: Annotated[str, typer.Argument(help="Why this repetition does not count.")],
) -> None:
    """Mark a repetition as rejected. Reports leave it out and say why."""
    from experiments.runs.runs import reject as mark

    mark(run, reason)
    say(f"{run}: rejected ({reason})")


app.command()(dashboard)
app.command(cls=OptionSections)(gap)
app.command()(watch)
app.command()(sheet)
app.command()(check)
app.command()(compare)
app.command()(home)
app.command("import", epilog=EPILOG)(import_)
app.command("export-model")(export_model)
app.command()(serve)
app.command()(doctor)
app.add_typer(calibrate, name="calibrate")
app.add_typer(benchmark, name="benchmark")


def main() -> None:
    """Entry point: run the command line, with errors as one line on standard error.

    Ends the process with the exit code: 0 done, 1 the work failed, 2 bad input, 130 interrupted,
    143 ended by SIGTERM.
    """
    from rig.loop.signals import leave_on_signals

    if sys.argv[1:] in ([], *([group.name] for group in app.registered_groups)):
        sys.argv.append("--help")
    threads = os.environ.get("NUMBA_NUM_THREADS")
    if threads is not None and not (threads.isdecimal() and int(threads) > 0):
        _fail(f"NUMBA_NUM_THREADS = {threads!r}: must be a whole number above 0", 2)
    # Before numpy: every process that a command starts inherits it. `calibration.linear_algebra`.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        with leave_on_signals(_print):  # the parser makes an interruption a returned 130
            code = app(prog_name="rig", standalone_mode=False)
        if code == INTERRUPTED:
            raise KeyboardInterrupt
        if sys.stdout is not None:
            sys.stdout.flush()
        if isinstance(code, int) and code:
            sys.exit(code)
    except typer.Exit as end:
        sys.exit(end.exit_code)
    except (KeyboardInterrupt, typer.Abort) as error:
        if isinstance(error.__cause__, EOFError):  # for the parser that is somebody who left
            _fail(f"a file, or a process of this program, ended too early: {error.__cause__}", 1)
        _fail("interrupted; what was recorded so far is kept", INTERRUPTED)
    except WorkFailedError as error:
        _fail(str(error), 1)
    except (ValueError, FileNotFoundError, NotADirectoryError, PermissionError) as error:
        _fail(error_words(error), 2)
    except OSError as error:
        if error.errno in BAD_NAMES:
            _fail(error_words(error), 2)
        full = error.errno in (errno.ENOSPC, errno.EDQUOT) and "free" not in str(error.strerror)
        cure = "; free some space: what was recorded so far is kept" if full else ""
        _fail(f"{error_words(error)}{cure}", 1)
    except MemoryError:
        _fail("there is not enough memory for this: end other programs, or cut the input", 1)
    except Exception as error:
        if hasattr(error, "format_message"):  # the parser's own usage errors
            _fail(usage_words(error, sys.argv), 2)
        if isinstance(error, RuntimeError) and str(error) == NO_THREAD:
            _fail("no thread can be started here: end other programs, or raise `ulimit -u`", 1)
        _fail(f"{type(error).__name__}: {error}", 1)


def _say(message: str) -> None:
    from rig.files import printable

    line = printable(message)
    if len(line) > LONGEST_LINE:
        line = f"{line[: LONGEST_LINE - 200]} ... {line[-195:]}"
    _print(line)


def _print(line: str) -> None:
    """Print a line on standard error, or nothing where that cannot be written."""
    with suppress(OSError):
        print(f"rig: {line}", file=sys.stderr)


def _fail(message: str, code: int) -> None:
    _say(message)
    try:
        if sys.stdout is not None:
            sys.stdout.flush()
    except OSError:  # a full disk: the interpreter would try again, and end with 120
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    sys.exit(code)


if __name__ == "__main__":
    main()
