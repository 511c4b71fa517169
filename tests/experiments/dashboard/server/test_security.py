"""Who may pass the gate: token, Host and Origin, on the page and on the websocket."""

import stat
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from experiments.dashboard.security import Asked, Gate, gate_of, kept_token

GATE = Gate("secret-token", 7644)
HERE, ORIGIN = ["127.0.0.1:7644"], ["http://127.0.0.1:7644"]
COOKIE = ["other=1; rig_dashboard_7644=secret-token"]


def test_the_printed_link_opens_the_page_and_its_cookie_the_websocket():
    assert GATE.refusal(Asked("/?token=secret-token", HERE)) is None
    assert GATE.refusal(Asked("/", HERE, cookies=COOKIE)) is None
    assert GATE.refusal(Asked("/", HERE, ORIGIN, COOKIE, websocket=True)) is None
    local = Asked("/", ["localhost:7644"], ["http://localhost:7644"], COOKIE, websocket=True)
    assert GATE.refusal(local) is None


@pytest.mark.parametrize(
    ("asked", "word"),
    [
        (Asked("/", HERE), "token"),
        (Asked("/?token=wrong", HERE), "token"),
        (Asked("/?token=", HERE), "token"),
        (Asked("/", HERE, cookies=["rig_dashboard_7645=secret-token"]), "token"),
        (Asked("/?token=secret-token", ["evil.example:7644"]), "host"),
        (Asked("/?token=secret-token", ["127.0.0.1:80"]), "host"),
        (Asked("/?token=secret-token", ["127.0.0.1"]), "host"),
        (Asked("/?token=secret-token", []), "host"),
        (Asked("/?token=secret-token", [*HERE, "evil.example"]), "host"),
        (Asked("/?token=secret-token", ["10.0.0.7:7644"]), "host"),
        (Asked("/?token=secret-token", HERE, ["http://evil.example"]), "origin"),
        (Asked("/", HERE, ["http://evil.example"], COOKIE, websocket=True), "origin"),
        (Asked("/", HERE, ["http://127.0.0.1:9999"], COOKIE, websocket=True), "origin"),
        (Asked("/", HERE, ["http://localhost:7644"], COOKIE, websocket=True), "origin"),
        (Asked("/", HERE, ["https://127.0.0.1:7644"], COOKIE, websocket=True), "origin"),
        (Asked("/", HERE, ["null"], COOKIE, websocket=True), "origin"),
        (Asked("/", HERE, [], COOKIE, websocket=True), "origin"),
        (Asked("/", HERE, [*ORIGIN, *ORIGIN], COOKIE, websocket=True), "origin"),
        (Asked("/", HERE, ORIGIN, websocket=True), "token"),
    ],
)
def test_everything_else_is_refused_with_its_reason(asked: Asked, word: str):
    refused = GATE.refusal(asked)
    assert refused is not None
    assert word in refused


@given(st.text(max_size=60), st.text(max_size=40), st.text(max_size=40), st.text(max_size=80))
def test_no_text_opens_the_gate_and_none_breaks_it(path, host, origin, cookie):
    asked = Asked(path, [host], [origin], [cookie], websocket=True)
    assert GATE.refusal(asked) is not None


def test_a_server_for_the_network_answers_to_addresses_and_its_own_names():
    gate = gate_of("0.0.0.0", 80, "t" * 20)
    assert gate.refusal(Asked("/?token=" + "t" * 20, ["10.1.2.3:80"])) is None
    assert gate.refusal(Asked("/?token=" + "t" * 20, ["[fe80::1]:80"])) is None
    assert gate.refusal(Asked("/?token=" + "t" * 20, ["evil.example:80"])) is not None
    assert not gate_of("127.0.0.1", 80, "t").any_address


def test_the_answer_hides_the_token_from_scripts_and_frames():
    headers = GATE.headers()
    assert "HttpOnly" in headers["Set-Cookie"]
    assert "SameSite=Strict" in headers["Set-Cookie"]
    assert headers["X-Frame-Options"] == "DENY"


def test_a_token_is_kept_for_its_owner_alone(tmp_path: Path):
    file = tmp_path / "token"
    token = kept_token(file)
    assert len(token) >= 32
    assert kept_token(file) == token
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    file.write_text("short\n")
    assert kept_token(file) != token
