"""The dashboard put together: server, session, scene, tabs, and the thread that draws."""

import threading
import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.dashboard.server.controls import Controls
from experiments.dashboard.server.messages import admit_values
from experiments.dashboard.server.pages import Pages
from experiments.dashboard.server.server import shell_of
from experiments.dashboard.session.foxglove_stream import FoxgloveStream
from experiments.dashboard.session.live import LiveBuffer, LiveState
from experiments.dashboard.session.plan import PlannedRun
from experiments.dashboard.session.playback import Playback
from experiments.dashboard.session.real_camera import RealCamera
from experiments.dashboard.session.run_setup import RealRunSetup, VirtualRunSetup
from experiments.dashboard.session.session import Session
from experiments.dashboard.session.virtual_camera import VirtualCamera
from experiments.dashboard.session.worker_process import WorkerProcess
from experiments.dashboard.tabs.calibrate import CalibrateTab
from experiments.dashboard.tabs.gap import GapTab
from experiments.dashboard.tabs.header import Header, set_looks
from experiments.dashboard.tabs.keys import add_keys
from experiments.dashboard.tabs.replay import ReplayTab
from experiments.dashboard.tabs.results import ResultsTab
from experiments.dashboard.tabs.run import RunTab
from experiments.dashboard.tabs.tour import Tour, both_completed
from experiments.dashboard.view.backlash_gauges import BacklashGauges
from experiments.dashboard.view.big_view import RESTING, big_view
from experiments.dashboard.view.camera_view import RESTS, CameraView
from experiments.dashboard.view.curves import LIVE, STOPPED, Curves
from experiments.dashboard.view.film_view import FilmView
from experiments.dashboard.view.ghost import Ghost
from experiments.dashboard.view.panels import Panels
from experiments.dashboard.view.portrait import Portrait
from experiments.dashboard.view.pose import plate_point
from experiments.dashboard.view.scene import TableScene, legend_words, light
from experiments.dashboard.view.side_plates import PlateMap
from experiments.dashboard.view.view_points import add_view_points, keep_sides
from experiments.runs.hardware import is_hardware
from rig.log import INDEX, shown_angles
from rig.loop.loop import Ending
from rig.parameters import Rig

if TYPE_CHECKING:
    from viser import ClientHandle, ViserServer

DRAW_HZ, CURVES_EVERY = 20.0, 2  # a film, of three tables, as the curves
_BALL, _TARGET = (INDEX[n] for n in ("ball_x_m", "target_x_m"))
_FOUND = [[INDEX[f"estimated_{kind}_play_{a}_rad"] for a in "xy"] for kind in ("gear", "joint")]
UNSEEN_S = 0.3  # an older sight of the ball is not drawn


class App:
    """The dashboard of one rig: builds the pages of `server` and starts session, workers and
    drawing thread; `close` ends them in order.

    out: folder of runs, figures and reports; rig_file: of `rig`, None for the virtual table. The
    attribute `films` holds, by page, what is shown there in place of the live table. stream: is
    given every row and event that is drawn, too, and closed.
    """

    def __init__(
        self,
        server: "ViserServer",
        rig: Rig,
        out: Path,
        *,
        rig_file: Path | None = None,
        stream: FoxgloveStream | None = None,
    ) -> None:
        self.server, self.rig, self.out, self._stream = server, rig, out, stream
        self.pages = Pages()
        self.live = LiveBuffer(rig.control_rate_hz)
        real = rig_file is not None and is_hardware(rig)
        seen = RealCamera(rig) if real and rig.table.camera else None
        self._real = (rig_file, seen) if real and rig_file else None
        self.eye: VirtualCamera | RealCamera = seen or VirtualCamera(rig)
        table = RealRunSetup(rig_file, out, seen) if real and rig_file else VirtualRunSetup(out)
        self.controls = Controls(self.pages.not_done, lambda text: self.session.note(text))
        self.session = Session(
            rig,
            table,
            self.live,
            on_event=stream.event if stream is not None else lambda t_s, text: None,
            on_recorded=self._on_recorded,
            still=self.controls.still,
        )
        # No figure waits for an analysis, nor for the film of a page that watches.
        self.analysis_worker, self.figure_worker, self.film_worker = (
            WorkerProcess() for _ in range(3)
        )
        self.films: dict[int, FilmView] = {}
        self._replayed = False  # a recorded run was shown
        admit_values(server, self.controls)
        shell = shell_of(server)
        shell.state = lambda: self.session.status.shown
        shell.stop = partial(self.controls.stop, act=self._stop)
        shell.live = lambda: big_view(
            self.session.rig, self.live.now(), self.session.status, self.live.curve()
        )
        self._ghost_of, self._ghost = rig, Ghost(rig)
        kind = f"{rig.table.kind} table" if table.real else "virtual table"
        self._build(f"{kind} of {rig_file.name}" if rig_file else kind)
        server.on_client_connect(self._on_connect)
        server.on_client_disconnect(self._on_disconnect)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._draw, daemon=True, name="draw")
        self._thread.start()

    def _build(self, table: str) -> None:
        server, gui = self.server, self.server.gui
        set_looks(server)
        gui.set_panel_label("Balancing table")
        gui.main_panel.dock_right()
        light(server, self.rig.linkage.side_m)
        self.scene = TableScene(server, self.rig)
        self.gauges = BacklashGauges(server, self.rig)
        self.plate_map = PlateMap(server)
        self.camera = CameraView(server, self.rig, real=self.session.table.real)
        shell_of(server).camera = lambda: self.camera.jpeg
        self.header = Header(
            server,
            self.controls,
            self.pages,
            self.session,
            table,
            lambda page: self.run_tab.balance(page),
        )
        panel = gui.add_panel()
        self._places = [panel.add_tab(name) for name in ("Curves", "Swing", "Camera")]
        curves, swing, camera = self._places
        with curves:
            self.curves = Curves(server, self.rig.servo)
        with swing:
            self.portrait = Portrait(server, self.rig.servo)
        with camera:
            self.camera.add_widgets(self.controls)
        with panel.add_tab("Legend"):
            side_m = self.rig.linkage.side_m
            add_view_points(server, self.controls, self.pages.clients, side_m)
            gui.add_markdown(legend_words(self.session.table.real))
        panel.dock_left()
        self._panels = Panels(panel, gui.main_panel)
        self._panels.widen()
        self._add_tabs()
        add_keys(server, self.controls, self._stop, self.run_tab, self.replay)

        server.scene.on_click(modifier="shift")(self.controls.click("target", self._aim))

    def _add_tabs(self) -> None:
        server, controls, analysis_worker, figure_worker = (
            self.server,
            self.controls,
            self.analysis_worker,
            self.figure_worker,
        )
        out, rows = self.out, lambda: self.results.rows
        virtual = not self.session.table.real
        self.tour = Tour(server, controls, self.pages, self._steps_done, visible=virtual)
        tabs = server.gui.add_tab_group(order=0)
        with tabs.add_tab("Run"):
            self.tour.add_steps()
            self.run_tab = RunTab(
                server, controls, self.session, out, lambda page: self.show_playback(page, None)
            )
        with tabs.add_tab("Calibrate"):
            self.calibrate = CalibrateTab(
                server,
                controls,
                analysis_worker,
                self.session,
                out,
                self.pages.send,
                real=self._real,
                rows=rows,
                show_live=lambda page: self.show_playback(page, None),
            )
        with tabs.add_tab("Results"):
            self.results = ResultsTab(
                server, controls, figure_worker, out, self.live, self.pages.send
            )
        with tabs.add_tab("Gap"):
            self.gap = GapTab(
                server,
                controls,
                analysis_worker,
                out,
                rows,
                self.plate_map.show,
                self.show_playback,
                self.pages.send,
                virtual=virtual,
            )
        with tabs.add_tab("Replay"):
            self.replay = ReplayTab(
                server, controls, self.pages, self.film_worker, rows, self.show_playback
            )
        self.replay.refresh()
        self.gap.refresh()

    def _steps_done(self) -> tuple[bool, ...]:
        """Which steps of the tour are done. An earlier program's pair of runs counts where Results
        shows it: else that step would promise a sentence that is not there.
        """
        compared = self.results.compared
        return (
            compared or both_completed(self.results.shown),
            compared,
            self._replayed,
            "play" in self.calibrate.accepted,
            self.gap.answer is not None and self.gap.answer.short.of_demo,
        )

    def _stop(self, who: str) -> None:
        """Stop whatever moves, now; a calibration as soon as the queue comes to it."""
        self.session.stop(who)
        self.controls.queue.put("stop", partial(self.calibrate.stop, who))

    def show_playback(self, page: int | None, playback: Playback | None) -> None:
        """Show a film in place of the live table on one page; None: the live table again. To be
        called in the thread of the control panel queue.
        """
        client = self.pages.clients.get(page) if page is not None else None
        if page is None or client is None:
            return
        if (before := self.films.pop(page, None)) is not None:
            before.close()
        self.replay.on_playback(page, playback)
        self.header.show_film(page, playback is not None)
        if playback is None:
            return
        self._replayed = self._replayed or playback.film is not None
        live = [*self.curves.handles, *self.portrait.handles, *self.camera.handles]
        real = self.session.table.real
        self.films[page] = FilmView(client, self.rig, playback, self._places, live, real=real)

    def _on_recorded(self, planned: PlannedRun, folder: Path, ending: Ending) -> None:
        """A run was recorded: draw its figures and list it, in the thread of the queue."""

        def do() -> None:
            if planned.number == 1 and not planned.plan.protocol.servo_only:
                self.results.started = planned.plan.protocol.name
            self.results.refresh()
            self.replay.refresh()
            self.gap.refresh()

        self.controls.queue.put("results", do)

    def _aim(self, event: Any) -> None:
        if event.client_id in self.films:
            raise ValueError("this page shows a replay: go back to the live table first")
        point = plate_point(np.array(event.ray_origin), np.array(event.ray_direction))
        if point is not None:
            self.run_tab.aim((float(point[0]), float(point[1])))

    # --- pages that come and go ---
    def _on_connect(self, client: "ClientHandle") -> None:
        def do() -> None:
            self.pages.joined(client)
            self.header.joined(client)
            keep_sides(client)
            self._panels.fit(client)

        self.controls.queue.put("a page came", do)

    def _on_disconnect(self, client: "ClientHandle") -> None:
        def do() -> None:
            if (film := self.films.pop(client.client_id, None)) is not None:
                film.end()
            self.replay.left(client.client_id)
            self.pages.left(client.client_id)
            self.header.left(client.client_id)

        self.controls.queue.put("a page went", do)

    # --- drawing ---
    def _draw(self) -> None:
        count, failed = 0, ""
        while not self._over.is_set():
            time.sleep(1 / DRAW_HZ)  # a wait of `threading` may go by the wall clock
            try:
                self._draw_once(count)
            except Exception as error:
                words = f"{type(error).__name__}: {error}"
                if words != failed:  # once, not twenty times a second
                    failed = words
                    self.session.note(f"drawing: {words}")
                    self.pages.notify(None, "drawing failed", words)
                time.sleep(0.5)
            count += 1

    def _draw_once(self, count: int) -> None:
        now = self.live.now()
        rows = self.live.unread()
        if self._stream is not None:
            self._stream.send(rows)
        if self._ghost_of is not (rig := self.session.rig):
            self._ghost_of, self._ghost = rig, Ghost(rig)
        self._ghost.follow(rows)
        with self.server.atomic():
            if now.row is not None and rows:
                self._draw_table(now.row, now.seen_s)
            self._draw_camera(now, count)
            if count % CURVES_EVERY == 0:
                self._draw_words(now, bool(rows))
        if count % CURVES_EVERY == 0:
            for film in list(self.films.values()):
                film.draw()

    def _draw_camera(self, now: LiveState, count: int) -> None:
        """What the camera sees: the real one, or the virtual one of the present pose."""
        if self.session.status.state in RESTING and isinstance(self.eye, VirtualCamera):
            self.camera.hide(RESTS if self.camera.wanted else "")
            return
        fresh = now.row is not None and now.row[0] - now.seen_s < UNSEEN_S
        self.camera.follow(self.eye, now.row, fresh, ask=count % 2 == 0)

    def _draw_words(self, now: LiveState, fresh: bool) -> None:
        """Lines, bars and curves: ten times a second."""
        status = self.session.status
        self.header.draw(now, status, self.rig.control_rate_hz)
        self.tour.draw()
        self.run_tab.draw(status, list(self.session.events))
        self.results.draw(running=status.state == "running")
        self.replay.draw()
        self.calibrate.draw()
        self.gap.draw()
        self.gauges.show(not self.gap.hides_truth)
        self.gauges.tell(self.session.table.real or "play" in self.calibrate.accepted)
        rests = status.state in RESTING
        self.curves.head(STOPPED if rests else LIVE)
        if rests:  # a model that nothing drives any more is no forecast
            self.scene.compare(None, None)
        if fresh:
            self.curves.draw(curve := self.live.curve())
            self.portrait.draw(curve, status.of)
            self.scene.draw_trail(self.live.trail(), self.live.centroid.xy_m)

    def _draw_table(self, row: np.ndarray, seen_s: float) -> None:
        ball = row[_BALL : _BALL + 2] if row[0] - seen_s < UNSEEN_S else None
        target = row[_TARGET : _TARGET + 2]
        status = self.session.status
        if status.run is not None and status.operator_step.startswith("place"):
            start = status.run.plan.protocol.start  # where the operator is to put the ball
            target = np.array([start.x_m, start.y_m])
        self.scene.pose(shown_angles(row), ball, target)
        ghost = self._ghost
        shown = ghost.on_plate and status.state not in RESTING
        self.scene.compare(ball, ghost.ball_m if shown else None)
        found = row[_FOUND]
        self.gauges.draw(self._ghost_of, ghost.gear_twist_rad, ghost.joint_twist_rad, found)

    def close(self) -> None:
        """End the drawing thread (waits at most 2 s), then session, workers, camera and queue, in
        this order.
        """
        self._over.set()
        self._thread.join(2.0)
        for part in (
            self.session,
            self.analysis_worker,
            self.figure_worker,
            self.film_worker,
            self.eye,
            self.controls.queue,
        ):
            part.close()
        if self._stream is not None:
            self._stream.close()
