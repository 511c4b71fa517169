"""What a student gets for a sheet: recorded runs of a table of their own, its rig file, and the
results file to fill in."""

from pathlib import Path

from experiments.progress import ProgressCall, silent
from experiments.runs.protocol import read_protocol
from experiments.runs.runner import RunRequest, keep_simulated, simulate_run
from experiments.sheets.catalogue import LabSheet, Question
from rig.files import write_ours, write_whole
from rig.rigfile import refuse_own, write_rig

RESULTS, EXERCISE, BLANK = "results.toml", "exercise.md", "?"
PAGES = Path(__file__).parent


def hand_out(
    sheet: LabSheet, student: str, out: Path, *, progress: ProgressCall = silent
) -> list[Path]:
    """Write rig.toml, the runs in out/runs, the exercise and a blank results.toml; return the run
    folders.

    A results file that is there is kept. FileExistsError: out/runs holds runs already. ValueError:
    as of `seed_of`, or out/rig.toml is somebody's own. OSError: `out` cannot be written.
    """
    table = sheet.table_of(student)
    if any((out / "runs").glob("*/run.json")):
        raise FileExistsError(f"{out}/runs holds runs already: give each sheet an --out of its own")
    refuse_own(out / "rig.toml")
    write_rig(table.known, out / "rig.toml")
    made = []
    for i, (protocol, arm) in enumerate(sheet.runs):
        progress("recording your table's runs", i, len(sheet.runs))
        seed = table.seed % 1_000_000 + i
        parts = read_protocol(protocol), arm, seed, out / "runs"
        request = RunRequest(table.plant, *parts, kind=table.known)
        made.append(keep_simulated(request, simulate_run(request), truth=False))
    progress("recording your table's runs", len(sheet.runs), len(sheet.runs))
    if not (out / RESULTS).exists():
        write_whole(out / RESULTS, blank_results(sheet, student).encode())
    write_ours(out / EXERCISE, exercise(sheet, out).encode(), b"uv run rig ")
    return made


def exercise(sheet: LabSheet, out: Path) -> str:
    """The sheet's page, its commands for the folder `out`."""
    page = (PAGES / f"{sheet.name}.md").read_text(encoding="utf-8")
    return page.replace(f"out/sheet-{sheet.name}", str(out))


def next_commands(sheet: LabSheet, out: Path) -> list[str]:
    """The commands of the sheet's page that follow the one that handed it out."""
    lines = exercise(sheet, out).splitlines()
    return [line for line in lines if line.startswith("uv run rig ")][1:]


def blank_results(sheet: LabSheet, student: str) -> str:
    """The results file with a line for each question, not answered."""
    name = " ".join(student.split()).replace("\\", "\\\\").replace('"', '\\"')
    lines = [f"# {sheet.title}: replace each {BLANK!r} by your answer.", f'sheet = "{sheet.name}"']
    lines += [f'student = "{name}"', "", "[answers]"]
    lines += [f'{one.key} = "{BLANK}"  # {_what(one)}' for one in sheet.questions]
    return "\n".join(lines) + "\n"


def _what(question: Question) -> str:
    if question.choices:
        return f"{question.asks}: {', '.join(question.choices)}"
    return f"{question.asks} [{question.unit}]"
