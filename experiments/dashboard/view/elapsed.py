"""How long somebody has been waiting, in whole seconds."""

import time


def minutes(seconds: float) -> str:
    """`seconds` [s] as m:ss."""
    rounded = max(0, round(seconds))
    return f"{rounded // 60}:{rounded % 60:02d}"


class Elapsed:
    """Whole seconds since it was made, or since `begin`."""

    def __init__(self) -> None:
        self.begin()

    def begin(self) -> None:
        """Count from now on."""
        self._since_s, self._told_s = time.monotonic(), -1

    @property
    def seconds(self) -> int:
        """Whole seconds until now."""
        return int(time.monotonic() - self._since_s)

    def changed(self) -> bool:
        """Whether `seconds` is another than when this was last asked."""
        told_s, self._told_s = self._told_s, self.seconds
        return self._told_s != told_s
