"""Who holds the controls: one page at a time; the others watch, may take over, and may stop."""

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Seat:
    """Pages by their number, in order of arrival, and the one that holds the controls."""

    pages: tuple[int, ...] = ()
    holder: int | None = None

    def joined(self, page: int) -> "Seat":
        """A page has come: it gets the controls where nobody holds them."""
        pages = (*(one for one in self.pages if one != page), page)
        return Seat(pages, page if self.holder is None else self.holder)

    def left(self, page: int) -> "Seat":
        """A page has gone; its controls are free, nobody gets them without asking."""
        pages = tuple(one for one in self.pages if one != page)
        return Seat(pages, None if self.holder == page else self.holder)

    def taken(self, page: int) -> "Seat":
        """A page takes the controls. ValueError: there is no such page."""
        if page not in self.pages:
            raise ValueError(f"page {page} is not connected: reload it")
        return replace(self, holder=page)

    def may(self, page: int | None) -> bool:
        return page is not None and page == self.holder

    def words(self, page: int) -> str:
        """What that page is told."""
        if self.holder == page:
            others = len(self.pages) - 1
            watch = f"; {others} other page{'s' * (others > 1)} watching" if others else ""
            return f"**You hold the controls** (page {page}){watch}."
        held = f"Page {self.holder} holds" if self.holder is not None else "Nobody holds"
        return f"**You are watching** (page {page}). {held} the controls. You can always stop."
