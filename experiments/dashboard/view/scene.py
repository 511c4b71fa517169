"""The 3-D view: plate, arms, ball, ghost, trail and target, and the legend of what they mean."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.dashboard.view.ghost import noise_alone_m
from experiments.dashboard.view.grid import LETTERS, axis_letters, below_numbers, draw_grid
from experiments.dashboard.view.pose import DROP_M, linkage, plate_wxyz
from experiments.dashboard.view.view_points import FIELD_OF_VIEW_RAD, view_point
from rig.parameters import Rig

if TYPE_CHECKING:
    from viser import ClientHandle, ViserServer

# The model is pink: blue is the run without compensation, green what is wanted.
ORANGE, GHOST, GREEN = (255, 112, 16), (225, 70, 180), (26, 150, 65)
PLATE, METAL, DARK = (228, 232, 238), (120, 128, 140), (70, 76, 86)
AWAY = (0.0, 0.0, -9.0)
LEGEND_TABLE = """
**Grey plate, orange ball**: the table as it is measured. Its trail is where the ball was, the
**target** is where it shall be. Fine lines are 1 cm apart.

**Pink ball**: the model, driven by the same volts and set onto the ball once a second. Below the
plate, "model 11.0 mm off (noise alone: 6 mm)": by the end of the second the camera's noise alone
makes them part by about 6 mm; what is beyond that is what the model does not know.

**Blocks beside the servos**: the play of gear and joint, 40 times as large. The
**yellow** tooth moves between two jaws: a **grey** jaw is free, a **red** one is touched.
"""
LEGEND_VIRTUAL = """
"found 0.9°": what the controller's observer has found of it while it moves. Once play was
calibrated (tab Calibrate) "true 1.0°" stands before it: what the virtual table has.
"""
LEGEND_REAL = """
"true 1.0°, found 0.9°": the rig file says 1.0 degrees of play; 0.9 is what the controller's
observer has found while it moves.
"""
LEGEND_CURVES = """
**Curves**: the torque in the shaft is what the controller's observer takes the twisted shafts to
pass on; the play found is what that observer has found so far, gear full, joint dashed.
"""
LEGEND_FILMS = """
**Two small plates behind** (tab Gap, before and after): the model without and with the named
effect, at the same moment of the recorded run; "from the ball" is from the recorded one.

**Coloured cells on the plate**: how far model and recording disagree there, in units of what even
a perfect model would leave (noise floors).
"""


def legend_words(real: bool) -> str:
    """Markdown for the tab Legend on the shapes and colours of the view; real: of a real table."""
    paragraphs = (
        LEGEND_TABLE + (LEGEND_REAL if real else LEGEND_VIRTUAL) + LEGEND_CURVES + LEGEND_FILMS
    )
    return "\n\n&nbsp;\n\n".join(paragraphs.strip().split("\n\n"))


def light(server: "ViserServer", side_m: float) -> None:
    """Set the scene's first view point, for a plate of this side, and its lamps."""
    camera = server.initial_camera
    camera.position, camera.look_at = view_point("Whole table", side_m)
    camera.fov = FIELD_OF_VIEW_RAD
    server.scene.configure_default_lights(True, cast_shadow=False)
    server.scene.configure_environment_map(None)  # the default one bleaches every colour
    server.scene.add_light_ambient("/light", intensity=1.2)


def ball_mesh(radius_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (n, 3) and faces (m, 3) of a sphere, by longitude and latitude."""
    rows, columns = 13, 24
    polar, around = np.meshgrid(
        np.linspace(0, np.pi, rows),
        np.linspace(0, 2 * np.pi, columns, endpoint=False),
        indexing="ij",
    )
    across = np.sin(polar)
    corners = np.stack([across * np.cos(around), across * np.sin(around), np.cos(polar)], axis=-1)
    i, j = np.meshgrid(np.arange(rows - 1), np.arange(columns), indexing="ij")
    a, b = i * columns + j, i * columns + (j + 1) % columns
    c, d = a + columns, b + columns
    faces = np.concatenate([np.stack([a, c, b], -1), np.stack([b, c, d], -1)]).reshape(-1, 3)
    return (radius_m * corners).reshape(-1, 3).astype(np.float32), faces.astype(np.uint32)


class PlateModel:
    """A square plate with a ball on it, drawn in viser's scene under the node `name`, its centre
    `at` (x, y, z) [m]. ghost: the ball has the colour of a model's.
    """

    def __init__(
        self,
        server: "ViserServer | ClientHandle",
        name: str,
        rig: Rig,
        *,
        at=(0.0, 0.0, 0.0),
        ghost: bool = False,
    ) -> None:
        self._rig, scene = rig, server.scene
        side, radius = rig.linkage.plate_side_m, rig.ball.radius_m
        self.name = name
        self.root = scene.add_frame(name, position=at, show_axes=False)
        self.plate = scene.add_frame(f"{name}/plate", show_axes=False)
        self.top = scene.add_box(
            f"{name}/plate/top", PLATE, (side, side, 0.006), position=(0, 0, -0.003)
        )
        half = side / 2
        corners = np.array(
            [
                [-half, -half, 0.0005],
                [half, -half, 0.0005],
                [half, half, 0.0005],
                [-half, half, 0.0005],
            ]
        )
        edges = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)
        cross = np.array(
            [[[-0.02, 0, 0.0005], [0.02, 0, 0.0005]], [[0, -0.02, 0.0005], [0, 0.02, 0.0005]]]
        )
        lines = np.concatenate([edges, cross])
        scene.add_line_segments(f"{name}/plate/edges", lines, METAL, thickness=0.0012)
        vertices, faces = ball_mesh(radius)
        self.ball = scene.add_mesh_simple(
            f"{name}/plate/ball", vertices, faces, color=GHOST if ghost else ORANGE, position=AWAY
        )

    def pose(self, theta_rad: np.ndarray, ball_m: np.ndarray | None) -> None:
        """Turn the plate to the servo angles theta_rad (2,) and put the ball to ball_m (2,) in the
        plate's frame; None or NaN: no ball.
        """
        self.plate.wxyz = plate_wxyz(theta_rad, self._rig)
        self.ball.position = _on_plate(ball_m, self._rig.ball.radius_m)


def _on_plate(ball_m: np.ndarray | None, height_m: float) -> tuple[float, float, float]:
    if ball_m is None or not np.all(np.isfinite(ball_m)):
        return AWAY
    return float(ball_m[0]), float(ball_m[1]), height_m


ARMS = {"with": (214, 39, 40), "without": (31, 79, 216)}  # as in every figure
HALO = 1.15  # the model's ball is so much larger: a halo where both are at one place


def _line(xy_m: np.ndarray) -> np.ndarray:
    """Segments (m, 2, 3) of a line on the plate through those of xy_m (n, 2) that are known; a
    point of fewer than two.
    """
    xy_m = xy_m[np.isfinite(xy_m).all(axis=1)]  # a browser knows no size of a line with NaN
    if len(xy_m) < 2:
        return np.zeros((1, 2, 3), np.float32)
    points = np.column_stack([xy_m, np.full(len(xy_m), 0.0012)]).astype(np.float32)
    return np.stack([points[:-1], points[1:]], axis=1)


class TableScene:
    """The table in the middle of the 3-D view: plate, ball, arms and rods, target, trail, centroid,
    and the model's ball with its distance from the measured one.
    """

    def __init__(self, server: "ViserServer | ClientHandle", rig: Rig) -> None:
        self._rig, scene = rig, server.scene
        noise_mm = 1e3 * noise_alone_m(rig)
        self._model_words = f"model {{:.1f}} mm off\n(noise alone: {noise_mm:.0f} mm)"
        self.table = PlateModel(server, "/table", rig)
        draw_grid(server, f"{self.table.name}/plate", rig.linkage.plate_side_m)
        vertices, faces = ball_mesh(HALO * rig.ball.radius_m)
        self.ghost = scene.add_mesh_simple(
            "/table/plate/ghost",
            vertices,
            faces,
            color=GHOST,
            opacity=0.7,
            side="back",  # of two balls at one place the measured one stands before it
            position=AWAY,
            cast_shadow=False,
        )
        vertices, faces = ball_mesh(rig.ball.radius_m)
        self.arms = {
            name: scene.add_mesh_simple(
                f"/table/plate/ball_{name}", vertices, faces, color=colour, position=AWAY
            )
            for name, colour in ARMS.items()
        }
        self.target = scene.add_cylinder(
            "/table/plate/target", 0.006, 0.0015, GREEN, position=(0, 0, 0.001)
        )
        empty = np.zeros((1, 2, 3), np.float32)
        self.trail = scene.add_line_segments("/table/plate/trail", empty, ORANGE, thickness=0.0015)
        self.trails = {
            name: scene.add_line_segments(
                f"/table/plate/trail_{name}", empty, colour, thickness=0.0015
            )
            for name, colour in ARMS.items()
        }
        self.gap = scene.add_line_segments("/table/plate/gap", empty, GHOST, thickness=0.002)
        self.gap_label = scene.add_label(
            "/table/gap_label",
            "",
            position=AWAY,
            anchor="top-center",
            font_screen_scale=LETTERS,
        )
        self.centroid = scene.add_icosphere(
            "/table/plate/centroid", 0.003, (20, 20, 20), position=AWAY, subdivisions=1
        )
        self._build_base(server)
        self.rods: list[Any] = [
            scene.add_line_segments(f"/table/rod_{a}", np.zeros((2, 2, 3)), DARK, thickness=0.005)
            for a in "xy"
        ]

    def _build_base(self, server: "ViserServer | ClientHandle") -> None:
        scene, half = server.scene, self._rig.linkage.plate_side_m / 2
        floor = -DROP_M - 0.03
        scene.add_box(
            "/table/base", DARK, (0.36, 0.36, 0.008), position=(0.02, 0.02, floor - 0.004)
        )
        scene.add_cylinder(
            "/table/post", 0.008, -floor - 0.006, METAL, position=(0, 0, (floor - 0.006) / 2)
        )
        for axis, name in enumerate("xy"):
            shaft = linkage(axis, np.zeros(2), self._rig)[0]
            size = (0.03, 0.04, 0.05) if axis == 0 else (0.04, 0.03, 0.05)
            where = shaft - np.array([0.02, 0.0, 0.0]) if axis == 0 else shaft - [0.0, 0.02, 0.0]
            scene.add_box(f"/table/motor_{name}", METAL, size, position=tuple(where))
        for name, at in axis_letters(2 * half):
            scene.add_label(
                f"/table/axis_{name}",
                name,
                position=at,
                font_screen_scale=LETTERS,
                anchor="center-center",
            )

    def pose(
        self, theta_rad: np.ndarray, ball_m: np.ndarray | None, target_m: np.ndarray | None
    ) -> None:
        """Show the measured pose: servo angles theta_rad (2,); ball_m and target_m (2,) in the
        plate's frame, None or NaN: not shown.
        """
        self.table.pose(theta_rad, ball_m)
        for axis, rod in enumerate(self.rods):
            shaft, tip, edge = linkage(axis, theta_rad, self._rig)
            rod.points = np.array([[shaft, tip], [tip, edge]], np.float32)
        self.target.position = _on_plate(target_m, 0.001)

    def compare(self, ball_m: np.ndarray | None, ghost_m: np.ndarray | None) -> None:
        """Show the model's ball ghost_m (2,) and its distance from the measured ball_m (2,), both
        in the plate's frame; None: not shown.
        """
        self.ghost.position = _on_plate(ghost_m, self._rig.ball.radius_m)
        self._apart(ball_m, ghost_m, self._model_words)

    def both(
        self, ball_m: np.ndarray | None, beside_m: np.ndarray | None, *, beside: str = "without"
    ) -> None:
        """Show the balls (2,) of two runs on one plate, with red and without blue; beside: the
        second one's controller. None: not shown.
        """
        radius = self._rig.ball.radius_m
        for name, ball in self.arms.items():
            ball.position = _on_plate(beside_m if name == beside else ball_m, radius)
        self._apart(ball_m, beside_m, "{:.0f} mm apart")

    def _apart(self, one_m: np.ndarray | None, other_m: np.ndarray | None, words: str) -> None:
        """Draw the distance of two balls (2,), and write it in mm into `words`; None: not shown."""
        if one_m is None or other_m is None or not np.all(np.isfinite([one_m, other_m])):
            self.gap.points, self.gap_label.position = np.zeros((1, 2, 3), np.float32), AWAY
            return
        heights_m = [2.1 * self._rig.ball.radius_m] * 2
        ends = np.column_stack([[one_m, other_m], heights_m]).astype(np.float32)
        self.gap.points = ends[None]
        self.gap_label.position = below_numbers(self._rig.linkage.plate_side_m)
        text = words.format(1e3 * float(np.hypot(*(one_m - other_m))))
        if self.gap_label.text != text:
            self.gap_label.text = text

    def draw_trail(self, xy_m: np.ndarray, centroid_m: np.ndarray | None) -> None:
        """Draw the ball's last positions xy_m (n, 2) as a line, and the run's centroid_m (2,),
        None: none yet.
        """
        self.centroid.position = _on_plate(centroid_m, 0.002)
        self.trail.points = _line(xy_m)

    def draw_trails(self, xy_m: Mapping[str, np.ndarray]) -> None:
        """Draw the last positions (n, 2) of the balls of two runs, by controller as in `both`."""
        for name, trail in self.trails.items():
            trail.points = _line(xy_m[name]) if name in xy_m else _line(np.empty((0, 2)))
