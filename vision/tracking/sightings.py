"""What round things can be seen in an image, whatever they are, and how sure is each?"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from vision.detection.appearance import NOISE_FLOOR, Appearance
from vision.detection.detector import RAYS_SHARE, Detection
from vision.detection.hough_circles import Circle, circles_of_any_size
from vision.detection.outline import FLAT_STD, rays_of
from vision.detection.pixels import company, relief, turn_steps, unevenness
from vision.detection.streaks_and_mirrors import locate_shrunk, mirror_silhouette
from vision.tracking.gate import is_plausible, outline_significance

# Of the image's shorter side: a ball of 0.4 and some slack.
LARGEST_SHARE = 0.45
SMALLEST_PX = 3.5
ROUGHLY_PX = 20.0  # radius at which a disc is judged: a larger one in an image that much smaller
ROUGH_SIZE = 0.45  # logarithm of radii: what a circle of the transform may be off
# Below this an outline is as likely chance: grain and noise give it up to 6, a ball of 5 px with
# twice the contrast of a plate's grain 7 and more.
LEAST_SIGNIFICANCE = 7.0
# Standard deviations between just inside and just outside a disc over five eighths of its turn; the
# inside of a printed circle shows less than 1.
LEAST_STEP = 1.2
# Weight, while it stays, of what differs from its surround along its turn alone; also the roundness
# below which a disc is flattened. A shadow flattens one ball in six, hence a weight of `FLAT`.
FAINT = 0.1
# Share of a disc's mean brightness by which a ball's shading varies at least: a ball under lamps
# has 0.07 and more, flat things 0.05 and less; under a wide even light a ball comes near them
# too, hence a weight and no condition.
RELIEF, FLAT = 0.06, 0.5


@dataclass(frozen=True, eq=False)
class Sighting:
    """A round thing seen in one frame: its disc, how it looks there, and the evidence for it.

    `evidence` is the logarithm of its outline's significance, times the share of the outline that
    was seen; 0 and less is none. `likely` is what speaks for a ball at rest before anything moved:
    a camera is aimed at its plate (1 in the image's middle, 0.5 in its corners), and light shades a
    ball but not a flat mark or coin (down to `FLAT`, which is `flat`). `round` tells a ball at rest
    from a disc that is seen aslant, which is flattened: 1 for a circle, towards 0. `company` is the
    share of what lies about it, up to three radii, that has its colour on half of its turn.
    `uneven`: how much the brightness of most of it spreads, see `pixels.unevenness`. `settled`: its
    `home`, where that is known.
    """

    seen: Detection
    appearance: Appearance
    evidence: float
    likely: float = 1.0
    flat: bool = False
    round: float = 1.0
    company: float = 0.0
    uneven: float = math.inf
    settled: tuple[float, float] | None = None

    @property
    def home(self) -> tuple[float, float]:
        """Where it would be (u, v) px had the camera not moved: `settled`, or its place."""
        return self.place if self.settled is None else self.settled

    @property
    def place(self) -> tuple[float, float]:
        """(u, v) px."""
        return self.seen.u_px, self.seen.v_px

    def far(self, other: Sighting) -> float:
        """Distance of the centres (px)."""
        return math.dist(self.place, other.place)


def bounds_of(image: np.ndarray, asked: tuple[float, float] | None) -> tuple[float, float]:
    """Bounds (min, max) px of the radius in an image (h, w, 3): those `asked` for, or any."""
    return asked or (SMALLEST_PX, LARGEST_SHARE * min(image.shape[:2]))


def round_things(
    image: np.ndarray,
    bounds_px: tuple[float, float],
    *,
    at_most: int = 10,
    due: Callable[[int], bool] = lambda pixels: True,
) -> list[Sighting]:
    """The round things in an image (h, w, 3) uint8 BGR with a radius within `bounds_px`, the
    surest first; `at_most` of every octave of radii, `due` as for `circles_of_any_size`."""
    found: list[Sighting] = []
    for c in circles_of_any_size(image, bounds_px, at_most=at_most, due=due):
        if any(_shows(s, c) for s in found):
            continue
        sighting = sight(image, c.u_px, c.v_px, c.radius_px, bounds_px)
        if sighting is not None:
            found.append(sighting)
    kept: list[Sighting] = []
    for s in sorted(found, key=lambda s: -s.evidence):
        if not any(same_place(s, k) for k in kept):
            kept.append(s)
    return kept


def _shows(s: Sighting, c: Circle) -> bool:
    """Whether a rough circle is a thing that was sighted already."""
    radius = s.seen.radius_px
    near = math.dist(s.place, (c.u_px, c.v_px)) < 0.5 * radius
    return near and abs(math.log(c.radius_px / radius)) < ROUGH_SIZE


def same_place(a: Sighting, b: Sighting) -> bool:
    """Whether two sightings of one image are of one thing: their discs share most of their area."""
    return a.far(b) <= 0.5 * max(a.seen.radius_px, b.seen.radius_px)


def sight(
    image: np.ndarray, u_px: float, v_px: float, radius_px: float, bounds_px: tuple[float, float]
) -> Sighting | None:
    """The round thing about a circle (px) in an image (h, w, 3) uint8 BGR, if there is one."""
    appearance = Appearance.sketch(image, u_px, v_px, radius_px)
    # A rough circle shows most of the contrast.
    if outline_significance(appearance.separation, radius_px) < 0.7 * LEAST_SIGNIFICANCE:
        return None
    about = (max(bounds_px[0], 0.7 * radius_px), min(bounds_px[1], 1.4 * radius_px))
    step, found = max(1, int(radius_px / ROUGHLY_PX)), None
    for fine in sorted({step, max(1, step // 2)}, reverse=True):  # finer at the image's border
        found = locate_shrunk(image, appearance, u_px, v_px, radius_px, fine, polish=False)
        if is_plausible(found, appearance, about, strict=True):
            break
    else:
        return None
    assert found is not None
    appearance = Appearance.sketch(image, found.u_px, found.v_px, found.radius_px)
    significance = outline_significance(appearance.separation, found.radius_px)
    step = _step(image, found)
    faint = significance < LEAST_SIGNIFICANCE
    significance = outline_significance(step, found.radius_px) if faint else significance
    if significance < LEAST_SIGNIFICANCE or step < LEAST_STEP:
        return None
    silhouette = mirror_silhouette(image, appearance, found)
    found = silhouette if silhouette is not None else found
    rough = found.residual_px / max(0.25, 0.05 * found.radius_px)
    evidence = found.inliers * math.log(significance / LEAST_SIGNIFICANCE + 1.0)
    h, w = image.shape[:2]
    off = math.hypot(found.u_px - 0.5 * w, found.v_px - 0.5 * h) / math.hypot(0.5 * w, 0.5 * h)
    evidence *= max(0.2, 1.0 - 0.5 * rough)
    solid = relief(image, found.u_px, found.v_px, found.radius_px) / RELIEF
    likely = (1.0 - 0.5 * off**2) * min(max(solid, FLAT), 1.0) * (FAINT if faint else 1.0)
    alike = _company(image, found, appearance)
    uneven = unevenness(image, found.u_px, found.v_px, found.radius_px)
    flat, roundness = solid <= FLAT, _roundness(found)
    return Sighting(found, appearance, evidence, likely, flat, roundness, alike, float(uneven))


def _roundness(found: Detection) -> float:
    """Likelihood of a disc's flattening for a sphere at rest, over that of none: normal with
    `FLAT_STD` and what the residuals of the outline leave uncertain."""
    noise = RAYS_SHARE / rays_of(found.radius_px) * (found.residual_px / found.radius_px) ** 2
    return math.exp(-0.5 * found.flattening**2 / (FLAT_STD**2 + 2.0 * noise))


def _company(image: np.ndarray, found: Detection, look: Appearance) -> float:
    """Share of what lies about a disc, beyond its soft edge and up to three radii, that looks like
    it, see `pixels.company`."""
    u, v, r = found.u_px, found.v_px, found.radius_px
    reach = 1.5 * r + 1.0, 3.0 * r + 2.0
    return float(company(image, u, v, *reach, look.surround_bgr, look.direction))


def _step(image: np.ndarray, found: Detection) -> float:
    """Step over five eighths of the outline [standard deviations]; small for a line about
    something like what lies outside, such as a printed circle."""
    place = found.u_px, found.v_px, found.radius_px
    return float(turn_steps(image, *place, NOISE_FLOOR)[3])


def surest_disc(
    image: np.ndarray,
    u_px: float,
    v_px: float,
    radius_px: float | None,
    bounds_px: tuple[float, float],
) -> Sighting | None:
    """The surest round thing about a place (px) that somebody pointed at, of a radius near
    `radius_px` or, without one, of any; None where no disc holds the place."""
    radii = np.geomspace(*bounds_px, max(2, math.ceil(math.log(bounds_px[1] / bounds_px[0]) / 0.2)))
    if radius_px is not None:
        radii = radius_px * np.array((1.0, 0.85, 1.18))
    found = [sight(image, u_px, v_px, float(r), bounds_px) for r in radii]
    about = [
        s for s in found if s is not None and math.dist(s.place, (u_px, v_px)) < s.seen.radius_px
    ]
    return max(about, key=lambda s: s.evidence, default=None)
