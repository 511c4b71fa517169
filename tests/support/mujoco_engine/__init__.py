"""A table whose mechanics MuJoCo computes. Without MuJoCo a test that imports this is skipped."""

from tests.support.parts import need

need("mujoco")
