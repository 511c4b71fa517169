"""`rig` on a machine that other tests keep busy: no run on a real table ends by a late loop.

    python -m tests.support.patient_rig run PROTOCOL ...

What a late loop does is asked of the monitor itself: tests/rig/safety/test_monitor.py and
tests/rig/loop/test_loop_faults.py.
"""

from dataclasses import replace
from unittest.mock import patch

from experiments.cli import main
from experiments.runs import hardware_run
from rig.loop.process import Job
from rig.safety.monitor import MonitorLimits


def patient_job(table, known, *words, **named) -> Job:
    """A job as the program makes it, with a monitor that forgives ticks that come late."""
    limits = replace(MonitorLimits.of_rig(known), late_s=10.0, late_ticks=1e9)
    return Job(table, known, *words, limits=limits, **named)


def patiently():
    """Context: this process makes its jobs for real tables by `patient_job`."""
    return patch.object(hardware_run, "Job", patient_job)


if __name__ == "__main__":
    with patiently():
        main()
