"""Locating on random looks: `uv run python tests/benchmarks/vision/seeing_random.py` (1 minute).

Ball, plate, lamp, gloss, grain, noise, blur, JPEG, speed and exposure are drawn anew for each look,
four places a look; the ball's looks are learnt at the first. Prints quantiles of the error and of
the error over its claimed sigma (per axis, of the median over 0.8326: 1 where sigma is honest).
"""

import argparse

import cv2
import numpy as np

from tests.benchmarks.vision.scenes import PLATES, Look, Studio
from vision.detection.appearance import Appearance
from vision.detection.detector import locate_ball

BALLS = ("orange", "green", "white", "black")
UNSEEN = {("white", "pale"), ("black", "dark")}  # hardly a ball's contrast
GAINS = (1.0, 1.0, 1.0, 0.5, 0.25, 0.16)
PLACES, GUESS_PX = 4, 0.7


def random_look(rng: np.random.Generator, name: str) -> Look:
    """A look that a lab could have."""
    ball, plate = str(rng.choice(BALLS)), str(rng.choice(list(PLATES)))
    while (ball, plate) in UNSEEN:
        ball, plate = str(rng.choice(BALLS)), str(rng.choice(list(PLATES)))
    way, lean, ambient = rng.uniform(0, 2 * np.pi), rng.uniform(0, 1.2), rng.uniform(0.3, 0.7)
    gain = float(rng.choice(GAINS))
    light = lean * np.cos(way), lean * np.sin(way), rng.uniform(0.5, 1.0)
    return Look(
        name, ball=ball, plate=plate, radius_m=float(rng.choice((0.0146, 0.02))), light=light,
        ambient=ambient, diffuse=1 - ambient, gloss=rng.uniform(0, 1),
        grain=float(rng.choice((0.0, 0.012, 0.02))), noise_dn=rng.uniform(1, 4),
        blur_px=rng.uniform(0.45, 1.1), gain=(gain, gain, gain),
        jpeg=int(rng.integers(80, 96)) if rng.random() < 0.35 else None,
        speed_m_s=float(rng.choice((0.0, 0.2, 0.5))),
        exposure_s=float(rng.choice((0.0005, 0.002, 0.006))),
    )  # fmt: skip


def located(look: Look, rng: np.random.Generator) -> list[tuple[float, float] | None]:
    """(error, claimed sigma) px per axis at some places of a look; None where no disc was found."""
    studio, appearance, found = Studio(look, (640, 480), int(rng.integers(1_000_000))), None, []
    for _ in range(PLACES):
        way = rng.uniform(0, 2 * np.pi)
        speed = look.speed_m_s * np.cos(way), look.speed_m_s * np.sin(way)
        shot = studio.shot(tuple(rng.uniform(-0.08, 0.08, 2)), speed)
        u, v, r = shot.u_px, shot.v_px, shot.radius_px
        appearance = appearance or Appearance.learn(shot.image, u, v, r)
        du, dv = GUESS_PX * rng.normal(size=2)
        disc = locate_ball(shot.image, appearance, u + du, v + dv, r)
        off = disc and float(np.hypot(disc.u_px - u, disc.v_px - v)) / 2**0.5
        found.append(disc and (off, disc.sigma_px))
    return found


def main() -> None:
    options = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    options.add_argument("--looks", type=int, default=140)
    options.add_argument("--seed", type=int, default=1)
    chosen = options.parse_args()
    cv2.setNumThreads(1)
    rng = np.random.default_rng(chosen.seed)
    every = [f for k in range(chosen.looks) for f in located(random_look(rng, f"{k}"), rng)]
    seen = np.array([f for f in every if f])
    marks = " ".join(
        f"{100 * q:g} %: {np.quantile(seen[:, 0], q):.3f}" for q in (0.5, 0.9, 0.95, 0.99, 1)
    )
    score = seen[:, 0] / seen[:, 1]
    print(f"{len(every)} images of {chosen.looks} looks, {len(every) - len(seen)} without a disc")
    print(f"error per axis [px], quantiles: {marks}")
    print(f"error over claimed sigma: median {np.median(score) / 0.8326:.2f}, "
          f"rms {np.sqrt(np.mean(score**2)):.2f}, above 4 in {(score > 4).sum()}")  # fmt: skip


if __name__ == "__main__":
    main()
