"""Records from one process to another through shared memory: the writer never waits.

One writer, one reader. Numbers that both touch are 8 bytes, aligned, each written by one side.
A reader that is a whole ring behind loses the oldest records and is told how many.

Nothing here relies on the order in which one processor's stores become visible to another: x86
keeps it, ARM (Raspberry Pi, Jetson, Apple) does not, and Python has no fence. Every slot therefore
carries its record's number and a CRC-32 over number and record. The reader copies the slot, and
takes the copy only where both agree with it: then all its bytes are those of one write. A slot of
which a part is not visible yet is read again later; one that bears a later number is lost. A
mixture of two records passes with a chance of 2^-32.
"""

import os
import weakref
import zlib
from contextlib import suppress
from multiprocessing.shared_memory import SharedMemory

import numpy as np


def encoded(text: str, size: int) -> bytes:
    """The text as at most `size` bytes of UTF-8, never cut inside a character; "?" for what is
    none, as in the name of a folder that is no UTF-8.
    """
    return text.encode(errors="replace")[:size].decode(errors="ignore").encode()


class SharedArray:
    """A numpy array (`array`) in shared memory, of this shape and dtype, zeros at first; pickled by
    its name.

    Pickling it to a spawned process makes another view of the same memory. The process that made
    the memory frees it with `close`; the others only let go of it. FileNotFoundError: `name` is
    given and no memory of that name exists. OSError: there is no room for it.
    """

    def __init__(self, shape: tuple[int, ...], dtype: np.dtype, name: str | None = None) -> None:
        self._shape, self._dtype, self._own = shape, np.dtype(dtype), name is None
        size = int(np.prod(shape)) * self._dtype.itemsize
        self._memory = SharedMemory(name, create=self._own, size=size if self._own else 0)
        self._finalizer = weakref.finalize(self, _free, self._memory, self._own)
        if self._own:
            self._reserve(size)
        self.array = np.ndarray(shape, self._dtype, self._memory.buf)
        if self._own:
            self.array[...] = np.zeros((), self._dtype)

    def _reserve(self, size: int) -> None:
        """Take the memory at once: else writing to a full one ends the program (SIGBUS)."""
        file = getattr(self._memory, "_fd", -1)
        if file < 0 or not hasattr(os, "posix_fallocate"):
            return
        try:
            os.posix_fallocate(file, 0, size)
        except OSError as error:
            self._finalizer()
            raise OSError(
                error.errno,
                f"shared memory has no room for {size} bytes ({error.strerror}): free or enlarge "
                "/dev/shm (mount -o remount,size=64m /dev/shm; docker run --shm-size 64m)",
            ) from None

    def __reduce__(self):
        return SharedArray, (self._shape, self._dtype, self._memory.name)

    def close(self) -> None:
        """Let go of the memory, and free it where this object made it; `array` is empty
        afterwards.
        """
        self.array = np.empty(0, self._dtype)
        self._finalizer()


def _free(memory: SharedMemory, own: bool) -> None:
    with suppress(BufferError, OSError):  # somebody still looks at it, or has closed its file
        memory.close()
    if own:
        with suppress(FileNotFoundError):
            memory.unlink()


class SharedRing:
    """A ring of `slots` records of one dtype: `write` in one process, `read` in another.

    lost: records that were overwritten before this reader took them.
    """

    def __init__(self, dtype: np.dtype, slots: int) -> None:
        self._slots = slots
        slot = [("number", np.int64), ("check", np.int64), ("record", np.dtype(dtype))]
        self._records = SharedArray((slots,), np.dtype(slot))
        self._written = SharedArray((1,), np.dtype(np.int64))
        self._taken = 0
        self.lost = 0

    def write(self, record) -> None:
        """Add a record; in a full ring it overwrites the oldest. Never waits."""
        count = int(self._written.array[0])
        slot = self._records.array[count % self._slots : count % self._slots + 1]
        slot["record"] = record
        slot["number"] = count + 1
        slot["check"] = _check(slot)
        self._written.array[0] = count + 1  # the reader looks at this first

    def read(self) -> np.ndarray:
        """Return a copy (n,) of the records since the last read, oldest first; counts `lost`."""
        written = int(self._written.array[0])
        # The slot that the writer may be in just now is the oldest: never read it.
        first = max(self._taken, written - self._slots + 1)
        got = self._records.array[np.arange(first, written) % self._slots].copy()
        whole, next_one = [], first
        for k in range(len(got)):
            slot, number = got[k : k + 1], first + k + 1
            if slot["check"][0] != _check(slot) or slot["number"][0] < number:
                break  # not all of it is visible yet, or it is being overwritten: later
            if slot["number"][0] == number:
                whole.append(k)
            next_one = number
        self.lost += next_one - self._taken - len(whole)
        self._taken = next_one
        return got["record"][whole]

    @property
    def news(self) -> bool:
        """Whether records were written since the last read."""
        return int(self._written.array[0]) != self._taken

    def close(self) -> None:
        """Let go of the ring's memory; the process that made it frees it."""
        self._records.close()
        self._written.close()


def _check(slot: np.ndarray) -> int:
    """CRC-32 over number and record of a slot (1,)."""
    return zlib.crc32(slot["record"].tobytes(), int(slot["number"][0]) & 0xFFFFFFFF)
