"""What to run, as data: a protocol is a TOML file; the shipped ones lie in `protocols/`."""

from importlib.resources import files
from inspect import signature
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field, ValidationError

from rig.course import Course
from rig.files import StrictModel, first_error_line, known_names, toml_of, why_no_file
from rig.parameters import Rig
from rig.reference import SHAPES

OWN = "own"  # the arm of a lab's own controller
STEPS = ("place", "hold", "release", "push")
SHORTEST, LONGEST = 1e-3, 1e6  # periods [s] and frequencies [Hz]; chosen: a tick at 1 kHz, 11 days
LARGEST = 1e6  # other numbers of a reference; chosen: far beyond any plate or angle


class Start(StrictModel):
    """Start of a run: where the operator places the ball (x_m, y_m), and for how long it is held.

    tolerance_m: a ball seen farther than that from the start stops the run.
    """

    x_m: float = 0.0
    y_m: float = 0.0
    hold_s: float = Field(default=0.5, ge=0, le=60)
    tolerance_m: float = Field(default=0.015, gt=0)


class Pushes(StrictModel):
    """How the ball is pushed: never, at drawn times, or whenever it rests at the centre.

    kind "drawn": at times and in directions drawn from the seed, the same for both arms; every
    other push or so (drawn with probability 1/2) is opposite to the one before, the others go
    anywhere. "at-centre": the paper's way; the arm that rests at the centre more often is pushed
    more often. first_s, every_s: time of the first drawn push and mean time between two; speed_m_s:
    speed given to the ball; seconds: duration of a push.
    """

    kind: Literal["none", "drawn", "at-centre"] = "none"
    first_s: float = Field(default=5.0, ge=0)
    every_s: float = Field(default=4.0, gt=0.2)
    speed_m_s: float = Field(default=0.2, gt=0, le=1)
    seconds: float = Field(default=0.08, gt=0, le=1)


class Protocol(StrictModel):
    """One experiment, as its TOML file says it; unknown keys are errors.

    duration_s: from the release on; reference: {shape = one of `rig.reference.SHAPES`, its
    parameters}; operator: the steps that a person at a real table is asked for; arms: the
    conditions to run, names of `rig.control.controllers.COMPENSATORS`; controller: a user's own,
    "mine.py:MyController", whose arm is "own"; repetitions: runs of each arm, with seeds from
    `seed` on; servo_only: no ball and no camera, the reference is in rad.
    """

    title: str
    duration_s: float = Field(gt=0.1, le=3600)
    reference: dict[str, float | str] = {"shape": "constant"}
    start: Start = Start()
    pushes: Pushes = Pushes()
    operator: list[Literal["place", "hold", "release", "push"]] = []
    arms: list[str] = Field(default=["without", "with"], min_length=1)
    controller: str = ""
    repetitions: int = Field(default=1, ge=1, le=1000)
    seed: int = Field(default=1, ge=0)
    servo_only: bool = False
    name: str = ""


def shipped() -> list[str]:
    """Names of the shipped protocols, sorted."""
    folder = files("experiments") / "protocols"
    return sorted(
        p.name.removesuffix(".toml") for p in folder.iterdir() if p.name.endswith(".toml")
    )


def read_protocol(name: str) -> Protocol:
    """A shipped protocol by its name, or a user's by the path of its .toml file.

    ValueError (one line): no such protocol or file, no TOML, or a mistake as in `parse`.
    """
    path = Path(name)
    if path.suffix == ".toml":
        if not path.is_file():
            known = ", ".join(shipped())
            raise ValueError(f"protocol file {path} {why_no_file(path)}; shipped: {known}")
        source, label = path, str(path)
    elif name in shipped():
        source, label = Path(str(files("experiments"))) / "protocols" / f"{name}.toml", name
    else:
        raise ValueError(
            f"unknown protocol '{name}'; shipped: {', '.join(shipped())}; your own: a .toml file"
        )
    try:
        data = toml_of(source)
    except ValueError as error:
        raise ValueError(f"{label}: {error}") from None
    plan = parse(data, label=label, name=path.stem)
    if not plan.controller:
        return plan
    file, _, made = plan.controller.rpartition(":")
    beside = path.parent / file
    return plan.model_copy(update={"controller": f"{beside}:{made}"})


def parse(data: dict[str, Any], *, label: str, name: str) -> Protocol:
    """Check a protocol's data, as read from TOML, and make the protocol of it.

    label: the file, for messages; name: the protocol's, unless the data give one. ValueError (one
    line) names the key, what is wrong and what is allowed.
    """
    if data.get("controller"):
        data = {"arms": [OWN]} | data
    try:
        protocol = Protocol.model_validate({"name": name} | data)
    except ValidationError as error:
        raise ValueError(f"{label}: {first_error_line(error, Protocol)}") from None
    shape = protocol.reference.get("shape")
    if shape not in SHAPES:
        known = known_names(shape, SHAPES)
        raise ValueError(f"{label}: reference.shape = '{shape}'; {known}")
    _check_reference(protocol, label)
    _check_operator(protocol, label)
    _check_arms(protocol, label)
    return protocol


def _check_arms(protocol: Protocol, label: str) -> None:
    """Arms that there are; "own" exactly where a controller is named."""
    from rig.control.controllers import COMPENSATORS

    for arm in protocol.arms:
        if arm not in COMPENSATORS and arm != OWN:
            known = known_names(arm, [*COMPENSATORS, OWN])
            raise ValueError(f"{label}: arms: unknown arm '{arm}'; {known}")
        if protocol.arms.count(arm) > 1:
            raise ValueError(f"{label}: arms = {protocol.arms}: name each once (see --repetitions)")
    if (OWN in protocol.arms) != bool(protocol.controller):
        raise ValueError(
            f"{label}: the arm 'own' and controller = \"mine.py:MyController\" belong together"
        )
    if protocol.controller and protocol.controller.count(":") < 1:
        raise ValueError(f"{label}: controller = '{protocol.controller}': write file.py:ClassName")


def _check_operator(protocol: Protocol, label: str) -> None:
    """Steps in the order in which they can happen, each at most once."""
    steps = list(protocol.operator)
    if steps != [step for step in STEPS if step in steps]:
        raise ValueError(f"{label}: operator = {steps}: the order is {', '.join(STEPS)}, each once")
    if "push" in steps and protocol.pushes.kind == "none":
        raise ValueError(f"{label}: operator asks for pushes, but pushes.kind is 'none'")


def _check_reference(protocol: Protocol, label: str) -> None:
    """Its shape's own parameters, numbers all, within what can be computed."""
    shape = str(protocol.reference["shape"])
    allowed = set(signature(SHAPES[shape]).parameters) - {"t_s", "rng"}
    for key, value in protocol.reference.items():
        if key == "shape":
            continue
        if key not in allowed:
            known = ", ".join(sorted(allowed))
            raise ValueError(f"{label}: unknown key 'reference.{key}'; {shape} knows: {known}")
        if isinstance(value, str):
            raise ValueError(f"{label}: reference.{key} = '{value}': must be a number")
        if key.endswith(("_s", "_hz")) and not SHORTEST <= value <= LONGEST:
            bounds = f"{SHORTEST:g} to {LONGEST:g}"
            raise ValueError(f"{label}: reference.{key} = {value:g}: must be {bounds}")
        if abs(value) > LARGEST:
            raise ValueError(f"{label}: reference.{key} = {value:g}: at most {LARGEST:g}")


def targets(protocol: Protocol, rate_hz: float, rng: np.random.Generator) -> np.ndarray:
    """Reference at every tick, (n, 2) [m] (servo-only: [rad]), n = duration_s times rate_hz.

    rng draws the targets of the shape "steps"; the other shapes do not use it.
    """
    t_s = np.arange(round(protocol.duration_s * rate_hz)) / rate_hz
    settings = {key: value for key, value in protocol.reference.items() if key != "shape"}
    if protocol.reference["shape"] == "steps":
        settings["rng"] = rng  # pyright: ignore[reportArgumentType]
    return SHAPES[str(protocol.reference["shape"])](t_s, **settings)


def pushes(protocol: Protocol, rate_hz: float, rng: np.random.Generator) -> np.ndarray:
    """Accelerations of the ball by drawn pushes at every tick, (n, 2) [m/s2]; else zeros.

    Directions and times are drawn from `rng`, so that arms with one seed get the same pushes.
    """
    n = round(protocol.duration_s * rate_hz)
    push = np.zeros((n, 2))
    p = protocol.pushes
    if p.kind != "drawn":
        return push
    t, angle = p.first_s, rng.uniform(0, 2 * np.pi)
    while t + p.seconds < protocol.duration_s:
        begin = round(t * rate_hz)
        direction = np.array([np.cos(angle), np.sin(angle)])
        push[begin : begin + round(p.seconds * rate_hz)] = p.speed_m_s / p.seconds * direction
        t += p.every_s * rng.uniform(0.8, 1.2)
        angle = angle + np.pi if rng.random() < 0.5 else rng.uniform(0, 2 * np.pi)
    return push


def _check_reach(protocol: Protocol, rig: Rig) -> None:
    """ValueError where the reference leaves the plate (or a servo-only one its angle limit), or is
    no number somewhere."""
    with np.errstate(all="ignore"):
        largest = np.abs(targets(protocol, 100.0, np.random.default_rng(0))).max()
    if not np.isfinite(largest):
        raise ValueError(
            f"protocol '{protocol.name}': the reference is no number with these values of "
            f"[reference]: {protocol.reference}"
        )
    limit, unit = min(rig.linkage.half_sides_m), "m (half the plate's side)"
    if protocol.servo_only:
        limit, unit = rig.servo.angle_limit_rad, "rad (the servo's angle limit)"
    if largest > limit:
        raise ValueError(
            f"protocol '{protocol.name}': the reference reaches {largest:.3g}, the limit is "
            f"{limit:.3g} {unit}; make it smaller"
        )


def _check_ticks(protocol: Protocol, rate_hz: float) -> None:
    """ValueError where a push is shorter than a tick, or the reference swings more than once in two
    ticks, which is another swing."""
    long_s = protocol.pushes.seconds
    if protocol.pushes.kind != "none" and round(long_s * rate_hz) == 0:
        raise ValueError(
            f"protocol '{protocol.name}': pushes.seconds = {long_s:g} is less than a tick "
            f"({1 / rate_hz:g} s): no push would come; make it longer"
        )
    for key, value in protocol.reference.items():
        if key.endswith("_hz") and float(value) > rate_hz / 2:
            raise ValueError(
                f"protocol '{protocol.name}': reference.{key} = {float(value):g} is more than half "
                f"of control_rate_hz ({rate_hz:g}): such a swing cannot be told; make it slower"
            )


def course(protocol: Protocol, rig: Rig, seed: int, *, place_std_m: float = 0.002) -> Course:
    """The protocol's course for a seed: targets, pushes, start and steps, the same for both arms.

    place_std_m: standard deviation of a hand's placing of the ball. ValueError: the start is off
    the plate or in a wall, the reference leaves the plate (servo-only: the servo's angle limit) or
    is no number or faster than the ticks tell, or a push is shorter than a tick.
    """
    half = min(rig.linkage.half_sides_m)
    start = protocol.start
    if max(abs(start.x_m), abs(start.y_m)) > half:
        raise ValueError(
            f"protocol '{protocol.name}': start ({start.x_m:g}, {start.y_m:g}) m is off the plate "
            f"(+-{half:g} m); correct [start]"
        )
    _check_reach(protocol, rig)
    _check_ticks(protocol, rig.control_rate_hz)
    inside = half - rig.ball.radius_m
    if rig.walls.present and max(abs(start.x_m), abs(start.y_m)) > inside:
        raise ValueError(
            f"protocol '{protocol.name}': start ({start.x_m:g}, {start.y_m:g}) m lies in the wall; "
            f"with walls the ball's centre stays within +-{inside:g} m; correct [start]"
        )
    where, reference, hand = np.random.default_rng([seed, 1]).spawn(3)
    reach = (inside if rig.walls.present else half) - 0.002
    placed = np.array([start.x_m, start.y_m]) + place_std_m * where.standard_normal(2)
    placed = np.clip(placed, -reach, reach)
    held = 0.0 if protocol.servo_only else start.hold_s
    if protocol.servo_only and not rig.walls.present:
        placed = np.array([2 * half, 2 * half])  # no ball: it lies beside the plate, unseen
    return Course(
        targets(protocol, rig.control_rate_hz, reference),
        pushes(protocol, rig.control_rate_hz, hand),
        (float(placed[0]), float(placed[1])),
        held,
        protocol.servo_only,
        start.tolerance_m,
        tuple(protocol.operator),
    )
