"""The pages: links lead somewhere, the front door stays one, the examples run."""

import re
from pathlib import Path

import pytest

from tests.support import ROOT

PAGES = [
    page for page in ROOT.rglob("*.md") if not {".venv", "out"} & set(page.relative_to(ROOT).parts)
]


def heading_anchor(heading: str) -> str:
    """The anchor that a page's heading gets where Markdown is shown."""
    return re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", "-")


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_links_lead_somewhere(page: Path):
    text = page.read_text(encoding="utf-8")
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        if target.startswith(("http:", "https:", "mailto:")):
            continue
        file, _, anchor = target.partition("#")
        there = page.parent / file if file else page
        assert there.exists(), f"{page.relative_to(ROOT)}: {target}"
        if anchor:
            headings = re.findall(r"^#+ (.*)$", there.read_text(encoding="utf-8"), flags=re.M)
            assert anchor in map(heading_anchor, headings), f"{page.relative_to(ROOT)}: {target}"


def test_the_front_door_stays_one():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 130
    first, second = re.findall(r"```sh\n(.*?)```", text, flags=re.S)[:2]
    assert "rig reproduce" in first
    assert "pytest" in second


def test_every_command_of_the_front_door_exists():
    from experiments.cli.application import app

    groups = {group.name for group in app.registered_groups}
    commands = {c.name or getattr(c.callback, "__name__", "") for c in app.registered_commands}
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    named = set(re.findall(r"uv run rig (\w+)", text))
    assert named
    assert named <= commands | groups


def test_the_effect_of_ones_own_on_the_page_is_one(tmp_path: Path):
    from rig.plant.own_equations import acts
    from rig.plant.plant_record import pack
    from rig.rigfile import read_rig

    text = (ROOT / "calibration/gap/README.md").read_text(encoding="utf-8")
    section = text.partition("## An effect of your own")[2]
    for language, name in (("python", "mine.py"), ("toml", "my.toml")):
        [code] = re.findall(rf"```{language}\n(.*?)```", section, flags=re.S)
        (tmp_path / name).write_text(code)
    rig = read_rig(tmp_path / "my.toml")
    assert rig.effects == {"dangling_tool": {"x": {"weight_V": 0.4}}}
    assert acts(pack(rig)["own"])


@pytest.mark.slow
def test_the_examples_of_the_library_page_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    text = (ROOT / "rig/library.md").read_text(encoding="utf-8")
    examples = re.findall(r"```python\n(.*?)```", text, flags=re.S)
    assert len(examples) == 5
    monkeypatch.chdir(tmp_path)
    names = {"__name__": "example"}
    for example in examples:  # one after the other: later ones use what earlier ones made
        exec(compile(example, "rig/library.md", "exec"), names)
