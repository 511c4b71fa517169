"""Work of the page for a worker process: figures, report. Everything here can be pickled."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from experiments.dashboard.session.worker_process import ProgressSender
from rig.files import as_unicode

if TYPE_CHECKING:
    from experiments.records.recording import Run

MOST_LISTED = 40  # runs; chosen: a list on the page is no longer
LONGEST_WORDS = 80  # characters of a run.json's word; chosen: every page is sent each of them
UNFINISHED, BEING_RECORDED = "unfinished", "being recorded"
SERVOS_ALONE = "the servos alone, without a ball: no figure; the tab Gap uses these runs."


@dataclass(frozen=True)
class CaptionedPicture:
    """A picture file with a sentence on what it shows."""

    path: Path
    caption: str


@dataclass(frozen=True)
class RunSummary:
    """A recorded run in a list of runs: what its run.json says.

    method: the compensator; centroid_cm: mean position (x, y) of the ball, None where not computed
    or where the target moves; by_hand: what somebody did to it ("12.3 s: push to the left, 0.15
    m/s"); servo_only: there was no ball; named: whether its label tells its folder's name, since
    another run has the same protocol, controller and time; table: number of the table that it was
    made on, 0 for that of the newest run; reason: why it ended as it did.
    """

    folder: Path
    protocol: str
    method: str
    seed: int | None
    outcome: str
    centroid_cm: tuple[float, float] | None = None
    by_hand: tuple[str, ...] = ()
    servo_only: bool = False
    named: bool = False
    table: int = 0
    reason: str = ""

    @property
    def when(self) -> str:
        """The clock when the run began, as on the wall here; with the day unless it is today's. Of
        a folder whose name tells no time, that name.
        """
        stamp, _, rest = self.folder.name.partition("-")
        try:
            begun = datetime.strptime(stamp, "%Y%m%dT%H%M%S").replace(tzinfo=UTC).astimezone()
        except ValueError:
            return self.folder.name
        day = "" if begun.date() == datetime.now().date() else f"{begun:%Y-%m-%d} "
        again = rest.rpartition("-")[2]  # of the runs that began in one second
        return f"{day}{begun:%H:%M:%S}" + (f" ({again})" if again.isdigit() else "")

    @property
    def label(self) -> str:
        """Name of the run for a person: protocol, controller, when; whether of an older table."""
        which = f" [{self.folder.name}]" if self.named else ""
        table = ", another table" if self.table else ""
        return f"{self.protocol}, {self.method}, {self.when}{which}{table}"

    @property
    def how(self) -> str:
        """How the run ended, why, and whether somebody disturbed it, for a person."""
        if self.outcome == UNFINISHED:
            return "cut off: Recover"
        why = f": {self.reason}" if self.reason else ""
        return self.outcome + why + (", disturbed by hand" if self.by_hand else "")


def list_runs(parent: Path, most: int = MOST_LISTED) -> list[RunSummary]:
    """At most `most` run folders of `parent`, newest first; runs that cannot be read are
    left out.
    """
    from experiments.analysis.alike import groups
    from experiments.records.made_with import entries, of_table
    from experiments.records.recording import being_recorded
    from experiments.records.run_folder import protocol_of, read_meta

    rows, made = [], []
    for folder in sorted(parent.iterdir() if parent.is_dir() else (), reverse=True):
        if as_unicode(folder.name) != folder.name:  # no page could be told
            continue
        try:
            if not (folder / "run.json").is_file():
                continue
            meta = read_meta(folder)
            outcome = str(meta.get("outcome") or UNFINISHED)
            if outcome == UNFINISHED and being_recorded(folder):
                outcome = BEING_RECORDED
        except (OSError, ValueError):  # also a folder that nobody but its owner may look into
            continue
        name = protocol_of(meta).get("name", "?")
        if "rejected" in meta:
            outcome = "rejected"
        by_hand = meta.get("by_hand")
        by_hand = tuple(map(str, by_hand[:MOST_LISTED])) if isinstance(by_hand, list) else ()
        reason = meta.get("rejected") or meta.get("reason") or ""
        name, method, outcome, reason = (
            str(words)[:LONGEST_WORDS] for words in (name, meta.get("arm"), outcome, reason)
        )
        servo_only = bool(protocol_of(meta).get("servo_only"))
        rows.append(
            RunSummary(
                folder,
                name,
                method,
                meta.get("seed"),
                outcome,
                by_hand=by_hand,
                servo_only=servo_only,
                reason=reason,
            )
        )
        made.append(of_table(entries(folder, meta)))
        if len(rows) == most:
            break
    rows = [replace(row, table=table) for row, table in zip(rows, groups(made), strict=True)]
    labels = Counter(row.label for row in rows)
    return [replace(row, named=labels[row.label] > 1) for row in rows]


@dataclass(frozen=True)
class DrawnFigures:
    """Figures of runs, the runs with their centroids, and both methods compared.

    sentence, table: of `experiments.analysis.comparison`, of the runs that count; counts: how many
    those are, without and with play compensation; left_out: sentences on runs that do not; unread:
    what is wrong with each that cannot be read.
    """

    pictures: list[CaptionedPicture]
    rows: list[RunSummary]
    sentence: str = ""
    table: list[list[str]] = field(default_factory=list)
    counts: tuple[int, int] = (0, 0)
    left_out: tuple[str, ...] = ()
    unread: tuple[str, ...] = ()


def draw_figures(
    rows: Sequence[RunSummary], out: Path, disturbed: bool, progress: ProgressSender
) -> DrawnFigures:
    """Draw the figures of the paper that these runs of one protocol (newest first) allow.

    Fig. 10 and 11, or 12 and 13, need a completed run of either method, Fig. 14 four of either.
    disturbed: runs that somebody disturbed by hand count as well; equal runs count once, and only
    those that were made as the newest was; one that cannot be read is told. OSError, ValueError:
    `out` cannot be written, no run can be read.
    """
    from experiments.analysis.alike import both_methods
    from experiments.analysis.comparison import comparison_rows, comparison_sentence
    from experiments.analysis.numbers import recorded, resting_centroid_cm
    from experiments.analysis.regime import rig_of_record
    from experiments.dashboard.session.figures_of_runs import Completed
    from experiments.records.made_with import entries
    from experiments.records.recording import read_run
    from experiments.reports.figures import save

    completed, methods, made = [], [], []
    counted, unread, sources, marks, side_cm = [], [], set(), {}, {}
    for i, row in enumerate(rows):
        progress("reading runs", i, len(rows))
        try:
            stored = read_run(row.folder)
        except (OSError, ValueError) as error:
            unread.append(str(error))
            if len(unread) == len(rows):
                raise
            continue
        run = recorded(row.folder, stored.log, row.outcome, servo_only=row.servo_only)
        marks[run.folder] = by_hand_s(stored)
        sources.add(str(stored.meta.get("source")))
        side_cm[run.folder] = 100 * rig_of_record(stored.meta.get("rig") or {}).linkage.side_m
        xy = resting_centroid_cm(run)
        where = None if xy is None else (float(xy[0]), float(xy[1]))
        counted.append(replace(row, centroid_cm=where))
        counts = disturbed or not row.by_hand
        seen = not row.servo_only and run.metrics.samples > 0
        if seen and counts and row.method in ("without", "with") and row.outcome == "completed":
            completed.append(run)
            methods.append(row.method)
            made.append(entries(run.folder, stored.meta))
    out.mkdir(parents=True, exist_ok=True)
    source = sources.pop() if len(sources) == 1 else "simulated"
    progress("drawing", 0, 1)
    both, left_out = both_methods(completed, methods, made)
    drawn = Completed(rows[0].protocol, *both, marks, side_cm).figures()
    pictures = [CaptionedPicture(save(one, out, name, source), text) for one, name, text in drawn]
    progress("drawing", 1, 1)
    table = comparison_rows(*both) if any(both) else []
    alone = all(row.servo_only for row in counted)
    sentence = SERVOS_ALONE if alone else comparison_sentence(*both)
    counts = len(both[0]), len(both[1])
    return DrawnFigures(pictures, counted, sentence, table, counts, tuple(left_out), tuple(unread))


def by_hand_s(stored: "Run") -> list[float]:
    """Times [s from release] at which somebody disturbed a recorded run."""
    from experiments.analysis.samples import run_part
    from rig.loop.commands import BY_HAND

    begin_s = float(run_part(stored.log)["t_s"][:1].sum())
    return [e["t_s"] - begin_s for e in stored.events if e["text"].startswith(BY_HAND)]


def recover_runs(folders: Sequence[Path], progress: ProgressSender) -> str:
    """Repair recordings that were cut off; return in words which cannot be repaired, "" where all
    were. A recording that is still being written is left alone.
    """
    from experiments.records.recording import recover

    left = []
    for i, folder in enumerate(folders):
        progress("repairing", i, len(folders))
        try:
            recover(folder)
        except (OSError, ValueError) as error:
            left.append(str(error))
    return "; ".join(left)


def report_of_runs(folders: Sequence[Path], out: Path, progress: ProgressSender) -> Path:
    """Write the report page of run folders into `out`; returns its path.

    ValueError, OSError (one line): a run cannot be read, or `out` cannot be written.
    """
    from experiments.records.run_folder import results_folder
    from experiments.reports.report_runs import report_runs

    return report_runs(list(folders), results_folder(out), progress=progress)
