"""Sixteen people's files; none of their writers has read how a map is proposed.

Each function writes a file into a folder and returns it with what it tells.
"""

import json
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path

import h5py
import numpy as np
from scipy.io import savemat

from tests.support.strangers.bench import Run, Told, run

DEGREE = np.pi / 180


def told_of(it: Run, *names: str, open_words: tuple[str, ...] = ()) -> Told:
    of = {"ball": it.ball_m, "command": it.command_rad, "theta": it.theta_rad}
    of["target"] = it.target_m
    return Told(it.t_s, {name: of[name] for name in names}, open_words)


def german_spreadsheet(folder: Path) -> tuple[Path, Told]:
    it = run(1)
    lines = ["Zeit [s];Sollwinkel X [°];Sollwinkel Y [°];Kugel X [mm];Kugel Y [mm]"]
    angle, ball = it.command_rad / DEGREE * [1, -1], it.ball_m * 1e3
    for t, a, b in zip(it.t_s, angle, ball, strict=True):
        lines.append(f"{t:.2f};{a[0]:.2f};{a[1]:.2f};{b[0]:.1f};{b[1]:.1f}".replace(".", ","))
    path = folder / "Messung 3.csv"
    path.write_bytes("\r\n".join(lines).encode("latin-1"))
    return path, told_of(it, "ball", "command")


def serial_plotter(folder: Path) -> tuple[Path, Told]:
    it = run(2, rate_hz=40.0, grid_rad=DEGREE)
    lines = []
    angle, ball = it.command_rad / DEGREE * [-1, 1] + [92, 88], it.ball_m * 1e3
    for t, a, b in zip(it.t_s, angle, ball, strict=True):
        lines.append(
            f"t:{1e3 * t + 5120:.0f} x:{b[0]:.1f} y:{b[1]:.1f} sx:{a[0]:.0f} sy:{a[1]:.0f}"
        )
    path = folder / "putty.log"
    path.write_text("\n".join(lines) + "\n")
    return path, told_of(it, "ball", "command")


def french_tabs(folder: Path) -> tuple[Path, Told]:
    it = run(3, course="circle")
    lines = [
        "Temps (ms)\tConsigne angle X (deg)\tConsigne angle Y (deg)\tBille X (cm)\tBille Y (cm)"
    ]
    angle, ball = it.command_rad[:, ::-1] / DEGREE, it.ball_m * 1e2  # plugs exchanged
    for t, a, b in zip(it.t_s, angle, ball, strict=True):
        line = f"{1e3 * t:.0f}\t{a[0]:.2f}\t{a[1]:.2f}\t{b[0]:.2f}\t{b[1]:.2f}"
        lines.append(line.replace(".", ","))
    path = folder / "essai_07.txt"
    path.write_bytes("\r\n".join(lines).encode("utf-16"))
    return path, told_of(it, "ball", "command")


def spanish_lines(folder: Path) -> tuple[Path, Told]:
    it = run(4, rate_hz=30.0)
    start = datetime(2023, 5, 4, 10, 11, 12, 345000, timezone(timedelta(hours=2)))
    angle, ball, goal = it.command_rad / DEGREE * [-1, -1], it.ball_m * 1e3, it.target_m * 1e3
    told = told_of(it, "ball", "command", "target")
    lines = []
    for row, (t, a, b, g) in enumerate(zip(it.t_s, angle, ball, goal, strict=True)):
        lost = row % 97 > 93
        told.signals["ball"][row] = np.nan if lost else told.signals["ball"][row]
        record = {
            "marca": (start + timedelta(seconds=float(t))).isoformat(timespec="milliseconds"),
            "pelota": None if lost else {"x_mm": round(b[0], 1), "y_mm": round(b[1], 1)},
            "orden": {"x_grados": round(a[0], 2), "y_grados": round(a[1], 2)},
            "objetivo": {"x_mm": round(g[0], 1), "y_mm": round(g[1], 1)},
        }
        lines.append(json.dumps(record))
    path = folder / "mesa.jsonl"
    path.write_text("\n".join(lines))
    return path, told


def matlab_new(folder: Path) -> tuple[Path, Told]:
    it = run(5, rate_hz=100.0, duration_s=30.0, lever=1.0)
    path = folder / "exp12.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        values = {
            "t": it.t_s,
            "xb": it.ball_m[:, 0],
            "yb": it.ball_m[:, 1],
            "alpha": -it.theta_rad[:, 1],  # about x: it moves the ball in y
            "beta": it.theta_rad[:, 0],
            "alpha_cmd": -it.command_rad[:, 1],
            "beta_cmd": it.command_rad[:, 0],
        }
        for name, column in values.items():
            data = file.create_dataset(name, data=column[None, :])
            data.attrs["MATLAB_class"] = np.bytes_("double")
    head = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(116) + bytes(8) + b"\x00\x02IM"
    with path.open("r+b") as file:
        file.write(head)
    return path, told_of(it, "ball", "theta", "command")


def simulink(folder: Path) -> tuple[Path, Told]:
    it = run(6, rate_hz=100.0, duration_s=30.0)
    shape = {"dimensions": 2.0}
    path = folder / "simout.mat"
    content = {
        "ball": {
            "time": it.t_s[:, None],
            "signals": {"values": it.ball_m, "label": "Ball position [m]", **shape},
            "blockName": "balancer/To Workspace",
        },
        "servo": {
            "time": it.t_s[:, None],
            "signals": {"values": it.command_rad, "label": "Servo command [rad]", **shape},
            "blockName": "balancer/To Workspace1",
        },
    }
    savemat(path, content)
    return path, told_of(it, "ball", "command")


def bus_servos(folder: Path) -> tuple[Path, Told]:
    it = run(7, rate_hz=60.0, grid_rad=2 * np.pi / 4096)
    lines = ["timestamp_us,goal_pos_1,goal_pos_2,present_pos_1,present_pos_2,ball_px_x,ball_px_y"]
    goal = np.round(it.command_rad * 4096 / 2 / np.pi) + 2048
    present = np.round(it.theta_rad * 4096 / 2 / np.pi) + 2048
    pixels = it.ball_m / 0.00055 * [1, -1] + [322, 239]
    for t, g, p, b in zip(it.t_s, goal, present, pixels, strict=True):
        lines.append(
            f"{1e6 * t:.0f},{g[0]:.0f},{g[1]:.0f},{p[0]:.0f},{p[1]:.0f},{b[0]:.1f},{b[1]:.1f}"
        )
    path = folder / "sts3215.csv"
    path.write_text("\n".join(lines))
    return path, told_of(it, "ball", "command", "theta", open_words=("px", "pixel"))


def frames(folder: Path) -> tuple[Path, Told]:
    it = run(8, lever=1.0)
    lines = ["# Ball on plate, lab 3", "# Date: 12.03.2020", "# Sample rate: 50 Hz", ""]
    lines += ["Frame\tX\tY\tPitch_act\tRoll_act", "-\tmm\tmm\tdeg\tdeg"]
    angle, ball = it.theta_rad / DEGREE * [1, -1], it.ball_m * 1e3
    for row, (a, b) in enumerate(zip(angle, ball, strict=True)):
        lines.append(f"{row + 417}\t{b[0]:.2f}\t{b[1]:.2f}\t{a[0]:.3f}\t{a[1]:.3f}")
    path = folder / "plate_0017.dat"
    path.write_text("\n".join(lines))
    return path, told_of(it, "ball", "theta")


def pulses(folder: Path) -> tuple[Path, Told]:
    it = run(9)
    lines = ["epoch_ms,pulse1,pulse2,ball_x_mm,ball_y_mm,setpoint_x_mm,setpoint_y_mm"]
    pulse = np.round(it.command_rad / DEGREE * 10.3 * [1, -1] + [1480, 1530])
    ball, goal = it.ball_m * 1e3, it.target_m * 1e3
    for t, p, b, g in zip(it.t_s, pulse, ball, goal, strict=True):
        cells = f"{b[0]:.1f},{b[1]:.1f},{g[0]:.1f},{g[1]:.1f}"
        lines.append(f"{1601234567000 + 1e3 * t:.0f},{p[0]:.0f},{p[1]:.0f},{cells}")
    path = folder / "session_2020-09-27.csv"
    path.write_text("\n".join(lines))
    return path, told_of(it, "ball", "command", "target", open_words=("scale", "pulse", " us"))


def touch_panel(folder: Path) -> tuple[Path, Told]:
    it = run(10, grid_rad=DEGREE)
    lines = ["millis,touch_x_adc,touch_y_adc,servo_x_deg,servo_y_deg"]
    counts = it.ball_m / 0.165 * [780, 700] + [510, 498]
    angle = it.command_rad / DEGREE + 90
    for t, c, a in zip(it.t_s, counts, angle, strict=True):
        lines.append(f"{1e3 * t + 311:.0f},{c[0]:.0f},{c[1]:.0f},{a[0]:.0f},{a[1]:.0f}")
    path = folder / "CAPTURE.TXT"
    path.write_text("\r\n".join(lines))
    return path, told_of(it, "ball", "command", open_words=("counts", "scale", "m in one"))


def excel_days(folder: Path) -> tuple[Path, Told]:
    it = run(11, lever=1.0)
    lines = ["Zeitpunkt;Ball X (m);Ball Y (m);Neigung X gemessen (Grad);Neigung Y gemessen (Grad)"]
    angle = it.theta_rad / DEGREE * [-1, 1]
    for t, b, a in zip(it.t_s, it.ball_m, angle, strict=True):
        line = f"{44210.51234 + t / 86400:.9f};{b[0]:.4f};{b[1]:.4f};{a[0]:.3f};{a[1]:.3f}"
        lines.append(line.replace(".", ","))
    path = folder / "Auswertung.csv"
    path.write_bytes("\r\n".join(lines).encode("utf-8-sig"))
    return path, told_of(it, "ball", "theta")


def json_array(folder: Path) -> tuple[Path, Told]:
    it = run(12)
    values = zip(it.t_s, it.ball_m, it.command_rad, it.target_m, strict=True)
    records = [
        {
            "t": round(t, 4),
            "ball": b.round(5).tolist(),
            "cmd": c.round(5).tolist(),
            "ref": r.tolist(),
        }
        for t, b, c, r in values
    ]
    path = folder / "run.json"
    path.write_text(json.dumps(records, indent=1))
    return path, told_of(it, "ball", "command", "target")


def hdf5_groups(folder: Path) -> tuple[Path, Told]:
    it = run(13, rate_hz=100.0, duration_s=30.0)
    path = folder / "trial.h5"
    with h5py.File(path, "w") as file:
        file["time"] = it.t_s
        file["ball/xy"] = it.ball_m * 1e3
        file["servo/setpoint"] = it.command_rad / DEGREE * [-1, 1]
        for name, unit in (("time", "s"), ("ball/xy", "mm"), ("servo/setpoint", "deg")):
            file[name].attrs["unit"] = unit
    return path, told_of(it, "ball", "command")


def numpy_archive(folder: Path) -> tuple[Path, Told]:
    it = run(14, lever=1.0, course="circle")
    path = folder / "episode_004.npz"
    arrays = {"time": it.t_s + 3.2, "ball": it.ball_m, "tilt_measured": it.theta_rad * [1, -1]}
    np.savez(path, ball_ref=it.target_m, **arrays)
    return path, told_of(it, "ball", "theta", "target")


def ros_topics(folder: Path) -> tuple[Path, Told]:
    it = run(15, rate_hz=60.0, lever=1.0)
    lines = ["%time,/ball/point/x,/ball/point/y,/plate_cmd/roll,/plate_cmd/pitch"]
    angle = np.stack([-it.command_rad[:, 1], it.command_rad[:, 0]], axis=1)
    for t, b, a in zip(it.t_s, it.ball_m, angle, strict=True):
        stamp = 1683187872345678901 + round(t * 1e9)
        lines.append(f"{stamp},{b[0]:.5f},{b[1]:.5f},{a[0]:.5f},{a[1]:.5f}")
    path = folder / "merged_topics.csv"
    path.write_text("\n".join(lines))
    return path, told_of(it, "ball", "command")


def past_midnight(folder: Path) -> tuple[Path, Told]:
    it = run(16, grid_rad=DEGREE / 2)
    start = datetime(2000, 1, 1, 23, 59, 48, 340000, UTC)
    lines = ["Time,servoA_cmd(deg),servoB_cmd(deg),ballX(in),ballY(in)"]
    angle = it.command_rad[:, ::-1] / DEGREE * [1, -1]  # A moves y, B moves x
    for t, b, a in zip(it.t_s, it.ball_m / 0.0254, angle, strict=True):
        clock = f"{start + timedelta(seconds=float(t)):%H:%M:%S.%f}"[:-3]
        lines.append(f"{clock},{a[0]:.1f},{a[1]:.1f},{b[0]:.3f},{b[1]:.3f}")
    path = folder / "night run.csv"
    path.write_bytes("\r\n".join(lines).encode("utf-8-sig"))
    return path, told_of(it, "ball", "command")


LABS = (
    german_spreadsheet, serial_plotter, french_tabs, spanish_lines, matlab_new, simulink,
    bus_servos, frames, pulses, touch_panel, excel_days, json_array, hdf5_groups, numpy_archive,
    ros_topics, past_midnight,
)  # fmt: skip
