"""Who has knocked at `rig serve` and not proven yet to know the token.

They wait beside the user's seat, few and not for long, so that nobody without the token keeps
anybody out.
"""

import secrets
import select
import socket
from collections.abc import Callable
from math import nan

from rig.hardware.network import remote_wire as wire
from rig.hardware.network.remote_wire import ProtocolError, Wire

GREETING_S = 2.0  # to prove oneself
MOST = 8  # at a time; chosen: a peer proves itself within two of the server's ticks
# Lines about who is turned away, in so many seconds; chosen: an honest user's wrong tokens are read
# one by one, a scan of ports leaves the terminal to what is said of the table.
LINES, LINES_S = 5, 60.0


class Peer:
    """A connection, its greeting, and the times of its newest command (for its clock).

    gone: why it is to be parted from, "" while it is there.
    """

    def __init__(self, wire_: Wire, host: str, name: str, now_s: float) -> None:
        self.wire, self.host, self.name = wire_, host, name
        self.nonce = secrets.token_bytes(wire.NONCE_BYTES)
        self.heard_s, self.gone = now_s, ""
        self.echo = (nan, nan)

    def tell(self, kind: int, payload: bytes = b"") -> None:
        """Say something; one who does not take it is gone."""
        try:
            self.wire.send(kind, payload)
        except OSError:
            self.gone = self.gone or "does not read what it is told"

    def proves(self, token: bytes) -> bool:
        """Whether the peer has shown that it knows the token; messages are sealed from then on.

        The proof is compared in constant time. Who says anything else is gone, and is told so.
        """
        try:
            said = self.wire.receive(wire.PROOF_BYTES)
        except ProtocolError:
            self.gone = "said what no honest user says"
            return False
        except OSError:
            self.gone = "is gone"
            return False
        for kind, payload in said[:1]:
            theirs, proof = payload[: wire.NONCE_BYTES], payload[wire.NONCE_BYTES :]
            right = wire.proof(token, self.nonce, theirs)
            if kind == wire.PROOF and secrets.compare_digest(proof, right):
                self.wire.seal(token, self.nonce, theirs, server=True)
                return True
            self.tell(wire.REFUSE, b"refused the token: it must be the same file on both machines")
            self.gone = "did not know the token"
        return False


class TurnedAway:
    """Tells a person who was turned away: the first of a minute by name, the others by number.

    say: gets the lines.
    """

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say, self._newest = say, ""
        self._count, self._since_s = 0, nan

    def tell(self, text: str, now_s: float) -> None:
        """One more, with its reason."""
        if self._count == 0:
            self._since_s = now_s
        self._count, self._newest = self._count + 1, text
        if self._count <= LINES:
            self._say(text)

    def sum_up(self, now_s: float) -> None:
        """Tell how many had no line of their own, once the minute is over."""
        if now_s - self._since_s >= LINES_S:
            self.close()

    def close(self) -> None:
        """Tell the same now."""
        if self._count > LINES:
            more = f"{self._count - LINES} more within {LINES_S:g} s"
            self._say(f"and {more} were turned away; the newest: {self._newest}")
        self._count = 0


class Greetings:
    """The peers at the door. say: gets lines for a person about who is turned away."""

    def __init__(self, token: bytes, say: Callable[[str], None]) -> None:
        self._token, self._turned_away = token, TurnedAway(say)
        self._waiting: list[Peer] = []

    def welcome(self, sock: socket.socket, address: tuple, now_s: float) -> None:
        """Greet a new connection; where too many wait, the oldest of the busiest address goes."""
        sock.setblocking(False)
        new = Peer(Wire(sock), address[0], f"{address[0]}:{address[1]}", now_s)
        self._waiting.append(new)
        if len(self._waiting) > MOST:
            hosts = [peer.host for peer in self._waiting]
            busiest = max(hosts, key=hosts.count)
            oldest = self._waiting[hosts.index(busiest)]
            oldest.gone = "made room: too many were at the door"
            self._turn_away(oldest, now_s)
        new.tell(wire.HELLO, bytes([wire.VERSION]) + new.nonce)

    def proven(self, now_s: float) -> list[Peer]:
        """Listen to all who wait, to as many bytes of each as a proof has: the table does not wait
        for strangers. Return those who have proven themselves since the last call.
        """
        self._turned_away.sum_up(now_s)
        if not self._waiting:
            return []
        said = select.select([peer.wire.sock for peer in self._waiting], [], [], 0.0)[0]
        found = []
        for peer in list(self._waiting):
            if peer.wire.sock in said and peer.proves(self._token):
                self._waiting.remove(peer)
                found.append(peer)
                continue
            if not peer.gone and now_s - peer.heard_s > GREETING_S:
                peer.gone = f"was silent for {GREETING_S:g} s"
            if peer.gone:
                self._turn_away(peer, now_s)
        return found

    def close(self) -> None:
        """Hang up on all who wait."""
        for peer in list(self._waiting):
            self._part(peer)
        self._turned_away.close()

    def _turn_away(self, peer: Peer, now_s: float) -> None:
        self._turned_away.tell(f"{peer.name} {peer.gone}", now_s)
        self._part(peer)

    def _part(self, peer: Peer) -> None:
        peer.wire.close()
        self._waiting.remove(peer)
