"""Ask the system for what a loop in time needs; what is refused is reported, not required."""

import ctypes
import gc
import os
import sys

PRIORITY = 50
LOCK_NOW, LOCK_LATER = 1, 2  # MCL_CURRENT, MCL_FUTURE
_held: list[int] = []  # a file that must stay open


def go_realtime() -> dict[str, str]:
    """Ask for real-time priority, locked memory and no sleep states; stop the garbage collector.

    Returns "yes" or why not for each, as run.json keeps it: sched_fifo, mlockall, cpu_dma_latency,
    and garbage_collector "off". What the system refuses is no error.
    """
    gc.collect()
    gc.freeze()
    gc.disable()
    return {
        "sched_fifo": _fifo(),
        "mlockall": _lock(),
        "cpu_dma_latency": _awake(),
        "garbage_collector": "off",
    }


def _fifo() -> str:
    if not hasattr(os, "sched_setscheduler"):
        return f"not on {sys.platform}"
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except OSError as error:
        return f"{error.strerror}: allow rtprio {PRIORITY} in /etc/security/limits.conf"
    return "yes"


def _lock() -> str:
    if not sys.platform.startswith("linux"):
        return f"not on {sys.platform}"
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.mlockall(LOCK_NOW | LOCK_LATER) != 0:
        why = os.strerror(ctypes.get_errno())
        return f"{why}: allow memlock unlimited in /etc/security/limits.conf"
    return "yes"


def _awake() -> str:
    """Keep the processors out of their deep sleep states while this process lives."""
    try:
        file = os.open("/dev/cpu_dma_latency", os.O_WRONLY)
        os.write(file, bytes(4))
    except OSError as error:
        return str(error.strerror)
    _held.append(file)
    return "yes"
