"""The real server behind the gate: page and websocket tried from outside."""

import gzip
import hmac
import http.client
import json
import os
import socket
import subprocess
import sys
import time
import warnings
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import pytest
import viser
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect
from websockets.typing import Origin, Subprotocol

from experiments.dashboard.server.door import (
    HEARD_S,
    MOST_WAITING,
)
from experiments.dashboard.server.server import (
    PortBusyError,
    free_port,
    link_of,
    open_server,
    shell_of,
)
from experiments.dashboard.server.shell import ICON, SCRIPT, SCRIPT_HASH, VIEW_HASH, VIEW_SCRIPT
from tests.support import ROOT
from tests.support.waiting import wait_for

TOKEN = "a-token-of-some-length-for-tests"


@pytest.fixture(scope="module")
def served():
    server, gate = open_server("127.0.0.1", 0, TOKEN)
    yield server, gate
    server.stop()


def page(gate, path: str, **headers: str):
    connection = http.client.HTTPConnection("127.0.0.1", gate.port, timeout=5)
    connection.request("GET", path, headers=headers)
    answer = connection.getresponse()
    body = answer.read()
    connection.close()
    return answer, body


def spoken(
    gate,
    *,
    origin: str | None,
    cookie: str | None = None,
    host: str = "127.0.0.1",
    versions: Sequence[str] = (viser.__version__,),
) -> bool:
    """Whether the websocket opens and says something; cookie None: the right one."""
    cookie = gate.key if cookie is None else cookie
    with connect(
        f"ws://{host}:{gate.port}{gate.path}",
        origin=Origin(origin) if origin else None,
        additional_headers={"Cookie": f"{gate.cookie}={cookie}"} if cookie else None,
        subprotocols=[Subprotocol(f"viser-v{version}") for version in versions] or None,
        open_timeout=5,
        compression=None,
    ) as websocket:
        return len(websocket.recv(timeout=5)) > 0


def test_only_the_link_opens_the_page(served):
    _, gate = served
    answer, _ = page(gate, f"/?token={TOKEN}")
    assert answer.status == 303
    assert answer.getheader("Location") == f"{gate.path}/"
    assert f"{gate.key}; HttpOnly" in (answer.getheader("Set-Cookie") or "")
    answer, body = page(gate, "/")
    assert answer.status == 403
    assert b"no valid token" in body
    cookie = f"{gate.cookie}={gate.key}"
    answer, body = page(gate, f"{gate.path}/", Cookie=cookie)
    assert answer.status == 200
    assert b"<html" in body.lower()
    assert page(gate, "/", Cookie=cookie)[0].status == 403
    assert page(gate, f"/?token={TOKEN}", Host=f"evil.example:{gate.port}")[0].status == 403
    assert page(gate, f"/?token={TOKEN}", Origin="http://evil.example")[0].status == 403
    odd = {"Upgrade": "WebSocket", "Connection": "Upgrade"}
    assert page(gate, f"/?token={TOKEN}", **odd)[0].status == 403  # no origin: no websocket


def test_only_its_own_page_speaks_on_the_websocket(served):
    _, gate = served
    assert spoken(gate, origin=f"http://127.0.0.1:{gate.port}")
    for origin in ("http://evil.example", "null", None, f"http://localhost:{gate.port}"):
        with pytest.raises(InvalidStatus, match="403"):
            spoken(gate, origin=origin)
    with pytest.raises(InvalidStatus, match="403"):
        spoken(gate, origin=f"http://127.0.0.1:{gate.port}", cookie="")
    with pytest.raises(InvalidStatus, match="403"):
        spoken(gate, origin=f"http://127.0.0.1:{gate.port}", cookie="wrong")


def test_who_speaks_as_another_version_is_refused_before_viser_prints_a_line(served, capfd):
    _, gate = served
    own = f"http://127.0.0.1:{gate.port}"
    for versions in (["1.0.0"], ["1.0.0", viser.__version__], []):
        with pytest.raises(InvalidStatus, match="403"):
            spoken(gate, origin=own, versions=versions)
    assert spoken(gate, origin=own)
    assert capfd.readouterr().out == ""


def test_what_is_said_to_a_page_that_has_left_is_dropped_in_silence():
    """viser warns of it, once for every page, in its own words."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        server, _ = open_server("127.0.0.1", 0, TOKEN)
        server.stop()
        server.gui.add_markdown("too late")
    assert not said


def test_no_page_opens_a_tunnel_to_the_internet(served):
    server, _ = served
    kinds = {kind.__name__ for kind in server._websock_server._incoming_handlers}
    assert "GuiUpdateMessage" in kinds
    assert not {kind for kind in kinds if "Share" in kind}


@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="counts open files in /proc")
def test_idle_strangers_use_up_nothing_and_keep_nobody_out(served):
    _, gate = served

    def sockets() -> int:
        count = 0
        for one in Path("/proc/self/fd").iterdir():
            with suppress(OSError):
                count += str(one.readlink()).startswith("socket:")
        return count

    before, idle = sockets(), []
    try:
        for k in range(MOST_WAITING + 100):
            idle.append(socket.create_connection(("127.0.0.1", gate.port)))
            if k % 2:
                idle[-1].sendall(b"GET / HTTP/1.1\r\n")
        few = before + len(idle) + MOST_WAITING
        wait_for("the end of all but a few", lambda: sockets() <= few, 5.0)
        time.sleep(2 * HEARD_S)  # of the last of them
        assert spoken(gate, origin=f"http://127.0.0.1:{gate.port}")
    finally:
        for one in idle:
            one.close()


def test_it_listens_where_it_was_told_and_nowhere_else(served):
    server, gate = served
    assert server.get_host() == "127.0.0.1"
    assert link_of(gate, "127.0.0.1") == f"http://127.0.0.1:{gate.port}/?token={TOKEN}"


def test_a_busy_port_is_said_and_nothing_is_started(tmp_path: Path):
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen(1)
        port = other.getsockname()[1]
        with pytest.raises(PortBusyError, match=f"port {port} of 127.0.0.1 cannot be used"):
            open_server("127.0.0.1", port, TOKEN)
        program = [sys.executable, "-m", "experiments.cli", "dashboard"]
        told = subprocess.run(
            [*program, "--port", str(port), "--out", str(tmp_path)],
            capture_output=True,
            text=True,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
        )
        assert told.returncode == 2
        assert told.stdout == ""
        assert f"port {port}" in told.stderr
    assert free_port("127.0.0.1", port) == port


@pytest.mark.skipif(not socket.has_ipv6, reason="a machine without IPv6")
def test_an_address_that_the_server_could_not_open_is_refused_at_once():
    """An IPv4 address written as IPv6 passed the probe, and the server waited for ever."""
    with pytest.raises(PortBusyError, match="cannot be used"):
        free_port("::ffff:127.0.0.1", 0)


@pytest.mark.parametrize("host", ["localhost..", " 127.0.0.1", "nope.invalid", "192.0.2.1", "a..b"])
def test_of_a_wrong_host_the_host_is_said_to_be_wrong(host: str):
    with pytest.raises(PortBusyError, match="name an address of this machine") as told:
        free_port(host, 0)
    assert repr(host) in str(told.value)
    assert "port" not in str(told.value)


def test_the_bar_stops_for_who_has_the_cookie_alone(served):
    server, gate = served
    shell, stops = shell_of(server), []
    shell.stop, shell.state = stops.append, lambda: "running"
    mine = {"Cookie": f"{gate.cookie}={gate.key}"}
    for part, headers in (
        ("stop", {}),
        ("stop", {"Cookie": f"{gate.cookie}=wrong"}),
        ("stop", mine | {"Origin": "http://evil.example"}),
        ("stop", mine | {"Host": f"evil.example:{gate.port}"}),
        ("anything", mine),
        ("stop/", {}),
    ):
        assert page(gate, f"{gate.path}/{part}", **headers)[0].status == 403
    assert page(gate, "/stop", **mine)[0].status == 403
    answer, body = page(gate, f"{gate.path}/alive", **mine)
    assert (answer.status, json.loads(body)["state"]) == (200, "running")
    assert not stops
    assert page(gate, f"{gate.path}/stop", **mine)[0].status == 200
    assert stops == ["STOP on a page (127.0.0.1)"]


def test_a_page_that_was_open_before_gets_a_cookie_for_its_proof(served):
    server, gate = served
    here = f"127.0.0.1:{gate.port}"

    def asked() -> str:
        answer, body = page(gate, f"{gate.path}/question")
        assert answer.status == 200
        assert answer.getheader("Set-Cookie") is None
        return json.loads(body)["number"]

    def proof(number: str, host: str = here, secret: str = shell_of(server).secret) -> str:
        return hmac.new(secret.encode(), f"{number} {host}".encode(), "sha256").hexdigest()

    def comes_back(number: str, shown: str) -> bool:
        answer, _ = page(gate, f"{gate.path}/return?number={number}&proof={shown}")
        cookie = answer.getheader("Set-Cookie") or ""
        assert (answer.status == 200) == (gate.key in cookie)
        return answer.status == 200

    number = asked()
    assert comes_back(number, proof(number))
    assert not comes_back(number, proof(number))  # once
    number = asked()
    assert not comes_back(number, proof(number, f"127.0.0.1:{gate.port + 1}"))  # of another port
    assert not comes_back(number, proof(number))  # nor a second try
    for bad in ("", "x", proof("x"), "%FF"):
        assert not comes_back(asked(), bad)
    assert not comes_back("1", proof("1"))  # no number of ours
    number = asked()
    assert not comes_back(number, proof(number, secret=gate.token))
    told = json.loads(page(gate, f"{gate.path}/alive", Cookie=f"{gate.cookie}={gate.key}")[1])
    assert told["secret"] == shell_of(server).secret != gate.token
    assert page(gate, f"{gate.path}/alive")[0].status == 403


def test_the_big_view_is_for_who_has_the_cookie_alone(served):
    _, gate = served
    mine = {"Cookie": f"{gate.cookie}={gate.key}"}
    for part in ("view", "live", "camera"):
        assert page(gate, f"{gate.path}/{part}")[0].status == 403
        evil = mine | {"Origin": "http://evil.example"}
        assert page(gate, f"{gate.path}/{part}", **evil)[0].status == 403
        assert page(gate, f"{gate.path}/{part}", **mine)[0].status == 200
    answer, body = page(gate, f"{gate.path}/view", **mine)
    assert (answer.getheader("Content-Type") or "").startswith("text/html")
    assert VIEW_SCRIPT.encode() in body
    assert VIEW_HASH in (answer.getheader("Content-Security-Policy") or "")


def test_the_page_bears_its_own_name_and_the_bar_zipped_or_not(served):
    _, gate = served
    for zipped in ("gzip", "identity"):
        headers = {"Cookie": f"{gate.cookie}={gate.key}", "Accept-Encoding": zipped}
        answer, body = page(gate, f"{gate.path}/", **headers)
        assert len(body) == int(answer.getheader("Content-Length") or 0)
        text = (gzip.decompress(body) if zipped == "gzip" else body).decode()
        assert "<title>Balancing table</title>" in text
        assert text.count(SCRIPT) == text.count(ICON) == 1
        assert SCRIPT_HASH in (answer.getheader("Content-Security-Policy") or "")
