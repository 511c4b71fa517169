"""A film in place of the live table, on one page: no other page sees it.

What is drawn for one page stands over what is drawn for all under the same name (viser's scopes),
so the live table is drawn on below it and is there again when the film is taken away.
"""

import threading
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.dashboard.server.messages import tell_page
from experiments.dashboard.session.playback import Playback
from experiments.dashboard.session.video import NO_VIDEO_OF_BOTH
from experiments.dashboard.view.backlash_gauges import TEETH
from experiments.dashboard.view.camera_view import NO_FILM, NO_VIDEO, CameraPicture
from experiments.dashboard.view.curves import FILM, Curves
from experiments.dashboard.view.distance_chart import DistanceChart
from experiments.dashboard.view.portrait import Portrait, newest
from experiments.dashboard.view.scene import TableScene
from experiments.dashboard.view.side_plates import MAP, MAP_LEGEND, PlateMap, SidePlates
from experiments.gap.closed_loop_replay import TableMotion
from rig.parameters import Rig

if TYPE_CHECKING:
    from viser import ClientHandle

TRAIL = 90  # points of the motion behind the ball


def _trail(motion: TableMotion, t_s: float) -> np.ndarray:
    """The ball's positions (n, 2) [m] up to the time t_s [s]."""
    return motion.ball_m[: int(np.searchsorted(motion.t_s, t_s))][-TRAIL:]


class FilmView:
    """The film `playback` of a table like `rig` on the page `client`, in the tabs `places` (curves,
    swing, camera); live: the widgets there which the film's stand in for; real: as of
    `CameraPicture`.

    To be built and closed in one thread, the control panel queue's; any may draw.
    """

    def __init__(
        self,
        client: "ClientHandle",
        rig: Rig,
        playback: Playback,
        places: Sequence[Any],
        live: Sequence[Any],
        *,
        real: bool,
    ) -> None:
        self.playback, self._client, self._live = playback, client, live
        self._lock, self._open = threading.Lock(), True
        scene = client.scene
        with client.atomic():
            self._scene = TableScene(client, rig)
            scene.add_frame(TEETH, show_axes=False, visible=False)  # recordings hold no twists
            self._roots = [self._scene.table.name, TEETH, "/camera"]
            if playback.plate_map is None:
                for name in (MAP, MAP_LEGEND):
                    scene.add_frame(name, show_axes=False, visible=False)
            PlateMap(client).show(playback.plate_map)
            self._plates = None if playback.models is None else SidePlates(client, rig)
            if self._plates is not None:
                self._roots += self._plates.names
            self._camera = CameraPicture(client, rig, real=real)
            curves, swing, camera = places
            film = playback.film
            self._distance = None
            with curves:
                if film is not None and film.beside is not None:
                    self._distance = DistanceChart(client, film, playback.clock.end_s)
                of = playback.name if film is None else film.of
                self._curves = Curves(client, rig.servo, of)
            with swing:
                self._portrait = Portrait(client, rig.servo)
            with camera:
                self._camera.add_picture()
            self._hide_live()

    def _hide_live(self) -> None:
        self._shown = [handle.visible for handle in self._live]  # on the other pages
        for handle in self._live:
            tell_page(self._client, handle, visible=False)

    def draw(self) -> None:
        """Draw the film as it is now: table, models, trail, curves, video."""
        with self._lock:
            if not self._open:
                return
            with self._client.atomic():
                self._draw()

    def _draw(self) -> None:
        if self._shown != [handle.visible for handle in self._live]:
            self._hide_live()  # some came to every page meanwhile
        playback, film = self.playback, self.playback.film
        t_s = playback.clock.t_s
        theta, ball, target = playback.motion.at(t_s)
        beside = None if film is None else film.beside
        self._scene.pose(theta, ball if beside is None else None, target)
        if film is not None and beside is not None:
            self._scene.both(ball, beside.at(t_s)[1], beside=film.beside_method)
            self._scene.draw_trails(
                {film.method: _trail(playback.motion, t_s), film.beside_method: _trail(beside, t_s)}
            )
        else:
            self._scene.draw_trail(_trail(playback.motion, t_s), None)
        if self._distance is not None:
            self._distance.draw(t_s)
        if self._plates is not None and playback.models is not None:
            self._plates.draw(ball, playback.models, t_s)
        rows, past = playback.curve(), playback.past()
        if film is None or rows is None or past is None:
            self._curves.rest(FILM)
        else:
            shadow = playback.past_beside()
            runs, other = {film.method: rows}, None
            if shadow is not None and len(shadow) > 2:
                other = film.beside_of, newest(shadow)
                runs[film.beside_method] = other[1]
            self._curves.draw(rows, t_s, [at_s for at_s, _ in film.events], runs)
            self._portrait.draw(past, film.of, other)
        video = playback.video
        if video is None:
            alone = NO_VIDEO if beside is None else NO_VIDEO_OF_BOTH
            self._camera.hide(NO_FILM if film is None else alone)
        elif (frame := video.at(t_s)) is not None:
            self._camera.show(frame, "the run's video")

    def end(self) -> None:
        """Draw no more, and close the film's video: the page is gone, or `close` follows."""
        with self._lock:
            self._open = False
            self.playback.close()

    def close(self) -> None:
        """Show the live table again."""
        self.end()
        with self._client.atomic():
            for name in self._roots:
                self._client.scene.remove_by_name(name)
            for part in (self._distance, self._curves, self._portrait, self._camera):
                for handle in part.handles if part is not None else ():
                    handle.remove()
            for handle in self._live:
                tell_page(self._client, handle, visible=handle.visible)
