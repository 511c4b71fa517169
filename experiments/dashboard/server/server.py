"""viser's server behind the gate: bound where it was told, on the port it was told, or not at all.

viser 1.1.1 (pinned) listens to the whole network by default, checks nobody, moves to the next port
when one is busy and opens a tunnel to the internet when any page asks. None of that happens here.
"""

import errno
import io
import json
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

from experiments.dashboard.server.door import crowd_limit
from experiments.dashboard.server.messages import LONGEST
from experiments.dashboard.server.returning import Returning
from experiments.dashboard.server.security import Gate, PageRequest, gate_of, in_address
from experiments.dashboard.server.shell import PARTS, UNPROVEN, Shell, dressed
from experiments.dashboard.server.wake import wake_from_any_thread
from rig.hardware.network.token_file import check_host

if TYPE_CHECKING:
    from viser import ViserServer


class PortBusyError(ValueError):
    """The port is taken; nothing was started."""


def free_port(host: str, port: int) -> int:
    """The port number `port`, or any free one for 0. PortBusyError: another program listens at
    `host` and that port, or the host is no address of this machine.
    """
    check_host(host)
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.socket(family, socket.SOCK_STREAM) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        if family == socket.AF_INET6:  # as asyncio will; an IPv4 address in IPv6 is refused here
            probe.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
        try:
            probe.bind((host, port))
            probe.listen(1)
        except (OSError, UnicodeError) as error:  # the latter: no name of a machine
            raise PortBusyError(_cure(host, port, error)) from None
        return probe.getsockname()[1]


def _cure(host: str, port: int, error: OSError | UnicodeError) -> str:
    """What is wrong with a host and port that cannot be listened at, and what helps."""
    if isinstance(error, OSError) and error.errno in (errno.EADDRINUSE, errno.EACCES):
        return (
            f"port {port} of {host} cannot be used ({error.strerror}): stop what listens "
            "there, or choose another --port"
        )
    why = error.strerror if isinstance(error, OSError) else "no name of a machine"
    return (
        f"--host {host!r} cannot be used ({why}): name an address of this machine, such "
        "as 127.0.0.1, or 0.0.0.0 for all"
    )


def page_request(request: Any) -> PageRequest:
    """Path and security headers of a `websockets` request."""
    headers = request.headers
    upgrade = ",".join(headers.get_all("Upgrade")).lower()
    return PageRequest(
        request.path,
        headers.get_all("Host"),
        headers.get_all("Origin"),
        headers.get_all("Cookie"),
        "websocket" in upgrade,
    )


def guarded(
    process_request: Callable | None,
    gate: Gate,
    passed: Callable = lambda connection: None,
    shell: Shell | None = None,
) -> Callable:
    """A `process_request` for viser's websocket server that asks `gate` before `process_request`,
    viser's own (None: it has none).

    Who may not pass, or speaks as another version of viser's page does, is answered 403 and a
    sentence; who comes by the link with the token is led on to the page's own address (303); a page
    that was open before is asked for a proof of that. passed: hears of the connections that may;
    shell: answers the bar around the page, and gives it to the page.
    """
    from websockets.datastructures import Headers
    from websockets.http11 import Response

    shell, returning = shell or Shell(), Returning(gate.token)
    shell.secret = returning.secret

    def guard(connection: Any, request: Any):
        asked = page_request(request)
        why = gate.refusal(asked) or (_other_version(request) if asked.websocket else None)
        if why is not None:
            return _refused(why)
        part = gate.part_of(request.path)
        if part not in UNPROVEN:
            passed(connection)
        if gate.bears_token(asked):
            head = Headers({"Location": gate.page_of(request.path), "Content-Length": "0"})
            head.update(gate.headers())
            return Response(303, "See Other", head)
        if part:
            head, body = gate.headers(), b"{}"
            if part == "question":
                head, body = {}, json.dumps({"number": returning.question()}).encode()
            elif part != "return":
                body = shell.answer(part, _caller(connection))
            elif not returning.is_answered(request.path, asked.hosts[0]):
                return _refused("no valid proof: open the link that rig dashboard printed")
            sized = {"Content-Type": PARTS[part], "Content-Length": str(len(body))}
            return Response(200, "OK", Headers(sized | head), body)
        request.path = "/"  # the only page that viser serves
        answer = process_request(connection, request) if process_request else None
        if answer is not None:
            answer.headers.update(gate.headers())
            return dressed(answer) if answer.status_code == 200 else answer
        return answer

    return guard


def _refused(why: str) -> Any:
    """The answer to who may not pass."""
    from websockets.datastructures import Headers
    from websockets.http11 import Response

    body = f"{why}\n".encode()
    head = Headers({"Content-Type": "text/plain", "Content-Length": str(len(body))})
    return Response(403, "Forbidden", head, body)


def _other_version(request: Any) -> str | None:
    """Why a websocket is refused that speaks another protocol than the page served here; None: it
    does not. viser would print a line for each before it closes it.
    """
    import viser

    spoken = request.headers.get_all("Sec-WebSocket-Protocol")
    return None if spoken == [f"viser-v{viser.__version__}"] else "another version: load it again"


def _caller(connection: Any) -> str:
    """Address of the machine at the other end, for a person."""
    address = getattr(connection, "remote_address", None)
    return str(address[0]) if address else "an unknown address"


@contextmanager
def _gated(gate: Gate, shell: Shell) -> Iterator[list[Any]]:
    """While inside, what `websockets` serves stands behind the gate; yields what was served."""
    import websockets.asyncio.server as module

    serve, served = module.serve, []

    def gated_serve(*args: Any, **settings: Any):
        settings["create_connection"], passed = crowd_limit()
        settings["process_request"] = guarded(settings.get("process_request"), gate, passed, shell)
        settings["max_size"] = LONGEST
        served.append(settings)
        return serve(*args, **settings)

    module.serve = gated_serve  # pyright: ignore[reportAttributeAccessIssue]
    try:
        yield served
    finally:
        module.serve = serve


def open_server(host: str, port: int, token: str) -> "tuple[ViserServer, Gate]":
    """Start viser's server behind a gate; returns both.

    host, port: where to listen (port 0: any free one); token: the secret of the link.
    PortBusyError: the port is taken. RuntimeError: viser moved to another port all the same.
    """
    import logging
    import warnings

    import viser
    from viser import _messages as messages

    # A connection without a handshake (a port scan, a closed tab) is no fault here: no traceback.
    logging.getLogger("websockets").setLevel(logging.CRITICAL)
    # Nor is a page that leaves while it is answered: a line for each answer.
    logging.getLogger("asyncio").addFilter(lambda one: "socket.send() raised" not in one.msg)
    # viser warns of a message that it does not expect, in the sender's own words, and of one to a
    # page that has just left.
    warnings.filterwarnings("ignore", message=r"\[viser\]|Queued a \w+ on a closed connection")

    wake_from_any_thread()
    port = free_port(host, port)
    gate = gate_of(host, port, token)
    shell = Shell()
    with (
        _gated(gate, shell) as served,
        redirect_stdout(io.StringIO()),
    ):  # it would print its own banner
        server = viser.ViserServer(host=host, port=port, verbose=False)
    if len(served) != 1 or server.get_port() != port:
        with redirect_stdout(io.StringIO()):
            server.stop()
        if len(served) > 1:
            raise PortBusyError(f"port {port} of {host} was taken meanwhile: try again")
        raise RuntimeError(
            f"viser {viser.__version__} serves in a way that is not known here: not opened"
        )
    handlers = server._websock_server._incoming_handlers
    for kind in (messages.ShareUrlRequest, messages.ShareUrlDisconnect):
        handlers.pop(kind, None)  # no page opens a tunnel to the internet
    _SHELLS[server] = shell
    return server, gate


_SHELLS: WeakKeyDictionary[Any, Shell] = WeakKeyDictionary()


def shell_of(server: "ViserServer") -> Shell:
    """The shell around the page of a server of `open_server`."""
    return _SHELLS[server]


def link_of(gate: Gate, host: str) -> str:
    """The link to open in a browser on this machine, token included; host: where the server
    listens, which is linked as the loopback address if it is every address.
    """
    own = {"0.0.0.0": "127.0.0.1", "localhost": "127.0.0.1", "::": "[::1]"}
    name = own.get(host, in_address(host))
    return f"http://{name}:{gate.port}/?token={gate.token}"
