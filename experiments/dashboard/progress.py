"""What is on and how long it takes, in a line."""

from experiments.dashboard.plan import Status

IDLE = "no run: choose a protocol and press **Start**"


def minutes(seconds: float) -> str:
    """m:ss for people."""
    whole = max(0, round(seconds))
    return f"{whole // 60}:{whole % 60:02d}"


def progress_words(status: Status) -> str:
    """One line about what happens and how long it takes."""
    leg = status.leg
    if leg is None:
        return f"{status.words}. {IDLE}" if status.state == "stopped" else IDLE
    of = f"run {leg.number} of {leg.of}"
    left = f"{minutes(status.left_s)} left"
    if status.state == "pause":
        return f"**Pause**: {status.words}, {left}; press **Next run**"
    return f"{of}: {status.words}, {status.t_s:.1f} of {status.whole_s:.1f} s, {left}"


class Progress:
    """The line over time: after a plan's last run it says that it is done and where to look."""

    def __init__(self) -> None:
        self._last: Status | None = None

    def words(self, status: Status) -> str:
        """The line for the present status."""
        if status.leg is not None:
            self._last = status if status.state == "running" else None
        elif self._last is not None and self._last.leg is not None:
            leg = self._last.leg
            if leg.number == leg.of and self._last.t_s >= self._last.whole_s - 0.5:
                many = f"All {leg.of} runs are" if leg.of > 1 else "The run is"
                return f"**{many} done**: see the tab **Results**."
        return progress_words(status)
