"""Light or dark, the same for every page; `?darkMode` in the address makes one page dark alone."""

from typing import TYPE_CHECKING

from experiments.dashboard.controls import Controls

if TYPE_CHECKING:
    from viser import ViserServer


class Theme:
    """Set at once, and again by the button."""

    def __init__(self, server: "ViserServer") -> None:
        self._server, self._dark = server, False
        self._apply()

    def add_widgets(self, controls: Controls) -> None:
        """The button, below everything else."""
        button = self._server.gui.add_button("Light / dark", color="gray", order=100)
        controls.button(button, "light / dark", lambda page: self.turn(), everybody=True)

    def turn(self) -> None:
        self._dark = not self._dark
        self._apply()

    def _apply(self) -> None:
        self._server.gui.configure_theme(
            dark_mode=self._dark, show_logo=False, show_share_button=False, control_width="large"
        )
