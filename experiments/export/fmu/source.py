"""The C of a table's FMU: the rig's equations, this table's numbers, the FMI functions."""

from importlib.resources import files
from math import ceil, isinf, isnan

import numpy as np

from experiments.export.fmu.variables import FALLEN, HELD, Variable
from experiments.export.translation.c_types import DOUBLE, INT, Array, Record
from experiments.export.translation.program import Program
from rig.effects import LONGEST_DELAY_S
from rig.parameters import Rig
from rig.plant import plant
from rig.plant.derived import derive
from rig.simulation.simulator import table_tick


def source(rig: Rig, record: np.record, token: str, variables: list[tuple[int, Variable]]) -> str:
    """Return the C file of a table, whose record (dtype PLANT) is `record`."""
    kind = Record("plant", record.dtype)
    rows, program = _rows(rig), Program(kind)
    state, history = Array((plant.STATE_ROWS, 2)), Array((rows, 2))
    program.add(derive, (kind,))
    program.add(
        table_tick,
        (state, kind, history, Array((2,)), *(DOUBLE,) * 2, INT, *(DOUBLE,) * 3, Array((7,))),
    )
    table = "\n".join(
        f"    {{{reference}, {_offset(one.place)}, {one.count}, '{one.causality[0]}'}},"
        for reference, one in variables
    )
    numbers = {
        "TICK_S": _number(1 / rig.control_rate_hz),
        "STEP_S": _number(float(record["step_s"])),
        "ROWS": rows,
        "STATE_ROWS": plant.STATE_ROWS,
        "HEIGHT_AT": 2 * (plant.SERVO_POSE + 1),
        "BALL_AT": 2 * plant.BALL,
        "TAKES_VOLTS": int(not rig.servo.takes_angle),
        "LATE_S(p, a)": " + ".join(f"(p).{field}[a]" for field in _late_fields(rig)),
        "HELD": HELD,
        "FALLEN": FALLEN,
        "TOKEN": f'"{token}"',
    }
    defined = "\n".join(f"#define {name} {value}" for name, value in numbers.items())
    start = f"static const struct plant START = {_initial(record)};"
    interface = (files("experiments.export.fmu") / "interface.c").read_text(encoding="utf-8")
    return "\n".join([program.text, defined, start, interface.replace("    VARIABLE_ROWS", table)])


def _rows(rig: Rig) -> int:
    """Rows of the history that the longest delay of the catalogue needs, in ticks."""
    late = "servo_dead_time" if rig.servo.takes_angle else "input_delay"
    longest = LONGEST_DELAY_S[late]
    if rig.servo.takes_angle:
        longest += max(rig.servo.pair("dead_time_s")) + max(rig.servo.pair("period_s"))
    return ceil(longest * rig.control_rate_hz) + 2


def _late_fields(rig: Rig) -> tuple[str, ...]:
    """The numbers of an axis that together say how old what acts on it may be."""
    if rig.servo.takes_angle:
        return "dead_time_s", "period_s", "servo_dead_time_delay_s"
    return ("input_delay_delay_s",)


def _offset(place: str) -> str:
    """Offset of plant.FIELD, plant.FIELD[i], or of a member of Model."""
    return f"offsetof(Model, {place})"


def _number(value: float) -> str:
    if isnan(value):
        return "NAN"
    return ("INFINITY" if value > 0 else "-INFINITY") if isinf(value) else repr(float(value))


def _initial(record: np.record) -> str:
    """C's initial value of a record."""
    parts = []
    for name in record.dtype.names or ():
        value = record[name]
        if getattr(value, "dtype", None) is not None and value.dtype.fields:
            parts.append(f".{name} = {_initial(value)}")
        elif np.ndim(value):
            parts.append(f".{name} = {{{', '.join(_number(v) for v in np.ravel(value))}}}")
        else:
            whole = isinstance(value, np.integer)
            parts.append(f".{name} = {int(value) if whole else _number(float(value))}")
    return "{" + ", ".join(parts) + "}"
