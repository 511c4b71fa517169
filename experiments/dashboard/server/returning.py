"""A page that stands open is let in again after the program was started anew.

What a browser sends by itself, it sends to whoever listens at the port meanwhile: so a cookie holds
for one start of the program. The page knows a secret, in memory alone, and proves it: HMAC-SHA256
(RFC 2104) of a number that is used once and of the page's own address. Whoever asks the page for
such a proof can use it at no other address, and at this one its program would have to listen.
"""

import hmac
import secrets
from collections import deque
from hashlib import sha256
from urllib.parse import parse_qs

OPEN_QUESTIONS = 64  # chosen: more pages than a lab has


class Returning:
    """Asks pages for a proof that they were open before; `secret` is what such pages were told."""

    def __init__(self, token: str) -> None:
        self.secret = _mac(token, "return")
        self._asked: deque[str] = deque(maxlen=OPEN_QUESTIONS)

    def question(self) -> str:
        """A number for one proof."""
        self._asked.append(secrets.token_hex(16))
        return self._asked[-1]

    def is_answered(self, path: str, host: str) -> bool:
        """Whether the query of `path` answers a question: the number and its proof, for the address
        `host` (with its port) at which the page stands. No number counts twice.
        """
        query = parse_qs(path.partition("?")[2])
        number, proof = (query.get(name, [""])[0] for name in ("number", "proof"))
        if number not in self._asked:
            return False
        self._asked.remove(number)
        right = _mac(self.secret, f"{number} {host.lower()}")
        return hmac.compare_digest(proof.encode("utf-8", "replace"), right.encode())


def _mac(key: str, text: str) -> str:
    return hmac.new(key.encode(), text.encode(), sha256).hexdigest()
