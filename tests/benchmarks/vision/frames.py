"""What a frame costs and how well it is seen: `python tests/benchmarks/vision/frames.py` (20 s).

Rendered 640x480 frames in the loop, the plate moving: CPU time of the parts in one run, and the
error of the observations against the renderer's truth (arm "with", free release and pushes).
"""

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np

from experiments.runs.assemble import load_rig, rendered_eye
from experiments.runs.protocol import read_protocol
from experiments.runs.runner import RunRequest, run
from experiments.runs.runs import calibrate_camera
from rig.plant.ball import plate_rotation, tilt_sines
from vision.frames import Frame

FRAMES = 600


def parts(bundle: Path) -> tuple[np.ndarray, np.ndarray]:
    """CPU ms of rendering and of seeing, frame by frame, along a Lissajous path."""
    rig = load_rig(None)
    eye = rendered_eye(rig, bundle, 1)
    spent = np.empty((FRAMES, 2))
    for i in range(FRAMES):
        t = i / 60
        ball = (0.08 * np.sin(2.1 * t), 0.07 * np.sin(1.7 * t))
        speed = (0.168 * np.cos(2.1 * t), 0.119 * np.cos(1.7 * t))
        theta = (0.3 * np.sin(3.0 * t), 0.3 * np.sin(2.3 * t))
        turn = plate_rotation(tilt_sines(theta, rig.linkage.ratio))
        start = time.process_time()
        image = eye.renderer.render(turn, ball, velocity_m_s=speed, exposure_s=eye.exposure_s)
        middle = time.process_time()
        eye.ball_camera.step(Frame(image, t, i), turn)
        spent[i] = middle - start, time.process_time() - middle
    return 1000 * spent[60:, 0], 1000 * spent[60:, 1]


def main() -> None:
    argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0]).parse_args()
    with tempfile.TemporaryDirectory() as folder:
        out, rig = Path(folder), load_rig(None)
        bundle = calibrate_camera(rig, out, 1)
        render, see = parts(bundle)
        print("| part | CPU ms a frame, median (95 %) |")
        print("|---|---|")
        for name, ms in (("render 640x480", render), ("markers, tracking, ball centre", see)):
            print(f"| {name} | {np.median(ms):.2f} ({np.quantile(ms, 0.95):.2f}) |")
        ratio = np.median(see) / np.median(render)
        print(f"\nseeing costs {ratio:.2f} of rendering in the same run\n")
        print("| protocol | frames | seen | RMS x, y [mm] | worst [mm] | bias x, y [mm] |")
        print("|---|---|---|---|---|---|")
        for name in ("free-release", "pushed", "circle"):
            pairs = run(RunRequest(rig, read_protocol(name), "with", 1, out, bundle)).pairs
            error = 1000 * (pairs[:, 3:] - pairs[:, 1:3])
            seen = np.isfinite(error).all(axis=1)
            rms, bias = np.sqrt(np.mean(error[seen] ** 2, axis=0)), error[seen].mean(axis=0)
            print(
                f"| {name} | {len(pairs)} | {100 * seen.mean():.1f} % | {rms[0]:.3f}, {rms[1]:.3f} "
                f"| {np.abs(error[seen]).max():.3f} | {bias[0]:+.3f}, {bias[1]:+.3f} |"
            )


if __name__ == "__main__":
    main()
