"""The public surface of the gap workflow: every name is there, and importing it costs nothing."""

import subprocess
import sys

import pytest

import calibration.gap


def test_every_public_name_is_there():
    for name in calibration.gap.__all__:
        assert getattr(calibration.gap, name).__doc__ or name == "STAGES"
    assert callable(calibration.gap.investigate)


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="has no attribute 'investigates'"):
        _ = calibration.gap.investigates


def test_the_package_imports_nothing_heavy():
    code = "import sys, calibration.gap; print({'numba', 'scipy', 'numpy'} & set(sys.modules))"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "set()"
