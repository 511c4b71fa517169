"""What every page shows above its tabs: who holds the controls, the state, and the stop."""

from typing import TYPE_CHECKING, Any

from experiments.dashboard.controls import Controls
from experiments.dashboard.live import Now
from experiments.dashboard.plan import Status
from experiments.dashboard.session import Session

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


def link_words(now: Now, status: Status, rate_hz: float) -> str:
    """Loop and camera in a few words."""
    if status.state not in ("balancing", "running", "starting"):
        return "loop: off · camera: off"
    if now.row is None or status.state == "starting":
        return "loop: starting · camera: starting"
    if now.silent_s > SILENT_S:
        return f"loop: **silent for {now.silent_s:.0f} s** · camera: ?"
    speed = status.leg.plan.speed if status.leg else 1.0
    rate = f"{now.rate:.0f} of {rate_hz * speed:.0f} ticks/s" if now.rate == now.rate else "ok"
    blind_s = float(now.row[0]) - now.seen_s
    seen = "sees the ball" if blind_s < BLIND_S else "**does not see the ball**"
    return f"loop: {rate} · camera: {seen}"


class Header:
    """The shared lines and the stop; a line and a button of each page's own."""

    def __init__(
        self, server: "ViserServer", controls: Controls, session: Session, table: str
    ) -> None:
        self._controls, self._session, self._table = controls, session, table
        gui = server.gui
        self._state: Any = gui.add_markdown("", order=-80)
        stop = gui.add_button("STOP (everybody may)", color="red", order=-70)
        controls.button(stop, "stop", self.stop, everybody=True)
        gui.add_markdown(NO_EMERGENCY, order=-60)
        self._own: dict[int, tuple[Any, Any]] = {}
        self._words = ""

    def stop(self, page: int | None) -> None:
        """End what moves."""
        self._session.stop(f"page {page}")

    def joined(self, client: "ClientHandle") -> None:
        """A page of its own has come; called by the worker."""
        page = client.client_id
        words = client.gui.add_markdown("", order=-100)
        take = client.gui.add_button("Take over the controls", order=-90, color="orange")
        self._own[page] = words, take
        self._controls.button(take, "take over", self._take, everybody=True)
        self._controls.seat = self._controls.seat.joined(page)
        self.draw_seats()

    def left(self, page: int) -> None:
        self._own.pop(page, None)
        self._controls.seat = self._controls.seat.left(page)
        self.draw_seats()

    def _take(self, page: int | None) -> None:
        if page is None:
            return
        self._controls.seat = self._controls.seat.taken(page)
        self._session.note(f"page {page} took over the controls")
        self.draw_seats()

    def draw_seats(self) -> None:
        seat = self._controls.seat
        for page, (words, take) in self._own.items():
            words.content = seat.words(page)
            take.visible = not seat.may(page)

    def draw(self, now: Now, status: Status, rate_hz: float, *, film: bool = False) -> None:
        words = f"**{STATES[status.state]}** ({self._table})  \n{link_words(now, status, rate_hz)}"
        words += FILM if film else LIVE
        if words != self._words:
            self._words = self._state.content = words
