"""Ten more files, invented after what the ten fresh ones lacked was mended."""

import json
from datetime import datetime, timedelta, timezone
from pathlib import Path

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from scipy.io import savemat

from tests.support.strangers.bench import Told, run
from tests.support.strangers.first import DEGREE, told_of


def dutch_sheet(folder: Path) -> tuple[Path, Told]:
    it = run(51)
    lines = ["Tijd [ms];Balpositie X [mm];Balpositie Y [mm];Gewenste hoek X [graden];"]
    lines[0] += "Gewenste hoek Y [graden]"
    angle, ball = it.command_rad / DEGREE * [-1, -1], it.ball_m * 1e3
    for t, a, b in zip(it.t_s, angle, ball, strict=True):
        cells = f"{1e3 * t:.0f};{b[0]:.2f};{b[1]:.2f};{a[0]:.3f};{a[1]:.3f}"
        lines.append(cells.replace(".", ","))
    path = folder / "meting.csv"
    path.write_bytes("\r\n".join(lines).encode("utf-8-sig"))
    return path, told_of(it, "ball", "command")


def serial_monitor(folder: Path) -> tuple[Path, Told]:
    it = run(52, rate_hz=40.0, grid_rad=DEGREE)
    start = datetime(2024, 6, 1, 12, 59, 50)
    angle, ball = it.command_rad / DEGREE * [1, -1] + 90, it.ball_m * 1e3
    lines = ["12:59:49.100 -> Ball balancer v1.3 ready"]
    for t, a, b in zip(it.t_s, angle, ball, strict=True):
        stamp = f"{start + timedelta(seconds=float(t)):%H:%M:%S.%f}"[:-3]
        lines.append(f"{stamp} -> x_mm:{b[0]:.1f} y_mm:{b[1]:.1f} s1:{a[0]:.0f} s2:{a[1]:.0f}")
    path = folder / "serial.txt"
    path.write_text("\r\n".join(lines))
    return path, told_of(it, "ball", "command")


def simulink_array(folder: Path) -> tuple[Path, Told]:
    it = run(53, rate_hz=100.0, duration_s=30.0, lever=1.0)
    signals = np.zeros(2, dtype=[("values", "O"), ("label", "O")])
    signals[0] = (it.ball_m * 1e3, "Ball position (mm)")
    signals[1] = (it.theta_rad / DEGREE * [1, -1], "Measured plate angle (deg)")
    path = folder / "scopedata.mat"
    savemat(path, {"ScopeData": {"time": it.t_s[:, None], "signals": signals}})
    return path, told_of(it, "ball", "theta")


def web_dashboard(folder: Path) -> tuple[Path, Told]:
    it = run(54, rate_hz=30.0)
    values = zip(it.t_s, it.ball_m * 1e2, it.target_m * 1e2, it.command_rad / DEGREE, strict=True)
    samples = [
        {
            "epochMs": 1_717_240_000_000 + round(1e3 * t),
            "ballPosCm": {"x": round(b[0], 2), "y": round(b[1], 2)},
            "setpointCm": {"x": round(g[0], 2), "y": round(g[1], 2)},
            "servoCmdDeg": {"x": round(-a[1], 2), "y": round(a[0], 2)},
        }
        for t, b, g, a in values
    ]
    path = folder / "session-8f2c.json"
    path.write_text(json.dumps({"version": 2, "device": "bb-03", "samples": samples}))
    return path, told_of(it, "ball", "target", "command")


def ros_bag_table(folder: Path) -> tuple[Path, Told]:
    it = run(55, rate_hz=50.0, lever=1.0)
    lines = [
        "Time,header.seq,header.stamp.secs,header.stamp.nsecs,point.x,point.y,point.z,roll_cmd"
    ]
    lines[0] += ",pitch_cmd"
    for row, (t, b, a) in enumerate(zip(it.t_s, it.ball_m, it.command_rad, strict=True)):
        whole, part = divmod(1_600_000_000_700_000_000 + round(1e9 * t), 10**9)
        stamp = f"{whole + part / 1e9 + 0.002:.6f},{row},{whole},{part}"
        lines.append(f"{stamp},{b[0]:.5f},{b[1]:.5f},0.0,{a[1]:.5f},{-a[0]:.5f}")
    path = folder / "ball_point.csv"
    path.write_text("\n".join(lines))
    return path, told_of(it, "ball", "command")


def french_report(folder: Path) -> tuple[Path, Told]:
    it = run(56, lever=1.0)
    lines = ["Banc bille sur plateau", "Date;12/03/2023", "Période d'échantillonnage [ms];20", ""]
    lines += ["N°;Bille X;Bille Y;Inclinaison X mesurée;Inclinaison Y mesurée", ";mm;mm;deg;deg"]
    angle, ball = it.theta_rad / DEGREE * [-1, 1], it.ball_m * 1e3
    for row, (a, b) in enumerate(zip(angle, ball, strict=True)):
        cells = f"{row};{b[0]:.2f};{b[1]:.2f};{a[0]:.3f};{a[1]:.3f}"
        lines.append(cells.replace(".", ","))
    path = folder / "essai.csv"
    path.write_bytes("\r\n".join(lines).encode("latin-1"))
    return path, told_of(it, "ball", "theta")


def labels_that_swap_and_inches(folder: Path) -> tuple[Path, Told]:
    it = run(57, grid_rad=DEGREE / 4)
    rows = {
        "timestamp": pa.array(1_700_000_000.25 + it.t_s),
        "ball_x_inches": pa.array(it.ball_m[:, 0] / 0.0254),
        "ball_y_inches": pa.array(it.ball_m[:, 1] / 0.0254),
        "motor_x_setpoint_degrees": pa.array(-it.command_rad[:, 1] / DEGREE),
        "motor_y_setpoint_degrees": pa.array(it.command_rad[:, 0] / DEGREE),
    }
    path = folder / "log.parquet"
    pq.write_table(pa.table(rows), path)
    return path, told_of(it, "ball", "command")


def zoned_text(folder: Path) -> tuple[Path, Told]:
    it = run(58, rate_hz=30.0)
    start = datetime(2023, 10, 29, 23, 59, 40, tzinfo=timezone(timedelta(hours=-5)))
    told = told_of(it, "ball", "command")
    lines = ["utc_time\tball.found\tball.x [cm]\tball.y [cm]\ttilt_cmd.x [deg]\ttilt_cmd.y [deg]"]
    angle = it.command_rad / DEGREE * [1, -1]
    for row, (t, a, b) in enumerate(zip(it.t_s, angle, it.ball_m * 1e2, strict=True)):
        found = row % 120 < 100
        if not found:
            b, told.signals["ball"][row] = [0.0, 0.0], np.nan
        stamp = (start + timedelta(seconds=float(t))).isoformat(timespec="milliseconds")
        cells = (f"{v:.3f}" for v in (*b, *a))
        lines.append("\t".join((stamp, str(found), *cells)))
    path = folder / "capture.tsv"
    path.write_text("\n".join(lines))
    return path, told


def percent_of_range(folder: Path) -> tuple[Path, Told]:
    it = run(59)
    lines = ["t_ms,ball_x_mm,ball_y_mm,servo_x_percent,servo_y_percent"]
    share = it.command_rad / 0.785 * 50 + 50
    for t, b, s in zip(it.t_s, it.ball_m * 1e3, share, strict=True):
        lines.append(f"{1e3 * t:.0f},{b[0]:.1f},{b[1]:.1f},{s[0]:.1f},{s[1]:.1f}")
    path = folder / "plc.csv"
    path.write_text("\n".join(lines))
    return path, told_of(it, "ball", "command", open_words=("scale", "percent", "unit"))


def resting_ball(folder: Path) -> tuple[Path, Told]:
    it = run(60, duration_s=20.0)
    rng = np.random.default_rng(60)
    still = rng.normal(0, 0.0002, it.ball_m.shape)
    path = folder / "idle.h5"
    with h5py.File(path, "w") as file:
        file["t"] = it.t_s
        file["ball_mm"] = still * 1e3 + 3.1
        file["servo_cmd_deg"] = rng.normal(0, 0.05, it.command_rad.shape)
        file["t"].attrs["units"] = "s"
    return path, told_of(it, "ball", "command", open_words=("sign", "which angle"))


LABS = (
    dutch_sheet, serial_monitor, simulink_array, web_dashboard, ros_bag_table, french_report,
    labels_that_swap_and_inches, zoned_text, percent_of_range, resting_ball,
)  # fmt: skip
