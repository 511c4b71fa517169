"""`rig` on a machine that other tests keep busy: no run on a real table ends by a late loop, nor
by an arm that stands still since its served table gives 0 V while its host is late.

    python -m tests.support.patient_rig run PROTOCOL ...

What a late loop and a blocked arm do is asked of the monitor itself:
tests/rig/safety/test_monitor.py and tests/rig/loop/test_loop_faults.py.
"""

from dataclasses import replace
from unittest.mock import patch

from experiments.cli import main
from experiments.runs import hardware_run
from rig.loop.job import Job


def patient_job(table, known, *words, limits, **named) -> Job:
    """A job as the program makes it, with a monitor that waits for 10 s before it stops a run."""
    limits = replace(limits, late_s=10.0, late_ticks=1e9, stall_s=10.0, motion=None)
    return Job(table, known, *words, limits=limits, **named)


def patiently():
    """Context: this process makes its jobs for real tables by `patient_job`."""
    return patch.object(hardware_run, "Job", patient_job)


if __name__ == "__main__":
    with patiently():
        main()
