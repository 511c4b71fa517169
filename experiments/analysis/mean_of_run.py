"""What the mean of a run must be, whatever the play: the controller ties it down."""

from dataclasses import dataclass

import numpy as np

from experiments.analysis.samples import Samples, ball_samples, run_part
from rig.log import Log
from rig.parameters import Rig


def expected_mean_m(
    duration_s: float,
    *,
    start_m: tuple[float, float] = (-0.13, 0.13),
    speed_m_s: tuple[float, float] = (0.0, 0.0),
    integral_change_rad: tuple[float, float] | None = None,
    rig: Rig | None = None,
) -> np.ndarray:
    """Expected mean (2,) [m] of the ball's position over a run about (0, 0), with play or without.

    duration_s: T; start_m, speed_m_s: x_0, v_0 at the start; integral_change_rad: change of the
    controller's integral over the run, None for a PD controller; rig: gains and b (default table).

    PD alone (integral_change_rad None): the ball obeys x'' = b theta, theta = -K_p x - K_d x'.
    Integrated from x_0, v_0 to rest at 0: -v_0 = b (-K_p int(x) dt + K_d x_0), so that

        mean = ((K_d/K_p) x_0 + v_0/(b K_p))/T       = 0.61 s * 0.13 m/T = 0.079 m s/T

    from rest, also with a lag of the servo (of gain one: it keeps int(theta) dt): 10 mm at T = 8 s
    and 2.6 mm at 30 s without any play. T must be long against the loop (2 s). A first frame that
    comes delta late adds x_0 delta/T, and the sine of Eq. 14 about 5 % from 13 cm.
    With an integral that was never clipped: theta_i' = -K_i x, so that mean = -(change)/(K_i T).
    ValueError: a duration that is not positive, or an integral's change without K_i.
    """
    rig = rig or Rig()
    gains = rig.gains
    if not duration_s > 0:
        raise ValueError(f"duration_s = {duration_s}: must be above 0")
    if integral_change_rad is None:
        kp, kd = gains.proportional_rad_m, gains.derivative_rad_s_m
        x_0, v_0 = np.asarray(start_m), np.asarray(speed_m_s)
        return (kd / kp * x_0 + v_0 / (rig.ball_gain_m_s2 * kp)) / duration_s
    if not gains.integral_rad_m_s > 0:
        raise ValueError("an integral changes only with gains.integral_rad_m_s above 0")
    return -np.asarray(integral_change_rad) / (gains.integral_rad_m_s * duration_s)


@dataclass(frozen=True, eq=False)
class Identity:
    """Mean error of a run beside the value that its integral predicts; pairs (2,) are x, y.

    mean_error_m: mean of target - position over duration_s = T; predicted_m: (change of the
    integral)/(K_i T), which equals mean_error_m where the integral was not clipped;
    integral_change_rad: that change; ki_rad_m_s: K_i; clipped (2,): share of ticks, 0 to 1, with
    the wanted angle at its limit.
    """

    mean_error_m: np.ndarray
    predicted_m: np.ndarray
    integral_change_rad: np.ndarray
    duration_s: float
    ki_rad_m_s: float
    clipped: np.ndarray


def integral_identity(
    log: Log, ki: float, *, rig: Rig | None = None, edge_s: float = 1.0
) -> Identity:
    """Test "mean error = (change of the integral)/(K_i T)" on a run of a PID with `ki` [rad/m/s].

    A log holds no integral. It is zero at the first observation and read back at the end from the
    wanted angle, I = theta_wanted - K_p e + K_d v, averaged over the last `edge_s`; T ends in the
    middle of these. Good to 0.1 mm at T = 15 s. `rig` gives K_p, K_d and the angle's limit.
    ValueError: ki not above 0, or a run with fewer than 8 samples of the ball, without its wanted
    angle in every row, or shorter than four times `edge_s`.
    """
    if not ki > 0:
        raise ValueError(f"ki = {ki}: the identity needs an integral; run with ki above 0")
    rig = rig or Rig()
    run, ball = run_part(log), ball_samples(log)
    ball = ball.where(np.asarray(~np.isnan(ball.xy_m).any(axis=1)))
    wanted = np.column_stack([run["desired_theta_x_rad"], run["desired_theta_y_rad"]])
    if len(ball.t_s) < 8 or np.isnan(wanted).any() or np.ptp(ball.t_s) < 4 * edge_s:
        raise ValueError(
            f"the integral identity needs both axes of the ball over {4 * edge_s:g} s or more and "
            "desired_theta in every row: give a run of the rig's own controller"
        )
    t, tick, error = ball.t_s, run["t_s"] - run["t_s"][0], ball.target_m - ball.xy_m
    begin, last = float(tick[~np.isnan(run["ball_x_m"])][0]), float(t[-1])
    end, gains = last - edge_s / 2, rig.gains
    final = (tick >= last - edge_s) & (tick <= last)
    change = (
        wanted[final].mean(axis=0)
        - gains.proportional_rad_m * _mean_between(t, error, last - edge_s, last)
        + gains.derivative_rad_s_m * _filtered_speed(ball, edge_s, gains.ball_filter_rad_s)
    )
    limit = rig.servo.angle_limit_rad - 1e-9
    return Identity(
        mean_error_m=_mean_between(t, error, begin, end),
        predicted_m=change / (ki * (end - begin)),
        integral_change_rad=change,
        duration_s=end - begin,
        ki_rad_m_s=ki,
        clipped=np.mean(np.abs(wanted) >= limit, axis=0),
    )


def _filtered_speed(ball: Samples, edge_s: float, filter_rad_s: float) -> np.ndarray:
    """Mean speed (2,) [m/s] over the last `edge_s` as the ball's filter sees it: 2/filter late."""
    late = ball.t_s[-1] - 2 / filter_rad_s
    half = min(0.05, 2 / filter_rad_s)
    after = _mean_between(ball.t_s, ball.xy_m, late - half, late + half)
    before = _mean_between(ball.t_s, ball.xy_m, late - edge_s - half, late - edge_s + half)
    return (after - before) / edge_s


def _mean_between(t: np.ndarray, values: np.ndarray, begin: float, end: float) -> np.ndarray:
    """Mean over the time from begin to end of values (n, 2) at times t (n,), straight between."""
    inner = (t > begin) & (t < end)
    at = np.concatenate(([begin], t[inner], [end]))
    line = np.column_stack([np.interp(at, t, values[:, a]) for a in range(2)])
    return np.asarray(np.trapezoid(line, at, axis=0)) / (end - begin)
