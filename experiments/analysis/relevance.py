"""How large a difference has to be to matter, by unit; fixed before any run."""

from math import pi

# A pixel of the paper's camera; a count of a 4096-count encoder; for times no derivation is known.
RELEVANT = {"cm": 0.0625, "rad": 2 * pi / 4096, "s": 0.25}
