"""Who may see the page and speak on its websocket: a token, the Host and the Origin, all checked.

The page is reached by a link that bears the token; its answer sets a cookie, which the websocket
brings. A page of another site knows neither token nor cookie and bears another Origin; a name that
somebody points at this machine (DNS rebinding) is another Host.
"""

import ipaddress
import secrets
from collections.abc import Sequence
from dataclasses import dataclass
from hmac import compare_digest
from http.cookies import CookieError, SimpleCookie
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

LOCAL_NAMES = frozenset({"127.0.0.1", "localhost", "[::1]"})
TOKEN_BYTES = 24


@dataclass(frozen=True)
class Asked:
    """What a request says of itself: every value of the headers that matter, and its path."""

    path: str
    hosts: Sequence[str]
    origins: Sequence[str] = ()
    cookies: Sequence[str] = ()
    websocket: bool = False


@dataclass(frozen=True)
class Gate:
    """What a request has to know. names: hosts it may ask for; any_address: any IP address, too
    (where the server listens to the network: an address cannot be rebound)."""

    token: str
    port: int
    names: frozenset[str] = LOCAL_NAMES
    any_address: bool = False

    @property
    def cookie(self) -> str:
        """Its name; cookies do not tell ports apart, so the name does."""
        return f"rig_dashboard_{self.port}"

    def refusal(self, asked: Asked) -> str | None:
        """Why the request is refused, in one line; None where it may pass."""
        if len(asked.hosts) != 1 or not self._is_here(asked.hosts[0]):
            return "wrong host: open the link that rig dashboard printed"
        origin = f"http://{asked.hosts[0]}".lower()
        strangers = [one for one in asked.origins if one.lower() != origin]
        if strangers or len(asked.origins) > 1 or (asked.websocket and not asked.origins):
            return "a page of another origin may not speak to the table"
        if not (self._in_query(asked.path) or self._in_cookies(asked.cookies)):
            return "no valid token: open the link that rig dashboard printed"
        return None

    def _is_here(self, host: str) -> bool:
        name, _, port = host.lower().rpartition(":")
        if port != str(self.port):
            return False
        return name in self.names or (self.any_address and _is_address(name))

    def _in_query(self, path: str) -> bool:
        return any(map(self._right, parse_qs(urlsplit(path).query).get("token", [])))

    def _in_cookies(self, cookies: Sequence[str]) -> bool:
        for text in cookies:
            try:
                found = SimpleCookie(text).get(self.cookie)
            except CookieError:
                continue
            if found is not None and self._right(found.value):
                return True
        return False

    def _right(self, given: str) -> bool:
        return compare_digest(given.encode("utf-8", "replace"), self.token.encode())

    def headers(self) -> dict[str, str]:
        """What every answer of the page bears."""
        return {
            "Set-Cookie": f"{self.cookie}={self.token}; HttpOnly; SameSite=Strict; Path=/",
            "X-Frame-Options": "DENY",
            "Content-Security-Policy": "frame-ancestors 'none'",
            "Referrer-Policy": "no-referrer",
            "Cache-Control": "no-store",
        }


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name.strip("[]"))
    except ValueError:
        return False
    return True


def gate_of(host: str, port: int, token: str) -> Gate:
    """The gate of a server that listens at `host`."""
    from socket import getfqdn, gethostname

    if host in ("127.0.0.1", "localhost", "::1"):
        return Gate(token, port)
    names = LOCAL_NAMES | {host.lower(), gethostname().lower(), getfqdn().lower()}
    return Gate(token, port, names, any_address=host in ("0.0.0.0", "::"))


def kept_token(path: Path) -> str:
    """The token of a file that only its owner reads; made where there is none, so that an open
    page finds the server again after a restart. Delete the file for a new token."""
    try:
        text = path.read_text(encoding="ascii").strip()
        if len(text) >= TOKEN_BYTES:
            return text
        path.unlink()
    except FileNotFoundError:
        pass
    except UnicodeDecodeError:
        path.unlink()
    token = secrets.token_urlsafe(TOKEN_BYTES)
    path.touch(mode=0o600)
    path.write_text(token + "\n", encoding="ascii")
    return token
