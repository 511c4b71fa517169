"""The live table for Foxglove: rows and events as a recording holds them, while they come."""

import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from experiments.records.samples_file import (
    EVENTS,
    SAMPLES,
    declarations,
    message_records,
)

HERE = "127.0.0.1"


class FoxgloveStream:
    """A server of Foxglove's WebSocket protocol on this machine alone; `port` 0: any free one.

    It sends and takes nothing, but asks nobody who he is, either: every program and every page of a
    browser on this machine can read what it sends. ValueError: the extra `foxglove` is not
    installed, or the port is taken.
    """

    def __init__(self, port: int) -> None:
        try:
            import foxglove
        except ImportError as error:
            raise ValueError(
                "--foxglove needs a library that is not installed: uv sync --extra foxglove"
            ) from error
        self._context: Any = foxglove.Context()  # without it the channels close
        schemas, channels = declarations()
        self._channels = {
            topic: foxglove.Channel(
                topic,
                schema=foxglove.Schema(name=name, encoding=kind, data=data),
                message_encoding=encoding,
                metadata=metadata,
                context=self._context,
            )
            for (name, kind, data), (topic, encoding, _, metadata) in zip(
                schemas, channels, strict=True
            )
        }
        try:
            self._server = foxglove.start_server(
                name="Balancing table", host=HERE, port=port, capabilities=[], context=self._context
            )
        except Exception as error:
            raise ValueError(f"--foxglove: port {port} cannot be used ({error})") from error
        self._start_ns, self._last_s = 0, np.inf

    @property
    def link(self) -> str:
        """The address that Foxglove's "Open connection" takes."""
        return f"ws://{HERE}:{self._server.port}"

    def send(self, rows: Sequence[np.ndarray]) -> None:
        """Send rows (len(COLUMNS),) of the loop, oldest first; rows without a time are left out.

        Each run's time begins anew, at the wall clock of its first row.
        """
        for row in rows:
            if not np.isfinite(row[0]):
                continue
            if row[0] < self._last_s:
                self._start_ns = time.time_ns() - round(1e9 * row[0])
            self._last_s = float(row[0])
            record = message_records(row[None], self._start_ns)[0]
            self._channels[SAMPLES].log(record["cells"].tobytes(), log_time=int(record["log_time"]))

    def event(self, t_s: float, text: str) -> None:
        """Send an event of the loop or of a page."""
        self._channels[EVENTS].log({"t_s": t_s, "text": text}, log_time=time.time_ns())

    def close(self) -> None:
        """End the server; who listens is told."""
        self._server.stop()
