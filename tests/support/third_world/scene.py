"""A plan as a MuJoCo model: desk, plate, ball, hand and leaves, with painted textures."""

from __future__ import annotations

import math

import cv2
import numpy as np

from tests.support.third_world.plan import PLATES, SIDE_M, Plan

DESK_M = 0.7  # half side
PLATE_Z_M = 0.06
THICK_M = 0.004
DESK_PX, PLATE_PX, BALL_PX = 1024, 768, 128


def model_text(plan: Plan) -> str:
    """The model's XML; its textures are `pictures`."""
    half, r = SIDE_M / 2, plan.radius_m
    lamp = 1.0 - plan.ambient
    see_through = 0.3 if plan.plate == "transparent" else 1.0
    return f"""
<mujoco>
  <visual>
    <global offwidth="{plan.size[0]}" offheight="{plan.size[1]}"/>
    <quality offsamples="4" shadowsize="2048"/>
    <map znear="0.02" zfar="20"/>
    <headlight ambient="{3 * (f"{plan.ambient:.3f} ")}" diffuse="0.1 0.1 0.1" specular="0 0 0"/>
  </visual>
  <asset>
    {_texture("desk")}{_texture("plate")}{_texture("ball")}
    <material name="desk" texture="desk" specular="0.1"/>
    <material name="plate" texture="plate" specular="{0.5 * plan.gloss}" shininess="0.6"/>
    <material name="ball" texture="ball" specular="{plan.gloss}" shininess="0.7"/>
  </asset>
  <worldbody>
    <light pos="{_row(plan.lamp)}" dir="{_row([-x for x in plan.lamp])}" directional="false"
      diffuse="{_row([lamp] * 3)}" specular="1 1 1" cutoff="80" castshadow="true"/>
    <camera name="eye" pos="0 0 1"/>
    <geom type="plane" size="{DESK_M} {DESK_M} 0.1" material="desk"/>
    <body name="plate" mocap="true" pos="0 0 {PLATE_Z_M}">
      <geom type="box" size="{half} {half} {THICK_M / 2}" material="plate"
        rgba="1 1 1 {see_through}"/>
    </body>
    <body name="ball" mocap="true">
      <geom name="ball" type="sphere" size="{r}" material="ball"/>
    </body>
    <body name="hand" mocap="true" pos="0 0 -5">{_hand(plan)}</body>
    {"".join(_leaf(k) for k in range(3)) if plan.kind == "leaves" else ""}
  </worldbody>
</mujoco>"""


def pictures(plan: Plan, rng: np.random.Generator) -> dict[str, bytes]:
    """The textures' PNG files by name."""
    painted = {
        "desk": _desk(plan, rng),
        "plate": _plate(plan, rng),
        "ball": _ball(plan),
    }
    return {f"{name}.png": _png(image) for name, image in painted.items()}


def _texture(name: str) -> str:
    return f'<texture name="{name}" type="2d" file="{name}.png"/>'


def _row(values) -> str:
    return " ".join(f"{v:.5f}" for v in values)


def _png(rgb: np.ndarray) -> bytes:
    bgr = np.clip(rgb[..., ::-1], 0, 255).astype(np.uint8)
    ok, data = cv2.imencode(".png", bgr)
    assert ok
    return data.tobytes()


def grain(rng: np.random.Generator, size: int, roughness: float, long: float = 1.0) -> np.ndarray:
    """Sum of noise at every octave (size, size), standard deviation 1, `long` times longer along
    one axis, like wood."""
    total = np.zeros((size, size), np.float32)
    for octave in range(1, 8):
        h, w = 2**octave, max(2, int(2**octave / long))
        cells = rng.standard_normal((h, w)).astype(np.float32)
        total += roughness**octave * cv2.resize(cells, (size, size), interpolation=cv2.INTER_CUBIC)
    return (total - total.mean()) / total.std()


def _desk(plan: Plan, rng: np.random.Generator) -> np.ndarray:
    """Grain, scribbles, papers with text, lids and coins."""
    base = rng.uniform(40, 215, 3)
    image = (
        base + rng.uniform(4, 22) * grain(rng, DESK_PX, 0.75, float(rng.uniform(1, 6)))[..., None]
    )
    image = np.ascontiguousarray(np.clip(image, 0, 255).astype(np.uint8))
    px_m = DESK_PX / (2 * DESK_M)
    for _ in range(plan.clutter):
        a, far = rng.uniform(0, 2 * math.pi), rng.uniform(0.2, 0.45) * px_m
        at = (int(DESK_PX / 2 + far * math.cos(a)), int(DESK_PX / 2 + far * math.sin(a)))
        colour = tuple(float(x) for x in rng.uniform(10, 245, 3))
        what = int(rng.integers(0, 4))
        wide = int(rng.uniform(0.008, 0.03) * px_m)
        if what == 0:
            cv2.circle(image, at, wide, colour, -1, cv2.LINE_AA)
        elif what == 1:
            cv2.circle(image, at, wide, colour, max(2, wide // 4), cv2.LINE_AA)
        elif what == 2:
            box = cv2.boxPoints((at, (4 * wide, 3 * wide), float(rng.uniform(0, 90))))
            cv2.fillPoly(image, [np.rint(box).astype(np.int32)], (236, 236, 230), cv2.LINE_AA)
            cv2.putText(image, "Lab 7", at, cv2.FONT_HERSHEY_SIMPLEX, 0.5, (20, 20, 20), 1)
        else:
            path = np.cumsum(rng.integers(-30, 31, (30, 1, 2)), 0) + at
            cv2.polylines(image, [path.astype(np.int32)], False, colour, 3, cv2.LINE_AA)
    return image


def _plate(plan: Plan, rng: np.random.Generator) -> np.ndarray:
    """The plate's face: grain, markers in its corners, screws, a grid or a target."""
    base = np.array(plan.plate_rgb, float)
    rough, long = (10.0, 8.0) if plan.plate == "birch" else (rng.uniform(0.5, 4.0), 1.0)
    face = base + rough * grain(rng, PLATE_PX, 0.8, long)[..., None]
    image = np.ascontiguousarray(np.clip(face, 0, 255).astype(np.uint8))
    ink = (40.0,) * 3 if base.mean() > 110 else (200.0,) * 3
    far = PLATE_PX // 9
    corners = [(x, y) for x in (far, PLATE_PX - far) for y in (far, PLATE_PX - far)]
    if plan.markers:
        tags = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_50)
        side = PLATE_PX // 10
        for k, (x, y) in enumerate(corners):
            tag = cv2.aruco.generateImageMarker(tags, 7 * k + plan.seed % 7, side)
            x0, y0, rim = x - side // 2, y - side // 2, side // 8
            image[y0 - rim : y0 + side + rim, x0 - rim : x0 + side + rim] = 240
            image[y0 : y0 + side, x0 : x0 + side] = tag[..., None]
    style = int(rng.integers(0, 4))
    middle = (PLATE_PX // 2, PLATE_PX // 2)
    if style == 1:
        for x, y in corners if not plan.markers else [(middle[0], far)]:
            cv2.circle(image, (x, y), PLATE_PX // 70, ink, -1, cv2.LINE_AA)
    elif style == 2:
        for k in range(1, 6):
            cv2.line(image, (k * PLATE_PX // 6, 0), (k * PLATE_PX // 6, PLATE_PX), ink, 2)
            cv2.line(image, (0, k * PLATE_PX // 6), (PLATE_PX, k * PLATE_PX // 6), ink, 2)
    elif style == 3:
        for k in (1, 2):
            cv2.circle(image, middle, k * PLATE_PX // 6, ink, 4, cv2.LINE_AA)
        cv2.line(image, (middle[0], 0), (middle[0], PLATE_PX), ink, 3)
    return image


def _ball(plan: Plan) -> np.ndarray:
    """The ball's paint, laid on along one axis."""
    image = np.empty((BALL_PX, BALL_PX, 3))
    image[:] = plan.ball_rgb
    if plan.kind == "half":
        image[:, : BALL_PX // 2] = plan.second_rgb
    elif plan.kind == "striped":
        for k in range(1, 8, 2):
            image[:, k * BALL_PX // 9 : (k + 1) * BALL_PX // 9] = plan.second_rgb
    return image


def _hand(plan: Plan) -> str:
    """A forearm in its sleeve, a palm, and five fingers of two links, thumb apart; the finger tips
    are the body's origin."""
    skin = _row([*(c / 255 for c in plan.skin), 1.0])
    cloth = plan.ball_rgb if plan.kind == "sleeve of its colour" else PLATES["blue"]
    sleeve = _row([*(c / 255 for c in cloth), 1.0])
    parts = [
        f'<geom type="ellipsoid" pos="0.075 0.03 0.05" size="0.045 0.04 0.016" rgba="{skin}"/>',
        _capsule((0.11, 0.05, 0.06), (0.16, 0.07, 0.08), 0.026, skin),
        _capsule((0.16, 0.07, 0.08), (0.5, 0.22, 0.25), 0.042, sleeve),
    ]
    for k in range(4):
        y = 0.018 * (k - 1.0)
        knuckle, tip = (0.04, 0.025 + y, 0.06), (0.0, 0.6 * y, 0.01 + 0.004 * abs(k - 1))
        bend = tuple(
            0.5 * (a + b) + c for a, b, c in zip(knuckle, tip, (0.0, 0.0, 0.02), strict=True)
        )
        parts += [_capsule(knuckle, bend, 0.009, skin), _capsule(bend, tip, 0.008, skin)]
    parts.append(_capsule((0.06, -0.005, 0.045), (0.01, -0.03, 0.012), 0.01, skin))
    return "".join(parts)


def _capsule(a, b, radius: float, rgba: str) -> str:
    return f'<geom type="capsule" fromto="{_row((*a, *b))}" size="{radius}" rgba="{rgba}"/>'


def _leaf(k: int) -> str:
    colour = ("0.25 0.45 0.15 1", "0.55 0.4 0.1 1", "0.6 0.2 0.12 1")[k]
    return (
        f'<body name="leaf{k}" mocap="true" pos="0 0 -5">'
        f'<geom type="ellipsoid" size="0.018 {0.008 + 0.003 * k} 0.001" rgba="{colour}"/></body>'
    )
