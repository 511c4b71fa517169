"""Which answers of a results file are right, without saying what would be right."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from experiments.records.recording import read_run
from experiments.records.run_folder import read_meta
from experiments.sheets.catalogue import LabSheet, Question
from experiments.sheets.handout import BLANK
from experiments.sheets.swing import swing
from rig.files import StrictModel, first_error_line, known_names, toml_of

RIGHT, WRONG, OPEN = "right", "wrong", "not answered"
BLANKS = ("", BLANK)


class Results(StrictModel):
    """A results file: the sheet, the student, and the answers by key."""

    sheet: str
    student: str
    answers: dict[str, float | str]


@dataclass(frozen=True)
class Checked:
    """One answer: RIGHT, WRONG or OPEN; hint: the tolerance and its reason, "" for a word."""

    question: Question
    state: str
    hint: str = ""


def read_results(path: Path, sheet: LabSheet) -> Results:
    """A results file of the sheet. FileNotFoundError, ValueError (one line): no such file, no TOML,
    unknown or missing keys, another sheet, or an answer of the wrong kind."""
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such results file; rig sheet {sheet.name} makes one")
    try:
        data: dict[str, Any] = toml_of(path)
        found = Results(**data)
    except ValidationError as error:
        raise ValueError(f"{path}: {first_error_line(error, Results)}") from None
    except (ValueError, TypeError) as error:
        raise ValueError(f"{path}: {error}") from None
    if found.sheet != sheet.name:
        raise ValueError(f"{path} is of sheet '{found.sheet}', not of '{sheet.name}'")
    known = {one.key: one for one in sheet.questions}
    for key, answer in found.answers.items():
        if key not in known:
            raise ValueError(f"{path}: unknown answer '{key}'; {known_names(key, known)}")
        _check_kind(path, known[key], answer)
    return found


def check(sheet: LabSheet, path: Path) -> list[Checked]:
    """The answers of a results file, in the sheet's order; a missing one is not answered.

    The limit cycle is taken from the student's own run beside the file. Errors as of
    `read_results`; FileNotFoundError, ValueError: that run is not there, or of another table.
    """
    found = read_results(path, sheet)
    table = sheet.table_of(found.student)
    truth = dict(table.truth)
    if sheet.cycle:
        truth |= _cycle(path.parent / "runs", sheet.cycle, table.seed, len(sheet.runs))
    return [
        _checked(one, found.answers.get(one.key, BLANK), truth[one.key]) for one in sheet.questions
    ]


def _check_kind(path: Path, question: Question, answer: float | str) -> None:
    if answer in BLANKS:
        return
    if question.choices and answer not in question.choices:
        raise ValueError(
            f"{path}: {question.key} = {answer!r} is none of {', '.join(question.choices)}"
        )
    if not question.choices and isinstance(answer, str):
        raise ValueError(f"{path}: {question.key} = {answer!r} is no number [{question.unit}]")


def _checked(question: Question, answer: float | str, true: float | str) -> Checked:
    if answer in BLANKS:
        return Checked(question, OPEN)
    if isinstance(true, str) or isinstance(answer, str):
        return Checked(question, RIGHT if answer == true else WRONG)
    allowed = question.within + question.share * abs(true)
    parts = []
    if question.within:
        parts.append(f"{question.within:g} {question.unit}")
    if question.share:
        parts.append(f"{100 * question.share:g} %")
    hint = f"within {' + '.join(parts)}: {question.why}"
    return Checked(question, RIGHT if abs(answer - true) <= allowed else WRONG, hint)


def _cycle(runs: Path, arm: str, seed: int, most: int) -> dict[str, float | str]:
    """Amplitude and period of the ball's limit cycle in x in the student's released run."""
    for folder in sorted(runs.glob(f"*hold-{arm}")):
        meta = read_meta(folder)
        if not 0 <= int(meta["seed"] or 0) - seed % 1_000_000 < most:
            raise ValueError(f"{folder} is of another student's table: check your own runs")
        amplitude_m, period_s = swing(read_run(folder).log, 0)
        return {"amplitude_x_cm": 100.0 * amplitude_m, "period_x_s": period_s}
    raise FileNotFoundError(
        f"{runs} holds no hold run '{arm}': keep the results file beside your runs"
    )
