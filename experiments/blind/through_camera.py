"""Blind trials through the camera: rendered frames, the real vision chain, a wrong mounting.

Hidden is a wrong camera delay, a turned camera (the marker sheet sits turned on the plate, so that
every frame agrees with the wrong frame), a shifted one (which no log can show: nothing missing), or
a ball whose height the rig does not know (distances come out too long: the class of camera_scale,
or unknown).
"""

from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from experiments.blind import sizes
from experiments.blind.hidden_tables import merged, well_kept
from experiments.blind.trial import BlindTrial, Effects, rig_data
from experiments.runs.assemble import (
    MAX_TILT_RAD,
    known,
    load_rig,
    simulated_operator,
    simulated_table,
    virtual_renderer,
)
from experiments.runs.protocol import course, read_protocol
from experiments.runs.runs import calibrate_camera
from rig.control.controllers import COMPENSATORS
from rig.control.tick import RUN
from rig.log import Log
from rig.loop.loop import Loop
from rig.parameters import Rig

VARIANTS = ("delayed", "turned", "shifted", "ball height", "as it should be")
FLAT_M = 1e-4  # radius in the rig file of a ball without height
SHIFTS_M = (0.003, 0.012)


def draw_camera_trials(seed: int, each: int, *, protocol: str = "steps") -> list[BlindTrial]:
    """`each` trials of every variant in `VARIANTS`, the variants in turn, on well-kept tables drawn
    from `seed`.

    protocol: recorded by each trial. What is hidden concerns the camera alone.
    """
    trials = []
    for number in range(each * len(VARIANTS)):
        rng = np.random.default_rng([seed, 1, number])
        variant = VARIANTS[number % len(VARIANTS)]
        nominal = replace(load_rig(None), effects={})
        plant = well_kept(nominal, rng)
        hidden, mounting = _hidden(variant, nominal, rng)
        if variant == "delayed":
            plant = replace(plant, effects=merged(plant.effects, hidden))
        if variant == "turned":  # by the sheet, not by the catalogue's equation
            plant.effects.pop("camera_yaw")
        seeds = (int(rng.integers(1, 2**31)),)
        name = f"camera-{number + 1:04d}"
        trial = BlindTrial(name, "camera", variant, (protocol,), seeds, rig_data(plant), {}, hidden)
        told = rig_data(nominal)
        trials.append(replace(trial, believed=told, engine="camera", camera=mounting))
    return trials


def _hidden(variant: str, rig: Rig, rng: np.random.Generator) -> tuple[Effects, dict]:
    """What is to be found, and how the camera is mounted."""
    mounting = {"yaw_rad": 0.0, "shift_m": [0.0, 0.0], "radius_m": rig.ball.radius_m}
    if variant == "delayed":
        return {"camera_delay": sizes.draw_effect("camera_delay", rng)[0]}, mounting
    if variant == "turned":
        by_axis = sizes.draw_effect("camera_yaw", rng)[0]
        return {"camera_yaw": by_axis}, mounting | {"yaw_rad": by_axis["xy"]["angle_rad"]}
    if variant == "shifted":
        way = rng.uniform(0, 2 * np.pi)
        shift = rng.uniform(*SHIFTS_M) * np.array([np.cos(way), np.sin(way)])
        return {}, mounting | {"shift_m": [float(v) for v in shift]}
    if variant == "ball height":
        from vision.synthetic.synthetic import virtual_view

        height = float(virtual_view().camera_from_plate[2, 3])
        fraction = rig.ball.radius_m / (height - rig.ball.radius_m)
        return {"camera_scale": {"xy": {"fraction": fraction}}}, mounting | {"radius_m": FLAT_M}
    return {}, mounting


@cache
def _bundle():
    """The calibration of the virtual camera, made once a process."""
    from calibration.bundle import load

    with TemporaryDirectory() as place:
        return load(calibrate_camera(replace(load_rig(None), effects={}), Path(place), 1))


def mounted(view, layout, yaw_rad: float, shift_m):
    """The view and the marker layout of a plate frame that is turned by yaw_rad, counter-clockwise,
    and shifted by shift_m (2,).

    view, layout: of the plate's true frame. With the new ones measured positions are R(yaw) true +
    shift, in every frame, whatever the plate's tilt.
    """
    from vision.plate.markers import MarkerLayout

    wrong_from_true = np.eye(4)
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    wrong_from_true[:2, :2], wrong_from_true[:2, 3] = [[c, -s], [s, c]], shift_m
    pose = view.camera_from_plate @ np.linalg.inv(wrong_from_true)
    corners = layout.corners_m @ wrong_from_true[:2, :2].T + wrong_from_true[:2, 3]
    return replace(view, camera_from_plate=pose), MarkerLayout(
        layout.ids, corners, layout.dictionary
    )


def _mounted_camera(trial: BlindTrial, seed: int):
    """The rendered camera over the trial's table, mounted as the trial says."""
    from rig.simulation.rendered_camera import RenderedCamera
    from vision.ball_camera import BallCamera, ball_mask, radius_range
    from vision.detection.appearance import Appearance
    from vision.tracking.tracker import Tracker

    rig, bundle, how = trial.nominal_rig, _bundle(), trial.camera or {}
    side = rig.linkage.side_m
    view, layout = mounted(bundle.view, bundle.layout, how["yaw_rad"], how["shift_m"])
    tracker = Tracker(
        appearance=Appearance.of_colour(rig.ball.colour),
        radius_px=radius_range(bundle.view, bundle.ball_radius_m, side, MAX_TILT_RAD),
        mask=ball_mask(bundle.view, bundle.ball_radius_m, side, MAX_TILT_RAD),
    )
    camera = BallCamera(view, layout, tracker, how["radius_m"], plate_side_m=side)
    renderer = virtual_renderer(rig, np.random.default_rng([seed, 5]))
    return RenderedCamera(renderer, camera, rig.linkage.ratio)


def camera_log(trial: BlindTrial, protocol: str, seed: int) -> Log:
    """One log of a camera trial, from the release of the ball on; a `logs.LogMaker`. seed: of the
    run.

    The real loop runs tick by tick on a simulated table whose rendered images go through the vision
    chain. ValueError: an unknown protocol.
    """
    plant, plan = trial.plant_rig, read_protocol(protocol)
    way = course(plan, plant, seed)
    table = simulated_table(plant, way, seed, _mounted_camera(trial, seed))
    rows: list[np.ndarray] = []
    with table:
        Loop(
            table,
            known(trial.nominal_rig),
            COMPENSATORS["without"],
            way,
            operator=simulated_operator(table, plan, way, seed),
            keep=lambda row: rows.append(row.copy()),
        ).run()
    log = Log.from_rows(np.array(rows))
    return log.where(log["phase"] == RUN)
