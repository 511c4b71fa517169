"""What every page shows outside its tabs: lock of the controls, state, stop, light or dark."""

from typing import TYPE_CHECKING, Any

from experiments.dashboard.server.controls import Controls
from experiments.dashboard.server.untrusted_text import plain
from experiments.dashboard.session.live import LiveState
from experiments.dashboard.session.plan import SessionStatus
from experiments.dashboard.session.session import Session

if TYPE_CHECKING:
    from viser import ClientHandle, ViserServer

NO_EMERGENCY = "This is **not** the emergency stop: that is the switch that cuts the motors' power."
FILM = "  \n3-D view: **a film**; the tab Replay leads back"
LIVE = "  \n3-D view: the live table"  # as many lines: nothing below may jump
SILENT_S, BLIND_S = 1.0, 0.25
STATES = {
    "starting": "Starting",
    "balancing": "Balancing",
    "running": "Run is on",
    "pause": "Pause between runs",
    "stopped": "Stopped, 0 V: the tab Run starts it again",
}


def link_words(now: LiveState, status: SessionStatus, rate_hz: float) -> str:
    """A line (Markdown) on the loop's ticks a second, beside the nominal `rate_hz`, and on whether
    the camera sees the ball.
    """
    if status.state not in ("balancing", "running", "starting"):
        return "loop: off · camera: off"
    if now.row is None or status.state == "starting":
        return "loop: starting · camera: starting"
    if now.silent_s > SILENT_S:
        return f"loop: **silent for {now.silent_s:.0f} s** · camera: ?"
    speed = status.run.plan.speed if status.run else 1.0
    rate = f"{now.rate:.0f} of {rate_hz * speed:.0f} ticks/s" if now.rate == now.rate else "ok"
    blind_s = float(now.row[0]) - now.seen_s
    seen = "sees the ball" if blind_s < BLIND_S else "**does not see the ball**"
    return f"loop: {rate} · camera: {seen}"


class Header:
    """Builds the lines above the tabs: state and STOP for all pages, and who controls, for each
    page.

    table: the table's name as it is shown.
    """

    def __init__(
        self, server: "ViserServer", controls: Controls, session: Session, table: str
    ) -> None:
        self._controls, self._session, self._table = controls, session, table
        gui = server.gui
        self._state: Any = gui.add_markdown("", order=-80)
        stop = gui.add_button("STOP (everybody may)", color="red", order=-70)
        controls.stop_button(stop, "stop", self.stop)
        gui.add_markdown(NO_EMERGENCY, order=-60)
        self._take_over: Any = gui.add_button(
            "Take over the controls", order=-90, color="orange", visible=False
        )
        controls.button(self._take_over, "take over", self._take, everybody=True)
        self._own: dict[int, Any] = {}
        self._words = ""

    def stop(self, page: int | None) -> None:
        """Stop what moves, from any thread; `page` is named in the run's events."""
        self._session.stop(f"page {page}")

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
        self._own.pop(page, None)
        self._controls.lock = self._controls.lock.left(page)
        self.draw_locks()

    def _take(self, page: int | None) -> None:
        if page is None:
            return
        self._controls.lock = self._controls.lock.taken(page)
        self._session.note(f"page {page} took over the controls")
        self.draw_locks()

    def draw_locks(self) -> None:
        """Tell every page whether it holds the controls."""
        lock = self._controls.lock
        for page, words in self._own.items():
            words.content = lock.words(page)
        self._take_over.visible = bool(lock.pages) and lock.pages != (lock.holder,)

    def draw(
        self, now: LiveState, status: SessionStatus, rate_hz: float, *, film: bool = False
    ) -> None:
        """Show the session's state; only what changed is sent. rate_hz: nominal ticks a second of
        the loop; film: a recorded motion is shown, not the live table.
        """
        words = f"**{STATES[status.state]}** ({plain(self._table)})  \n"
        words += link_words(now, status, rate_hz)
        words += FILM if film else LIVE
        if words != self._words:
            self._words = self._state.content = words


# A path or a number without a blank breaks where the panel ends instead of leaving it.
WRAP = "<style>p, li, td, h4 { overflow-wrap: anywhere }</style>"


class Theme:
    """Light or dark for every page; `?darkMode` in the address makes one page dark alone."""

    def __init__(self, server: "ViserServer") -> None:
        self._server, self._dark = server, False
        self._apply()

    def add_widgets(self, controls: Controls) -> None:
        """Add the light/dark button below everything else, and the style by which long
        words break.
        """
        self._server.gui.add_html(WRAP)
        button = self._server.gui.add_button("Light / dark", color="gray", order=100)
        controls.button(button, "light / dark", lambda page: self.turn(), everybody=True)

    def turn(self) -> None:
        """Switch between light and dark."""
        self._dark = not self._dark
        self._apply()

    def _apply(self) -> None:
        self._server.gui.configure_theme(
            dark_mode=self._dark, show_logo=False, show_share_button=False, control_width="large"
        )
