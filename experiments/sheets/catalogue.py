"""The lab sheets: what each asks, how far an answer may be off and why, and what is recorded."""

from collections.abc import Callable
from dataclasses import dataclass

from experiments.sheets.tables import (
    MISSING,
    HiddenTable,
    camera_table,
    missing_table,
    play_table,
    seed_of,
    servo_table,
)


@dataclass(frozen=True)
class Question:
    """A question that a sheet asks.

    key: of the answer in the results file; asks: the question; unit: "" for a word; choices: of a
    word; within: how far a number may be off, in its unit, plus `share` of the true value; why: the
    reason of that tolerance.
    """

    key: str
    asks: str
    unit: str = ""
    choices: tuple[str, ...] = ()
    within: float = 0.0
    share: float = 0.0
    why: str = ""


@dataclass(frozen=True)
class LabSheet:
    """A sheet: its questions, the runs (protocol, arm) that are recorded on the student's table,
    and how that is drawn. cycle: an arm whose limit cycle in the student's own run is asked for."""

    name: str
    title: str
    questions: tuple[Question, ...]
    runs: tuple[tuple[str, str], ...]
    draw: Callable[[int], HiddenTable]
    cycle: str = ""

    def table_of(self, student: str) -> HiddenTable:
        """The student's table. ValueError: as of `seed_of`."""
        return self.draw(seed_of(self.name, student))


_OF_RUN = "two ways to read it from one run (a sine fitted, half of top to bottom) differ by that"
_AXES = ("x", "y")
PLAY = LabSheet(
    "play",
    "Play and limit cycle",
    (
        Question(
            "amplitude_x_cm",
            "amplitude of the limit cycle in x, run without the model",
            "cm",
            within=0.05,
            share=0.2,
            why=_OF_RUN,
        ),
        Question(
            "period_x_s",
            "its period",
            "s",
            within=0.1,
            share=0.15,
            why="cycles of one run differ by that",
        ),
        Question("wider", "the axis whose joint has more play", choices=_AXES),
        Question(
            "play_x_deg",
            "play of the joint of x, full width at the servo",
            "deg",
            within=0.15,
            why="twice the interval of a play fitted to these runs",
        ),
        Question("play_y_deg", "play of the joint of y", "deg", within=0.15, why="as of x"),
    ),
    (("hold", "without"), ("hold", "with"), ("steps", "without")),
    play_table,
    cycle="without",
)
SERVO = LabSheet(
    "servo",
    "Identify a servo",
    (
        Question(
            "gain_rad_s_V",
            "K of the servos",
            "rad/s/V",
            share=0.04,
            why="friction that is assumed and not measured moves it by 2 %, twice that is allowed",
        ),
        Question(
            "time_constant_ms",
            "tau of the servos",
            "ms",
            share=0.1,
            why="the fit's interval and the tick of 2 ms",
        ),
        Question(
            "friction_x_V",
            "dry friction of the motor of x beyond what the rig file knows",
            "V",
            within=0.02,
            why="the tolerance of a well-kept rig (rig effects) and its interval",
        ),
    ),
    (("servo-squares", "without"), ("steps", "without"), ("sine-sweep", "without")),
    servo_table,
)
CAMERA_SHEET = LabSheet(
    "camera",
    "Camera calibration and its errors",
    (
        Question(
            "absent",
            "which of the three errors is not there?",
            choices=("scale", "yaw", "delay"),
        ),
        Question(
            "scale_percent",
            "error of the scale, positive: seen too long; 0 if absent",
            "%",
            within=0.6,
            why="twice the tolerance of a well-kept rig",
        ),
        Question(
            "yaw_deg",
            "angle by which the camera is turned; 0 if absent",
            "deg",
            within=0.4,
            why="the tolerance of a well-kept rig and the interval of these runs",
        ),
        Question(
            "delay_ms",
            "delay beyond the rig file's; 0 if absent",
            "ms",
            within=4.0,
            why="twice the tolerance of a well-kept rig",
        ),
    ),
    (("steps", "without"), ("circle", "without"), ("sine-sweep", "without")),
    camera_table,
)
MISSING_SHEET = LabSheet(
    "missing",
    "What is missing in this model?",
    (
        Question("effect", "the effect that the rig file lacks", choices=tuple(sorted(MISSING))),
        Question("axis", "the axis that it acts on (xy: both)", choices=("x", "y", "xy")),
        Question(
            "size",
            "its first parameter (rig effects), in SI units",
            "SI",
            share=0.2,
            why="the interval of a size from three runs, and what the model leaves out",
        ),
    ),
    (("steps", "without"), ("sine-sweep", "without"), ("circle", "without")),
    missing_table,
)
SHEETS = {sheet.name: sheet for sheet in (PLAY, SERVO, CAMERA_SHEET, MISSING_SHEET)}


def sheet_named(name: str) -> LabSheet:
    """The sheet of that name. ValueError: there is none."""
    if name not in SHEETS:
        raise ValueError(f"unknown sheet '{name}'; known: {', '.join(SHEETS)}")
    return SHEETS[name]
