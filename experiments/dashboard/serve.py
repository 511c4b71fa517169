"""Open the dashboard and serve it until the program is ended."""

import io
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout
from pathlib import Path

from experiments.dashboard.app import App
from experiments.dashboard.server.door import allow_files
from experiments.dashboard.server.server import link_of, open_server
from experiments.dashboard.session.foxglove_stream import FoxgloveStream
from rig.hardware.network.token_file import is_from_here, keep_token
from rig.loop.signals import NAMES, end_by, heeded
from rig.parameters import Rig


def serve_dashboard(
    rig: Rig,
    rig_file: Path | None,
    out: Path,
    *,
    host: str,
    port: int,
    foxglove_port: int | None = None,
    say: Callable[[str], None],
) -> None:
    """Serve the dashboard until Ctrl-C, SIGTERM or SIGHUP, then level the table and end in order,
    whatever signals come meanwhile, and raise what the first of them means (`end_by`).

    rig_file: of `rig`, None for the virtual table; out: folder of everything that is made; host,
    port: where to listen (port 0: any free one); foxglove_port: serves the live table to Foxglove,
    too; say: is given the link to open, and Foxglove's. ValueError: the port is taken
    (PortBusyError), or a folder that came from elsewhere leads out of itself; nothing was started.
    """
    allow_files()
    _refuse_links(out)
    stream = None if foxglove_port is None else FoxgloveStream(foxglove_port)
    server, gate = open_server(host, port, keep_token(out / "token"))
    app = App(server, rig, out, rig_file=rig_file, stream=stream)
    with _signals() as came:
        try:
            say(link_of(gate, host))
            if stream is not None:
                say(f"Foxglove, Open connection: {stream.link}")
            while not came:
                time.sleep(0.1)
        finally:
            app.close()
            with redirect_stdout(io.StringIO()):
                server.stop()
    end_by(came[0])


def _refuse_links(out: Path) -> None:
    """ValueError: the folder came from elsewhere and holds links to folders, into which the page
    would write: whoever packed it chose where they lead."""
    token = out / "token"
    if not out.is_dir() or (token.is_file() and is_from_here(token)):
        return
    links = sorted(path.name for path in out.iterdir() if path.is_symlink() and path.is_dir())
    if links:
        raise ValueError(
            f"{out} came from elsewhere, and {', '.join(links)} in it lead to other folders, into "
            "which the page would write: remove these links"
        )


@contextmanager
def _signals() -> Iterator[list[int]]:
    """The signals that ask the program to end, in the order in which they come."""
    came: list[int] = []
    numbers = heeded("SIGINT", *NAMES)
    before = {number: signal.signal(number, lambda n, _: came.append(n)) for number in numbers}
    try:
        yield came
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
