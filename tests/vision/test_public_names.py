"""The package's public names: each is there, and `import vision` loads none of their modules."""

import subprocess
import sys

import pytest

import vision


@pytest.mark.parametrize("name", vision.__all__)
def test_every_public_name_is_found(name: str):
    assert getattr(vision, name).__name__ == name


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'Tracer'"):
        _ = vision.Tracer  # pyright: ignore[reportAttributeAccessIssue]


def test_import_vision_loads_nothing_heavy():
    code = "import sys, vision; print({'cv2', 'numba', 'numpy', 'scipy'} & set(sys.modules))"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "set()"
