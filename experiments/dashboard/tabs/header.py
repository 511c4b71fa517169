"""What every page shows outside its tabs: lock of the controls and state."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from experiments.dashboard.server.controls import Controls
from experiments.dashboard.server.pages import Pages
from experiments.dashboard.server.untrusted_text import plain
from experiments.dashboard.session.live import LiveState
from experiments.dashboard.session.plan import SessionStatus
from experiments.dashboard.session.session import Session

if TYPE_CHECKING:
    from viser import ClientHandle, ViserServer

NO_EMERGENCY = (
    "STOP and **Esc** are **not** the emergency stop: that is the switch that cuts the motors' "
    "power."
)
FILM = (
    "● **A replay is shown on this page**. STOP and the bar at the top are of the live table, to "
    "which the tab Replay leads back."
)
SILENT_S, BLIND_S = 1.0, 0.25
ON_TIME = 0.95  # share of the ticks; chosen: as of the monitor of a real table
STATES = {
    "starting": "Starting",
    "balancing": "Balancing",
    "running": "Run is on",
    "run starting": "Run is starting",
    "pause": "Pause between runs",
    "stopping": "Stopping: the plate is levelled",
    "at rest": "Stopped, motors at 0 V",
    "stopped": "Stopped, motors at 0 V",
}


def live(words: str) -> str:
    """Markdown of one paragraph that is true only while the program speaks to the page: a page that
    has lost it hides them (`server/shell.css`). "" stays "".
    """
    return f'<span class="rig-live">{words}</span>' if words else ""


def with_mouse(words: str) -> str:
    """Markdown of one paragraph on what is done with a mouse or keys: a screen that is touched
    hides it (`server/shell.css`).
    """
    return f'<span class="rig-mouse">{words}</span>'


def link_words(now: LiveState, status: SessionStatus, rate_hz: float) -> str:
    """A line (Markdown) on whether the loop keeps its time, `rate_hz` ticks a second, and whether
    the camera sees the ball.
    """
    if status.state not in ("balancing", "running", "starting"):
        return "loop and camera are off"
    if now.row is None or status.state == "starting":
        so_far = f", {now.silent_s:.0f} s so far" if now.row is None else ""
        first = " (the first time a minute or two)" if now.run <= 1 else ""
        return f"loop and camera are starting{so_far}{first}"
    if now.silent_s > SILENT_S:
        return f"**the loop is silent for {now.silent_s:.0f} s**"
    speed = status.run.plan.speed if status.run else 1.0
    nominal = rate_hz * speed
    slow = now.rate < ON_TIME * nominal  # False where no rate is known yet
    rate = f"**slow: {now.rate:.0f} of {nominal:.0f} ticks/s**" if slow else "running on time"
    blind_s = float(now.row[0]) - now.seen_s
    seen = "ball in sight" if blind_s < BLIND_S else "**ball not in sight**"
    if status.run is not None and status.run.plan.protocol.servo_only:
        seen = "the servos alone, without a ball"
    return f"● {rate} · ● {seen}"


class Header:
    """Builds the lines above the tabs: the state for all pages, and who controls, for each page.

    pages: those that are connected; table: the table's name as it is shown; balance: balances the
    virtual table again.
    """

    def __init__(
        self,
        server: "ViserServer",
        controls: Controls,
        pages: Pages,
        session: Session,
        table: str,
        balance: Callable[[int | None], None],
    ) -> None:
        self._controls, self._pages = controls, pages
        self._session, self._table = session, table
        gui = server.gui
        self._state: Any = gui.add_markdown("", order=-80)
        self._balance: Any = gui.add_button(
            "Balance again", color="green", order=-70, visible=False
        )
        controls.button(self._balance, "balance", balance)
        gui.add_markdown(NO_EMERGENCY, order=-60)
        self._take_over: Any = gui.add_button(
            "Take over the controls", order=-90, color="orange", visible=False
        )
        for handle in (self._take_over, gui.add_command("Take over the controls")):
            controls.button(handle, "take over", self._take, everybody=True)
        self._own: dict[int, Any] = {}
        self._films: set[int] = set()  # pages that show one
        self._words = ""

    def joined(self, client: "ClientHandle") -> None:
        """Note that a page has connected. To be called in the thread of the control panel queue."""
        page = client.client_id
        self._own[page] = client.gui.add_markdown("", order=-100)
        self._controls.lock = self._controls.lock.joined(page)
        self.draw_locks()

    def left(self, page: int) -> None:
        """Note that a page has disconnected. To be called in the thread of the control
        panel queue.
        """
        self._films.discard(page)
        self._own.pop(page, None)
        self._controls.lock = self._controls.lock.left(page)
        self.draw_locks()

    def _take(self, page: int | None) -> None:
        if page is None:
            return
        self._controls.lock = self._controls.lock.taken(page)
        self._session.note("another page took over the controls")
        self.draw_locks()

    def show_film(self, page: int, on: bool) -> None:
        """Say on a page that it shows a film, or (`on` False) the live table."""
        (self._films.add if on else self._films.discard)(page)
        self.draw_locks()

    def draw_locks(self) -> None:
        """Tell every page whether it holds the controls and shows the live table, and let it see
        what it may use.
        """
        lock = self._controls.lock
        for page, words in self._own.items():
            film = f"<br>{FILM}" if page in self._films else ""
            words.content = live(lock.words(page) + film)

    def draw(self, now: LiveState, status: SessionStatus, rate_hz: float) -> None:
        """Show the session's state and what each page may use; only what changed is sent. rate_hz:
        nominal ticks a second of the loop.
        """
        rests = status.state == "stopped" and not self._session.table.real
        if self._balance.visible != rests:
            self._balance.visible = rests
        for page in list(self._pages.clients):
            holds = self._controls.lock.holder == page
            self._pages.tell(page, self._take_over, visible=not holds)
            # of the live table, which a page with a film does not show
            self._pages.tell(page, self._state, visible=page not in self._films)
        self._pages.show_usable(list(self._controls.checks.values()))
        words = f"**{STATES[status.shown]}** ({plain(self._table)})<br>"
        words += link_words(now, status, rate_hz)
        if words != self._words:
            self._words = words
            self._state.content = live(words)


# A path or a number without a blank breaks where the panel ends instead of leaving it; in a table
# a name does, in a column that is as wide as a word ("completed") all the same.
WRAP = (
    "<style>p, li, h4, .rig-name { overflow-wrap: anywhere } "
    "th, td { padding-right: 0.7em } td:has(.rig-name) { min-width: 5.5em } "
    "td:nth-child(3):has(.rig-name) { min-width: 6.4em }</style>"
)


def set_looks(server: "ViserServer") -> None:
    """Set how every page looks, and that long words break. Light or dark is each page's own choice
    (`server/shell.js`).
    """
    server.gui.configure_theme(
        dark_mode=False, show_logo=False, show_share_button=False, control_width="large"
    )
    server.gui.add_html(WRAP)
