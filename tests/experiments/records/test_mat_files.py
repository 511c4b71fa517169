"""MAT files of version 7.3 are HDF5 with every array transposed, as MATLAB writes them."""

import h5py
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.io import savemat
from scipy.sparse import csc_matrix

from experiments.importing.formats.choose import read_recording
from experiments.importing.formats.matlab import read_matlab
from experiments.records.importing import read_log, read_logs
from tests.support.gap.logs import log_of, table_log

HEADER = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM"


def write_7_3(path, columns, *, struct=None, row_vectors=False):
    """Write `columns` as MATLAB's save(..., '-v7.3') lays them out."""
    with h5py.File(path, "w", userblock_size=512) as file:
        group = file.create_group(struct) if struct else file
        if struct:
            group.attrs["MATLAB_class"] = np.bytes_("struct")
        for name, values in columns.items():
            values = np.asarray(values)
            shape = (len(values), 1) if row_vectors else (1, len(values))
            data = group.create_dataset(name, data=values.reshape(shape))
            data.attrs["MATLAB_class"] = np.bytes_("double")
        file.create_group("#refs#")
    with path.open("r+b") as file:
        file.write(HEADER.ljust(512, b"\0"))
    return path


@settings(max_examples=15, suppress_health_check=[HealthCheck.too_slow])
@given(
    order=st.permutations(list(table_log(seconds=0.01))),
    struct=st.sampled_from([None, "log"]),
    rows=st.booleans(),
)
def test_columns_and_structs_are_read_exactly(tmp_path_factory, order, struct, rows):
    columns = table_log(seconds=1.0)
    path = tmp_path_factory.mktemp("mat") / "log.mat"
    write_7_3(path, {name: columns[name] for name in order}, struct=struct, row_vectors=rows)
    log = read_log(path)
    np.testing.assert_array_equal(log.rows, log_of(columns).rows)


def test_unknown_names_are_said_and_not_read(tmp_path):
    columns = {"t_s": np.arange(3.0), "ball_x_m": np.ones(3), "mood": np.ones(7)}
    log = read_log(write_7_3(tmp_path / "log.mat", columns))
    assert log.notes[0] == "unknown columns left out: mood"


def test_what_is_no_column_is_refused_in_one_line(tmp_path):
    path = write_7_3(tmp_path / "log.mat", {"t_s": np.arange(4.0)})
    with h5py.File(path, "r+") as file:
        file.create_group("theta_x_rad")
    with pytest.raises(ValueError, match="theta_x_rad is no column of numbers"):
        read_log(path)
    with h5py.File(path, "r+") as file:
        del file["theta_x_rad"]
        file["theta_x_rad"] = np.array([[72, 105]], np.uint16)
        file["theta_x_rad"].attrs["MATLAB_class"] = np.bytes_("char")
    with pytest.raises(ValueError, match="theta_x_rad is no column of numbers"):
        read_log(path)
    with h5py.File(path, "r+") as file:
        del file["theta_x_rad"]
        file["theta_x_rad"] = np.array([0, 0], np.uint64)
        file["theta_x_rad"].attrs["MATLAB_empty"] = 1
    with pytest.raises(ValueError, match="no values in any of"):
        read_log(path)


def test_a_matlab_table_names_the_cure(tmp_path):
    path = write_7_3(tmp_path / "log.mat", {"T": np.arange(6.0)})
    with h5py.File(path, "r+") as file:
        file.create_group("#subsystem#")
    with pytest.raises(ValueError, match="table2struct"):
        read_log(path)


@pytest.mark.parametrize("share", [0.3, 0.6, 0.95])
def test_damaged_files_are_refused_in_one_line(tmp_path, share):
    path = write_7_3(tmp_path / "log.mat", table_log(seconds=2.0))
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(ValueError, match="log") as caught:
        read_log(path)
    assert "\n" not in str(caught.value)


def test_a_column_that_lies_in_another_file_is_refused(tmp_path):
    """Else a file from a stranger would read any file of this machine."""
    other = tmp_path / "other.h5"
    with h5py.File(other, "w") as file:
        file["theta_x_rad"] = np.zeros((1, 4))
    secret = tmp_path / "secret"
    secret.write_bytes(bytes(32))
    for way in ("external", "link", "soft", "virtual"):
        path = write_7_3(tmp_path / f"{way}.mat", {"t_s": np.arange(4.0)})
        with h5py.File(path, "r+") as file:
            if way == "link":
                file["theta_x_rad"] = h5py.ExternalLink(str(other), "theta_x_rad")
            elif way == "soft":
                columns = {name: file[name][()] for name in file if name != "#refs#"}
                for name, values in columns.items():
                    file[f"log/{name}"] = values
                    del file[name]
                file["zoo"] = h5py.ExternalLink(str(other), "/")
                file["log/theta_x_rad"] = h5py.SoftLink("/zoo/theta_x_rad")
            elif way == "external":
                storage = [(str(secret), 0, h5py.h5f.UNLIMITED)]
                file.create_dataset("theta_x_rad", (1, 4), "f8", external=storage)
            else:
                layout = h5py.VirtualLayout((1, 4), "f8")
                layout[:] = h5py.VirtualSource(str(other), "theta_x_rad", (1, 4))
                file.create_virtual_dataset("theta_x_rad", layout)
        with pytest.raises(ValueError, match="theta_x_rad lies in another file"):
            read_log(path)


@pytest.mark.parametrize("read", [read_log, read_recording])
def test_a_link_to_nothing_is_named(tmp_path, read):
    path = write_7_3(tmp_path / "log.mat", {"t_s": np.arange(40.0)})
    with h5py.File(path, "r+") as file:
        file["theta_x_rad"] = h5py.SoftLink("/what was deleted")
    with pytest.raises(ValueError, match="theta_x_rad is a link to nothing: delete it"):
        read(path)


def test_a_column_that_no_file_of_its_size_can_hold_is_refused(tmp_path):
    path = write_7_3(tmp_path / "log.mat", {"t_s": np.arange(4.0)})
    with h5py.File(path, "r+") as file:
        shape = (1, 1 << 27)
        file.create_dataset("theta_x_rad", shape, "f8", chunks=(1, 1 << 16), compression="gzip")
    assert path.stat().st_size < 1 << 20
    with pytest.raises(ValueError, match="theta_x_rad claims 1073741824 bytes, more than its"):
        read_log(path)


def test_text_is_refused_before_it_is_read(tmp_path, monkeypatch):
    """Sixty thousand entries may be one text of 1 MB."""
    path = write_7_3(tmp_path / "log.mat", {"ball_x_m": np.arange(30.0)})
    with h5py.File(path, "r+") as file:
        file.create_dataset("t_s", (30,), h5py.string_dtype())
        file["t_s"].attrs["MATLAB_class"] = np.bytes_("double")
        file["more"] = file["t_s"]
    read, asked = h5py.Dataset.__getitem__, []

    def recorded(self, *what):
        asked.append(self.dtype.kind)
        return read(self, *what)

    monkeypatch.setattr(h5py.Dataset, "__getitem__", recorded)
    with pytest.raises(ValueError, match="t_s is no column of numbers"):
        read_log(path)
    read_matlab(path)
    assert asked == ["f"] * len(asked)


def test_a_sparse_column_is_refused_by_the_files_name(tmp_path):
    path = tmp_path / "sparse.mat"
    savemat(path, {"t_s": csc_matrix(np.arange(30.0)[:, None]), "ball_x_m": np.arange(30.0)})
    with pytest.raises(ValueError, match=r"sparse\.mat: t_s is no column of numbers"):
        read_logs(path)
