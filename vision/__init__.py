"""From images to "the ball was at (x, y) m at time t, with this covariance" (README.md).

    from vision import Tracker, open_source
    with open_source("film.mp4") as source:
        tracker = Tracker()
        tracks = [tracker.step(frame) for frame in source]

The names below are imported when they are first used (PEP 562), so that `import vision` is instant.
"""

from typing import TYPE_CHECKING

from vision.lazy import lazy_names

if TYPE_CHECKING:
    from vision.ball_camera import BallCamera
    from vision.detection.appearance import Appearance
    from vision.frames import Frame, Observation, Track
    from vision.overlay import draw_track
    from vision.plate.markers import MarkerLayout, default_layout, find_pose, track_pose
    from vision.sources.source_errors import SourceError
    from vision.sources.sources import Source, open_source
    from vision.synthetic.synthetic import Renderer, Scene, virtual_camera, virtual_view
    from vision.tracking.tracker import Tracker
    from vision.view import Camera, View

__all__ = [
    "Appearance",
    "BallCamera",
    "Camera",
    "Frame",
    "MarkerLayout",
    "Observation",
    "Renderer",
    "Scene",
    "Source",
    "SourceError",
    "Track",
    "Tracker",
    "View",
    "default_layout",
    "draw_track",
    "find_pose",
    "open_source",
    "track_pose",
    "virtual_camera",
    "virtual_view",
]

__getattr__ = lazy_names(
    __name__,
    {
        "ball_camera": "BallCamera",
        "detection.appearance": "Appearance",
        "frames": "Frame Observation Track",
        "overlay": "draw_track",
        "plate.markers": "MarkerLayout default_layout find_pose track_pose",
        "sources.source_errors": "SourceError",
        "sources.sources": "Source open_source",
        "synthetic.synthetic": "Renderer Scene virtual_camera virtual_view",
        "tracking.tracker": "Tracker",
        "view": "Camera View",
    },
)
