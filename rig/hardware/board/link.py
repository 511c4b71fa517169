"""Bytes to a board and back: what every cable offers, and how a dead one is named."""

from typing import Protocol

LINK_DEAD_S = 0.08  # so long may a board be silent or deaf; the error is raised within 100 ms


class LinkLost(OSError):  # noqa: N818 - it names a link state used as a run ending
    """The device vanished or fell silent: one line with its name. Outcome of the run: "link
    lost".
    """

    outcome = "link lost"

    def __str__(self) -> str:
        return self.strerror or super().__str__()  # a number says nothing to a reader


class Link(Protocol):
    """A cable to one board. Every call raises LinkLost when the device is gone."""

    name: str

    def send(self, data: bytes) -> None:
        """Hand all of `data` to the device, or raise LinkLost within `LINK_DEAD_S`."""
        ...

    def receive(self) -> bytes:
        """Return everything that has arrived; b"" when nothing has. It does not wait for bytes
        to come.
        """
        ...

    def wait(self, timeout_s: float) -> bool:
        """Wait until bytes are there, at most `timeout_s`; return whether they are."""
        ...

    def close(self) -> None:
        """Let the device go; a second call, or one on a vanished device, does nothing."""
        ...
