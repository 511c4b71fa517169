"""The multipart reader: the same parts however the stream is cut, and none lost to a broken one."""

from itertools import pairwise

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.stream_server import BOUNDARY, jpeg, part
from vision.sources.multipart import JpegEnd, Multipart, boundary_of

JPEGS = [jpeg(level, (16, 16)) for level in (10, 100, 200)]


def with_thumbnail(image, thumbnail):
    """A JPEG with another one inside an application segment, as cameras send them."""
    segment = b"\xff\xe1" + (2 + len(thumbnail)).to_bytes(2, "big") + thumbnail
    return image[:2] + segment + image[2:]


def cut(data, places):
    edges = [0, *sorted(p % (len(data) + 1) for p in places), len(data)]
    return [data[a:b] for a, b in pairwise(edges)]


def parts_of(chunks):
    reader = Multipart(BOUNDARY)
    found = [p for chunk in chunks for p in reader.feed(chunk)]
    return found, reader.closed


bodies = st.one_of(
    st.sampled_from([*JPEGS, with_thumbnail(JPEGS[0], JPEGS[1])]),
    st.binary(max_size=80).filter(lambda b: BOUNDARY.encode() not in b and b[:2] != b"\xff\xd8"),
)


@st.composite
def streams(draw):
    """A stream with its bodies; lengths, newlines and padding as servers have them."""
    data, expected = draw(st.sampled_from([b"", b"\r\n", b"preamble\r\n"])), []
    for _ in range(draw(st.integers(1, 4))):
        body = draw(bodies)
        newline = draw(st.sampled_from([b"\r\n", b"\n"]))
        # Without a length, the newline before the boundary is not the body's.
        length = draw(st.booleans()) or body.endswith((b"\r", b"\n", b"-"))
        stamp = draw(st.floats(1.0, 1e9))
        data += part(body, length=length, newline=newline, x_timestamp=repr(stamp))
        expected.append((body, repr(stamp)))
    closed = draw(st.booleans())
    return data + f"--{BOUNDARY}{'--' if closed else ''}\r\n".encode(), expected, closed


@settings(max_examples=200)
@given(streams(), st.lists(st.integers(0, 1 << 16), max_size=12))
def test_any_cut_gives_every_part_with_its_headers(stream, places):
    data, expected, closed = stream
    found, ended = parts_of(cut(data, places))
    assert [(p.body, p.headers["x-timestamp"], p.fault) for p in found] == [
        (*pair, "") for pair in expected
    ]
    assert ended == closed


@settings(max_examples=25)
@given(streams())
def test_byte_by_byte_is_the_same(stream):
    data, expected, _ = stream
    found, _ = parts_of([data[i : i + 1] for i in range(len(data))])
    assert [p.body for p in found] == [body for body, _ in expected]


@settings(max_examples=200)
@given(st.binary(max_size=400), st.lists(st.integers(0, 1 << 16), max_size=6), st.booleans())
def test_garbage_never_breaks_the_reader_nor_hides_the_next_frame(garbage, places, length):
    name = BOUNDARY.encode()
    garbage = garbage.replace(name, b"")
    data = part(JPEGS[0][:90] + garbage, length=length) + part(JPEGS[1])
    found, _ = parts_of(cut(data, places))
    assert found[-1].body == JPEGS[1]
    assert all(p.fault or p.body for p in found)
    whole, _ = parts_of([data])
    # Neither do faults depend on the cuts, only their words on what was seen of them first.
    assert [(p.body, bool(p.fault)) for p in found] == [(p.body, bool(p.fault)) for p in whole]


@pytest.mark.parametrize("length", [True, False])
def test_a_truncated_jpeg_is_named_and_costs_no_frame_after_it(length):
    data = part(JPEGS[0][:-40], length=length) + part(JPEGS[1], length=length)
    found, _ = parts_of([data])
    assert [bool(p.fault) for p in found] == [True, False]
    assert "corrupt JPEG" in found[0].fault
    assert found[1].body == JPEGS[1]


@pytest.mark.parametrize("claimed", ["999999", "12", "99999999999", "many", "-1", "²"])
def test_a_wrong_length_costs_at_most_its_own_frame(claimed):
    wrong = part(JPEGS[0]).replace(
        b"Content-Length: %d" % len(JPEGS[0]), b"Content-Length: " + claimed.encode("latin-1")
    )
    found, _ = parts_of([wrong + part(JPEGS[1])])
    assert found[-1].body == JPEGS[1]
    assert len(found) == 2


def test_a_jpeg_is_given_before_the_next_boundary_comes():
    reader = Multipart(BOUNDARY)
    data = part(JPEGS[0], length=False)
    assert [p.body for p in reader.feed(data[:-2])] == [JPEGS[0]]  # even without its newline


def test_a_head_without_end_is_a_fault():
    found, _ = parts_of([b"--frame\r\n" + b"x: y\r\n" * 5000 + part(JPEGS[0])])
    assert [p.body for p in found if not p.fault] == [JPEGS[0]]
    assert found[0].fault


@pytest.mark.parametrize(
    ("header", "name"),
    [
        ("multipart/x-mixed-replace; boundary=frame", "frame"),
        ('multipart/x-mixed-replace;boundary="my frame"', "my frame"),
        ("multipart/x-mixed-replace; Boundary=--dashed; x=y", "dashed"),
    ],
)
def test_boundary_is_found_in_the_header(header, name):
    assert boundary_of(header) == name


@pytest.mark.parametrize("header", ["", "multipart/x-mixed-replace", "a; boundary=--"])
def test_a_missing_boundary_is_refused(header):
    with pytest.raises(ValueError, match="no boundary"):
        boundary_of(header)


@settings(max_examples=60)
@given(st.integers(0, 2**32 - 1), st.booleans(), st.integers(0, 5), st.data())
def test_the_end_of_a_jpeg_is_its_last_byte(seed, progressive, restarts, data):
    noise = np.random.default_rng(seed).integers(0, 255, (24, 40, 3), dtype=np.uint8)
    options = [cv2.IMWRITE_JPEG_PROGRESSIVE, int(progressive), cv2.IMWRITE_JPEG_RST_INTERVAL]
    image = cv2.imencode(".jpg", noise, [*options, restarts])[1].tobytes()
    assert JpegEnd().find(image + b"\r\n--frame\r\n") == len(image)
    assert JpegEnd().find(image[: data.draw(st.integers(0, len(image) - 1))]) is None
