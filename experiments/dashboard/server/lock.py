"""Which of the connected pages holds the controls: one at most."""

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class ControlLock:
    """Numbers of the connected pages in order of arrival, and the page that holds the controls."""

    pages: tuple[int, ...] = ()
    holder: int | None = None

    def joined(self, page: int) -> "ControlLock":
        """The lock after a page connected: that page holds the controls if no other does."""
        pages = (*(other for other in self.pages if other != page), page)
        return ControlLock(pages, page if self.holder is None else self.holder)

    def left(self, page: int) -> "ControlLock":
        """The lock after a page disconnected: its controls are free until a page takes them."""
        pages = tuple(other for other in self.pages if other != page)
        return ControlLock(pages, None if self.holder == page else self.holder)

    def taken(self, page: int) -> "ControlLock":
        """The lock after a page took the controls. ValueError: the page is not connected."""
        if page not in self.pages:
            raise ValueError(f"page {page} is not connected: reload it")
        return replace(self, holder=page)

    def may(self, page: int | None) -> bool:
        """Whether a page holds the controls; None (no page) never does."""
        return page is not None and page == self.holder

    def words(self, page: int) -> str:
        """Markdown for a page: whether it holds the controls or watches."""
        if self.holder == page:
            others = len(self.pages) - 1
            watch = f" {others} other page{'s' * (others > 1)} watching." if others else ""
            return f"**You are in control.**{watch}"
        holder = "Another page is" if self.holder is not None else "Nobody is"
        return f"**You are watching.** {holder} in control; you can always stop."
