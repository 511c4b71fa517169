"""Backlash gauges: a tooth between two jaws for each gear and joint, drawn 40 times as large.

The position of the tooth comes from the model (nothing measures it), the number below it from the
controller's observer.
"""

from math import degrees
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.dashboard.view.grid import LETTERS
from experiments.dashboard.view.pose import TOOTH_M, backlash_widths, gauges
from rig.parameters import Rig

if TYPE_CHECKING:
    from viser import ViserServer

FREE, TOUCHED, TOOTH = (150, 158, 170), (214, 39, 40), (255, 176, 30)
TEETH = "/teeth"  # the node of the scene above all gauges
PLACES = {  # of the four gauges, beside the two servos: the joint's above the gear's
    ("gear", 0): (0.225, -0.03, 0.01),
    ("joint", 0): (0.225, -0.03, 0.06),
    ("gear", 1): (-0.07, 0.215, 0.09),
    ("joint", 1): (-0.07, 0.215, 0.14),
}


class BacklashGauge:
    """One backlash in the 3-D view: two jaws of the driven side, the tooth of the driving side
    between them. kind: "gear" or "joint"; axis: 0 x, 1 y. The attribute `told` says whether the
    label gives the true width, too.
    """

    def __init__(self, server: "ViserServer", kind: str, axis: int) -> None:
        scene, name = server.scene, f"{TEETH}/{kind}_{'xy'[axis]}"
        self._along = np.eye(3)[0]  # across the picture, whatever the servo
        self._words = f"play of {kind} {'xy'[axis]}"
        size = np.full(3, TOOTH_M)
        size[2] = 3 * TOOTH_M
        scene.add_frame(name, position=PLACES[kind, axis], show_axes=False)
        self._tooth: Any = scene.add_box(f"{name}/tooth", TOOTH, tuple(size))
        # A jaw is two boxes, one of which is shown: a colour would change later than a place.
        self._jaws: list[tuple[Any, Any]] = [
            (
                scene.add_box(f"{name}/jaw_{side}", FREE, tuple(size)),
                scene.add_box(f"{name}/jaw_{side}_touched", TOUCHED, tuple(size), visible=False),
            )
            for side in "ab"
        ]
        above = kind == "joint"  # none lies between two gauges, however small those are drawn
        self._label: Any = scene.add_label(
            f"{name}/label",
            self._words,
            position=(0, 0, (2.2 if above else -2.2) * TOOTH_M),
            font_screen_scale=LETTERS,
            anchor="bottom-center" if above else "top-center",
        )
        self._touches, self.told = 0, True

    def draw(self, play_rad: float, twist_rad: float, found_rad: float, rig: Rig) -> None:
        """Draw the backlash at the servo: play_rad, its full width; twist_rad, driving minus driven
        side in the model; found_rad, the width that the observer found (NaN or 0: none yet).
        """
        half, at, touches = gauges(play_rad, twist_rad, rig)
        self._tooth.position = tuple(at * self._along)
        for jaw, side in zip(self._jaws, (-1, 1), strict=True):
            for box in jaw:
                box.position = tuple(side * (half + TOOTH_M) * self._along)
            if touches != self._touches:
                free, touched = jaw
                free.visible, touched.visible = touches != side, touches == side
        self._touches = touches
        found = f"found {degrees(found_rad):.1f}°" if found_rad > 0.0 else "nothing found yet"
        true = f"true {degrees(play_rad):.1f}°, " if self.told else ""
        text = f"{self._words}:\n{true}{found}"  # a longer line is cut
        if self._label.text != text:
            self._label.text = text


class BacklashGauges:
    """The gauges of both gears and both joints; of the joints alone where servos take an angle, as
    their gears lie within their own loop."""

    def __init__(self, server: "ViserServer", rig: Rig) -> None:
        self._root: Any = server.scene.add_frame(TEETH, show_axes=False)
        kinds = ("joint",) if rig.servo.takes_angle else ("gear", "joint")
        self._gauges = {
            place: BacklashGauge(server, *place) for place in PLACES if place[0] in kinds
        }

    def show(self, shown: bool) -> None:
        """Show the gauges or, as they tell the true backlash, hide them."""
        if self._root.visible != shown:
            self._root.visible = shown

    def tell(self, told: bool) -> None:
        """Give the true widths in the labels, or what the observer found alone."""
        for gauge in self._gauges.values():
            gauge.told = told

    def draw(self, rig: Rig, gear_rad: np.ndarray, joint_rad: np.ndarray, found: np.ndarray):
        """Draw all gauges: gear_rad and joint_rad (2,), twists in the model by axis; found (2, 2)
        [rad], widths that the observer found, rows gear and joint, columns x and y.
        """
        gear, joint = backlash_widths(rig)
        rows = {"gear": (gear, gear_rad, found[0]), "joint": (joint, joint_rad, found[1])}
        for (kind, axis), gauge in self._gauges.items():
            width, twist, seen = rows[kind]
            gauge.draw(width[axis], twist[axis], seen[axis], rig)
