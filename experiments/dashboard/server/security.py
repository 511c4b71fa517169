"""Access to the page and its websocket: token, Host and Origin of every request are checked.

The page is reached by a link that bears the token; its answer sets a cookie and leads on to the
page's own address, which bears no token; page and websocket bring the cookie. A page of another
site knows neither token nor cookie and bears another Origin; a name that somebody points at this
machine (DNS rebinding) is another Host. A browser sends a cookie to every port of its host: this
one is bound to the path of the page, as hard to guess as the token, so that a server of somebody
else on this machine is not sent it; and it holds for one start of the program, since a page that
stands open sends it to whoever takes the port when the program has ended (`returning`).
"""

import ipaddress
import re
import secrets
from collections.abc import Sequence
from dataclasses import dataclass, field
from hashlib import sha256
from hmac import compare_digest
from http.cookies import CookieError, SimpleCookie
from urllib.parse import parse_qs, parse_qsl, urlencode

from experiments.dashboard.server.shell import PARTS, SCRIPT_HASH, UNPROVEN, VIEW_HASH

# The two scripts of viser 1.1.1's page (loader, and the program that it unpacks), our bar's and the
# big view's.
# No other runs, so that HTML in a text cannot act. viser needs the rest: bindings made by
# `Function`, styles set by script, workers and pictures from its own data.
SCRIPTS = (
    "sha256-5iRcjB7VnwnYpbUpHa15FmjNIRu22hIQnvWuocHMxJw=",
    "sha256-o/BTEGoB4UnTxqb+3RxwUFQZkWXpqUxouHkbDNrAkqE=",
    SCRIPT_HASH,
    VIEW_HASH,
)
CONTENT_POLICY = "; ".join(
    (
        "default-src 'none'",
        f"script-src {' '.join(map(repr, SCRIPTS))} 'unsafe-eval'",
        "style-src 'unsafe-inline'",
        "worker-src blob:",
        "img-src data: blob:",
        "font-src data:",
        "connect-src 'self' data: blob:",
        "base-uri 'none'",
        "form-action 'none'",
        "frame-ancestors 'none'",
    )
)
LOCAL_NAMES = frozenset({"127.0.0.1", "localhost", "[::1]"})


@dataclass(frozen=True)
class PageRequest:
    """Path and security headers of a request, every value of each header."""

    path: str
    hosts: Sequence[str]
    origins: Sequence[str] = ()
    cookies: Sequence[str] = ()
    websocket: bool = False


@dataclass(frozen=True)
class Gate:
    """Decides which requests reach the page: who has the token (or the cookie), from this page's
    own address.

    token: the secret of the link; port: where the server listens; names: allowed values of the Host
    header; any_address: any IP address is allowed as well, for a server that listens to the network
    (unlike a name, an address cannot be rebound to another machine); key: what the cookie holds.
    """

    token: str
    port: int
    names: frozenset[str] = LOCAL_NAMES
    any_address: bool = False
    key: str = field(default_factory=lambda: secrets.token_hex(32), compare=False)

    @property
    def path(self) -> str:
        """Path of the page and of its websocket, made from the token and as hard to guess."""
        return f"/{sha256(b'path ' + self.token.encode()).hexdigest()[:32]}"

    @property
    def cookie(self) -> str:
        """Name of the cookie, which holds the port, since browsers share cookies between ports."""
        return f"rig_dashboard_{self.port}"

    def refusal(self, request: PageRequest) -> str | None:
        """Why the request is refused, in one line; None: it may pass."""
        if len(request.hosts) != 1 or not self._is_here(request.hosts[0]):
            return "wrong host: open the link that rig dashboard printed"
        origin = f"http://{request.hosts[0]}".lower()
        other_origins = [given for given in request.origins if given.lower() != origin]
        if other_origins or len(request.origins) > 1 or (request.websocket and not request.origins):
            return "a page of another origin may not speak to the table"
        if self.bears_token(request):
            return None
        part = self.part_of(request.path)
        known = part in PARTS and not request.websocket
        if known and part in UNPROVEN:
            return None
        if not ((known or part == "") and self._in_cookies(request.cookies)):
            return "no valid token: open the link that rig dashboard printed"
        return None

    def bears_token(self, request: PageRequest) -> bool:
        """Whether the request comes by the link, with the token in its query, and has to be led on
        to the page's own address.
        """
        tokens = parse_qs(request.path.partition("?")[2]).get("token", [])
        return not request.websocket and any(_same(given, self.token) for given in tokens)

    def page_of(self, path: str) -> str:
        """Path of the page with the query of `path` less the token: where the link leads on to."""
        rest = [pair for pair in parse_qsl(path.partition("?")[2]) if pair[0] != "token"]
        return f"{self.path}/" + (f"?{urlencode(rest)}" if rest else "")

    def part_of(self, path: str) -> str | None:
        """What of the page a path asks for: "" the page itself, else what follows its own path;
        None: it is no path of the page.
        """
        given = path.partition("?")[0].rstrip("/")
        page, rest = given[: len(self.path)], given[len(self.path) :]
        if not compare_digest(page.encode("utf-8", "replace"), self.path.encode()):
            return None
        return rest[1:] if rest.startswith("/") else (None if rest else "")

    def _is_here(self, host: str) -> bool:
        found = re.fullmatch(r"(\[[^\]]*\]|[^:]*)(?::([0-9]{1,5}))?", host.lower())
        if found is None or int(found[2] or 80) != self.port:  # browsers leave 80 out
            return False
        name = found[1]
        return name in self.names or (self.any_address and _is_address(name))

    def _in_cookies(self, cookies: Sequence[str]) -> bool:
        for text in cookies:
            try:
                found = SimpleCookie(text).get(self.cookie)
            except CookieError:
                continue
            if found is not None and _same(found.value, self.key):
                return True
        return False

    def headers(self) -> dict[str, str]:
        """HTTP headers of every answer to who has proved himself: cookie, what the page may load,
        no referrer, no cache.
        """
        # Lax, not Strict: the link may stand in somebody's message, and be followed from there.
        bounds = f"HttpOnly; SameSite=Lax; Path={self.path}"
        return {
            "Set-Cookie": f"{self.cookie}={self.key}; {bounds}",
            "X-Frame-Options": "DENY",
            "Content-Security-Policy": CONTENT_POLICY,
            "Referrer-Policy": "no-referrer",
            "Cache-Control": "no-store",
        }


def _same(given: str, right: str) -> bool:
    return compare_digest(given.encode("utf-8", "replace"), right.encode())


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name.strip("[]"))
    except ValueError:
        return False
    return True


def in_address(host: str) -> str:
    """A host as it stands in an address: IPv6 in brackets."""
    return f"[{host}]" if ":" in host else host


def gate_of(host: str, port: int, token: str) -> Gate:
    """The gate of a server that listens at `host` and `port`."""
    from socket import getfqdn, gethostname

    if host in ("127.0.0.1", "localhost", "::1"):
        return Gate(token, port)
    names = LOCAL_NAMES | {in_address(host).lower(), gethostname().lower(), getfqdn().lower()}
    return Gate(token, port, names, any_address=host in ("0.0.0.0", "::"))
