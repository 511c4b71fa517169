"""What lies between the servos and the plate: two rods, or three arms (`rig.three_arms`)."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import acos, asin, atan2, cos, degrees, hypot, nan, pi, sin, sqrt
from typing import ClassVar, Literal

from rig import three_arms
from rig.compiled import compiled
from rig.section import Length, Section, Size

RODS, THREE_ARMS = "two-rods", "three-arms"
Pair = tuple[float, float]
_STEP_RAD = 1e-3  # chosen: the tilt per angle at level changes by a millionth over it


@dataclass(frozen=True)
class Linkage(Section):
    """Servo arm to plate.

    "two-rods": sin(phi) = 2 R_d sin(theta)/L for each axis (paper Eq. 14), R_d = arm_radius_m the
    arm, L/2 = plate_side_m/2 the lever from the pivot to the rod; with a rod_length_m (0: so long
    that it stays upright) by `rod_tilt`. "three-arms": the angles are the plate's own tilt, which
    arms of arm_radius_m at base_radius_m, rods of rod_length_m and ball joints at plate_radius_m
    give it; its centre is held at height_m above the arms' axes, and plate_side_m is its size.
    """

    by_axis: ClassVar[tuple[str, ...]] = ("arm_radius_m", "plate_side_m", "rod_length_m")
    kind: Literal["two-rods", "three-arms"] = RODS
    arm_radius_m: Length = 0.0254
    plate_side_m: Length = 0.275
    rod_length_m: Size = 0.0
    base_radius_m: Length = 0.08
    plate_radius_m: Length = 0.1
    height_m: Length = 0.11
    x: dict[str, float] = field(default_factory=dict)
    y: dict[str, float] = field(default_factory=dict)

    @property
    def ratios(self) -> tuple[float, float]:
        """2 R_d/L of Eq. 14 for x and y; with three arms 1, as the angle is the plate's own."""
        if self.kind == THREE_ARMS:
            return 1.0, 1.0
        arms, sides = self.pair("arm_radius_m"), self.pair("plate_side_m")
        return 2 * arms[0] / sides[0], 2 * arms[1] / sides[1]

    @property
    def ratio(self) -> float:
        """2 R_d/L of Eq. 14 [1]; where the axes differ, the mean of both."""
        x, y = self.ratios
        return x if x == y else 0.5 * (x + y)

    @property
    def half_sides_m(self) -> tuple[float, float]:
        """Half the plate's side in x and y [m]."""
        x, y = self.pair("plate_side_m")
        return x / 2, y / 2

    @property
    def side_m(self) -> float:
        """Side of the square that holds the plate [m]: the longer one where the axes differ."""
        return 2 * max(self.half_sides_m)

    @property
    def size(self) -> tuple[float, float, float, float]:
        """Base radius, plate radius, arm and rod [m] as `rig.three_arms` takes them."""
        return self.base_radius_m, self.plate_radius_m, self.arm_radius_m, self.rod_length_m

    # --- its servos: those of x and y, or of the arms in the order of their azimuths ---
    @property
    def servos(self) -> int:
        """How many servos move the plate."""
        return three_arms.ARMS if self.kind == THREE_ARMS else 2

    @property
    def servo_names(self) -> tuple[str, ...]:
        """What the servos are called in messages."""
        if self.kind != THREE_ARMS:
            return "x", "y"
        return tuple(f"arm at {degrees(azimuth):.0f} degrees" for azimuth in three_arms.AZIMUTHS)

    def servo_angles(self, angles: Pair) -> tuple[float, ...]:
        """Angles of the servos from level [rad] at the table's angles (x, y) [rad]; NaN where three
        arms do not reach them.
        """
        if self.kind != THREE_ARMS:
            return angles
        return three_arms.turned(sin(angles[0]), sin(angles[1]), self.height_m, self.size)

    def table_angles(self, turned: Sequence[float]) -> Pair:
        """The table's angles (x, y) [rad] at the servos' from level [rad]; NaN where three arms
        hold no plate. The inverse of `servo_angles`; three arms may hold the plate higher or lower.
        """
        if self.kind != THREE_ARMS:
            return turned[0], turned[1]
        s_x, s_y = three_arms.sines(turned, self.height_m, self.size)
        return asin(s_x), asin(s_y)

    def servo_limits_rad(self, angle_limit_rad: float) -> tuple[float, ...]:
        """How far each servo turns from level at most [rad] while the table's angles stay within
        their limit.
        """
        if self.kind != THREE_ARMS:
            return angle_limit_rad, angle_limit_rad
        return three_arms.most_turned(angle_limit_rad, self.height_m, self.size)

    def servo_rates(self, rates: Pair) -> tuple[float, ...]:
        """Rate limits of the servos of those by axis: arms, which move both, keep to the lower."""
        return rates if self.kind != THREE_ARMS else (min(rates),) * self.servos

    @property
    def tilt_per_servo(self) -> tuple[Pair, ...]:
        """By servo, what (sin phi_x, sin phi_y) change per radian of it at level [1]."""
        if self.kind != THREE_ARMS:
            return (self.ratios[0], 0.0), (0.0, self.ratios[1])
        found = []
        for i in range(self.servos):
            high, low = (
                three_arms.sines(
                    [way * _STEP_RAD * (k == i) for k in range(self.servos)],
                    self.height_m,
                    self.size,
                )
                for way in (1, -1)
            )
            found.append(tuple((a - b) / (2 * _STEP_RAD) for a, b in zip(high, low, strict=True)))
        return tuple(found)

    def check(self, angle_limit_rad: float, travel_rad: float, radius_m: float) -> None:
        """Raise ValueError (one line) where the plate cannot reach every angle up to the limit.

        travel_rad: to which the servo's arms can turn, to each side; radius_m: of the ball.
        """
        if self.kind == THREE_ARMS:
            return self._check_arms(angle_limit_rad, travel_rad, radius_m)
        for axis in "xy":
            one = self.on(axis)
            half, label = one.plate_side_m / 2, f"linkage.{axis}." if self.x or self.y else ""
            label = label or "linkage."
            if radius_m >= half:
                raise ValueError(
                    f"ball.radius_m = {radius_m:g} is not below half the plate's side "
                    f"({half:g} m): the ball does not fit on the plate; correct [ball] or [linkage]"
                )
            if one.arm_radius_m > half:  # equal: the angle is the plate's own
                raise ValueError(
                    f"{label}arm_radius_m = {one.arm_radius_m:g} is above half the "
                    f"plate's side ({half:g} m): the plate would stand upright; correct [linkage]"
                )
            reach = rod_reach_rad(one.arm_radius_m, half, one.rod_length_m, angle_limit_rad)
            if one.rod_length_m > 0 and reach < angle_limit_rad:
                raise ValueError(
                    f"{label}rod_length_m = {one.rod_length_m:g} reaches {reach:.3f} rad of the "
                    f"servo, servo.angle_limit_rad = {angle_limit_rad:g} is beyond: lower it"
                )
        return None

    def _check_arms(self, angle_limit_rad: float, travel_rad: float, radius_m: float) -> None:
        if self.x or self.y:
            raise ValueError("linkage.x and linkage.y: three arms have no values by axis")
        half = self.plate_side_m / 2
        if radius_m >= half:
            raise ValueError(
                f"ball.radius_m = {radius_m:g} is not below half the plate's side "
                f"({half:g} m): the ball does not fit on the plate; correct [ball] or [linkage]"
            )
        if angle_limit_rad >= pi / 4:
            raise ValueError(
                f"servo.angle_limit_rad = {angle_limit_rad:g} is the tilt of a plate on three arms:"
                " must be below 0.785 (45 degrees)"
            )
        reach = three_arms.reach_rad(self.height_m, self.size, travel_rad, angle_limit_rad)
        if reach < 0:
            raise ValueError(
                f"linkage.height_m = {self.height_m:g} is out of reach or singular for arms of "
                f"{self.arm_radius_m:g} m and rods of {self.rod_length_m:g} m: correct [linkage]"
            )
        if reach < angle_limit_rad:
            raise ValueError(
                f"servo.angle_limit_rad = {angle_limit_rad:g} is out of the three arms' reach "
                f"(both tilts at once up to {reach:.3f} rad): lower it, or correct [linkage]"
            )


@compiled
def rod_tilt(theta, arm, lever, rod):
    """Sine of the plate's tilt by a rod of finite length, and its derivative by theta [1].

    The arm of length R turns by theta about an axis at the distance lever - R below the plate's
    pivot plane and points outwards; at theta = 0 the rod stands upright. Its upper end lies on the
    circle of the lever d about the pivot, at the distance l from its lower end: with rho and gamma
    the lower end's distance and direction from the pivot,

        phi = gamma + arccos((d^2 + rho^2 - l^2)/(2 d rho)).

    theta [rad], lengths [m]; NaN where the rod does not reach. For l -> infinity Eq. 14.
    """
    x, z = lever - arm + arm * cos(theta), arm * sin(theta) - rod
    rho = sqrt(x * x + z * z)
    bent = (lever * lever + rho * rho - rod * rod) / (2.0 * lever * rho)
    if abs(bent) > 1.0:
        return nan, nan
    phi = atan2(z, x) + acos(bent)
    s, c = sin(phi), cos(phi)
    n_x, n_z = lever * c - x, lever * s - z
    turned = arm * (n_z * cos(theta) - n_x * sin(theta)) / (lever * (n_z * c - n_x * s))
    return s, c * turned


def rod_reach_rad(arm: float, lever: float, rod: float, most_rad: float) -> float:
    """Largest angle [rad], at most `most_rad`, up to which a rod reaches and the tilt grows."""
    if rod == 0.0:
        return most_rad
    good, steps = 0.0, 50
    for k in range(1, steps + 1):
        theta = most_rad * k / steps
        if not all(_holds(sign * theta, arm, lever, rod) for sign in (1, -1)):
            break
        good = theta
    return good


def _holds(theta: float, arm: float, lever: float, rod: float) -> bool:
    """The rod stands well on the lever and on the arm (`three_arms.LEAST_TRANSMISSION`)."""
    s, _ = rod_tilt(theta, arm, lever, rod)
    if not abs(s) < 1.0:
        return False
    x, z = lever - arm + arm * cos(theta), arm * sin(theta) - rod
    n_x, n_z = (lever * sqrt(1 - s * s) - x) / rod, (lever * s - z) / rod
    on_arm, on_lever = n_z * cos(theta) - n_x * sin(theta), n_z * sqrt(1 - s * s) - n_x * s
    return min(on_arm, on_lever) / hypot(n_x, n_z) >= three_arms.LEAST_TRANSMISSION
