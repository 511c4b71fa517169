"""The program: it ends in order, whatever signals come, and waits for nobody who reads it."""

import http.client
import os
import re
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

import pytest
from websockets.exceptions import WebSocketException
from websockets.sync.client import connect
from websockets.typing import Origin, Subprotocol

from experiments.dashboard import serve
from experiments.dashboard.server.security import gate_of
from rig.parameters import Rig
from tests.support import ROOT


@pytest.mark.skipif(os.name == "nt", reason="signals are POSIX")
@pytest.mark.usefixtures("heeded")
@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_a_second_signal_breaks_off_no_ending(monkeypatch, tmp_path: Path, name: str):
    number, did = getattr(signal, name), []

    def close() -> None:
        for _ in range(3):
            os.kill(os.getpid(), number)
            time.sleep(0.01)
        did.append("closed")

    server = SimpleNamespace(stop=lambda: did.append("stopped"))
    monkeypatch.setattr(serve, "open_server", lambda *_: (server, None))
    monkeypatch.setattr(serve, "App", lambda *_, **__: SimpleNamespace(close=close))
    monkeypatch.setattr(serve, "link_of", lambda *_: "link")
    before = signal.getsignal(number)

    def run() -> None:
        serve.serve_dashboard(
            Rig(),
            None,
            tmp_path,
            host="127.0.0.1",
            port=0,
            say=lambda _: os.kill(os.getpid(), number),
        )

    with pytest.raises(KeyboardInterrupt if name == "SIGINT" else SystemExit) as left:
        run()
    assert name == "SIGINT" or getattr(left.value, "code", None) == 128 + number
    assert did == ["closed", "stopped"]
    assert signal.getsignal(number) is before


@pytest.mark.skipif(os.name == "nt", reason="signals are POSIX")
@pytest.mark.usefixtures("heeded")
def test_nohup_keeps_the_end_of_a_terminal_away():
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    with serve._signals() as came:
        signal.raise_signal(signal.SIGHUP)
        assert not came
        signal.raise_signal(signal.SIGTERM)
        assert came == [signal.SIGTERM]


def fill(pipe: int) -> None:
    """Write into a pipe until it takes no more."""
    os.set_blocking(pipe, False)
    with suppress(BlockingIOError):
        while True:
            os.write(pipe, b"x")
    os.set_blocking(pipe, True)


@pytest.mark.skipif(os.name == "nt", reason="pipes of POSIX")
def test_stop_is_answered_while_nobody_reads_what_the_program_prints(tmp_path: Path):
    there, here = os.pipe()
    command = [sys.executable, "-m", "experiments.cli", "dashboard", "--port", "0"]
    program = subprocess.Popen(
        [*command, "--out", str(tmp_path)],
        stdout=here,
        stderr=subprocess.DEVNULL,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    try:
        said = b""
        while b"\n" not in said:
            said += os.read(there, 4096)
        found = re.search(r"//(.*):(\d+)/\?token=(\w+)", said.decode())
        assert found is not None
        fill(here)
        host, gate = f"{found[1]}:{found[2]}", gate_of(found[1], int(found[2]), found[3])
        link = http.client.HTTPConnection(host, timeout=5)
        link.request("GET", f"/?token={found[3]}")
        with link.getresponse() as led_on:
            mine = {"Cookie": (led_on.getheader("Set-Cookie") or "").partition(";")[0]}
        link.close()
        with suppress(WebSocketException):  # refused, or closed as it begins
            connect(
                f"ws://{host}{gate.path}",
                origin=Origin(f"http://{host}"),
                additional_headers=mine,
                subprotocols=[Subprotocol("viser-v1.0.0")],
                open_timeout=5,
            )
        asked = http.client.HTTPConnection(host, timeout=5)  # 1 s, generously
        asked.request("GET", f"{gate.path}/stop", headers=mine)
        with asked.getresponse() as answer:
            assert answer.status == 200
        asked.close()
    finally:
        program.kill()
        program.wait()
        os.close(there)
        os.close(here)


@pytest.mark.skipif(os.name == "nt", reason="links need rights there")
def test_a_folder_from_elsewhere_that_leads_out_of_itself_is_refused(tmp_path: Path, monkeypatch):
    """Its calibration would be written over the lab's own."""
    opened = []
    monkeypatch.setattr(serve, "open_server", lambda *words: opened.append(words) or 1 / 0)
    mine, theirs = tmp_path / "mine", tmp_path / "theirs"
    (mine / "calibration").mkdir(parents=True)
    theirs.mkdir()
    (theirs / "calibration").symlink_to(mine / "calibration")

    def start() -> None:
        told = {"host": "127.0.0.1", "port": 0, "say": print}
        serve.serve_dashboard(Rig(), None, theirs, **told)

    with pytest.raises(ValueError, match="calibration in it lead to other folders"):
        start()
    assert not opened
    (theirs / "calibration").unlink()
    with pytest.raises(ZeroDivisionError):
        start()
    (theirs / "runs").symlink_to(mine)  # by who started it here before: a larger disk, say
    with pytest.raises(ZeroDivisionError):
        start()
