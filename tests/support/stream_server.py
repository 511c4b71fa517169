"""A small MJPEG server on 127.0.0.1 that does what a test's script says, faults among it."""

import contextlib
import socket
import threading
import time

import cv2
import numpy as np

BOUNDARY = "frame"


def picture(level, size=(64, 48)):
    """A flat grey picture; its level survives JPEG, so that it numbers the frame."""
    return np.full((size[1], size[0], 3), level, np.uint8)


def jpeg(level, size=(64, 48)):
    return cv2.imencode(".jpg", picture(level, size))[1].tobytes()


def part(body, *, length=True, newline=b"\r\n", **headers):
    """One part of the stream; `x_timestamp=1.5` becomes the header X-Timestamp."""
    lines = [b"--" + BOUNDARY.encode(), b"Content-Type: image/jpeg"]
    if length:
        lines.append(b"Content-Length: %d" % len(body))
    lines += [f"{k.replace('_', '-').title()}: {v}".encode() for k, v in headers.items()]
    return newline.join([*lines, b"", body, b""])


def level_of(frame):
    return round(float(frame.image.mean()))


class Server:
    """Runs `script(send, k)` for its k-th connection; `send` raises when the client has gone."""

    def __init__(self, script, *, head=None, port=0):
        self.script = script
        self.head = head or (
            "HTTP/1.1 200 OK\r\n"
            f"Content-Type: multipart/x-mixed-replace; boundary={BOUNDARY}\r\n\r\n"
        )
        self.requests = []
        self._stopping = False
        self._clients = []
        self._threads = []
        self._listener = socket.create_server(("127.0.0.1", port))
        self.port = self._listener.getsockname()[1]
        self._accepting = threading.Thread(target=self._accept, daemon=True)
        self._accepting.start()

    @property
    def address(self):
        return f"http://127.0.0.1:{self.port}/stream"

    def _accept(self):
        while not self._stopping:
            try:
                client, _ = self._listener.accept()
            except OSError:
                return
            self._clients.append(client)
            thread = threading.Thread(target=self._serve, args=(client,), daemon=True)
            self._threads.append(thread)
            thread.start()

    def _serve(self, client):
        with client, contextlib.suppress(OSError):
            request = b""
            while b"\r\n\r\n" not in request:
                got = client.recv(4096)
                if not got:
                    return
                request += got
            self.requests.append(request.decode())
            client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            client.sendall(self.head.encode())
            self.script(client.sendall, len(self.requests) - 1)

    def until_stopped(self):
        """For scripts: wait while the connection stays open and silent."""
        while not self._stopping:
            time.sleep(0.005)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.stop()

    def stop(self):
        self._stopping = True
        with contextlib.suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        for client in self._clients:
            with contextlib.suppress(OSError):
                client.shutdown(socket.SHUT_RDWR)
        for thread in [self._accepting, *self._threads]:
            thread.join(5)


class Script:
    """Sends what the test puts, on whichever connection is open; None closes it."""

    def __init__(self, first=()):
        self.first = list(first)
        self.sent = 0
        self._items, self._news = [], threading.Condition()

    def put(self, *items):
        with self._news:
            self._items += items
            self._news.notify_all()

    def __call__(self, send, k):
        self.put(*self.first)
        while True:
            with self._news:
                if not self._news.wait_for(lambda: self._items, 3):
                    return
                item = self._items.pop(0)
            if item is None:
                return
            send(item)
            self.sent += 1
