"""Invented laboratories: each writes the same kind of run in its own format, names and units.

`LABS`: name -> what writes the recording into a folder and returns its path and the truth.
"""

import json
from pathlib import Path

import numpy as np

from tests.support.other_labs.bench import Axis, run
from tests.support.other_labs.truth import Truth


def _pair(**how) -> tuple[Axis, Axis]:
    return run(0, **how), run(1, **how)


def _held(values: np.ndarray) -> np.ndarray:
    at = np.maximum.accumulate(np.where(np.isfinite(values), np.arange(len(values)), 0))
    return values[at]


def _write(path: Path, header: str, columns, separator=",", digits=5, comma=False) -> Path:
    lines = [header] if header else []
    for row in zip(*columns, strict=True):
        cells = [one if isinstance(one, str) else f"{one:.{digits}f}" for one in row]
        line = separator.join(cells)
        lines.append(line.replace(".", ",") if comma else line)
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def german_hobby(folder: Path, seed: int = 0):
    """Semicolons, decimal commas, degrees about 90, millimetres, -1 for no ball."""
    x, y = _pair(seed=seed, course_kind="squares")
    balls = [1000 * _held(a.seen) for a in (x, y)]
    lost = slice(len(x.t) // 3, len(x.t) // 3 + 80)
    for ball in balls:
        ball[lost] = -1
    servo = [90 + np.degrees(x.command), 90 - np.degrees(y.command)]
    path = _write(
        folder / "messung.csv",
        "Zeit [ms];Servo X Soll [°];Servo Y Soll [°];Kugel X [mm];Kugel Y [mm]",
        [1000 * x.t, *servo, *balls],
        ";",
        2,
        comma=True,
    )
    return path, Truth((x, y))


def matlab_motors(folder: Path, seed: int = 0):
    """A struct in a MAT file (version 5): volts and angles; a motor turns the other way."""
    from scipy.io import savemat

    x, y = _pair(seed=seed, motor=True, course_kind="wander", dead=0)
    data = {
        "time": x.t,
        "theta1": x.angle,
        "theta2": -y.angle,
        "vm1": x.volts,
        "vm2": y.volts,
        "xb": _held(x.seen),
        "yb": _held(y.seen),
    }
    path = folder / "run3.mat"
    savemat(path, {"data": data, "Kp": np.eye(2), "note": "third run"}, oned_as="column")
    return path, Truth((x, y), ("theta", "voltage"))


def lerobot(folder: Path, seed: int = 0):
    """A LeRobot data set: two episodes, degrees in the names, centimetres."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    x, y = _pair(seed=seed, control_hz=50, frame_hz=50, course_kind="circle")
    root = folder / "table_set"
    (root / "meta").mkdir(parents=True)
    (root / "data/chunk-000").mkdir(parents=True)
    n = len(x.t)
    half = n // 2
    episode = (np.arange(n) >= half).astype(int)
    stamp = np.where(episode, x.t - x.t[half], x.t)
    action = np.degrees(np.column_stack((y.command, x.command))).astype(np.float32)
    state = 100 * np.column_stack((_held(x.seen), _held(y.seen))).astype(np.float32)
    info = {
        "codebase_version": "v3.0",
        "fps": 50,
        "features": {
            "action": {"dtype": "float32", "shape": [2], "names": ["servo_a_deg", "servo_b_deg"]},
            "observation.state": {
                "dtype": "float32",
                "shape": [2],
                "names": {"axes": ["ball_x_cm", "ball_y_cm"]},
            },
        },
    }
    (root / "meta/info.json").write_text(json.dumps(info), encoding="utf-8")
    table = pa.table(
        {
            "action": pa.array(list(action), pa.list_(pa.float32(), 2)),
            "observation.state": pa.array(list(state), pa.list_(pa.float32(), 2)),
            "timestamp": pa.array(stamp.astype(np.float32)),
            "frame_index": pa.array(np.arange(n)),
            "episode_index": pa.array(episode),
            "index": pa.array(np.arange(n)),
            "task_index": pa.array(np.zeros(n, int)),
        }
    )
    pq.write_table(table, root / "data/chunk-000/file-000.parquet")
    return root, Truth((x, y))


POINT = """std_msgs/Header header
geometry_msgs/Point point
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: geometry_msgs/Point
float64 x
float64 y
float64 z
"""
JOINTS = """std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
"""


def ros(folder: Path, seed: int = 0):
    """A ROS 2 bag: the ball in metres on a topic of its own, commands and joints with names."""
    from mcap_ros2.writer import Writer

    x, y = _pair(seed=seed, frame_hz=40, course_kind="wander")
    path = folder / "bag_0.mcap"
    start = 1_700_000_000_000_000_000
    with path.open("wb") as file:
        writer = Writer(file)
        point = writer.register_msgdef("geometry_msgs/msg/PointStamped", POINT)
        joints = writer.register_msgdef("sensor_msgs/msg/JointState", JOINTS)
        for k, t in enumerate(x.t):
            at = start + int(1e9 * t)
            header = {"stamp": {"sec": at // 10**9, "nanosec": at % 10**9}, "frame_id": "plate"}
            if np.isfinite(x.seen[k]):
                place = {"x": float(y.seen[k]), "y": float(x.seen[k]), "z": 0.0}
                message = {"header": header, "point": place}
                writer.write_message("/ball", point, message, log_time=at, publish_time=at)
            for topic, a, b in (
                ("/servo_command", x.command[k], y.command[k]),
                ("/joint_states", x.angle[k], y.angle[k]),
            ):
                message = {
                    "header": header,
                    "name": ["roll_servo_rad", "pitch_servo_rad"],
                    "position": [float(a), float(b)],
                    "velocity": [],
                    "effort": [],
                }
                writer.write_message(topic, joints, message, log_time=at, publish_time=at)
        writer.finish()
    return path, Truth((x, y), ("command", "theta"))


def labview(folder: Path, seed: int = 0):
    """TDMS: units as properties of the channels, no time but the waveform's step."""
    from nptdms import ChannelObject, TdmsWriter

    x, y = _pair(seed=seed, motor=True, dead=0)
    signals = {
        "AO motor x": (x.volts, "V"),
        "AO motor y": (-y.volts, "V"),
        "encoder x": (np.degrees(x.angle), "deg"),
        "encoder y": (np.degrees(y.angle), "deg"),
        "ball x": (-1000 * _held(x.seen), "mm"),
        "ball y": (1000 * _held(y.seen), "mm"),
        "room temperature": (np.full(len(x.t), 21.0), "degC"),
    }
    path = folder / "test.tdms"
    with TdmsWriter(path) as writer:
        writer.write_segment(
            [
                ChannelObject("DAQ", name, values, {"unit_string": unit, "wf_increment": 0.01})
                for name, (values, unit) in signals.items()
            ]
        )
    return path, Truth((x, y), ("theta", "voltage"))


def pixels(folder: Path, seed: int = 0):
    """A camera script: pixels without a calibration; nothing says how many are a metre."""
    x, y = _pair(seed=seed, frame_hz=30, control_hz=50)
    u, v = 320 + 1500 * _held(x.seen), 240 - 1500 * _held(y.seen)
    path = _write(
        folder / "track.csv",
        "timestamp_s,u_px,v_px,servo_x_cmd_rad,servo_y_cmd_rad",
        [x.t, u, v, x.command, y.command],
    )
    return path, Truth((x, y))


def arduino(folder: Path, seed: int = 0):
    """A serial monitor's text: no names, tabs, milliseconds since power-on, pulse widths."""
    x, y = _pair(seed=seed)
    pulse = [1500 + 1000 * a.command / (np.pi / 2) for a in (x, y)]
    balls = [500 + 2000 * _held(a.seen) for a in (x, y)]
    path = _write(folder / "monitor.txt", "", [4231 + 1000 * x.t, *balls, *pulse], "\t", 0)
    return path, Truth((x, y))


def simulink(folder: Path, seed: int = 0):
    """Simulink's structure with time, version 7.3: commands in degrees, ball in metres."""
    import h5py

    x, y = _pair(seed=seed, course_kind="squares")
    path = folder / "logsout.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        group = file.create_group("ScopeData")
        group.attrs["MATLAB_class"] = np.bytes_("struct")
        group["time"] = x.t[None, :]
        refs = file.create_group("#refs#")
        values = {
            "ball position (m)": np.vstack((_held(x.seen), _held(y.seen))),
            "servo command (deg)": np.degrees(np.vstack((-x.command, y.command))),
        }
        signals = group.create_group("signals")
        signals.attrs["MATLAB_class"] = np.bytes_("struct")
        for key in ("values", "label"):
            signals.create_dataset(key, (2, 1), dtype=h5py.ref_dtype)
        for i, (label, matrix) in enumerate(values.items()):
            refs[f"v{i}"] = matrix
            refs[f"l{i}"] = np.array([[ord(c)] for c in label], np.uint16)
            refs[f"l{i}"].attrs["MATLAB_class"] = np.bytes_("char")
            signals["values"][i, 0] = refs[f"v{i}"].ref
            signals["label"][i, 0] = refs[f"l{i}"].ref
    head = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM"
    with path.open("r+b") as file:
        file.write(head)
    return path, Truth((x, y))


def stutter(folder: Path, seed: int = 0):
    """A date a row on a 10 ms grid, 20 to 50 ms apart, 0 for no ball, many other columns."""
    rng = np.random.default_rng(seed)
    x, y = _pair(seed=seed, course_kind="squares", frame_hz=100)
    rows = np.cumsum(rng.integers(2, 6, len(x.t) // 3))
    rows = rows[rows < len(x.t)]
    balls = [_held(a.seen)[rows] for a in (x, y)]
    balls[1] = -balls[1]
    for start in (100, 400):
        for ball in balls:
            ball[start : start + 30] = 0.0
    stamps = []
    for t in x.t[rows]:
        stamps.append(f"2024-03-05 14:{int(t // 60):02d}:{t % 60:06.3f}")
    n = len(rows)
    start_s = float(x.t[rows[0]])
    path = _write(
        folder / "log_2024.csv",
        "fps,date,temperature_C,ball_y_m,plate_servo_y_deg_cmd,ball_x_m,loop_us,"
        "plate_servo_x_deg_cmd,error_x,target_x_m",
        [
            30 + rng.standard_normal(n),
            stamps,
            22 + 0.1 * rng.standard_normal(n),
            balls[1],
            np.degrees(y.command[rows]),
            balls[0],
            900 + 50 * rng.standard_normal(n),
            np.degrees(x.command[rows]),
            x.target[rows] - balls[0],
            x.target[rows],
        ],
    )
    return path, Truth((x, y), start_s=start_s)


def appended(folder: Path, seed: int = 0):
    """Three sessions in one file, the time starts anew; swapped servos, both told and measured."""
    parts, header = [], "t (s),servo1_set (rad),servo2_set (rad),servo1_actual (rad),"
    header += "servo2_actual (rad),ball x (cm),ball y (cm)"
    first = None
    for session in range(3):
        x, y = _pair(seed=seed + session, course_kind="wander", seconds=25)
        first = first or (x, y)
        balls = [100 * _held(x.seen), 100 * _held(y.seen)]
        for ball in balls:
            ball[700:760] = np.nan
        parts.append(np.column_stack((x.t, y.command, -x.command, y.angle, -x.angle, *balls)).T)
    path = _write(folder / "sessions.csv", header, np.hstack(parts))
    assert first is not None
    return path, Truth(first, ("command", "theta"))


def plotter(folder: Path, seed: int = 0):
    """A microcontroller's lines for a serial plotter: a boot message, a name and a unit with each
    number, no ball's names where there is no ball."""
    x, y = _pair(seed=seed, course_kind="squares")
    balls = [1000 * _held(a.seen) for a in (x, y)]
    lost = range(len(x.t) // 3, len(x.t) // 3 + 80)
    lines = ["ball balancer, firmware 3"]
    for k, t in enumerate(x.t):
        servos = np.degrees([x.command[k], -y.command[k]]) + 90
        said = [
            f"t={1000 * t:.0f} ms",
            *(f"servo {a} cmd = {s:.2f} deg" for a, s in zip("xy", servos, strict=True)),
        ]
        seen = [f"ball {a} = {b[k]:.2f}mm" for a, b in zip("xy", balls, strict=True)]
        lines.append(", ".join(said if k in lost else said + seen))
    path = folder / "serial.log"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path, Truth((x, y))


def web(folder: Path, seed: int = 0):
    """A web page's JSON Lines: times as texts, objects within objects, null for no ball."""
    x, y = _pair(seed=seed, course_kind="wander")
    lost = range(len(x.t) // 4, len(x.t) // 4 + 60)
    places = [100 * _held(a.seen) for a in (x, y)]
    path = folder / "session.jsonl"
    with path.open("w", encoding="utf-8") as file:
        for k, t in enumerate(x.t):
            at = np.datetime64("2026-03-29T11:59:50", "us") + int(round(1e6 * t))
            ball = {f"{a}_cm": round(p[k], 3) for a, p in zip("xy", places, strict=True)}
            tilt = {"x": round(x.command[k], 5), "y": round(-y.command[k], 5), "unit": "rad"}
            one = {"at": f"{at}Z", "ball": None if k in lost else ball, "tilt_cmd_rad": tilt}
            file.write(json.dumps(one) + "\n")
    return path, Truth((x, y))


def dutch(folder: Path, seed: int = 0):
    """Dutch names, tabs, decimal commas; the servo of y turns the other way."""
    x, y = _pair(seed=seed, course_kind="squares")
    columns = [x.t, *(100 * _held(a.seen) for a in (x, y))]
    columns += [np.degrees(x.command), -np.degrees(y.command)]
    names = (
        "Tijd (s)",
        "Bal X (cm)",
        "Bal Y (cm)",
        "Hoek X gewenst (graden)",
        "Hoek Y gewenst (graden)",
    )
    return _write(folder / "meting.txt", "\t".join(names), columns, "\t", 3, comma=True), Truth(
        (x, y)
    )


LABS = {
    one.__name__: one
    for one in (
        german_hobby,
        matlab_motors,
        lerobot,
        ros,
        labview,
        pixels,
        arduino,
        simulink,
        stutter,
        appended,
        plotter,
        web,
        dutch,
    )
}
