"""The dashboard put together: server, session, scene, tabs, and the thread that draws."""

import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.dashboard.controls import Controls
from experiments.dashboard.curves import Curves
from experiments.dashboard.ghost import Ghost
from experiments.dashboard.header import Header
from experiments.dashboard.live import Live
from experiments.dashboard.pose import plate_point
from experiments.dashboard.run_tab import RunTab
from experiments.dashboard.scene import TableScene
from experiments.dashboard.session import Session
from experiments.dashboard.teeth import Teeth
from rig.log import INDEX
from rig.parameters import Rig

if TYPE_CHECKING:
    from viser import ClientHandle, ViserServer

DRAW_HZ, CURVES_EVERY = 20.0, 2
_THETA, _BALL, _TARGET = (INDEX[n] for n in ("theta_x_rad", "ball_x_m", "target_x_m"))
_FOUND = [[INDEX[f"estimated_{kind}_play_{a}_rad"] for a in "xy"] for kind in ("gear", "joint")]
UNSEEN_S = 0.3  # an older sight of the ball is not drawn


class App:
    """Everything that lives while the dashboard is open; `close` ends it in order."""

    def __init__(self, server: "ViserServer", rig: Rig, out: Path, *, table: str) -> None:
        self.server, self.rig, self.out = server, rig, out
        self.clients: dict[int, ClientHandle] = {}
        self.live = Live(rig.control_rate_hz)
        self.session = Session(rig, out, self.live, said=self._said)
        self.controls = Controls(self.tell, self.session.note)
        self._ghost_of, self._ghost = rig, Ghost(rig)
        self._build(table)
        server.on_client_connect(self._came)
        server.on_client_disconnect(self._went)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._draw, daemon=True, name="draw")
        self._thread.start()

    def _build(self, table: str) -> None:
        server, gui = self.server, self.server.gui
        gui.configure_theme(show_logo=False, show_share_button=False, control_width="large")
        gui.set_panel_label("Balancing table")
        gui.main_panel.dock_right()
        gui.main_panel.set_width(390)
        camera = server.initial_camera
        camera.position, camera.look_at = (0.22, -0.46, 0.38), (0.02, 0.02, -0.02)
        server.scene.configure_default_lights(True, cast_shadow=False)
        self.scene, self.teeth = TableScene(server, self.rig), Teeth(server)
        self.header = Header(server, self.controls, self.session, table)
        panel = gui.add_panel()
        with panel.add_tab("Live curves"):
            self.curves = Curves(server)
        panel.dock_left()
        panel.set_width(330)
        tabs = gui.add_tab_group(order=0)
        with tabs.add_tab("Run"):
            self.run_tab = RunTab(server, self.controls, self.session)
        self._commands()

        @server.scene.on_click(modifier="shift")
        def _(event: Any) -> None:
            ray = np.array(event.ray_origin), np.array(event.ray_direction)
            self.controls.orders.put("target", lambda: self._aim(event.client_id, *ray), event.client_id)

    def _aim(self, page: int, origin: np.ndarray, direction: np.ndarray) -> None:
        self.controls.check(page)
        point = plate_point(origin, direction)
        if point is not None:
            self.run_tab.aim((float(point[0]), float(point[1])))

    def _commands(self) -> None:
        """Keys, and the entries of the command palette (Ctrl + K)."""
        add, button = self.server.gui.add_command, self.controls.button
        button(add("Stop", hotkey="escape"), "stop", self.header.stop, everybody=True)
        button(add("Start the run", hotkey="enter"), "start", lambda page: self.run_tab.start())
        button(add("Next run", hotkey="N"), "next run", lambda page: self.session.go_on())
        button(add("Balance again", hotkey="B"), "balance", lambda page: self.session.balance())
        for key, angle in (("left", 180), ("right", 0), ("up", 90), ("down", 270)):
            push = add(f"Push {key}", hotkey=f"arrow{key}", modifier="shift")  # pyright: ignore[reportArgumentType]
            button(push, "push", lambda page, a=float(angle): self.run_tab.push(a))

    # --- pages that come and go ---
    def _came(self, client: "ClientHandle") -> None:
        def do() -> None:
            self.clients[client.client_id] = client
            self.header.joined(client)

        self.controls.orders.put("a page came", do)

    def _went(self, client: "ClientHandle") -> None:
        def do() -> None:
            self.clients.pop(client.client_id, None)
            self.header.left(client.client_id)

        self.controls.orders.put("a page went", do)

    def tell(self, page: int | None, title: str, text: str) -> None:
        """A notification for one page, or for all."""
        for client in self._of(page):
            with suppress(Exception):  # it may be gone by now
                client.add_notification(title, text, auto_close_seconds=8.0, color="red")

    def _of(self, page: int | None) -> list[Any]:
        if page is None:
            return list(self.clients.values())
        return [self.clients[page]] if page in self.clients else []

    def _said(self, t_s: float, text: str) -> None:
        """An event of the loop."""

    # --- drawing ---
    def _draw(self) -> None:
        count, failed = 0, ""
        while not self._over.wait(1 / DRAW_HZ):
            try:
                self._draw_once(count)
            except Exception as error:
                words = f"{type(error).__name__}: {error}"
                if words != failed:  # once, not twenty times a second
                    failed = words
                    self.session.note(f"drawing: {words}")
                    self.tell(None, "drawing failed", words)
                time.sleep(0.5)
            count += 1

    def _draw_once(self, count: int) -> None:
        now, status = self.live.now(), self.session.status
        rows = self.live.fresh()
        if self._ghost_of is not self.session.rig:
            self._ghost_of = self.session.rig
            self._ghost = Ghost(self._ghost_of)
        self._ghost.follow(rows)
        with self.server.atomic():
            if now.row is not None and rows:
                self._draw_table(now.row, now.seen_s)
            if count % CURVES_EVERY == 0:
                self.header.draw(now, status, self.rig.control_rate_hz)
                self.run_tab.draw(status)
                if rows:
                    self.curves.draw(self.live.curve())
                    self.scene.draw_trail(self.live.trail(), self.live.centroid.xy_m)

    def _draw_table(self, row: np.ndarray, seen_s: float) -> None:
        ball = row[_BALL : _BALL + 2] if row[0] - seen_s < UNSEEN_S else None
        target = row[_TARGET : _TARGET + 2]
        self.scene.pose(row[_THETA : _THETA + 2], ball, target)
        ghost = self._ghost
        self.scene.compare(ball, ghost.ball_m if ghost.on_plate else None)
        found = row[_FOUND]
        self.teeth.draw(self._ghost_of, ghost.gear_twist_rad, ghost.joint_twist_rad, found)

    def close(self) -> None:
        self._over.set()
        self._thread.join(2.0)
        self.session.close()
        self.controls.orders.close()
