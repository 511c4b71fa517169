"""A camera class from a user's file: what it must do, and its errors by file and class."""

import os
import subprocess
import sys
import time

import numpy as np
import pytest

from vision.sources.live import RETRY_S
from vision.sources.source_errors import StalledError, UserCameraError
from vision.sources.sources import open_source
from vision.sources.user_camera import split_address

pytestmark = pytest.mark.realtime

GOOD = """
import time
import numpy as np

class MyCamera:
    log = []

    def open(self):
        self.log.append("open")
        self.k, self.image = 0, np.zeros((6, 8, 3), np.uint8)

    def read(self):
        time.sleep(0.002)
        self.k += 1
        if self.k > 20:
            return None
        self.image[:] = self.k  # the same buffer again
        return self.image, time.monotonic()

    def close(self):
        self.log.append("close")
"""

WITH = """
import time
import numpy as np

class MyCamera:
    def __enter__(self):
        return iter_of_frames()

    def __exit__(self, *error):
        print("left")

class iter_of_frames:
    def read(self):
        time.sleep(0.002)
        return np.full((6, 8), 7, np.uint8), time.monotonic()
"""


def write(tmp_path, text):
    (tmp_path / "mine.py").write_text(text)
    return f"{tmp_path / 'mine.py'}:MyCamera"


def reading(body, *, before=""):
    return (
        f"import time\nimport numpy as np\n{before}\nclass MyCamera:\n  def read(self):\n    {body}"
    )


@pytest.mark.parametrize(
    ("address", "parts"),
    [
        ("mine.py:MyCamera", ("mine.py", "MyCamera")),
        ("C:\\rig\\mine.py:MyCamera", ("C:\\rig\\mine.py", "MyCamera")),
        ("mine.py", None),
        ("C:\\film.mp4", None),
        ("http://host:80", None),
        ("mine.py:not a name", None),
    ],
)
def test_addresses_of_classes(address, parts):
    found = split_address(address)
    assert (found and (str(found[0]), found[1])) == parts


def test_a_class_is_opened_read_to_its_end_and_closed_once(tmp_path):
    start_s = time.monotonic()
    with open_source(write(tmp_path, GOOD), start_s=start_s) as source:
        assert source.size == (8, 6)
        frames = list(source)
        assert source.stamped_by == "camera"
        log = source._reader._capture.feed._camera.log
    levels = [int(f.image[0, 0, 0]) for f in frames]
    assert levels[-1] == 20
    assert all(f.image.min() == f.image.max() for f in frames)  # copies, not the user's buffer
    assert np.all(np.diff(levels) > 0)
    assert np.all(np.diff([f.t_s for f in frames]) > 0)
    assert 0 < frames[0].t_s <= time.monotonic() - start_s
    assert len(frames) + source.dropped == 20
    assert log == ["open", "close"]


def test_a_context_manager_gives_grey_frames(tmp_path, capfd):
    with open_source(write(tmp_path, WITH)) as source:
        assert next(source).image.shape == (6, 8, 3)
        assert next(source).image.max() == 7
    assert capfd.readouterr().out == "left\n"


IMAGE = "np.zeros((4, 4, 3), np.uint8)"
WIDE = "np.broadcast_to(np.zeros((1, 1, 3), np.uint8), (9000, 9000, 3))"
MUTE = """class Mute(Exception):
  def __str__(self): raise RuntimeError
  def __float__(self): raise RuntimeError
"""
LEFT = "class Left:\n  def __float__(self): raise SystemExit(143)\n"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("x = 1 / 0", r"loading the file: ZeroDivisionError: division by zero \(line 1\)"),
        ("def f(:", "loading the file: SyntaxError"),
        ("import no_such_sdk", "ModuleNotFoundError: No module named 'no_such_sdk'"),
        ("raise SystemExit(3)", "SystemExit: 3"),
        ("class Other: pass", "no such class in that file; it has Other"),
        ("class MyCamera: pass", r"needs a method read\(\)"),
        (reading("return 1 / 0"), r"read: ZeroDivisionError: division by zero \(line 6\)"),
        (reading("pass\n  def __init__(self, port): pass"), "__init__: TypeError"),
        (reading("pass\n  def open(self): raise OSError('a\\nb')"), "open: OSError: a b"),
        (reading(f"return {IMAGE}"), r"returned ndarray, not a tuple"),
        (reading("return [1], time.monotonic()"), "the image is a list"),
        (reading(f"return {IMAGE} + 0.5, 1.0"), r"float64 of shape \(4, 4, 3\), not uint8"),
        (reading("return np.zeros((4, 4, 4), np.uint8), 1.0"), r"shape \(4, 4, 4\)"),
        (reading(f"return {IMAGE}, 'now'"), "t_s is 'now'"),
        (reading(f"return {IMAGE}, float('nan')"), "t_s is nan"),
        (reading(f"return {IMAGE}, Mute()", before=MUTE), "t_s is a Mute without a number"),
        (reading("raise Mute", before=MUTE), "read: Mute: its words cannot be read"),
        (reading("raise ValueError('ab' * 10**6)"), "read: ValueError: (ab){250} "),
        (
            reading("raise asyncio.CancelledError", before="import asyncio"),
            "read: CancelledError",
        ),
        (
            reading("pass\n  def __init__(self): raise GeneratorExit"),
            "__init__: GeneratorExit",
        ),
        (
            reading("pass\n  @property\n  def open(self): raise SystemExit(143)"),
            "open: SystemExit: 143",
        ),
        (reading(f"return {IMAGE}, Left()", before=LEFT), "read: SystemExit: 143"),
        (
            reading(f"return {WIDE}, 1.0"),
            "9000 x 9000 pixels, over 67108864",
        ),
        (reading(f"return {IMAGE}, time.time()"), r"time.monotonic\(\) is .*use that clock"),
        (
            reading(f"return {IMAGE}, NOW", before="NOW = time.monotonic()"),
            "t_s does not increase",
        ),
    ],
)
def test_errors_name_file_and_class_in_one_line(tmp_path, text, words):
    address = write(tmp_path, text)
    with pytest.raises(UserCameraError, match=words) as caught, open_source(address) as source:
        list(source)
    assert str(caught.value).startswith(address)
    assert "\n" not in str(caught.value)


def test_a_stamp_of_the_future_is_refused_and_one_that_was_rounded_up_is_now(tmp_path):
    """Exposed after it arrived: the loop would leave every frame out, and lose the ball."""
    text = GOOD.replace("time.monotonic()", "time.monotonic() + AHEAD")
    (tmp_path / "good.py").write_text(text.replace("AHEAD", "0.001"))
    with open_source(f"{tmp_path / 'good.py'}:MyCamera", start_s=0.0) as source:
        assert next(source).t_s <= time.monotonic()
    (tmp_path / "ahead.py").write_text(text.replace("AHEAD", "0.05"))
    with pytest.raises(UserCameraError, match="use that clock"):
        open_source(f"{tmp_path / 'ahead.py'}:MyCamera", start_s=0.0)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="forks of POSIX")
def test_a_process_that_it_forked_does_not_go_on_reading_the_camera(tmp_path):
    path, children = tmp_path / "mine.py", tmp_path / "children"
    fork = f"if self.k == 3: open({str(children)!r}, 'a').write(f'{{os.fork()}}\\n')\n        "
    path.write_text("import os\n" + GOOD.replace("self.k += 1", f"self.k += 1\n        {fork}"))
    read = "import sys; from vision.sources.sources import open_source\n"
    read += f"with open_source({f'{path}:MyCamera'!r}, start_s=0.0) as s: print(len(list(s)))"
    done = subprocess.run(
        [sys.executable, "-c", read], stdout=subprocess.PIPE, timeout=60, text=True
    )
    assert done.returncode == 0
    assert 0 < int(done.stdout) <= 20  # the child printed nothing, and let go of the pipe
    assert {int(one) > 0 for one in children.read_text().split()} == {True, False}


@pytest.mark.parametrize("end", ["", "; raise RuntimeError('stuck')"])
def test_a_class_whose_read_cannot_be_looked_up_is_closed(tmp_path, capfd, end: str):
    text = reading("return None").replace("  def read(self):", "  @property\n  def read(self):")
    text = text.replace("return None", "raise RuntimeError('not now')")
    text += f"\n  def close(self): print('closed', flush=True){end}"
    with (
        pytest.raises(UserCameraError, match="read: RuntimeError: not now"),
        open_source(write(tmp_path, text)),
    ):
        pass
    assert capfd.readouterr().out == "closed\n"


def test_an_error_in_close_is_named_at_the_end(tmp_path):
    text = reading("return None if self.__dict__ else (self.__dict__.update(a=1), 1)")
    text += "\n  def close(self): raise RuntimeError('stuck')"
    text = text.replace(
        "(self.__dict__.update(a=1), 1)",
        f"(self.__dict__.update(a=1) or {IMAGE}, time.monotonic())",
    )
    with (
        pytest.raises(UserCameraError, match="close: RuntimeError: stuck"),
        open_source(write(tmp_path, text)) as source,
    ):
        list(source)


def test_a_file_without_a_class_asks_for_one(tmp_path):
    with pytest.raises(ValueError, match=r"mine\.py:MyCamera"):
        open_source(tmp_path / "mine.py")


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"mine\.py:MyCamera"):
        open_source(tmp_path / "mine.py:MyCamera")


def test_a_camera_that_fails_comes_back_with_a_new_object(tmp_path):
    text = reading(
        "self.k = getattr(self, 'k', 0) + 1\n    time.sleep(0.01)\n"
        f"    return ({IMAGE}, time.monotonic()) if self.k < 3 else [][0]"
    )
    with open_source(write(tmp_path, text)) as source:
        for _ in range(3):
            with pytest.raises(UserCameraError, match="IndexError"):
                list(source)
        assert next(source).image.shape == (4, 4, 3)


def test_a_camera_that_hangs_is_a_stall(tmp_path):
    text = reading(
        "self.k = getattr(self, 'k', 0) + 1\n    time.sleep(0.0 if self.k < 2 else 1.0)\n"
        f"    return {IMAGE}, time.monotonic()"
    )
    with open_source(write(tmp_path, text), patience_s=0.1) as source:
        next(source)
        with pytest.raises(StalledError, match="MyCamera: no new frame"):
            next(source)


def test_a_thread_of_the_camera_keeps_no_program_from_its_end(tmp_path):
    text = GOOD.replace(
        "self.k, ", "threading.Thread(target=time.sleep, args=(600,)).start()\n        self.k, "
    ).replace("import time", "import threading\nimport time")
    program = (
        "from vision.sources.sources import open_source\n"
        f"with open_source({write(tmp_path, text)!r}) as source: print(len(list(source)))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=120, check=False
    )
    assert (done.returncode, int(done.stdout) > 0) == (0, True), done.stderr


ONE = f"return None if self.__dict__ else (self.__dict__.update(a=1) or {IMAGE}, time.monotonic())"


def test_a_camera_that_has_ended_is_not_opened_anew_where_its_close_fails(tmp_path):
    text = reading(ONE, before="OPENED = []") + (
        "\n  def open(self): OPENED.append(1)\n  def close(self): raise RuntimeError('stuck')"
    )
    with open_source(write(tmp_path, text)) as source:
        with pytest.raises(UserCameraError, match="close: RuntimeError: stuck"):
            list(source)
        assert list(source) == []
    assert sys.modules["user_camera_mine"].OPENED == [1]


def test_a_camera_that_fails_at_once_is_left_alone_for_a_while(tmp_path):
    text = reading(ONE.replace("None", "1 / 0"), before="OPENED = []")
    text += "\n  def open(self): OPENED.append(time.monotonic())"
    with open_source(write(tmp_path, text)) as source:
        for _ in range(3):
            with pytest.raises(UserCameraError, match="ZeroDivisionError"):
                list(source)
        next(source)
    assert np.diff(sys.modules["user_camera_mine"].OPENED).min() >= RETRY_S
