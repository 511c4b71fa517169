"""The pages that are connected: messages and files for one of them, or for all."""

from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments.dashboard.server.messages import tell_page
from experiments.dashboard.server.untrusted_text import words_of
from rig.files import as_unicode, file_bytes

if TYPE_CHECKING:
    from viser import ClientHandle

SHOWN_S = 8.0  # a message
MOST_UNREAD = 1000  # messages; chosen: more than a page that reads has waiting, some megabytes


def refusal(check: Callable[[int], Any], page: int) -> str:
    """Why `check(page)` refuses, "" where it does not."""
    try:
        check(page)
    except (ValueError, PermissionError) as error:
        return words_of(error)
    return ""


def _unread(client: "ClientHandle") -> list[Any]:
    """Messages for this page alone that have not left yet."""
    return list(client._websock_connection.get_message_buffer().message_from_id.values())


class Pages:
    """The connected pages; `clients`: by number. They come and go in the control panel queue's
    thread alone.
    """

    def __init__(self) -> None:
        self.clients: dict[int, ClientHandle] = {}
        self._told: dict[int, dict[tuple[str, str], Any]] = {}

    def joined(self, client: "ClientHandle") -> None:
        """Take note of a page that connected."""
        self.clients[client.client_id] = client

    def left(self, page: int) -> None:
        """Take note that a page is gone."""
        self.clients.pop(page, None)
        self._told.pop(page, None)

    def tell(self, page: int, handle: Any, **properties: Any) -> None:
        """Show an element of all pages with other properties on one page; what it was told before
        is not sent again. To be called for a page and a property from one thread.
        """
        client = self.clients.get(page)
        if client is None:
            return
        told = self._told.setdefault(page, {})
        new = {
            name: value
            for name, value in properties.items()
            if (handle._impl.uuid, name) not in told or told[handle._impl.uuid, name] != value
        }
        if new:
            told.update({(handle._impl.uuid, name): value for name, value in new.items()})
            tell_page(client, handle, **new)

    def show_usable(self, checks: Iterable[tuple[Any, Sequence[Callable[[int], Any]]]]) -> None:
        """Grey on every page the elements one of whose `checks` refuses that page, with its words
        as their hint, which viser shows of inputs alone. What a page was told is not sent again.
        """
        for page in list(self.clients):
            for handle, asked in list(checks):
                why = next(filter(None, (refusal(check, page) for check in asked)), "")
                self.tell(page, handle, disabled=bool(why), hint=why or handle.hint)

    def not_done(self, page: int | None, what: str, why: str) -> None:
        """Tell a page why `what` was not done; page None: every page."""
        self.notify(page, f"Not done: {what}", why)

    def notify(self, page: int | None, title: str, text: str, *, good: bool = False) -> None:
        """Show a message with this title for SHOWN_S on a page, red unless it is `good`; page None:
        on every page. One that does not read what it was told is not told more.
        """
        for client in self._of(page):
            with suppress(Exception):  # it may be gone by now
                if len(_unread(client)) > MOST_UNREAD:
                    continue
                told, color = as_unicode(text), "green" if good else "red"
                client.add_notification(title, told, auto_close_seconds=SHOWN_S, color=color)

    def send(self, page: int | None, path: Path, name: str = "") -> None:
        """Let a page download the file `path` as `name` (default: its own), and say so; page None:
        every page. One that has not read the file that it was sent before is not sent another.
        OSError, ValueError: it cannot be read.
        """
        from viser import _messages as messages

        content, name = file_bytes(path, None), name or path.name
        kept = (
            f"{name} is among your browser's downloads, and kept as {path.name} in {path.parent}."
        )
        for client in self._of(page):
            if any(isinstance(one, messages.FileTransferPart) for one in _unread(client)):
                self.not_done(client.client_id, name, "the one before is still on its way here")
                continue
            client.send_file_download(name, content, save_immediately=True)
            self.notify(client.client_id, "Downloaded", kept, good=True)

    def _of(self, page: int | None) -> list["ClientHandle"]:
        if page is None:
            return list(self.clients.values())
        return [self.clients[page]] if page in self.clients else []
