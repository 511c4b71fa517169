"""The dashboard in a real browser; a test that imports this is skipped where there is none."""

from tests.support.parts import need

need("playwright", "chromium")
