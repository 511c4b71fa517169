"""The study in five numbered steps, each with what to look for, ticked as it is done."""

from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any

from experiments.dashboard.server.controls import Controls
from experiments.dashboard.server.pages import Pages
from experiments.dashboard.session.tasks import RunSummary

if TYPE_CHECKING:
    from viser import ViserServer

STEPS = (
    (
        "Run",
        "leave the choices as they are and press **Start**: two runs of 16 s. Look at the panel "
        "*Swing*: without compensation the ball does not come to rest but goes round, a ring; with "
        "it the ring shrinks. (The protocol *hold* shows it for longer.)",
    ),
    (
        "Results",
        "one sentence says how much nearer the ball stays. Is it what you saw?",
    ),
    (
        "Replay",
        "choose a run, tick *Both controllers* and press **Show**: red is with compensation, blue "
        "without, from the same release on. When do they part?",
    ),
    (
        "Calibrate",
        "press **play** (or *All steps*): gear and joint are told apart, and what was found is "
        "held against the truth. It moves a copy of the table, not the one in view, for about two "
        "minutes.",
    ),
    (
        "Gap",
        "tick *Hide the truth* and press the **demo**: its own table has play that the model "
        "lacks. Which axis has more, and how many degrees? A field takes your guess, the analysis "
        "some minutes.",
    ),
)
# Steps that end when somebody says so: number from 0 -> the words of the button. A button whose
# words end so opens that tab (shell.js).
ENDED_BY_WORD = {
    i: f"I have {done} it: next step, tab {STEPS[i + 1][0]}"
    for i, done in ((1, "read"), (2, "watched"))
}
IN_ONE_GO = "*The whole study*, in the list *Protocol*, makes the runs of every step in one go."


def both_completed(rows: Iterable[RunSummary]) -> bool:
    """Whether some protocol and seed were completed with and without play compensation."""
    done: dict[tuple[str, int | None], set[str]] = {}
    for row in rows:
        if row.outcome == "completed":
            done.setdefault((row.protocol, row.seed), set()).add(row.method)
    return any({"with", "without"} <= methods for methods in done.values())


def next_step(done: Sequence[bool]) -> int | None:
    """Number, from 0, of the first step that is not done; None: all are."""
    return next((i for i, is_done in enumerate(done) if not is_done), None)


def step_words(number: int, mark: str = "") -> str:
    """Markdown of a step (from 0) after a mark."""
    tab, look_for = STEPS[number]
    return f"{mark}**{number + 1}, tab {tab}**: {look_for}"


def _marks(done: Sequence[bool]) -> list[str]:
    at = next_step(done)
    return ["✓" if is_done else "▶" if i == at else "○" for i, is_done in enumerate(done)]


def tour_words(done: Sequence[bool]) -> str:
    """Markdown of all steps, marked; done: which of them are. The next one stands above already."""
    at = next_step(done)
    return "\n\n".join(
        f"{mark} **{i + 1} {STEPS[i][0]}**: as above." if i == at else step_words(i, f"{mark} ")
        for i, mark in enumerate(_marks(done))
    )


def next_words(done: Sequence[bool]) -> str:
    """Markdown of the step that is next."""
    at = next_step(done)
    if at is None:
        return "**The study is done.** Now with other gains, or another play?"
    marks = " ".join(f"{mark}\u00a0{i + 1}" for i, mark in enumerate(_marks(done)))
    return f"The study in five steps ({marks}). Next: {step_words(at)}"


class Tour:
    """Builds the next step above the tabs of the GUI of viser that is open, for the page of `pages`
    that holds the controls: another may not do it. done: tells which steps are done, as far as the
    program knows: of those of ENDED_BY_WORD a button says so, or the step after it; visible: False,
    and nobody is shown the study.
    """

    def __init__(
        self,
        server: "ViserServer",
        controls: Controls,
        pages: Pages,
        done: Callable[[], Sequence[bool]],
        *,
        visible: bool = True,
    ) -> None:
        self._done, self._said, self._gui = done, "", server.gui
        self._controls, self._pages = controls, pages
        self._next: Any = server.gui.add_markdown("", order=-50, visible=False)
        self._visible, self._at = visible, 0
        self._said_done: set[int] = set()
        words = next(iter(ENDED_BY_WORD.values()))
        self._next_step: Any = server.gui.add_button(words, order=-40, visible=False)
        controls.button(self._next_step, "next step", lambda page: self.end_step())
        self._folder: Any = None
        self._words: Any = None

    def add_steps(self) -> None:
        """Add all steps as a folding group to the container that is open."""
        self._folder = self._gui.add_folder(
            "All five steps", expand_by_default=False, visible=False
        )
        with self._folder:
            self._words = self._gui.add_markdown("")
            self._gui.add_markdown(IN_ONE_GO)

    def end_step(self) -> None:
        """Somebody says that the step of the button is done."""
        self._said_done.add(self._at)

    def draw(self) -> None:
        """Tick what was done, and say what is next; only a change is sent."""
        known = list(self._done())
        waits = {
            i for i in ENDED_BY_WORD if known[i] and not (i in self._said_done or known[i + 1])
        }
        done = [is_done and i not in waits for i, is_done in enumerate(known)]
        words = tour_words(done)
        if words != self._said:
            self._said = self._words.content = words
            self._next.content = next_words(done)
        at = next_step(done)
        if at in waits and at != self._at:
            self._at, self._next_step.label = at, ENDED_BY_WORD[at]
        for page in list(self._pages.clients):
            guided = self._visible and self._controls.lock.may(page)
            for handle in (self._next, self._folder):
                self._pages.tell(page, handle, visible=guided)
            self._pages.tell(page, self._next_step, visible=guided and at in waits)
