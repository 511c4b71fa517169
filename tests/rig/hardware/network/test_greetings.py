"""Strangers at the door of a served table: each tick hears a few bytes of each."""

import socket

from rig.hardware.network import remote_wire as wire
from rig.hardware.network.greetings import LINES, MOST, Greetings
from rig.hardware.network.remote_wire import PROOF_BYTES, Wire

TOKEN = b"a token of some length"
JUNK = b"\x01\x00\x01" * 21_800  # messages without content, as short as they can be


def door() -> tuple[Greetings, list[str]]:
    said: list[str] = []
    return Greetings(TOKEN, said.append), said


def comes(greetings: Greetings) -> socket.socket:
    """A new peer; its own end of the connection."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        there = socket.create_connection(server.getsockname())
        here, _ = server.accept()
    greetings.welcome(here, ("192.0.2.1", 1), 0.0)
    return there


def proves(end: socket.socket) -> None:
    mine = Wire(end)
    ((kind, payload),) = mine.receive()
    assert kind == wire.HELLO
    nonce = bytes(wire.NONCE_BYTES)
    mine.send(wire.PROOF, nonce + wire.proof(TOKEN, payload[1:], nonce))


def test_of_a_flood_of_eight_a_few_bytes_are_heard(monkeypatch):
    greetings, said = door()
    ends = [comes(greetings) for _ in range(MOST)]
    opened = []
    monkeypatch.setattr(Wire, "_opened", lambda self, k, p: opened.append(k) or (k, p))
    for end in ends:
        end.send(JUNK)
    assert greetings.proven(0.1) == []
    greetings.close()
    assert len(said) == LINES + 1
    assert said[-1].startswith(f"and {MOST - LINES} more")
    assert len(opened) <= MOST * PROOF_BYTES // 3
    for end in ends:
        end.close()


def test_who_knows_the_token_gets_in_between_them():
    greetings, _ = door()
    ends = [comes(greetings) for _ in range(MOST - 1)]
    honest = comes(greetings)
    proves(honest)
    for end in ends:
        end.send(JUNK)
    (peer,) = greetings.proven(0.1)
    peer.wire.close()
    for end in [*ends, honest]:
        end.close()


def test_a_proof_fits_what_is_heard_of_it_and_what_follows_waits():
    greetings, _ = door()
    end = comes(greetings)
    proves(end)
    end.send(JUNK[:3])
    (peer,) = greetings.proven(0.1)
    assert peer.wire.sock.recv(100) == JUNK[:3]
    peer.wire.close()
    end.close()
