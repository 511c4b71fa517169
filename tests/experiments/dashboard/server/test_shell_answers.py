"""What the bar above the page is answered, and how it comes into viser's page."""

import gzip
import json
from base64 import b64encode
from hashlib import sha256
from types import SimpleNamespace

import pytest

from experiments.dashboard.server.shell import (
    ICON,
    PARTS,
    SCRIPT,
    SCRIPT_HASH,
    STYLE,
    TITLE,
    UNPROVEN,
    VIEW,
    VIEW_HASH,
    VIEW_SCRIPT,
    Shell,
    dressed,
)

PAGE = '<html><link href="data:image/svg+xml,old"/><title>Viser</title><body>rest</body>'


def response(text: str, *, zipped: bool):
    body = gzip.compress(text.encode()) if zipped else text.encode()
    coding = "gzip" if zipped else "identity"
    headers = {"Content-Length": str(len(body)), "Content-Encoding": coding}
    return SimpleNamespace(body=body, headers=headers)


def test_alive_tells_the_state_and_stops_nothing_and_stop_tells_who():
    stops = []
    shell = Shell(lambda: "running", stops.append)
    told = json.loads(shell.answer("alive", "10.0.0.7"))
    assert told == {"state": "running", "began": shell.began, "secret": ""}
    assert stops == []
    assert json.loads(shell.answer("stop", "10.0.0.7")) == told
    assert stops == ["STOP on a page (10.0.0.7)"]


def test_the_big_view_gets_its_page_the_table_and_the_cameras_image():
    stops = []
    shell = Shell(stop=stops.append)
    assert json.loads(shell.answer("live", "x")) == {}
    assert shell.answer("camera", "x") == b""
    shell.live, shell.camera = lambda: {"ball_m": [0.1, None]}, lambda: b"jpeg"
    assert json.loads(shell.answer("live", "x")) == {"ball_m": [0.1, None]}
    assert shell.answer("camera", "x") == b"jpeg"
    page = shell.answer("view", "x").decode()
    scripts = f"<style>{STYLE}</style><script>{SCRIPT}</script><script>{VIEW_SCRIPT}</script>"
    assert f"<title>{TITLE}</title>{scripts}" in page
    assert page.replace(scripts, "") == VIEW
    assert stops == []
    assert f"sha256-{b64encode(sha256(VIEW_SCRIPT.encode()).digest()).decode()}" == VIEW_HASH
    shell.live = lambda: {"x": float("nan")}
    with pytest.raises(ValueError, match="JSON"):
        shell.answer("live", "x")
    kinds = {"alive": "json", "stop": "json", "live": "json", "camera": "jpeg", "view": "html"}
    kinds |= dict.fromkeys(UNPROVEN, "json")
    assert {part: kind.split("/")[1][:4] for part, kind in PARTS.items()} == kinds


def test_before_the_program_is_ready_it_starts_and_every_start_has_a_name_of_its_own():
    one, other = Shell(), Shell()
    assert json.loads(one.answer("stop", "x"))["state"] == "starting"
    assert one.began != other.began
    assert len(one.began) == 16


@pytest.mark.parametrize("zipped", [True, False])
def test_the_page_gets_its_bar_its_name_and_its_icon(zipped: bool):
    made = dressed(response(PAGE, zipped=zipped))
    assert made.headers["Content-Length"] == str(len(made.body))
    text = (gzip.decompress(made.body) if zipped else made.body).decode()
    own = f"<title>{TITLE}</title><style>{STYLE}</style><script>{SCRIPT}</script>"
    assert text == f'<html><link href="{ICON}"/>{own}<body>rest</body>'
    assert TITLE == "Balancing table"
    assert 'id="rig-stop"' not in text  # made by the script
    assert "■ STOP" in SCRIPT
    assert "#rig-stop" in STYLE
    assert f"sha256-{b64encode(sha256(SCRIPT.encode()).digest()).decode()}" == SCRIPT_HASH
    assert ICON.startswith("data:image/svg+xml,%3Csvg ")


def test_another_page_than_the_known_one_is_not_served_without_stop():
    with pytest.raises(RuntimeError, match="STOP"):
        dressed(response("<html><title>Another</title>", zipped=False))
