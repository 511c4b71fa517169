"""The study in five numbered steps, each with what to look for, ticked as it is done."""

from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any

from experiments.dashboard.session.tasks import RunSummary

if TYPE_CHECKING:
    from viser import ViserServer

STEPS = (
    (
        "Run",
        "protocol free-release, controller both: **Start**. Look at the tab *Swing*: without "
        "compensation the ball goes round for ever, a ring; with it the ring shrinks.",
    ),
    (
        "Results",
        "one sentence says how much nearer the ball stays. Is it what you saw?",
    ),
    (
        "Replay",
        "tick *Both controllers*: with red, without blue, from the same release on. When do they "
        "part?",
    ),
    (
        "Calibrate",
        "press **play**: gear and joint are told apart. Compare with the blocks beside the servos.",
    ),
    (
        "Gap",
        "the **demo** hides a play that the model lacks. Guess before it ends: which axis has "
        "more, and how many degrees?",
    ),
)


def both_completed(rows: Iterable[RunSummary]) -> bool:
    """Whether some protocol and seed were completed with and without play compensation."""
    done: dict[tuple[str, int | None], set[str]] = {}
    for row in rows:
        if row.outcome == "completed":
            done.setdefault((row.protocol, row.seed), set()).add(row.method)
    return any({"with", "without"} <= methods for methods in done.values())


def tour_words(done: Sequence[bool]) -> str:
    """Markdown of the steps; done: which of them are."""
    lines, next_found = [], False
    for number, ((tab, look_for), is_done) in enumerate(zip(STEPS, done, strict=True), 1):
        mark = "✓" if is_done else ("▶" if not next_found else "○")
        next_found = next_found or not is_done
        lines.append(f"{mark} **{number} {tab}**: {look_for}")
    if all(done):
        lines.append("**The study is done.** Now with other gains, or another play?")
    return "\n\n".join(lines)


def tour_label(done: Sequence[bool]) -> str:
    """Title of the folded steps: which is next."""
    for number, ((tab, _), is_done) in enumerate(zip(STEPS, done, strict=True), 1):
        if not is_done:
            return f"The study in five steps: next {number} {tab}"
    return "The study in five steps: done"


class Tour:
    """Builds the steps as a folding group in the GUI container of viser that is open; done: tells
    which of them are done; visible: whether it is shown.
    """

    def __init__(
        self, server: "ViserServer", done: Callable[[], Sequence[bool]], *, visible: bool = True
    ) -> None:
        self._done, self._said = done, ""
        self._folder: Any = server.gui.add_folder(
            tour_label([False] * len(STEPS)), expand_by_default=False, visible=visible
        )
        with self._folder:
            self._words: Any = server.gui.add_markdown("")

    def draw(self) -> None:
        """Tick what was done; only a change is sent."""
        words = tour_words(self._done())
        if words != self._said:
            self._said = self._words.content = words
            self._folder.label = tour_label(self._done())
