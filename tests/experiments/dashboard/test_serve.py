"""The dashboard ends in order, whatever signals come while it does."""

import os
import signal
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from experiments.dashboard import serve
from rig.parameters import Rig


@pytest.mark.skipif(os.name == "nt", reason="signals are POSIX")
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

    if name == "SIGINT":
        with pytest.raises(KeyboardInterrupt):
            run()
    else:
        run()
    assert did == ["closed", "stopped"]
    assert signal.getsignal(number) is before
