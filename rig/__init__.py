"""The table as a thing: parameters, simulator, drivers, estimators, controllers, loop (README.md).

    from rig import COMPENSATORS, Course, Rig, draw, simulate
    run = simulate(rig, Rig(), COMPENSATORS["with"], course, draw(rng, rig, course))

The names below are imported when they are first used, so that `import rig` is instant.
"""

from typing import TYPE_CHECKING

from vision.lazy import lazy_names

if TYPE_CHECKING:
    from rig.control.controllers import COMPENSATORS
    from rig.course import Course
    from rig.effects import CATALOGUE, Effect, Parameter
    from rig.hardware.choose import open_table
    from rig.log import COLUMNS, Log
    from rig.loop.loop import Ending, Loop
    from rig.parameters import Rig
    from rig.rigfile import read_rig, write_rig
    from rig.safety.limits import limit
    from rig.simulation.batch import simulate_many
    from rig.simulation.simulate import Draws, Simulated, Task, draw, simulate
    from rig.simulation.simulator import SimulatedTable
    from rig.table import Reading, Table

__all__ = [
    "CATALOGUE",
    "COLUMNS",
    "COMPENSATORS",
    "Course",
    "Draws",
    "Effect",
    "Ending",
    "Log",
    "Loop",
    "Parameter",
    "Reading",
    "Rig",
    "Simulated",
    "SimulatedTable",
    "Table",
    "Task",
    "draw",
    "limit",
    "open_table",
    "read_rig",
    "simulate",
    "simulate_many",
    "write_rig",
]

__getattr__ = lazy_names(
    __name__,
    {
        "control.controllers": "COMPENSATORS",
        "course": "Course",
        "effects": "CATALOGUE Effect Parameter",
        "hardware.choose": "open_table",
        "log": "COLUMNS Log",
        "loop.loop": "Ending Loop",
        "parameters": "Rig",
        "rigfile": "read_rig write_rig",
        "safety.limits": "limit",
        "simulation.batch": "simulate_many",
        "simulation.simulate": "Draws Simulated Task draw simulate",
        "simulation.simulator": "SimulatedTable",
        "table": "Reading Table",
    },
)
