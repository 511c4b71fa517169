"""The folder of `--out`, which is one command's until its end."""

import os
from pathlib import Path

_held: dict[tuple[int, int], int] = {}  # open folders of this process, by disk and number


def out_folder(out: Path, *, shared: bool = False) -> Path:
    """Make the folder of a command that writes several files, and keep it from other programs until
    this one ends: a page, its figures and results.json are of one call. shared: but for those that
    ask so, as runs do, which have folders of their own in it.

    ValueError: another program has it, or as `results_folder`, whose OSErrors it raises as well.
    """
    from experiments.records.recording import lock
    from experiments.records.run_folder import results_folder

    made = results_folder(out)
    try:
        handle = os.open(made, os.O_RDONLY)
    except OSError:  # Windows opens no folders
        return made
    found = os.fstat(handle)
    place = found.st_dev, found.st_ino
    if place in _held:
        os.close(handle)
        return made
    if not lock(handle, shared=shared):
        os.close(handle)
        raise ValueError(
            f"--out {out}: another program is writing its results there; wait for its end or "
            "choose another folder"
        )
    _held[place] = handle
    return made
