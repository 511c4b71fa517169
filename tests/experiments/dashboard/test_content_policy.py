"""What a real browser runs of a page, and to whom it sends the cookie."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, HTTPServer

import pytest

from experiments.dashboard.server.server import link_of, open_server
from experiments.dashboard.server.untrusted_text import plain
from tests.support.waiting import wait_for

TEXT = "<iframe srcdoc='<script>top.acted = 1</script>'></iframe>"


@contextmanager
def other_server(sent: list[str | None]) -> Iterator[int]:
    """Somebody else's server on this machine, which notes the cookies that it is sent."""

    class Noting(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            sent.append(self.headers["Cookie"])
            self.send_response(200)
            self.end_headers()

        def log_message(self, *args: object) -> None:
            pass

    with HTTPServer(("127.0.0.1", 0), Noting) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield server.server_port
        server.shutdown()


@pytest.mark.slow
def test_html_in_a_text_runs_no_script_and_the_page_works(chromium):
    server, gate = open_server("127.0.0.1", 0, "a-token-of-some-length-for-tests")
    server.gui.add_markdown(f"as it stands {TEXT}")  # no text of the program is shown like this
    server.gui.add_markdown(f"escaped {plain(TEXT)}")
    server.scene.add_icosphere("/ball", radius=0.3, color=(255, 90, 0))
    wrong: list[str] = []
    try:
        page = chromium.new_context().new_page()
        page.on("pageerror", lambda error: wrong.append(str(error)))
        page.goto(link_of(gate, "127.0.0.1"))
        page.get_by_text("escaped").wait_for(timeout=120e3)
        assert TEXT in page.get_by_text("escaped").inner_text()
        wait_for("the frame", lambda: page.locator("iframe").count() == 1, 10.0)
        assert page.url.startswith(f"http://127.0.0.1:{gate.port}{gate.path}")
        assert gate.token not in page.url
        page.wait_for_timeout(1000)  # longer than a script takes to run
        assert page.evaluate("window.acted") is None
        assert page.locator("canvas").count() > 0
        assert page.evaluate("history.length") <= 2  # the link is not in the way back
        sent = []
        with other_server(sent) as port:
            page.goto(f"http://127.0.0.1:{port}/")
            page.goto(f"http://127.0.0.1:{gate.port}{gate.path}/")
            page.get_by_text("escaped").wait_for(timeout=120e3)
        assert len(sent) >= 1
        assert not any(sent)
    finally:
        server.stop()
    assert wrong == []
