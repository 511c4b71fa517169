"""Find where model and table disagree, name the missing effect, add it, prove it (README.md).

    from calibration.gap import investigate
    answer = investigate(logs, rig)  # logs: rig.log.Log of one table; rig: rig.parameters.Rig
    print(answer.findings.sentence)

The names below are imported when they are first used.
"""

from typing import TYPE_CHECKING

from vision.lazy import lazy_names

if TYPE_CHECKING:
    from calibration.gap.findings import Findings, Interval
    from calibration.gap.investigation import STAGES, Investigation, investigate
    from calibration.gap.model.parameters import NominalModel, Parameter
    from calibration.gap.next_experiment import propose
    from calibration.gap.tolerances import learn

__all__ = [
    "STAGES",
    "Findings",
    "Interval",
    "Investigation",
    "NominalModel",
    "Parameter",
    "investigate",
    "learn",
    "propose",
]

__getattr__ = lazy_names(
    __name__,
    {
        "findings": "Findings Interval",
        "investigation": "STAGES Investigation investigate",
        "model.parameters": "NominalModel Parameter",
        "next_experiment": "propose",
        "tolerances": "learn",
    },
)
