"""The dashboard put together: server, session, scene, tabs, and the thread that draws."""

import threading
import time
from collections import deque
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.dashboard.calibrate_tab import CalibrateTab
from experiments.dashboard.camera_view import NO_FILM, CameraView
from experiments.dashboard.controls import Controls
from experiments.dashboard.curves import FILM, Curves
from experiments.dashboard.desk import Desk
from experiments.dashboard.gap_tab import GapTab
from experiments.dashboard.ghost import Ghost
from experiments.dashboard.header import Header
from experiments.dashboard.legend import legend_words
from experiments.dashboard.live import Live, Now
from experiments.dashboard.plan import Leg
from experiments.dashboard.player import Stage
from experiments.dashboard.pose import plate_point
from experiments.dashboard.readying import RealTable, VirtualTable
from experiments.dashboard.real_camera import RealCamera
from experiments.dashboard.replay_tab import ReplayTab
from experiments.dashboard.results_tab import ResultsTab
from experiments.dashboard.run_tab import RunTab
from experiments.dashboard.scene import TableScene, light
from experiments.dashboard.session import Session
from experiments.dashboard.side_plates import SidePlates
from experiments.dashboard.teeth import Teeth
from experiments.dashboard.theme import Theme
from experiments.dashboard.virtual_eye import VirtualEye
from experiments.hardware import is_hardware
from rig.endings import Ending
from rig.log import INDEX
from rig.parameters import Rig

if TYPE_CHECKING:
    from viser import ClientHandle, ViserServer

DRAW_HZ, CURVES_EVERY, EVENTS_SHOWN = 20.0, 2, 4  # a film, of three tables, as the curves
_THETA, _BALL, _TARGET = (INDEX[n] for n in ("theta_x_rad", "ball_x_m", "target_x_m"))
_FOUND = [[INDEX[f"estimated_{kind}_play_{a}_rad"] for a in "xy"] for kind in ("gear", "joint")]
UNSEEN_S = 0.3  # an older sight of the ball is not drawn


class App:
    """Everything that lives while the dashboard is open; `close` ends it in order."""

    def __init__(
        self, server: "ViserServer", rig: Rig, out: Path, *, rig_file: Path | None = None
    ) -> None:
        self.server, self.rig, self.out = server, rig, out
        self.clients: dict[int, ClientHandle] = {}
        self.live = Live(rig.control_rate_hz)
        self.events: deque[str] = deque(maxlen=EVENTS_SHOWN)
        real = rig_file is not None and is_hardware(rig)
        seen = RealCamera(rig) if real and rig.table.camera else None
        self._real = (rig_file, seen) if real and rig_file else None
        self.eye: VirtualEye | RealCamera = seen or VirtualEye(rig)
        table = RealTable(rig_file, out, seen) if real and rig_file else VirtualTable(out)
        self.session = Session(rig, table, self.live, said=self._said, recorded=self._recorded)
        self.desk, self.quick = Desk(), Desk()  # no figure waits for an analysis
        self.stage: Stage | None = None
        self.controls = Controls(self.tell, self.session.note)
        self._ghost_of, self._ghost = rig, Ghost(rig)
        kind = f"{rig.table.kind} table" if table.real else "virtual table"
        self._build(f"{kind} of {rig_file.name}" if rig_file else kind)
        server.on_client_connect(self._came)
        server.on_client_disconnect(self._went)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._draw, daemon=True, name="draw")
        self._thread.start()

    def _build(self, table: str) -> None:
        server, gui = self.server, self.server.gui
        self.theme = Theme(server)
        gui.set_panel_label("Balancing table")
        gui.main_panel.dock_right()
        gui.main_panel.set_width(390)
        light(server)
        self.scene, self.teeth = TableScene(server, self.rig), Teeth(server)
        self.sides = SidePlates(server, self.rig)
        self.camera = CameraView(server, self.rig if self.session.table.real else None)
        self.header = Header(server, self.controls, self.session, table)
        panel = gui.add_panel()
        with panel.add_tab("Live curves"):
            self.curves = Curves(server)
        with panel.add_tab("Camera"):
            self.camera.add_widgets()
        with panel.add_tab("Legend"):
            gui.add_markdown(legend_words(self.session.table.real))
        panel.dock_left()
        panel.set_width(330)
        self._add_tabs()
        self.theme.add_widgets(self.controls)
        self._commands()

        @server.scene.on_click(modifier="shift")
        def _(event: Any) -> None:
            ray = np.array(event.ray_origin), np.array(event.ray_direction)
            self.controls.orders.put(
                "target", lambda: self._aim(event.client_id, *ray), event.client_id
            )

    def _add_tabs(self) -> None:
        server, controls, desk, quick = self.server, self.controls, self.desk, self.quick
        out, rows = self.out, lambda: self.results.rows
        tabs = server.gui.add_tab_group(order=0)
        with tabs.add_tab("Run"):
            self.run_tab = RunTab(server, controls, self.session, lambda: self.play(None))
        with tabs.add_tab("Calibrate"):
            self.calibrate = CalibrateTab(
                server, controls, desk, self.session, out, self.send, real=self._real, rows=rows
            )
        with tabs.add_tab("Results"):
            self.results = ResultsTab(server, controls, quick, out, self.live, self.send)
        with tabs.add_tab("Gap"):
            self.gap = GapTab(
                server, controls, desk, out, rows, self.sides.show_map, self.play, self.send
            )
        with tabs.add_tab("Replay"):
            self.replay = ReplayTab(server, controls, quick, rows, self.play)
        self.replay.refresh()

    def play(self, stage: Stage | None) -> None:
        """Show a stage instead of the live table, or (None) the live table again."""
        self.stage = stage
        self.camera.hide()
        self.replay.on_stage(stage)
        self.sides.begin(stage)
        self.teeth.show(stage is None)

    def _recorded(self, leg: Leg, folder: Path, ending: Ending) -> None:
        """A run is on the disk: figures, lists."""

        def do() -> None:
            self.results.refresh(leg.plan.protocol.name)
            self.replay.refresh()

        self.controls.orders.put("results", do)

    def send(self, page: int | None, path: Path) -> None:
        """Let a page download a file."""
        for client in self._of(page):
            client.send_file_download(path.name, path.read_bytes(), save_immediately=True)

    def _aim(self, page: int, origin: np.ndarray, direction: np.ndarray) -> None:
        self.controls.check(page)
        point = plate_point(origin, direction)
        if point is not None:
            self.run_tab.aim((float(point[0]), float(point[1])))

    def _commands(self) -> None:
        """Keys, and the entries of the command palette (Ctrl + K)."""
        add, button = self.server.gui.add_command, self.controls.button
        button(add("Stop", hotkey="escape"), "stop", self.header.stop, everybody=True)
        button(add("Start the run", hotkey="R"), "start", lambda page: self.run_tab.start())
        button(add("Next run", hotkey="N"), "next run", lambda page: self.run_tab.go_on())
        button(add("Balance again", hotkey="B"), "balance", lambda page: self.run_tab.balance())
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
        """An event of the loop or of a page, from any thread."""
        self.events.append(f"{t_s:.1f} s: {text}")

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
        now = self.live.now()
        rows = self.live.fresh()
        if self._ghost_of is not (rig := self.session.rig):
            self._ghost_of, self._ghost = rig, Ghost(rig)
        self._ghost.follow(rows)
        stage = self.stage
        with self.server.atomic():
            if stage is not None and count % CURVES_EVERY == 0:
                self._draw_stage(stage)
            elif stage is None and now.row is not None and rows:
                self._draw_table(now.row, now.seen_s)
            self._draw_camera(now, stage, count)
            if count % CURVES_EVERY == 0:
                self._draw_words(now, bool(rows))

    def _draw_camera(self, now: Now, stage: Stage | None, count: int) -> None:
        """What the camera sees: a film's frame, the real camera's, or the virtual one's of the
        present pose."""
        if stage is not None:
            video = stage.video
            if count % 2 == 0 and video and (frame := video.at(stage.player.t_s)) is not None:
                self.replay.show_frame(frame)
                self.camera.show(frame, "the run's video")
            elif video is None:
                self.camera.hide(NO_FILM)
            return
        fresh = now.row is not None and now.row[0] - now.seen_s < UNSEEN_S
        self.camera.follow(self.eye, now.row, fresh, ask=count % 2 == 0)

    def _draw_words(self, now: Now, fresh: bool) -> None:
        """Lines, bars and curves: ten times a second."""
        status = self.session.status
        self.header.draw(now, status, self.rig.control_rate_hz, film=self.stage is not None)
        self.run_tab.draw(status, list(self.events))
        self.results.draw(running=status.state == "running")
        self.replay.draw()
        self.calibrate.draw()
        self.gap.draw()
        if self.stage is not None:
            self.curves.rest(FILM)
        elif fresh:
            self.curves.draw(self.live.curve())
            self.scene.draw_trail(self.live.trail(), self.live.centroid.xy_m)

    def _draw_stage(self, stage: Stage) -> None:
        """A recorded run in the place of the live table; both models of it beside."""
        t_s = stage.player.t_s
        self.scene.pose(*stage.shown.at(t_s))
        self.scene.compare(None, None)
        past = stage.shown.ball_m[: int(np.searchsorted(stage.shown.t_s, t_s))][-90:]
        self.scene.draw_trail(past, None)
        self.sides.draw(t_s)

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
        for part in (self.session, self.desk, self.quick, self.eye, self.controls.orders):
            part.close()
