"""A camera over a virtual table: the plant's process notes what the light shows, another one makes
pictures of it and serves them as MJPEG over HTTP, each with the moment of its exposure.

Run as a process: python -m tests.support.virtual_film FOLDER. FOLDER/seen is what to show;
FOLDER/film gets the address.
"""

import sys
import time
from pathlib import Path

import numpy as np

LAYOUT = (9,)  # count, monotonic s, ball x, y, sines x, y, velocity x, y, count


class Film:
    """What a `SimulatedTable` takes as its eye: it sees nothing itself, it shows. FOLDER/balls gets
    a line (monotonic s, x, y) for each exposure with a ball."""

    def __init__(self, folder: Path) -> None:
        self._shown = np.memmap(folder / "seen", np.float64, "w+", shape=LAYOUT)
        self._balls = (folder / "balls").open("w", buffering=1)
        self.now_s = 0.0  # of the table, at its tick: `see` is called late by up to one of these

    def see(self, exposed_s, ball_xy_m, tilt_sines_true, velocity_m_s, theta_rad) -> None:
        at_s = time.monotonic() - (self.now_s - exposed_s)
        x, y = ball_xy_m or (np.nan, np.nan)
        count = self._shown[0] + 1
        self._shown[0] = count
        self._shown[1:8] = at_s, x, y, *tilt_sines_true, *velocity_m_s
        self._shown[8] = count
        if ball_xy_m is not None:
            self._balls.write(f"{at_s!r} {x!r} {y!r}\n")


def balls(folder: Path) -> np.ndarray:
    """(n, 3): monotonic s, x, y of every exposure with a ball."""
    rows = (folder / "balls").read_text().split("\n")[:-1]
    return np.array([[float(v) for v in row.split()] for row in rows])


def newer(exposed_s: np.ndarray) -> np.ndarray:
    """Which rows hold an exposure later than all before, whether old ones are held or blank."""
    before_s = np.fmax.accumulate(np.concatenate([[-np.inf], exposed_s[:-1]]))
    return exposed_s > before_s


def measured_and_true(log, folder: Path) -> np.ndarray:
    """(n, 4): where the run's log has the ball, and where it was at that exposure."""
    exposed = log["ball_exposed_s"]
    new = newer(exposed)
    times, told = exposed[new], np.column_stack([log["ball_x_m"], log["ball_y_m"]])[new]
    truth, best = balls(folder), np.zeros((0, 4))
    for stamp in truth[:, 0]:  # the run's zero is where all its exposures are those of the film
        wanted = times - times[-1] + stamp
        at = np.clip(np.searchsorted(truth[:, 0], wanted - 2e-5), 0, len(truth) - 1)
        hit = np.abs(truth[at, 0] - wanted) < 2e-5
        if hit.sum() > len(best):
            best = np.column_stack([told[hit], truth[at[hit], 1:]])
    assert len(best) > 0.9 * len(times)
    return best


def main(folder: Path) -> None:
    import cv2

    from experiments.runs.assemble import load_rig, virtual_scene
    from rig.plant.ball import plate_rotation
    from tests.support.stream_server import Server, part
    from vision.synthetic.synthetic import Renderer, virtual_view

    cv2.setNumThreads(1)
    shown = np.memmap(folder / "seen", np.float64, "r", shape=LAYOUT)
    renderer = Renderer(virtual_scene(load_rig(None)), virtual_view(), np.random.default_rng(2))

    renderer.render(np.eye(3), (0.0, 0.0))  # compiles before anybody waits

    def script(send, k: int) -> None:
        last = 0.0
        while True:
            now = np.array(shown)
            if now[0] == last or now[0] != now[8]:
                time.sleep(0.001)
                continue
            last, ball = now[0], None if np.isnan(now[2]) else now[2:4]
            turn = plate_rotation((now[4], now[5]))
            image = renderer.render(turn, ball, velocity_m_s=now[6:8])
            body = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 90])[1].tobytes()
            send(part(body, x_timestamp=float(now[1])))

    with Server(script) as server:
        (folder / "film.new").write_text(server.address)
        (folder / "film.new").rename(folder / "film")
        while True:
            time.sleep(60)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
