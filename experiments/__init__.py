"""From a protocol to a report: run, record, read back, measure (README.md).

    from experiments import read_protocol, read_run, run_metrics, run_protocol
    done = run_protocol(rig, read_protocol("steps"), arms=["with"], out=out, seed=1, repetitions=1)
    metrics = run_metrics(read_run(done[0].folder).log)

The names below are imported when they are first used, so that `rig --help` is instant.
"""

from typing import TYPE_CHECKING

from vision.lazy import lazy_names

if TYPE_CHECKING:
    from experiments.analysis.metrics import RunMetrics, run_metrics
    from experiments.records.exporting import export_run
    from experiments.records.importing import read_log
    from experiments.records.recording import Run, read_run, write_run
    from experiments.runs.protocol import Protocol, course, read_protocol
    from experiments.runs.runs import run_protocol

__all__ = [
    "Protocol",
    "Run",
    "RunMetrics",
    "course",
    "export_run",
    "read_log",
    "read_protocol",
    "read_run",
    "run_metrics",
    "run_protocol",
    "write_run",
]

__getattr__ = lazy_names(
    __name__,
    {
        "analysis.metrics": "RunMetrics run_metrics",
        "records.exporting": "export_run",
        "records.importing": "read_log",
        "records.recording": "Run read_run write_run",
        "runs.protocol": "Protocol course read_protocol",
        "runs.runs": "run_protocol",
    },
)
