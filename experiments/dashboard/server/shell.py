"""What stands around viser's page: title, icon, the bar with STOP above it, and the big view.

The bar is a script and a style of our own (`shell.js`, `shell.css`), put into the page that viser
serves. It speaks to the program by addresses below the page's own, `alive` and `stop`, and
needs nothing of viser: no connection, no widget, no place in the control panel's queue. The big
view (`view.html`, `view.js`; for a projector or a phone) is a page of our own below the same bar;
it asks for `live` and `camera`.
"""

import gzip
import json
import re
import secrets
from base64 import b64encode
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
SCRIPT = (HERE / "shell.js").read_text(encoding="utf-8")
STYLE = (HERE / "shell.css").read_text(encoding="utf-8")
VIEW_SCRIPT = (HERE / "view.js").read_text(encoding="utf-8")
TITLE = "Balancing table"
ICON = (
    "data:image/svg+xml,%3Csvg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 16 16'%3E"
    "%3Cpath d='M1 11 15 8v3L1 14z' fill='%23495057'/%3E"
    "%3Ccircle cx='8' cy='5' r='4' fill='%23e8590c'/%3E%3C/svg%3E"
)
VIEW = (HERE / "view.html").read_text(encoding="utf-8")
PARTS = {  # and what kind of content each is
    "alive": "application/json",
    "stop": "application/json",
    "live": "application/json",
    "camera": "image/jpeg",
    "view": "text/html; charset=utf-8",
    "question": "application/json",
    "return": "application/json",
}
UNPROVEN = ("question", "return")  # by which a page that was open before gets its cookie


def _hash(script: str) -> str:
    """The hash of a script by which a Content-Security-Policy lets it run."""
    return f"sha256-{b64encode(sha256(script.encode()).digest()).decode()}"


SCRIPT_HASH, VIEW_HASH = _hash(SCRIPT), _hash(VIEW_SCRIPT)


@dataclass
class Shell:
    """What the bar and the big view ask of the program.

    state: the session's state (a key of `tabs.header.STATES`); stop: ends what moves, called in the
    server's thread with who asks; live: the table (`view.big_view`); camera: its newest image
    (JPEG), empty where none is looked through; began: names this start of the program; secret: by
    which the page returns after the next one (`returning`).
    """

    state: Callable[[], str] = lambda: "starting"
    stop: Callable[[str], None] = lambda who: None
    live: Callable[[], dict[str, Any]] = dict
    camera: Callable[[], bytes] = bytes
    began: str = field(default_factory=lambda: secrets.token_hex(8))
    secret: str = ""

    def answer(self, part: str, who: str) -> bytes:
        """The answer to a request for `part` of PARTS, from the address `who`."""
        if part == "live":
            return json.dumps(self.live(), allow_nan=False).encode()
        if part == "camera":
            return self.camera()
        if part == "view":
            return _with_bar(VIEW, f"<script>{VIEW_SCRIPT}</script>").encode()
        if part == "stop":
            self.stop(f"STOP on a page ({who})")
        told = {"state": self.state(), "began": self.began, "secret": self.secret}
        return json.dumps(told).encode()


@cache  # of two pages: as it is, and zipped
def _dressed(body: bytes, zipped: bool) -> bytes:
    text = (gzip.decompress(body) if zipped else body).decode()
    head, found, rest = text.partition("<title>Viser</title>")
    if not found:
        raise RuntimeError("viser's page is another than the one that STOP is put into")
    head = re.sub(r'href="data:image/svg[^"]*"', lambda _: f'href="{ICON}"', head)
    made = _with_bar(f"{head}<title>{TITLE}</title>{rest}").encode()
    return gzip.compress(made) if zipped else made


def _with_bar(page: str, more: str = "") -> str:
    """A page with the bar's style and script, and `more`, behind its title."""
    title = f"<title>{TITLE}</title>"
    return page.replace(title, f"{title}<style>{STYLE}</style><script>{SCRIPT}</script>{more}")


def dressed(response: Any) -> Any:
    """viser's answer with its page, a `websockets` response, with title, icon and bar in it.

    RuntimeError: it is not the page that is known here.
    """
    body = _dressed(response.body, response.headers.get("Content-Encoding") == "gzip")
    response.body = body
    del response.headers["Content-Length"]
    response.headers["Content-Length"] = str(len(body))
    return response
