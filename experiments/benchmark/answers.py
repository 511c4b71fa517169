"""Answers to a set: made by `rig gap` (or another entry), read, and checked before they count."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from experiments.benchmark.make import CASES
from experiments.blind.analysis_jobs import (
    FAILED,
    Analysis,
    Packed,
    analyse,
    answers_of,
    pack_folder,
    run_analyses,
)
from experiments.blind.seal import SEAL, sealed_hash
from experiments.progress import ProgressCall, silent
from experiments.records.run_folder import writable, write_json
from rig.files import first_error_line, json_of
from rig.rigfile import effect_files

WORK = "work"  # answers with their seconds, by which an interrupted run goes on
NO_ANSWER: dict[str, Any] = {"verdict": FAILED, "sentence": "no answer", "effects": []}


class _Part(BaseModel):
    """A part of an answer; what the score does not read may stand beside."""

    model_config = ConfigDict(extra="ignore", frozen=True, allow_inf_nan=False)


Number = Annotated[float, Field(strict=True)]  # no text, no true


class Interval(_Part):
    """A number with its 95 % interval; None: bounded on no side."""

    value: Number
    low: Number | None = None
    high: Number | None = None


class Effect(_Part):
    """A name of the catalogue (or of an entry's own), how sure, and its sizes by axis and key."""

    name: str
    probability: Annotated[Number, Field(ge=0, le=1)] | None = None
    parameters: dict[Literal["x", "y", "xy"], dict[str, Interval]] = {}


class Answer(_Part):
    """What the score reads of the JSON of `rig gap`."""

    verdict: Literal["named", "nothing-missing", "unknown-effect", "undecided", "failed"]
    effects: tuple[Effect, ...] = ()
    unknown: dict[str, Any] | None = None


def case_names(folder: Path) -> list[str]:
    """The names of a set's cases. FileNotFoundError: there is no set in `folder`."""
    names = sorted(path.name for path in (folder / CASES).glob("*") if path.is_dir())
    if not names:
        raise FileNotFoundError(f"{folder} holds no benchmark: make one with `rig benchmark make`")
    return names


def answer_set(
    folder: Path,
    out: Path,
    *,
    answer: Analysis = analyse,
    first: int | None = None,
    jobs: int | None = None,
    cluster: str | None = None,
    progress: ProgressCall = silent,
) -> int:
    """Answer the cases of a set; OUT/CASE.json is the JSON of `rig gap`. Return how many failed.

    answer: from a case's folder to that JSON; first: so many cases alone, in the set's order;
    jobs, cluster: see `experiments.workers.results_of`. A later call goes on where one was
    interrupted. The answers depend neither on processes nor on machines. ValueError: `out` holds
    answers to another set, a rig file of the set names code, no cluster. FileNotFoundError: no set.
    OSError: not writable.
    """
    names = case_names(folder)[:first]
    _same_set(folder, out)
    if sealed_hash(out) is None and answers_of(out / WORK):
        raise ValueError(f"{out}: does not say to which set its answers are: choose another --out")
    write_json(writable(out) / SEAL, {"sha256": sealed_hash(folder)})  # before the first answer
    found = run_analyses(
        names,
        lambda name: packed_case(folder / CASES / name),
        out / WORK,
        answer=answer,
        jobs=jobs,
        cluster=cluster,
        progress=progress,
    )
    for name, one in found.items():
        write_json(out / f"{name}.json", one["answer"])
    return sum(one["answer"].get("verdict") == FAILED for one in found.values())


def packed_case(case: Path) -> Packed:
    """The files of a case. ValueError (one line): its rig file names code, which would be executed
    where it is read: a set may be anybody's.
    """
    packed = pack_folder(case)
    try:
        named = effect_files(packed.get("rig.toml", b"").decode())
    except ValueError as error:
        raise ValueError(f"{case / 'rig.toml'}: {error}") from None
    if named:
        raise ValueError(
            f"{case / 'rig.toml'} names effects of its own ({named[0]}), and the code of a set is "
            "not executed: take that case out"
        )
    return packed


def _same_set(folder: Path, out: Path) -> None:
    """ValueError: the answers in `out` say that they are to another set."""
    mine, theirs = sealed_hash(folder), sealed_hash(out)
    if theirs is not None and mine != theirs:
        raise ValueError(
            f"{out}: answers to another set (hash {theirs[:12]}, not {str(mine)[:12]})"
        )


def read_answers(
    folder: Path, out: Path, names: Sequence[str]
) -> tuple[dict[str, Mapping[str, Any]], dict[str, float]]:
    """The answers in `out` to these cases, and the seconds of those that were timed, by name.

    A case without a file has no entry. ValueError (one line): an answer is no JSON of `rig gap`, or
    to a case that the set does not have, or to another set. FileNotFoundError: no such folder.
    """
    if not out.is_dir():
        raise FileNotFoundError(f"{out}: no such folder of answers")
    _same_set(folder, out)
    files = {path.stem: path for path in sorted(out.glob("*.json")) if path.name != SEAL}
    odd = sorted(set(files) - set(names))
    if odd:
        raise ValueError(f"{files[odd[0]]}: the set has no case of that name")
    timed = {name: one["seconds"] for name, one in answers_of(out / WORK).items()}
    # What nobody checked does not reach the score.
    return {name: _checked(path)[1].model_dump() for name, path in files.items()}, timed


def read_answer(path: Path) -> dict[str, Any]:
    """One answer. ValueError (one line): it is no JSON, or not as the rules have it."""
    return _checked(path)[0]


def _checked(path: Path) -> tuple[dict[str, Any], Answer]:
    """An answer as it is, and what the score reads of it; errors as of `read_answer`."""
    try:
        data = json_of(path)
        return data, Answer.model_validate(data)
    except ValidationError as error:
        raise ValueError(f"{path}: {first_error_line(error)}; format: rules.md") from None
    except (ValueError, OSError) as error:
        why = error.strerror if isinstance(error, OSError) else error
        raise ValueError(f"{path}: {why}") from None
