"""Ten people's files, invented after what the first sixteen lacked was mended."""

import json
from datetime import datetime, timedelta
from pathlib import Path

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from scipy.io import savemat

from tests.support.strangers.bench import Told, run
from tests.support.strangers.first import DEGREE, told_of


def italian_sheet(folder: Path) -> tuple[Path, Told]:
    it = run(31, rate_hz=40.0)
    lines = [
        "Tempo (s);Pallina X (mm);Pallina Y (mm);Angolo comandato X (gradi);Angolo comandato Y"
    ]
    lines[0] += " (gradi)"
    angle, ball = it.command_rad / DEGREE * [-1, 1], it.ball_m * 1e3
    for t, a, b in zip(it.t_s, angle, ball, strict=True):
        line = f'"{t + 12:.3f}";"{b[0]:.1f}";"{b[1]:.1f}";"{a[0]:.2f}";"{a[1]:.2f}"'
        lines.append(line.replace(".", ","))
    path = folder / "prova1.csv"
    path.write_bytes("\r\n".join(lines).encode("latin-1"))
    return path, told_of(it, "ball", "command")


def parquet_lists(folder: Path) -> tuple[Path, Told]:
    it = run(32, rate_hz=100.0, duration_s=30.0, lever=1.0)
    stamps = [1_710_165_907_123_456 + round(1e6 * t) for t in it.t_s]
    table = {
        "stamp": pa.array(stamps, pa.timestamp("us", tz="UTC")),
        "ball_position": pa.array(it.ball_m.tolist()),
        "plate_angle_cmd": pa.array((it.command_rad * [1, -1]).tolist()),
        "plate_angle_meas": pa.array((it.theta_rad * [1, -1]).tolist()),
    }
    path = folder / "part-0000.parquet"
    pq.write_table(pa.table(table), path)
    return path, told_of(it, "ball", "command", "theta")


def python_logging(folder: Path) -> tuple[Path, Told]:
    it = run(33, rate_hz=30.0)
    start = datetime(2024, 3, 11, 14, 5, 7)
    angle = it.command_rad / DEGREE + [91, 88]
    lines = ["2024-03-11 14:05:05,002 INFO camera opened"]
    for t, a, b in zip(it.t_s, angle, it.ball_m, strict=True):
        stamp = f"{start + timedelta(seconds=float(t)):%Y-%m-%d %H:%M:%S,%f}"[:-3]
        numbers = f"ball=({b[0]:.4f}, {b[1]:.4f}) servo=({a[0]:.1f}, {a[1]:.1f})"
        lines.append(f"{stamp} INFO {numbers}")
    path = folder / "balance.log"
    path.write_text("\n".join(lines))
    return path, told_of(it, "ball", "command", open_words=("commanded or measured",))


def matlab_struct(folder: Path) -> tuple[Path, Told]:
    it = run(34, course="circle")
    ball = it.ball_m * 1e2
    log = {
        "time_ms": it.t_s[:, None] * 1e3,
        "ball": {"x_cm": ball[:, :1], "y_cm": ball[:, 1:]},
        "u_deg": it.command_rad[:, ::-1] / DEGREE * [-1, 1],
        "Kp": 2.2,
        "note": "run with new gains",
    }
    path = folder / "data_2022_11_03.mat"
    savemat(path, {"log": log})
    return path, told_of(it, "ball", "command")


def microseconds_that_wrap(folder: Path) -> tuple[Path, Told]:
    it = run(35, rate_hz=100.0, duration_s=30.0, grid_rad=DEGREE)
    lines = ["micros,ballX_mm,ballY_mm,servoCmd1_deg,servoCmd2_deg"]
    angle, ball = it.command_rad / DEGREE * [1, -1] + 90, it.ball_m * 1e3
    for t, a, b in zip(it.t_s, angle, ball, strict=True):
        stamp = (4_280_000_000 + round(1e6 * t)) % 2**32
        lines.append(f"{stamp},{b[0]:.1f},{b[1]:.1f},{a[0]:.0f},{a[1]:.0f}")
    path = folder / "teensy.csv"
    path.write_text("\r\n".join(lines))
    return path, told_of(it, "ball", "command")


def portuguese_tabs(folder: Path) -> tuple[Path, Told]:
    it = run(36)
    head = "tempo_s bola_x_cm bola_y_cm ref_x_cm ref_y_cm angulo_x_comando_graus"
    lines = ["\t".join((*head.split(), "angulo_y_comando_graus"))]
    angle, ball, goal = it.command_rad / DEGREE, it.ball_m * 1e2, it.target_m * 1e2
    for t, a, b, g in zip(it.t_s, angle, ball, goal, strict=True):
        cells = (f"{v:.3f}" for v in (t, *b, *g, *a))
        lines.append("\t".join(cells))
    path = folder / "ensaio_b.tsv"
    path.write_text("\n".join(lines))
    return path, told_of(it, "ball", "command", "target")


def motion_capture(folder: Path) -> tuple[Path, Told]:
    it = run(37, rate_hz=100.0, duration_s=30.0, lever=1.0)
    height = 812 + np.random.default_rng(37).normal(0, 0.3, len(it.t_s))
    lines = [f"NO_OF_FRAMES\t{len(it.t_s)}", "NO_OF_CAMERAS\t8", "FREQUENCY\t100"]
    lines += ["TIME_STAMP\t2023-02-01, 11:12:13", "DATA_INCLUDED\t6D"]
    lines += ["Frame\tBall X [mm]\tBall Y [mm]\tBall Z [mm]\tPlate Roll [deg]\tPlate Pitch [deg]"]
    angle = np.stack([it.theta_rad[:, 1], -it.theta_rad[:, 0]], axis=1) / DEGREE
    for row, (a, b, h) in enumerate(zip(angle, it.ball_m * 1e3, height, strict=True)):
        lines.append(f"{row + 1}\t{b[0]:.3f}\t{b[1]:.3f}\t{h:.3f}\t{a[0]:.4f}\t{a[1]:.4f}")
    path = folder / "balance0004.tsv"
    path.write_text("\r\n".join(lines))
    return path, told_of(it, "ball", "theta")


def shares_of_an_image(folder: Path) -> tuple[Path, Told]:
    it = run(38, rate_hz=30.0, lever=1.0)
    place, angle = it.ball_m / 0.4 * [1, -1] + 0.5, it.command_rad / DEGREE
    lines = [
        json.dumps({"ts": 1_700_000_000 + t, "nx": b[0], "ny": b[1], "roll": a[1], "pitch": a[0]})
        for t, a, b in zip(it.t_s, angle, place, strict=True)
    ]
    path = folder / "detections.jsonl"
    path.write_text("\n".join(lines))
    return path, told_of(it, "ball", "command", open_words=("ball.unit", "ball_x_m.column"))


def compound_table(folder: Path) -> tuple[Path, Told]:
    it = run(39, rate_hz=100.0, duration_s=30.0)
    kinds = [("t_ns", "u8"), ("ball_x_um", "i4"), ("ball_y_um", "i4")]
    rows = np.zeros(len(it.t_s), dtype=[*kinds, ("cmd_a_mrad", "f4"), ("cmd_b_mrad", "f4")])
    rows["t_ns"] = 1_650_000_000_000_000_000 + np.round(1e9 * it.t_s).astype(np.uint64)
    rows["ball_x_um"], rows["ball_y_um"] = np.round(it.ball_m.T * 1e6)
    rows["cmd_a_mrad"], rows["cmd_b_mrad"] = -it.command_rad[:, 1] * 1e3, it.command_rad[:, 0] * 1e3
    path = folder / "daq.hdf5"
    with h5py.File(path, "w") as file:
        file["run_017/samples"] = rows
    return path, told_of(it, "ball", "command")


def lost_balls(folder: Path) -> tuple[Path, Told]:
    it = run(40)
    start = datetime(2024, 3, 11, 14, 5, 7)
    told = told_of(it, "ball", "command")
    lines = ["Datum/Uhrzeit;Kugel_X;Kugel_Y;Servo1_Soll;Servo2_Soll", ";mm;mm;Grad;Grad"]
    angle, ball = it.command_rad[:, ::-1] / DEGREE, it.ball_m * 1e3
    for row, (t, a, b) in enumerate(zip(it.t_s, angle, ball, strict=True)):
        if row % 211 > 190:
            b, told.signals["ball"][row] = [-999.0, -999.0], np.nan
        stamp = f"{start + timedelta(seconds=float(t)):%d.%m.%Y %H:%M:%S.%f}"[:-4]
        line = f"{b[0]:.1f};{b[1]:.1f};{a[0]:.1f};{a[1]:.1f}".replace(".", ",")
        lines.append(f"{stamp};{line}")
    path = folder / "Export_Prüfstand.csv"
    path.write_bytes("\r\n".join(lines).encode("latin-1"))
    return path, told


LABS = (
    italian_sheet, parquet_lists, python_logging, matlab_struct, microseconds_that_wrap,
    portuguese_tabs, motion_capture, shares_of_an_image, compound_table, lost_balls,
)  # fmt: skip
