"""A recorder that tells somebody what it records: a person at the table, or a page."""

from collections.abc import Callable

from experiments.recording import Recorder


class Telling(Recorder):
    """Records, says every event, and looks for pushes at the end."""

    say: Callable[[float, str], None] = staticmethod(lambda t_s, text: None)
    at_end: Callable[[], None] = staticmethod(lambda: None)

    def event(self, t_s: float, text: str, **data) -> None:
        super().event(t_s, text, **data)
        self.say(t_s, text)

    def finish(self, outcome: str, reason: str = "", **notes) -> None:
        self.at_end()
        super().finish(outcome, reason, **notes)
