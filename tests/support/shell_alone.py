"""The bar above the page with a session that only stops: for tests of the bar in a browser."""

from experiments.dashboard.server.server import link_of, open_server, shell_of

TOKEN = "a-token-of-some-length-for-tests"
CONTRAST = """one => {
  const style = getComputedStyle(one), light = colour => {
    const parts = colour.match(/[0-9.]+/g).slice(0, 3).map(v => v / 255)
      .map(v => v <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
    return 0.2126 * parts[0] + 0.7152 * parts[1] + 0.0722 * parts[2]; };
  const both = [light(style.color), light(style.backgroundColor)].sort((a, b) => b - a);
  return (both[0] + 0.05) / (both[1] + 0.05); }"""


class ShellAlone:
    """A page with fields, whose session stops when it is told so."""

    def __init__(self, port: int = 0) -> None:
        self.server, self.gate = open_server("127.0.0.1", port, TOKEN)
        self.state, self.stops, self.obeys = "running", [], True
        shell = shell_of(self.server)
        shell.state, shell.stop = lambda: self.state, self._stop
        self.link = link_of(self.gate, "127.0.0.1")
        gui = self.server.gui
        gui.main_panel.dock_right()
        gui.add_markdown('<span class="rig-live">**Run is on** for 12 s</span>')
        gui.add_markdown("what stays")
        gui.add_number("P", 1.0)
        gui.add_dropdown("Protocol", ("circle", "steps"))
        gui.add_checkbox("Arm", False)
        gui.add_button("▶ Start", color="green")
        for i in range(60):
            gui.add_markdown(f"line {i}")

    def _stop(self, who: str) -> None:
        self.stops.append(who)
        if self.obeys:
            self.state = "stopped"

    def stopped(self) -> bool:
        """Whether it was stopped since the last call; it runs again."""
        found, self.stops, self.state = bool(self.stops), [], "running"
        return found


def opened(chromium, program: ShellAlone, **settings):
    """A page, as soon as the bar is there; viser's own page may come later."""
    page = chromium.new_context(**settings).new_page()
    page.goto(program.link)
    page.locator("#rig-state", has_text="Run is on").wait_for()
    return page
