"""The operator at the table: the steps that they are asked for, and how they are told."""

from collections.abc import Callable

from rig.table import Reading

SAY = {
    "place": "place the ball at x = {x:.1f} cm, y = {y:.1f} cm",
    "hold": "hold it there",
    "release": "let it go",
    "push": "push the ball now",
}


class Operator:
    """Who places, releases and pushes the ball: here a person, who is told what to do.

    `tell` shows a sentence to that person; the loop sees from the ball that it was done. is_person:
    whether the steps of a course have to be asked for; release_limit_s: how long after the course's
    `hold_s` the ball may stay before the run ends as "not released" [s].
    """

    is_person = True
    release_limit_s = 120.0

    def __init__(self, tell: Callable[[str], None] = lambda text: None) -> None:
        self.tell = tell

    def act(self, reading: Reading, wanted_m_s2: tuple[float, float]) -> tuple[float, float]:
        """Return the push that the recording names [m/s2]; called at every tick.

        wanted_m_s2: acceleration (x, y) that the course or a command asks for at this tick. A
        person pushes by hand, so that it is returned unchanged.
        """
        return wanted_m_s2
