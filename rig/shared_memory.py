"""Records from one process to another through shared memory: the writer never waits.

One writer, one reader. Numbers that both touch are 8 bytes, aligned, each written by one side.
A reader that is a whole ring behind loses the oldest records and is told how many.
"""

import weakref
from contextlib import suppress
from multiprocessing.shared_memory import SharedMemory

import numpy as np


class SharedArray:
    """A numpy array in shared memory, zeros at first; pickled by its name (to spawned processes).

    Who made it frees it (`close`); the others only let go of it.
    """

    def __init__(self, shape: tuple[int, ...], dtype: np.dtype, name: str | None = None) -> None:
        self._shape, self._dtype, self._own = shape, np.dtype(dtype), name is None
        size = int(np.prod(shape)) * self._dtype.itemsize
        self._memory = SharedMemory(name, create=self._own, size=size if self._own else 0)
        self.array = np.ndarray(shape, self._dtype, self._memory.buf)
        if self._own:
            self.array[...] = np.zeros((), self._dtype)
        self._finalizer = weakref.finalize(self, _free, self._memory, self._own)

    def __reduce__(self):
        return SharedArray, (self._shape, self._dtype, self._memory.name)

    def close(self) -> None:
        self.array = np.empty(0, self._dtype)
        self._finalizer()


def _free(memory: SharedMemory, own: bool) -> None:
    with suppress(BufferError):  # somebody still looks at it: freed with the process
        memory.close()
    if own:
        with suppress(FileNotFoundError):
            memory.unlink()


class SharedRing:
    """A ring of `slots` records of one dtype. `write` from one process, `read` from another."""

    def __init__(self, dtype: np.dtype, slots: int) -> None:
        self._dtype, self._slots = np.dtype(dtype), slots
        self._records = SharedArray((slots,), self._dtype)
        self._written = SharedArray((1,), np.dtype(np.int64))
        self._taken = 0
        self.lost = 0

    def write(self, record) -> None:
        """Add a record; overwrites the oldest in a full ring."""
        count = int(self._written.array[0])
        self._records.array[count % self._slots] = record
        self._written.array[0] = count + 1  # after the record: the reader looks at this first

    def read(self) -> np.ndarray:
        """A copy (n,) of what was written since the last read, oldest first; counts `lost`."""
        written = int(self._written.array[0])
        # The slot that the writer may be in just now is the oldest: never read it.
        first = max(self._taken, written - self._slots + 1)
        got = self._records.array[np.arange(first, written) % self._slots].copy()
        spoilt = int(self._written.array[0]) - self._slots + 1 - first
        if spoilt > 0:  # overwritten while they were copied
            got, first = got[spoilt:], min(first + spoilt, written)
        self.lost += first - self._taken
        self._taken = written
        return got

    @property
    def news(self) -> bool:
        """Whether there is something to read."""
        return int(self._written.array[0]) != self._taken

    def close(self) -> None:
        self._records.close()
        self._written.close()
