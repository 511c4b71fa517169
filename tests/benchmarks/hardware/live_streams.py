"""How far behind a consumer of a live stream is, and how soon a stream is back.

`python tests/benchmarks/hardware/live_streams.py` serves 640x480 MJPEG from a process of its own on
127.0.0.1, reads it with consumers of several speeds through `open_source` and through OpenCV's own
capture, then stops and starts the server. About 40 s.
"""

from __future__ import annotations

import argparse
import multiprocessing
import time

import cv2
import numpy as np

from tests.support.stream_server import Server, part
from vision.sources.source_errors import SourceError
from vision.sources.sources import open_source

LEVELS = 160  # frames are numbered by their brightness, modulo this
RATE_HZ = 60.0


def serve(port, sent, going, until_s):
    """Serve from `port` (0: any, then its value is set) while `going`, starting at `until_s`."""
    rng = np.random.default_rng(0)
    noise = rng.normal(0, 4, (480, 640, 3))
    bodies = [
        cv2.imencode(".jpg", np.rint(np.clip(40 + k + noise, 0, 255)).astype(np.uint8))[1].tobytes()
        for k in range(LEVELS)
    ]

    def script(send, _):
        next_s = time.monotonic()
        while going.value:
            body = bodies[(sent.value + 1) % LEVELS]
            # Counted when it is offered; full buffers hold the server up, as they do a real one.
            sent.value += 1
            send(part(body, x_timestamp=f"{time.time():.6f}"))
            next_s += 1 / RATE_HZ
            time.sleep(max(0.0, next_s - time.monotonic()))

    time.sleep(max(0.0, until_s.value - time.monotonic()))
    with Server(script, port=port.value) as server:
        port.value = server.port
        while going.value:
            time.sleep(0.01)


class Camera:
    """The server's process."""

    def __init__(self):
        context = multiprocessing.get_context("spawn")
        self.port, self.sent = context.Value("i", 0), context.Value("i", 0)
        self.going, self.start_s = context.Value("b", 0), context.Value("d", 0.0)
        self._context = context

    def start(self, in_s=0.0):
        self.going.value, self.start_s.value = 1, time.monotonic() + in_s
        arguments = (self.port, self.sent, self.going, self.start_s)
        self.process = self._context.Process(target=serve, args=arguments, daemon=True)
        self.process.start()
        while self.port.value == 0:
            time.sleep(0.01)
        return f"http://127.0.0.1:{self.port.value}/"

    def stop(self):
        self.going.value = 0
        self.process.join(5)

    def behind(self, image):
        """How many frames were sent after this one."""
        return (self.sent.value - round(float(image.mean()) - 40)) % LEVELS


def consume(read, camera, work_s, seconds=4.0):
    """Frames behind at delivery, by a consumer that works `work_s` on every frame."""
    behind, end_s = [], time.monotonic() + seconds
    while time.monotonic() < end_s:
        image = read()
        behind.append(camera.behind(image))
        time.sleep(work_s)
    return np.array(behind[2:])


def main():
    argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0]).parse_args()
    camera = Camera()
    address = camera.start()
    print(f"{RATE_HZ:g} Hz, 640x480: frames behind at delivery, median / 99 % / worst, read")
    for work_s in (0.0, 0.02, 0.05, 0.2):
        ages_s = []
        with open_source(address) as source:

            def read(source=source, ages_s=ages_s):
                frame = next(source)
                ages_s.append(time.monotonic() - source.start_s - frame.t_s)
                return frame.image

            ours = consume(read, camera, work_s)
            dropped = source.dropped
        plain = cv2.VideoCapture(address)
        theirs = consume(lambda plain=plain: plain.read()[1], camera, work_s)
        plain.release()
        print(
            f"work {1e3 * work_s:3.0f} ms | open_source {say(ours)}, dropped {dropped}, "
            f"age {1e3 * np.median(ages_s):.1f} ms | cv2.VideoCapture {say(theirs)}"
        )
    camera.stop()
    reconnects(camera)


def say(behind):
    p99 = np.percentile(behind, 99)
    return f"{np.median(behind):.0f} / {p99:.0f} / {behind.max()}, n {len(behind)}"


def reconnects(camera):
    """From the moment the server listens again to the first frame, several times."""
    camera.port.value = 0  # any: then it is known when it listens
    address, times_s = camera.start(), []
    with open_source(address, patience_s=5.0) as source:
        for _ in range(4):
            next(source)
            camera.stop()
            camera.start(in_s=2.0)
            while True:
                try:
                    next(source)
                    if time.monotonic() > camera.start_s.value:
                        break
                except SourceError as error:
                    name = type(error).__name__
            times_s.append(time.monotonic() - camera.start_s.value)
    camera.stop()
    print(f"reconnect after {name}: " + ", ".join(f"{1e3 * t:.0f}" for t in times_s) + " ms")


if __name__ == "__main__":
    main()
