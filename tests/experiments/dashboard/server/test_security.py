"""Who may pass the gate: token, Host and Origin, on the page and on the websocket."""

import os
import re
import shutil
import stat
import tarfile
from base64 import b64encode
from dataclasses import FrozenInstanceError
from functools import reduce
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest
import viser
import zstandard
from hypothesis import given
from hypothesis import strategies as st

from experiments.dashboard.server.security import (
    CONTENT_POLICY,
    SCRIPTS,
    Gate,
    PageRequest,
    gate_of,
)
from experiments.dashboard.server.server import link_of, open_server
from experiments.dashboard.server.shell import SCRIPT_HASH, VIEW_HASH
from rig.hardware.network.token_file import check_host, keep_token

GATE = Gate("secret-token", 7644, key="secret-key")

# Modes and owners as they were sent, as a program that unpacks an archive leaves them; the
# parameter came with Python 3.11.4, whose default it is here.
UNCHANGED = {"filter": "fully_trusted"} if hasattr(tarfile, "fully_trusted_filter") else {}


def derived() -> dict[str, Gate]:
    """What is made of the gate under test, for a mutant of it."""
    return {"GATE": Gate("secret-token", 7644, key="secret-key")}


HERE, ORIGIN = ["127.0.0.1:7644"], ["http://127.0.0.1:7644"]
COOKIE = ["other=1; rig_dashboard_7644=secret-key"]


def test_the_printed_link_opens_the_page_and_its_cookie_the_websocket():
    assert GATE.refusal(PageRequest("/?token=secret-token", HERE)) is None
    assert GATE.refusal(PageRequest(f"{GATE.path}/?darkMode", HERE, cookies=COOKIE)) is None
    assert GATE.refusal(PageRequest(GATE.path, HERE, ORIGIN, COOKIE, websocket=True)) is None
    local = PageRequest(
        GATE.path, ["localhost:7644"], ["http://localhost:7644"], COOKIE, websocket=True
    )
    assert GATE.refusal(local) is None


@pytest.mark.parametrize(
    ("asked", "word"),
    [
        (PageRequest("/", HERE), "token"),
        (PageRequest("/?token=wrong", HERE), "token"),
        (PageRequest("/?token=", HERE), "token"),
        (PageRequest(GATE.path, HERE, cookies=["rig_dashboard_7645=secret-key"]), "token"),
        (PageRequest("/?token=secret-token", ["evil.example:7644"]), "host"),
        (PageRequest("/?token=secret-token", ["127.0.0.1:80"]), "host"),
        (PageRequest("/?token=secret-token", ["127.0.0.1"]), "host"),
        (PageRequest("/?token=secret-token", []), "host"),
        (PageRequest("/?token=secret-token", [*HERE, "evil.example"]), "host"),
        (PageRequest("/?token=secret-token", ["10.0.0.7:7644"]), "host"),
        (PageRequest("/?token=secret-token", HERE, ["http://evil.example"]), "origin"),
        (PageRequest("/", HERE, ["http://evil.example"], COOKIE, websocket=True), "origin"),
        (PageRequest("/", HERE, ["http://127.0.0.1:9999"], COOKIE, websocket=True), "origin"),
        (PageRequest("/", HERE, ["http://localhost:7644"], COOKIE, websocket=True), "origin"),
        (PageRequest("/", HERE, ["https://127.0.0.1:7644"], COOKIE, websocket=True), "origin"),
        (PageRequest("/", HERE, ["null"], COOKIE, websocket=True), "origin"),
        (PageRequest("/", HERE, [], COOKIE, websocket=True), "origin"),
        (PageRequest("/", HERE, [*ORIGIN, *ORIGIN], COOKIE, websocket=True), "origin"),
        (PageRequest(GATE.path, HERE, ORIGIN, websocket=True), "token"),
        (PageRequest("/?token=secret-token", HERE, ORIGIN, websocket=True), "token"),
        (PageRequest("/", HERE, cookies=COOKIE), "token"),
        (PageRequest(f"{GATE.path}/more", HERE, cookies=COOKIE), "token"),
        (PageRequest(GATE.path, HERE, cookies=["rig_dashboard_7644=secret-token"]), "token"),
        (PageRequest(f"{GATE.path}/alive", HERE), "token"),
        (PageRequest("/question", HERE), "token"),
        (PageRequest(f"{GATE.path}/return", ["evil.example:7644"]), "host"),
        (PageRequest(f"{GATE.path}/question", HERE, ["http://evil.example"]), "origin"),
        (PageRequest(f"{GATE.path}/return", HERE, ORIGIN, websocket=True), "token"),
    ],
)
def test_everything_else_is_refused_with_its_reason(asked: PageRequest, word: str):
    refused = GATE.refusal(asked)
    assert refused is not None
    assert word in refused


@given(st.text(max_size=60), st.text(max_size=40), st.text(max_size=40), st.text(max_size=80))
def test_no_text_opens_the_gate_and_none_breaks_it(path, host, origin, cookie):
    asked = PageRequest(path, [host], [origin], [cookie], websocket=True)
    assert GATE.refusal(asked) is not None


def test_a_server_for_the_network_answers_to_addresses_and_its_own_names():
    gate = gate_of("0.0.0.0", 80, "t" * 20)
    assert gate.refusal(PageRequest("/?token=" + "t" * 20, ["10.1.2.3:80"])) is None
    assert gate.refusal(PageRequest("/?token=" + "t" * 20, ["[fe80::1]:80"])) is None
    assert gate.refusal(PageRequest("/?token=" + "t" * 20, ["evil.example:80"])) is not None
    assert not gate_of("127.0.0.1", 80, "t").any_address


def test_the_answer_hides_the_token_from_scripts_and_frames():
    headers = GATE.headers()
    assert "HttpOnly" in headers["Set-Cookie"]
    assert "SameSite=Lax" in headers["Set-Cookie"]
    assert headers["X-Frame-Options"] == "DENY"


def test_the_cookie_is_bound_to_a_path_that_nobody_can_guess():
    assert f"Path={GATE.path}" in GATE.headers()["Set-Cookie"]
    assert len(GATE.path) >= 32
    assert GATE.path == Gate("secret-token", 7644).path != Gate("another-token", 7644).path
    assert GATE.token not in GATE.path


def test_what_the_browser_keeps_is_worthless_after_the_next_start():
    """A page that stands open sends it to whoever takes the port meanwhile."""
    one, next_one = Gate("secret-token", 7644), Gate("secret-token", 7644)
    assert one.token not in one.headers()["Set-Cookie"]
    assert len(one.key) == 64  # 256 bits
    kept = [f"{one.cookie}={one.key}"]
    assert one.refusal(PageRequest(one.path, HERE, cookies=kept)) is None
    assert "token" in (next_one.refusal(PageRequest(one.path, HERE, cookies=kept)) or "")


def test_a_page_that_was_open_may_ask_how_it_returns():
    for part in ("question", "return?number=1&proof=2"):
        assert GATE.refusal(PageRequest(f"{GATE.path}/{part}", HERE, ORIGIN)) is None


def test_a_gate_is_as_it_was_made():
    with pytest.raises(FrozenInstanceError):
        GATE.token = "another"  # type: ignore
    with pytest.raises(FrozenInstanceError):
        PageRequest("/", HERE).path = "/other"  # type: ignore
    assert len(GATE.path) == 33
    for host in ("127.0.0.1", "localhost", "::1"):
        assert gate_of(host, 80, "t") == Gate("t", 80)


def test_the_link_leads_on_without_its_token():
    assert GATE.page_of("/?token=secret-token") == f"{GATE.path}/"
    assert GATE.page_of("/?darkMode=1&token=secret-token") == f"{GATE.path}/?darkMode=1"


def test_a_token_is_kept_for_its_owner_alone(tmp_path: Path):
    file = tmp_path / "token"
    token = keep_token(file)
    assert len(token) >= 32
    assert keep_token(file) == token
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    file.write_text("short\n")
    assert keep_token(file) != token
    assert (tmp_path / "token.1").read_text() == "short\n"  # it may have been somebody's own
    file.chmod(0o644)
    assert keep_token(file) != keep_token(tmp_path / "token.2") != token


def test_a_token_that_came_with_a_folder_is_known_to_who_sent_it(tmp_path: Path):
    (tmp_path / "theirs").mkdir()
    known = keep_token(tmp_path / "theirs/token")
    with tarfile.open(tmp_path / "sent.tar", "w") as archive:
        archive.add(tmp_path / "theirs", "mine")
    with tarfile.open(tmp_path / "sent.tar") as archive:
        archive.extractall(tmp_path, **UNCHANGED)
    file = tmp_path / "mine/token"
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    token = keep_token(file)
    assert token != known
    assert keep_token(file) == token
    (tmp_path / "moved").mkdir()
    file.rename(tmp_path / "moved/token")
    assert keep_token(tmp_path / "moved/token") == token  # the same file, of the same owner
    shutil.copy2(tmp_path / "moved/token", file)
    assert keep_token(file) != token


@pytest.mark.skipif(os.name == "nt", reason="pipes and links of POSIX")
@pytest.mark.parametrize("kind", ["a folder", "a pipe", "a link to nothing"])
def test_a_token_that_is_no_file_is_refused_in_a_line_with_its_cure(tmp_path: Path, kind: str):
    make = {"a folder": os.mkdir, "a pipe": os.mkfifo}  # type: ignore[attr-defined]
    file = tmp_path / "token"
    make.get(kind, lambda path: path.symlink_to(tmp_path / "nowhere"))(file)
    with pytest.raises(ValueError, match="is no file: remove it") as told:
        keep_token(file)
    assert "\n" not in str(told.value)
    assert list(tmp_path.iterdir()) == [file]


def test_the_page_runs_the_scripts_of_visers_page_and_of_its_bar_and_no_others():
    page = (Path(viser.__file__).parent / "client/build/index.html").read_text()
    loader = re.fullmatch(
        r'.*<script data-p="([^"]*)" data-ss="(\d+)" data-cs="(\d+)">(.*?)</script>.*', page, re.S
    )
    assert loader is not None
    packed, style, program, text = loader.groups()
    alphabet = re.search(r'const A="(.*?)";', text)
    assert alphabet is not None
    digits = [alphabet[1].replace("\\\\", "\\").index(one) for one in packed]  # to base 88
    words = np.reshape(digits[: len(digits) // 5 * 5], (-1, 5)) @ 88 ** np.arange(4, -1, -1)
    rest = reduce(lambda value, digit: 88 * value + digit, digits[len(words) * 5 :], 0)
    ends = len(digits) % 5 - 1
    zipped = words.astype(">u4").tobytes() + (rest.to_bytes(ends, "big") if ends > 0 else b"")
    sizes = int(style), int(program)
    code = zstandard.ZstdDecompressor().decompress(zipped, sum(sizes))[sizes[0] :]
    found = [b64encode(sha256(one).digest()).decode() for one in (text.encode(), code)]
    assert [f"sha256-{one}" for one in found] == list(SCRIPTS[:2])
    assert SCRIPTS[2:] == (SCRIPT_HASH, VIEW_HASH)
    assert "'unsafe-inline'" not in CONTENT_POLICY.partition("script-src")[2].partition(";")[0]


def test_port_80_and_ipv6_are_told_apart_from_others():
    gate = gate_of("127.0.0.1", 80, "secret-token")
    for host in ("127.0.0.1", "127.0.0.1:80", "localhost", "[::1]:80", "[::1]"):
        assert gate.refusal(PageRequest("/?token=secret-token", [host])) is None
    for host in ("127.0.0.1:7644", "", ":80", "[::1", "a]:80", "127.0.0.1:", "127.0.0.1:x"):
        assert gate.refusal(PageRequest("/?token=secret-token", [host])) is not None
    cookie = [f"{gate.cookie}={gate.key}"]
    page = PageRequest(gate.path, ["127.0.0.1"], ["http://127.0.0.1"], cookie, websocket=True)
    assert gate.refusal(page) is None
    lab = gate_of("fd00::7", 7644, "secret-token")
    assert lab.refusal(PageRequest("/?token=secret-token", ["[fd00::7]:7644"])) is None
    assert lab.refusal(PageRequest("/?token=secret-token", ["[fd00::8]:7644"])) is not None
    assert link_of(lab, "fd00::7") == "http://[fd00::7]:7644/?token=secret-token"
    assert link_of(lab, "::").startswith("http://[::1]:7644/")
    assert link_of(lab, "::1").startswith("http://[::1]:7644/")


@pytest.mark.parametrize("host", ["", " "])
def test_nobody_listens_to_the_whole_network_unasked(host):
    with pytest.raises(ValueError, match="--host is empty"):
        open_server(host, 0, "secret-token")


@pytest.mark.parametrize("host", ["0", "00", "0x0", "0:0:0:0:0:0:0:0"])
def test_every_address_has_to_be_asked_for_by_its_own_name(host):
    with pytest.raises(ValueError, match="is every address of this machine"):
        check_host(host)
    for good in ("127.0.0.1", "::1", "localhost", "0.0.0.0", "::"):
        check_host(good)


def test_of_the_page_only_its_known_parts_are_asked_for():
    gate = gate_of("127.0.0.1", 8000, "secret-token")
    here = gate.path
    for path, part in (
        (here, ""),
        (f"{here}/", ""),
        (f"{here}/?darkMode=", ""),
        (f"{here}/stop", "stop"),
        (f"{here}/alive?x=1", "alive"),
        (f"{here}/a/b", "a/b"),
        (f"{here}stop", None),
        ("/stop", None),
        (f"/x{here[2:]}/stop", None),
        (here[:-1], None),
    ):
        assert gate.part_of(path) == part, path

    def refused(path: str, *, websocket: bool = False) -> bool:
        origins = ["http://127.0.0.1:8000"] if websocket else []
        cookies = [f"{gate.cookie}={gate.key}"]
        request = PageRequest(path, ["127.0.0.1:8000"], origins, cookies, websocket)
        return gate.refusal(request) is not None

    assert not refused(here)
    assert not refused(here, websocket=True)
    assert not refused(f"{here}/stop")
    assert not refused(f"{here}/alive")
    assert refused(f"{here}/stop", websocket=True)
    assert refused(f"{here}/anything")
    assert refused("/stop")
