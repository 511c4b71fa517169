"""Where a page looks at the table from: a few named places, each page by itself."""

from collections.abc import Callable, Mapping
from math import atan, tan
from typing import TYPE_CHECKING, Any

from experiments.dashboard.server.controls import Controls

if TYPE_CHECKING:
    from viser import CameraHandle, ClientHandle, ViserServer

Point = tuple[float, float, float]
SIDE_M = 0.275  # of the plate that the places below are for
# Vertical angle of a view whose width is at least so many times its height; chosen: the table fits.
FIELD_OF_VIEW_RAD, NARROW = 0.82, 0.74
# Camera and what it looks at, in the table's frame [m]; chosen: the table fills the view.
VIEW_POINTS: dict[str, tuple[Point, Point]] = {
    "Whole table": ((0.24, -0.62, 0.52), (0.03, 0.03, -0.03)),
    "From above": ((0.04, -0.01, 0.72), (0.04, 0.03, 0.0)),
    "Level with the plate": ((0.06, -0.8, 0.03), (0.06, 0.0, -0.02)),
    "Play of x": ((0.34, -0.28, 0.1), (0.15, 0.0, -0.03)),
    "Play of y": ((-0.28, 0.38, 0.1), (0.0, 0.15, -0.03)),
}


def view_point(name: str, side_m: float) -> tuple[Point, Point]:
    """One of VIEW_POINTS, from so much farther as a plate of this side is larger than SIDE_M."""
    position, at = VIEW_POINTS[name]
    farther = max(1.0, side_m / SIDE_M)
    x, y, z = (a + farther * (p - a) for p, a in zip(position, at, strict=True))
    return (x, y, z), at


def field_of_view_rad(aspect: float) -> float:
    """Vertical angle of view [rad] for a view of this width over height: a narrower one than NARROW
    sees as much from side to side as that does."""
    return 2.0 * atan(tan(FIELD_OF_VIEW_RAD / 2.0) * max(1.0, NARROW / aspect))


def keep_sides(client: "ClientHandle") -> None:
    """Let a page see the table from side to side whatever becomes of its window."""

    async def widen(camera: "CameraHandle") -> None:
        if camera.image_width > 0 and camera.image_height > 0:
            camera.fov = field_of_view_rad(camera.aspect)

    client.camera.fov = field_of_view_rad(client.camera.aspect)
    client.camera.on_update(widen)


def look_from(client: "ClientHandle", name: str, side_m: float) -> None:
    """Move the view of one page to one of VIEW_POINTS, for a plate of this side."""
    position, at = view_point(name, side_m)
    with client.atomic():
        client.camera.position, client.camera.look_at = position, at


def add_view_points(
    server: "ViserServer",
    controls: Controls,
    clients: Mapping[int, "ClientHandle"],
    side_m: float,
) -> None:
    """A button for each of VIEW_POINTS in the GUI container of viser that is open, and an entry of
    the command palette; every page may press them and moves its own view alone. side_m: of the
    plate.
    """
    gui = server.gui
    with gui.add_folder("Look at", expand_by_default=True):
        for name in VIEW_POINTS:
            for handle in (gui.add_button(name, color="gray"), gui.add_command(name)):
                controls.button(handle, name, _act(clients, name, side_m), everybody=True)


def _act(clients: Mapping[int, Any], name: str, side_m: float) -> Callable[[int | None], None]:
    def act(page: int | None) -> None:
        if page is not None and page in clients:
            look_from(clients[page], name, side_m)

    return act
