"""One run of the bench as any lab might have written it: units, signs, names and order at will.

`disguised` makes the columns; `Disguise.answer` is a person who knows the lab and is asked.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from tests.support.other_labs.bench import Axis, run
from tests.support.other_labs.truth import Truth

LENGTHS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "px": 1 / 1400, "counts": 1 / 2600, "1": 0.14}
ANGLES = {
    "rad": 1.0,
    "deg": np.pi / 180,
    "turn/4096": 2 * np.pi / 4096,
    "us": np.pi / 2000,
    "1": np.pi / 3,
}
CENTRES = {"turn/4096": 2048.0, "us": 1500.0, "px": 300.0, "counts": 512.0}
TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
SUFFIX = {"turn/4096": "ticks", "1": "norm", "counts": "adc"}
BALL_NAMES = ("ball_{}", "Kugel {}", "x_{}", "pos {}", "ball.{}", "bille_{}", "obj{}")
ANGLE_NAMES = ("servo_{}", "theta_{}", "angle {}", "motor{}", "Winkel {}", "arm_{}", "plate {}")
COMMAND_NAMES = ("servo_{}_cmd", "theta_ref_{}", "command_{}", "action.servo_{}", "angle {} soll")
TIME_NAMES = ("time", "t", "Zeit", "timestamp", "clock")
AXES = (("x", "y"), ("1", "2"), ("X", "Y"))

BENCHES = (
    {"course_kind": "squares"},
    {"course_kind": "circle", "lag": 0.12, "delay": 0.08},
    {"course_kind": "wander", "ratio": 0.1, "frame_hz": 25.0},
    {"course_kind": "hold", "noise": 0.001},
    {"course_kind": "squares", "ratio": 0.45, "level": 0.03, "control_hz": 50},
    {"course_kind": "wander", "ratio": 1.0, "noise": 0.001},
    {"course_kind": "squares", "motor": True, "dead": 0, "frame_hz": 30.0},
    {"course_kind": "hold", "motor": True, "dead": 0, "noise": 0.002, "seconds": 15.0},
    {"course_kind": "wander", "seconds": 15.0, "level": 0.02},
)
_RUNS: dict[int, tuple[Axis, Axis]] = {}


def bench(number: int) -> tuple[Axis, Axis]:
    """Both axes of one of the BENCHES, made once."""
    if number not in _RUNS:
        how = BENCHES[number]
        _RUNS[number] = run(0, seed=number, **how), run(1, seed=number, **how)
    return _RUNS[number]


@dataclass(frozen=True)
class Disguise:
    """Columns of the file, and what each is: log column -> the keys of its map, true signs."""

    columns: dict[str, np.ndarray]
    keys: dict[str, dict]
    time: dict
    truth: Truth
    theirs: dict[str, int] = field(default_factory=dict)

    def answer(self, place: str, key: str, signals: dict) -> str:
        """What a person who knows the lab says to a question; `signals`: the proposal so far."""
        if (place, key) == ("angle", "kind"):
            return "commanded" if "command" in self.truth.kinds else "measured"
        if place == "time":
            return str(self.time[key])
        name = place if place in self.keys else next(n for n in self.keys if n.startswith(place))
        if key == "column":
            return self.keys[name]["column"] if name in self.keys else "none"
        column = signals.get(name, {}).get("column", self.keys[name]["column"])
        true_name = next((n for n, k in self.keys.items() if k["column"] == column), name)
        true = self.keys[true_name]
        if key == "sign":
            ball = f"ball_{name.split('_')[1]}_m"
            other = next(n for n, k in self.keys.items() if k["column"] == signals[ball]["column"])
            return str(true["sign"] * self.keys[other]["sign"] * signals[ball].get("sign", 1))
        return str(true[key])


def disguised(
    rng: np.random.Generator, number: int | None = None, *, habits: bool = False, named: float = 0.6
) -> Disguise:
    """A lab's columns, drawn; every choice is independent of the others.

    named: share of the labs that put the unit into a name; habits: also lost balls under some
    code, coarse readings, rows that are missing.
    """
    number = int(rng.integers(len(BENCHES))) if number is None else number
    axes = bench(number)
    code = np.nan
    if habits:
        axes, code = _with_lost_balls(axes, rng), float(rng.choice(CODES))
    motor = bool(BENCHES[number].get("motor"))
    kind = "theta" if motor or rng.random() < 0.3 else "command"
    names = AXES[rng.integers(len(AXES))]
    columns: dict[str, np.ndarray] = {}
    keys: dict[str, dict] = {}
    swap = rng.random() < 0.4

    def add(log: str, label: str, values, unit: str, scale: float, *, named: bool, sign: int):
        offset = CENTRES.get(unit, 90.0 if unit == "deg" and rng.random() < 0.4 else 0.0)
        full = f"{label}_{SUFFIX.get(unit, unit)}" if named else label
        columns[full] = sign * np.asarray(values) / scale + offset
        keys[log] = {"column": full, "unit": unit, "scale": scale, "offset": offset, "sign": sign}

    unit, told = str(rng.choice(list(LENGTHS))), rng.random() < named
    label = str(rng.choice(BALL_NAMES))
    for i, axis in enumerate("xy"):
        sign = int(rng.choice((1, -1)))
        add(f"ball_{axis}_m", label.format(names[i]), _held(axes[i].seen), unit, LENGTHS[unit],
            named=told, sign=sign)  # fmt: skip
    unit, told = str(rng.choice(list(ANGLES))), rng.random() < named
    pool = COMMAND_NAMES if kind == "command" and rng.random() < 0.7 else ANGLE_NAMES
    label = str(rng.choice(pool))
    for i, axis in enumerate("xy"):
        values = axes[i].command if kind == "command" else axes[i].angle
        called = names[1 - i] if swap else names[i]
        add(f"{kind}_{axis}_rad", label.format(called), values, unit, ANGLES[unit],
            named=told, sign=int(rng.choice((1, -1))))  # fmt: skip
    if motor:
        for i, axis in enumerate("xy"):
            add(f"voltage_{axis}_V", f"volt {names[i]}", axes[i].volts, "V", 1.0,
                named=True, sign=int(rng.choice((1, -1))))  # fmt: skip
    unit = str(rng.choice(list(TIMES)))
    label = str(rng.choice(TIME_NAMES)) + (f"_{unit}" if rng.random() < 0.5 else "")
    columns[label] = (axes[0].t + rng.choice((0.0, 1.7e9))) / TIMES[unit]
    time = {"column": label, "unit": unit}
    if habits:
        columns = _with_habits(columns, keys, axes, rng, code)
    order = rng.permutation(list(columns))
    kinds = (kind, "voltage") if motor else (kind,)
    return Disguise({n: columns[n] for n in order}, keys, time, Truth(axes, kinds))


CODES = (-1.0, 0.0, 9999.0, np.nan)


def _with_lost_balls(axes: tuple[Axis, Axis], rng: np.random.Generator) -> tuple[Axis, Axis]:
    """Both axes without the ball in a few stretches of 0.3 to 2 s."""
    gone = np.zeros(len(axes[0].t), bool)
    for start in rng.uniform(0, axes[0].t[-1], 3):
        gone |= (axes[0].t > start) & (axes[0].t < start + rng.uniform(0.3, 2.0))
    x, y = (replace(one, seen=np.where(gone, np.nan, _held(one.seen))) for one in axes)
    return x, y


def _with_habits(columns, keys, axes, rng: np.random.Generator, code: float):
    """The columns with the code where the ball was lost, coarse readings, and rows missing."""
    gone = np.isnan(axes[0].seen)
    out = dict(columns)
    for name, key in keys.items():
        size = {"ball": 0.0005, "thet": 0.002, "comm": 0.006}.get(name[:4], 0.01) / key["scale"]
        size *= rng.choice((0.01, 1.0))
        out[key["column"]] = np.round(columns[key["column"]] / size) * size
        if name.startswith("ball"):
            out[key["column"]][gone] = code
            key["absent"] = "" if np.isnan(code) else code
    kept = rng.random(len(gone)) < rng.choice((1.0, 0.6))
    kept[0] = True
    return {name: values[kept] for name, values in out.items()}


def _held(values: np.ndarray) -> np.ndarray:
    at = np.maximum.accumulate(np.where(np.isfinite(values), np.arange(len(values)), 0))
    return values[at]
