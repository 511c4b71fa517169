"""A served stream of one frame, and what it does next."""

from collections.abc import Iterator

import pytest

from tests.support.stream_server import Script, Server, jpeg, part


@pytest.fixture
def script() -> Script:
    return Script([part(jpeg(10))])


@pytest.fixture
def server(script: Script) -> Iterator[Server]:
    with Server(script) as server:
        yield server
        script.put(None, None)  # one for each connection that a test may have open
