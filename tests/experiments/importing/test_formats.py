"""Files of every format, written by the formats' own libraries."""

import json
import subprocess
import sys
from pathlib import Path
from zipfile import ZipFile

import h5py
import numpy as np
import pytest

from experiments.importing.formats.bags import LONGEST_MESSAGE
from experiments.importing.formats.choose import read_recording
from experiments.importing.recording import BadFileError

T = np.arange(50) * 0.02
X = np.sin(T)


def columns(path: Path) -> dict[str, np.ndarray]:
    return dict(read_recording(path).stream.columns)


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("t,x\n0,1.5\n0.1,2.5\n0.2,3.5\n", ["t", "x"]),
        ("t;x\n0;1,5\n0,1;2,5\n0,2;3,5\n", ["t", "x"]),
        ("t\tx\t\n0\t1.5\t\n0.1\t2.5\t\n0.2\t3.5\t\n", ["t", "x"]),
        ("0 1.5\n0.1 2.5\n0.2 3.5\n", ["column 1", "column 2"]),
        ("0,0 1,5\n0,1 2,5\n0,2 3,5\n", ["column 1", "column 2"]),
        ("# made by us\n# 2024\n# t,x\n0,1.5\n0.1,2.5\n0.2,3.5\n", ["t", "x"]),
        ("lab 3\n\nt,x\ns,mm\n0,1.5\n0.1,2.5\n0.2,3.5\n", ["t", "x"]),
        ('"t";"x"\n"0";"1,5"\n"0,1";"2,5"\n"0,2";"3,5"\n', ["t", "x"]),
        ("t|x\n00:00:00|1.5\n00:00:00.1|2.5\n00:00:00.2|3.5\n", ["t", "x"]),
    ],
)
def test_text_of_many_hands(text: str, names: list[str], tmp_path: Path):
    path = tmp_path / "a.csv"
    path.write_text(text, encoding="utf-8")
    found = columns(path)
    assert list(found)[:2] == names
    values = list(found.values())
    np.testing.assert_allclose(values[0], [0, 0.1, 0.2], atol=1e-9)
    np.testing.assert_allclose(values[1], [1.5, 2.5, 3.5])


def test_text_blanks_words_units_and_encodings(tmp_path: Path):
    path = tmp_path / "a.csv"
    path.write_bytes("t;Winkel;Ort\ns;°;mm\n0;1;\n0,1;NaN;2\n0,2;aus;3\n".encode("latin-1"))
    stream = read_recording(path).stream
    assert stream.units == {"t": "s", "Winkel": "°", "Ort": "mm"}
    assert np.isnan(stream.columns["Winkel"][1:]).all()
    assert np.isnan(stream.columns["Ort"][0])
    path.write_text("t,x\nseconds,millimeters\n1,2\n3,4\n", encoding="utf-8")
    assert read_recording(path).stream.units == {"t": "seconds", "x": "millimeters"}
    path.write_text("t,x\n1,2\n3,4\n", encoding="utf-16")
    assert list(columns(path)) == ["t", "x"]


def test_lines_that_were_cut_off_are_left_out_and_told(tmp_path: Path):
    path = tmp_path / "a.csv"
    path.write_text("t,x,y\n" + "".join(f"{i},1,2\n" for i in range(300)) + "300,1", "utf-8")
    recording = read_recording(path)
    assert len(recording.stream) == 300
    assert recording.notes == ("lines without 3 cells, left out: 1 of 301",)
    path.write_text("t,x,y\n" + "".join(f"{i},1{',2' * (i % 150 != 9)}\n" for i in range(300)))
    recording = read_recording(path)
    assert len(recording.stream) == 298
    assert recording.notes == ("lines without 3 cells, left out: 2 of 300",)


def test_matlab_5_variables_structs_and_matrices(tmp_path: Path):
    from scipy.io import savemat

    path = tmp_path / "a.mat"
    deep = {"servo": {"angle": X, "cmd": X + 1}, "K": np.eye(3)}
    savemat(path, {"t": T, "data": deep, "xy": np.column_stack((X, -X)), "name": "run"})
    found = columns(path)
    assert set(found) == {"t", "xy[1]", "xy[2]", "data.servo.angle", "data.servo.cmd"}
    np.testing.assert_array_equal(found["xy[2]"], -X)


def test_matlab_to_file_matrix_has_its_time_in_the_first_row(tmp_path: Path):
    from scipy.io import savemat

    path = tmp_path / "a.mat"
    savemat(path, {"ans": np.vstack((T, X, 2 * X))})
    np.testing.assert_array_equal(columns(path)["ans[3]"], 2 * X)


def test_matlab_streams_with_clocks_of_their_own_are_joined(tmp_path: Path):
    from scipy.io import savemat

    path = tmp_path / "a.mat"
    slow = T[::5] + 0.001
    fast = {"time": T, "u": X}
    savemat(path, {"fast": fast, "cam": {"time": np.tile(slow, 4), "x": np.tile(slow, 4)}})
    recording = read_recording(path)
    seen = recording.stream.columns["cam.x"]
    assert np.isfinite(seen).sum() == 10
    rows = np.flatnonzero(np.isfinite(seen))
    assert np.all(T[rows] >= seen[rows])  # nothing is known before it happened
    assert "late" in " ".join(recording.notes)


def test_matlab_73_and_objects_that_only_matlab_reads(tmp_path: Path):
    import h5py

    path = tmp_path / "a.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        file["t"], file["x"] = T[None, :], X[None, :]
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
    np.testing.assert_array_equal(columns(path)["x"], X)
    with h5py.File(path, "w") as file:
        file["logsout"] = np.zeros((1, 6), np.uint32)
        file["logsout"].attrs["MATLAB_object_decode"] = 3
    with pytest.raises(BadFileError, match="Structure with time"):
        columns(path)


def test_parquet_with_units_and_lists(tmp_path: Path):
    import pyarrow as pa
    import pyarrow.parquet as pq

    path = tmp_path / "a.parquet"
    field = pa.field("x", pa.float32(), metadata={"unit": "mm"})
    arrays = [pa.array(T), pa.array(X.astype(np.float32)), pa.array([[1.0, 2.0]] * len(T))]
    names = [pa.field("t", pa.float64()), field, pa.field("cmd", pa.list_(pa.float64()))]
    pq.write_table(pa.Table.from_arrays(arrays, schema=pa.schema(names)), path)
    stream = read_recording(path).stream
    assert list(stream.columns) == ["t", "x", "cmd[0]", "cmd[1]"]
    assert stream.units == {"x": "mm"}


def test_mcap_json_topics(tmp_path: Path):
    from mcap.writer import Writer

    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("ball", "jsonschema", b"{}")
        channel = writer.register_channel("/ball", "json", schema)
        for t, x in zip(T, X, strict=True):
            data = json.dumps({"place": {"x": x}, "note": "a", "picture": [0] * 100}).encode()
            at = int(1e9 * t) + 10**18
            writer.add_message(channel, log_time=at, data=data, publish_time=at)
        writer.finish()
    found = columns(path)
    assert list(found) == ["ball.time", "ball.place.x"]
    np.testing.assert_allclose(found["ball.place.x"], X)
    np.testing.assert_allclose(np.diff(found["ball.time"]), 0.02, atol=1e-6)


def test_an_mcap_file_that_was_cut_off_is_read_as_far_as_it_goes(tmp_path: Path):
    from mcap.writer import Writer

    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=500)
        writer.start()
        channel = writer.register_channel("/b", "json", writer.register_schema("b", "", b""))
        for t in T:
            writer.add_message(channel, int(1e9 * t), json.dumps({"x": t}).encode(), 0)
        writer.finish()
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    recording = read_recording(path)
    assert 10 < len(recording.stream) < 50
    assert "cut off" in recording.notes[0]


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells a program's own most memory")
def test_an_mcap_file_without_its_end_that_unpacks_to_gigabytes_is_refused(tmp_path: Path):
    from mcap.writer import CompressionType, Writer

    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=1 << 27, compression=CompressionType.ZSTD)
        writer.start()
        channel = writer.register_channel("/b", "json", writer.register_schema("b", "", b""))
        for t in range(900):
            writer.add_message(channel, t, b'{"x": 1, "pad": "' + b"a" * 10**6 + b'"}', 0)
        writer.finish()
    path.write_bytes(path.read_bytes()[:-8])
    assert path.stat().st_size < 200_000
    read = "from pathlib import Path\n"
    read += "from experiments.importing.formats.choose import read_recording\n"
    read += f"try: read_recording(Path({str(path)!r}))\n"
    read += "except ValueError as error: print(error)\n"
    # Not ru_maxrss, which a program takes over from the one that starts it.
    read += "print(Path('/proc/self/status').read_text().split('VmHWM:')[1].split()[0])"
    done = subprocess.run([sys.executable, "-c", read], capture_output=True, text=True, check=True)
    said, most_kB = done.stdout.splitlines()
    assert "chunks hold more than" in said
    assert int(most_kB) < 700_000


def test_messages_are_sorted_by_their_time_and_lack_what_they_lack(tmp_path: Path):
    from mcap.writer import Writer

    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel("/b", "json", writer.register_schema("b", "", b""))
        for t in (3, 1, 2):
            row = {"x": t} if t < 3 else {"x": t, "y": 7}
            writer.add_message(channel, t * 10**9, json.dumps(row).encode(), 0)
        writer.finish()
    found = columns(path)
    assert found["b.time"].tolist() == [1, 2, 3]
    assert found["b.x"].tolist() == [1, 2, 3]
    np.testing.assert_array_equal(found["b.y"], [np.nan, np.nan, 7])


@pytest.mark.parametrize(
    ("name", "data", "says"),
    [
        ("a.csv", b"", "empty"),
        ("a.csv", b"hello\nworld\n", "no rows of numbers"),
        ("a.csv", b"\x00" * 100, "no text"),
        ("a.csv", b"t,t\n1,2\n3,4\n", "twice"),
        ("a.csv", ",".join(f"c{i}" for i in range(10**6)).encode() + b"\n", "1000000 columns"),
        ("a.csv", b"1," * 10**6 + b"1\n", "columns"),
        ("a.mat", b"", "not readable"),
        (
            "a.mat",
            b"MATLAB 5.0 MAT-file".ljust(126) + b"IM" + b"\x0f\0\0\0\x10\0\0\0zz",
            "not readable",
        ),
        ("a.mat", b"MATLAB 7.3 MAT-file".ljust(600), "7.3"),
        ("a.parquet", b"PAR1", "Parquet"),
        ("a.mcap", b"\x89MCAP0\r\n" + b"\x01" * 40, "MCAP"),
        ("a.mcap", b"", "MCAP"),
        ("a.npz", b"PK\x03\x04", "npz"),
        ("a.npy", b"\x93NUMPY", "npy"),
        ("a.npy", b"", "npy"),
        ("a.ods", b"PK", r"no kind of recording.*as \.xlsx or \.csv"),
    ],
)
def test_bad_files_get_one_line(name: str, data: bytes, says: str, tmp_path: Path):
    path = tmp_path / name
    path.write_bytes(data)
    with pytest.raises(BadFileError, match=says) as caught:
        read_recording(path)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 600


def test_a_run_of_the_rig_is_not_imported(tmp_path: Path):
    for name in ("run.json", "samples.mcap"):
        (tmp_path / name).touch()
    with pytest.raises(BadFileError, match="is a run of the rig"):
        read_recording(tmp_path)


def test_numpy_files_without_pythons_objects(tmp_path: Path):
    np.savez(tmp_path / "a.npz", t=T, x=X, who=np.array([{"a": 1}], dtype=object), g=np.eye(3))
    assert set(columns(tmp_path / "a.npz")) == {"t", "x"}
    np.save(tmp_path / "a.npy", np.column_stack((T, X)))
    assert list(columns(tmp_path / "a.npy")) == ["column 1", "column 2"]
    np.save(tmp_path / "b.npy", np.array(list(zip(T, X, strict=True)), [("t", "f8"), ("x", "f4")]))
    assert list(columns(tmp_path / "b.npy")) == ["t", "x"]
    np.save(tmp_path / "c.npy", np.array([{"a": 1}] * 30, dtype=object))
    with pytest.raises(BadFileError, match=r"\.npy"):
        read_recording(tmp_path / "c.npy")
    np.savez(tmp_path / "d.npz", who=np.array([{"a": 1}], dtype=object))
    with pytest.raises(BadFileError, match="no rows of numbers"):
        read_recording(tmp_path / "d.npz")


def test_damaged_or_odd_numpy_files_get_one_line_and_good_arrays_stay(tmp_path: Path, monkeypatch):
    packed = tmp_path / "notes.npz"
    np.savez(packed, t=T, x=X)
    with ZipFile(packed, "a") as file:
        file.writestr("README.txt", "made on a Tuesday")
    assert set(columns(packed)) == {"t", "x"}

    whole = packed.read_bytes()
    array, listed = whole.index(b"\x93NUMPY"), whole.index(b"PK\x01\x02")
    for name, at, new in (
        ("locked.npz", listed + 8, b"\x01"),
        ("method.npz", listed + 10, b"\x63"),
        ("head.npz", array + 12, b"(" * 40),
    ):
        data = whole[:at] + new + whole[at + len(new) :]
        (tmp_path / name).write_bytes(data)
        with pytest.raises(BadFileError) as caught:
            read_recording(tmp_path / name)
        assert "\n" not in str(caught.value)

    for name, shape in (("one.npy", ()), ("none.npy", (0, 10**12))):
        np.save(tmp_path / name, np.broadcast_to(np.zeros(()), shape))
        with pytest.raises(BadFileError, match="no rows of numbers"):
            read_recording(tmp_path / name)
    np.save(tmp_path / "wide.npy", np.zeros((1, 100_000), np.uint8))
    made = []
    monkeypatch.setattr("experiments.importing.formats.numpy_files._some", made.append)
    with pytest.raises(BadFileError, match="100000 columns"):
        read_recording(tmp_path / "wide.npy")
    assert not made


def test_bombs_are_refused_before_they_are_unpacked(tmp_path: Path, monkeypatch):
    import h5py
    import pyarrow as pa
    import pyarrow.parquet as pq
    from scipy.io import savemat

    path = tmp_path / "huge.mat"
    with h5py.File(path, "w") as file:  # a terabyte that was never written
        file.create_dataset("x", (10**11, 10), "f8", chunks=(1000, 10))
    with pytest.raises(BadFileError, match="limit"):
        read_recording(path)
    monkeypatch.setattr("experiments.importing.formats.matlab.MAX_CELLS", 10_000)
    monkeypatch.setattr("experiments.importing.recording.MAX_CELLS", 10_000)
    savemat(tmp_path / "bomb.mat", {"x": np.zeros(100_000)}, do_compression=True)
    with pytest.raises(BadFileError, match="unpacks"):
        read_recording(tmp_path / "bomb.mat")
    pq.write_table(pa.table({"x": np.zeros(100_000)}), tmp_path / "bomb.parquet")
    with pytest.raises(BadFileError, match="limit"):
        read_recording(tmp_path / "bomb.parquet")
    np.savez_compressed(tmp_path / "bomb.npz", x=np.zeros(100_000))
    with pytest.raises(BadFileError, match="limit"):
        read_recording(tmp_path / "bomb.npz")


@pytest.mark.parametrize("way", ["external", "link", "soft", "virtual", "reference"])
def test_no_file_from_elsewhere_is_read(way: str, tmp_path: Path):
    """Else a log from a stranger would put any file of this machine into what is made of it."""
    import h5py

    path, other, secret = tmp_path / "log.mat", tmp_path / "other.h5", tmp_path / "secret"
    secret.write_bytes(bytes(800))
    with h5py.File(other, "w") as file:
        file["theta"] = np.zeros((1, 100))
    with h5py.File(path, "w") as file:
        file["t"] = np.arange(100.0)[None]
        outside = [(str(secret), 0, h5py.h5f.UNLIMITED)]
        if way == "external":
            file.create_dataset("theta", (1, 100), "f8", external=outside)
        elif way == "virtual":
            layout = h5py.VirtualLayout((1, 100), "f8")
            layout[:] = h5py.VirtualSource(str(other), "theta", (1, 100))
            file.create_virtual_dataset("theta", layout)
        elif way == "reference":
            hidden = file.create_dataset("#refs#/a", (1, 100), "f8", external=outside)
            file.create_dataset("theta", (1, 1), h5py.ref_dtype)[0, 0] = hidden.ref
        else:
            file["theta" if way == "link" else "#b"] = h5py.ExternalLink(str(other), "theta")
            if way == "soft":
                file["theta"] = h5py.SoftLink("/#b")
    with pytest.raises(BadFileError, match="lies in another file"):
        read_recording(path)


@pytest.mark.parametrize(("name", "module"), [("a.tdms", "nptdms")])
def test_a_library_that_is_missing_is_named_with_its_cure(name, module, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, module, None)
    (tmp_path / name).write_bytes(b"TDSm")
    with pytest.raises(BadFileError, match="uv sync --extra import"):
        read_recording(tmp_path / name)


def test_lerobot_without_data_says_so(tmp_path: Path):
    (tmp_path / "meta").mkdir()
    (tmp_path / "meta/info.json").write_text('{"features": {}}', encoding="utf-8")
    with pytest.raises(BadFileError, match="fetch"):
        read_recording(tmp_path)
    (tmp_path / "meta/info.json").write_text("[]", encoding="utf-8")
    with pytest.raises(BadFileError, match=r"info\.json"):
        read_recording(tmp_path)


def test_an_older_bag_says_how_to_convert_it(tmp_path: Path):
    (tmp_path / "metadata.yaml").write_text("a: 1", encoding="utf-8")
    with pytest.raises(BadFileError, match="ros2 bag convert"):
        read_recording(tmp_path)


def test_groups_that_link_to_one_another_are_not_walked_for_ever(tmp_path: Path):
    """Each of 18 levels holds 8 links to the one below: 8^18 ways through a file of some kB."""
    path = tmp_path / "dag.mat"
    with h5py.File(path, "w") as file:
        below = file.create_group("g0")
        for i in range(18):
            group = file.create_group(f"g{i + 1}")
            for k in range(8):
                group[f"l{k}"] = below
            below = group
        for i in range(18):
            del file[f"g{i}"]
    assert path.stat().st_size < 100_000
    with pytest.raises(BadFileError, match="limit"):
        read_recording(path)


def test_a_message_beyond_all_measure_is_left_out(tmp_path: Path):
    from mcap.writer import Writer

    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel("/b", "json", writer.register_schema("b", "", b""))
        for t in range(30):
            row = {"x": t, "more": [[]] * (LONGEST_MESSAGE if t == 7 else 1)}
            writer.add_message(channel, t * 10**9, json.dumps(row).encode(), 0)
        writer.finish()
    stream = read_recording(path).stream
    assert stream.columns["b.x"].tolist() == [t for t in range(30) if t != 7]
