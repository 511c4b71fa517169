"""The command `rig import`: somebody's recording as a log of this rig, by a map kept beside it."""

import sys
from collections.abc import Callable
from filecmp import cmp
from pathlib import Path
from typing import Annotated

import typer

from experiments.cli.say import say

EPILOG = """
Without --map the file's names, ranges and physics are looked at, a map is proposed in five lines,
and you are asked; --yes takes it. What the file does not tell (a sign, a unit, a scale) is asked,
and with --yes refused in one line that names the option. Examples:
--set ball.unit=mm (both axes), --set ball_x_m.column="Pos X", --set time.rate_hz=50,
--set command.offset=90, --set voltage.scale=12 (volts of the supply, for a share of it),
--set theta.unit=turn/4096 (counts a turn), --set ball_y_m.sign=-1, --set target.column=none.
Then: rig gap LOG --rig my.toml (the last line says it)
"""


def import_(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE...",
            help="CSV, text, JSON, MAT, HDF5, NumPy, TDMS, Parquet, MCAP; folder "
            "of a LeRobot set or ROS 2 bag.",
        ),
    ],
    out: Annotated[Path, typer.Option("--out", help="Log: .csv, .parquet or .mat.")],
    map_file: Annotated[
        Path | None, typer.Option("--map", help="Reuse a map; do not look at the file.")
    ] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="NAME.KEY=VALUE", help="State a part of the map."),
    ] = None,
    calibration: Annotated[
        Path | None, typer.Option(help="Camera's bundle: the ball is in pixels.")
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", help="Take the proposal unasked.")] = False,
) -> None:
    """Turn recordings of other programs into logs. A file import.toml beside them keeps how.

    Several sessions become LOG-1, LOG-2, ...
    """
    from experiments.importing.formats.choose import read_recording
    from experiments.importing.import_map import stated
    from experiments.importing.words import log_line, next_line
    from experiments.records.exporting import export_log, writer_of
    from experiments.records.run_folder import refuse_input

    said = stated(settings or [])
    if calibration is not None:
        said.setdefault("", {})["calibration"] = str(calibration)
    writer_of(out)
    recordings = [read_recording(path) for path in files]
    made = _made(files, recordings, said, map_file, yes=yes)
    logs = _converted(files, recordings, made, told=map_file is None)
    names = [out]
    if len(logs) > 1:
        names = [out.with_name(f"{out.stem}-{i + 1}{out.suffix}") for i in range(len(logs))]
    for name in names:
        refuse_input("--out", name, files)
    for name, log in zip(names, logs, strict=True):
        written(name, lambda part, log=log: export_log(log, part), aside=name != out)
        say(log_line(str(name), log))
    _keep_map(made, out.with_name("import.toml"), map_file)
    say(next_line(names, made))


def _made(files: list[Path], recordings, said, map_file: Path | None, *, yes: bool):
    """The map for these files: the one that was given, or the one that the first file seems to
    need. ValueError (one line): there is none, or a file says otherwise."""
    from experiments.importing.import_map import merged, read_map
    from experiments.importing.recording import BadFileError
    from rig.files import printable

    sources = tuple(printable(path.name) for path in files)
    if map_file is not None:
        made = merged(read_map(map_file), said).model_copy(update={"sources": sources})
        _refuse_other_units(files, recordings, made, said)
        return made
    try:
        made = _proposed(recordings[0], said, sources, yes=yes)
    except BadFileError as error:
        why = "; ".join((str(error), *recordings[0].notes))
        raise ValueError(f"{files[0]}: {why}") from error
    _refuse_other_units(files, recordings, made, said, recordings[0].stream)
    _refuse_others(files[1:], recordings[1:], made, said)
    return made


def _converted(files: list[Path], recordings, made, *, told: bool) -> list:
    """The logs of every recording in turn; told: the first one's notes were said already.

    ValueError (one line, with the path): as of `convert`.
    """
    from experiments.importing.conversion import convert

    logs = []
    for i, (path, recording) in enumerate(zip(files, recordings, strict=True)):
        try:
            logs += convert(recording.stream, made)
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from error
        for note in () if told and i == 0 else recording.notes:
            say(f"note: {path}: {note}", sys.stderr)
    return logs


def _keep_map(made, kept: Path, given: Path | None) -> None:
    """Write the map as `kept`, unless that is the one that was given: it is somebody's."""
    from experiments.importing.import_map import write_map

    if given is None or not kept.exists() or not kept.samefile(given):
        written(kept, lambda part: write_map(part, made), aside=True)
    say(f"map: {kept}")


def written(path: Path, write: Callable[[Path], object], *, aside: bool) -> None:
    """Have `write` make a file; aside: another one of that name, which nobody named, is kept beside
    it as NAME.1, NAME.2 ..., unless it is the same."""
    from rig.files import naming, part_of, put_aside

    part = part_of(path).with_suffix(path.suffix)
    try:
        with naming(path):
            write(part)
        if aside and path.exists() and not cmp(path, part, shallow=False):
            put_aside(path)
            say(f"{path.name} was there: it is kept as {path.name}.1 or the next free number")
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def somebody_is_there() -> bool:
    """Whether a person can answer: standard input is a terminal."""
    return sys.stdin.isatty()


def _proposed(recording, said, sources: tuple[str, ...], *, yes: bool):
    """The map that the file seems to need: shown, and asked about unless `yes`.

    ValueError (one line): `yes`, or nobody is there to ask, and something is in doubt.
    """
    from experiments.importing.import_map import with_answers
    from experiments.importing.proposal import propose
    from experiments.importing.words import report_lines

    found = propose(recording.stream, said)
    ask = not yes and somebody_is_there()
    if ask and found.doubts:
        for line in report_lines(recording, found):
            say(line)
    while found.doubts and ask:
        doubt = found.doubts[0]
        try:
            answered = with_answers(said, _answer(doubt))
            found, said = propose(recording.stream, answered), answered
        except ValueError as error:
            say(str(error))
    for line in report_lines(recording, found):
        say(line)
    made = found.map(sources)
    if not yes:
        if not ask:
            raise ValueError("nobody is there to ask: --yes takes this proposal")
        typer.confirm("import so", abort=True, default=True)
    return made


def _refuse_other_units(files: list[Path], recordings, made, said, first=None) -> None:
    """ValueError (one line): a file states another unit than the map that was given, or than the
    `first` file, of which the map was made."""
    from experiments.importing.agreement import other_unit

    for path, recording in zip(files, recordings, strict=True):
        if words := other_unit(made, recording.stream, said, first):
            raise ValueError(_unfit(path, "map of the first file" if first else "given map", words))


def _unfit(path: Path, which: str, words: str) -> str:
    return (
        f"{path}: the {which} does not fit it ({words}): import it alone, or state what is right "
        "for all with --set"
    )


def _refuse_others(files: list[Path], recordings, made, said) -> None:
    """ValueError (one line): a further file does not say of itself what the first one's map says.

    A file in which nothing can be compared says nothing against it.
    """
    from experiments.importing.agreement import contradiction, other_pace
    from experiments.importing.proposal import propose
    from experiments.importing.recording import BadFileError

    for path, recording in zip(files, recordings, strict=True):
        try:
            words = contradiction(made, propose(recording.stream, said))
            words = words or other_pace(made, recording.stream)
        except BadFileError:
            continue
        except ValueError as error:
            words = str(error)
        if words:
            raise ValueError(_unfit(path, "map of the first file", words))


def _answer(doubt) -> str:
    """What a person says to a doubt, as `NAME.KEY=VALUE`."""
    first = doubt.options[0] if doubt.options else None
    choices = f" ({', '.join(doubt.options)})" if doubt.options else ""
    answer = typer.prompt(f"{doubt.why}? {doubt.place}.{doubt.key}{choices}", default=first)
    return f"{doubt.place}.{doubt.key}={answer}"
