"""What tests of the dashboard share."""

from collections.abc import Iterator

import pytest

from tests.support.shell_alone import ShellAlone


@pytest.fixture
def program() -> Iterator[ShellAlone]:
    """The bar above the page, with a session that only stops."""
    one = ShellAlone()
    yield one
    one.server.stop()
