"""Records from one process to another through shared memory: the writer never waits.

One writer, one reader. Numbers that both touch are 8 bytes, aligned, each written by one side.
A reader that is a whole ring behind loses the oldest records and is told how many.
"""

import weakref
from contextlib import suppress
from multiprocessing.shared_memory import SharedMemory

import numpy as np


class SharedArray:
    """A numpy array (`array`) in shared memory, of this shape and dtype, zeros at first; pickled by
    its name.

    Pickling it to a spawned process makes another view of the same memory. The process that made
    the memory frees it with `close`; the others only let go of it. FileNotFoundError: `name` is
    given and no memory of that name exists.
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
        """Let go of the memory, and free it where this object made it; `array` is empty
        afterwards.
        """
        self.array = np.empty(0, self._dtype)
        self._finalizer()


def _free(memory: SharedMemory, own: bool) -> None:
    with suppress(BufferError):  # somebody still looks at it: freed with the process
        memory.close()
    if own:
        with suppress(FileNotFoundError):
            memory.unlink()


class SharedRing:
    """A ring of `slots` records of one dtype: `write` in one process, `read` in another.

    lost: records that were overwritten before this reader took them.
    """

    def __init__(self, dtype: np.dtype, slots: int) -> None:
        self._dtype, self._slots = np.dtype(dtype), slots
        self._records = SharedArray((slots,), self._dtype)
        self._written = SharedArray((1,), np.dtype(np.int64))
        self._taken = 0
        self.lost = 0

    def write(self, record) -> None:
        """Add a record; in a full ring it overwrites the oldest. Never waits."""
        count = int(self._written.array[0])
        self._records.array[count % self._slots] = record
        self._written.array[0] = count + 1  # after the record: the reader looks at this first

    def read(self) -> np.ndarray:
        """Return a copy (n,) of the records since the last read, oldest first; counts `lost`."""
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
        """Whether records were written since the last read."""
        return int(self._written.array[0]) != self._taken

    def close(self) -> None:
        """Let go of the ring's memory; the process that made it frees it."""
        self._records.close()
        self._written.close()
