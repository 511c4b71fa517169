"""What the page of a comparison says of its conditions."""

import re

from experiments.compare.glossary import CONDITIONS, RETUNED, glossary
from rig.control.controllers import COMPENSATORS
from tests.support import ROOT


def test_every_compensator_is_explained_as_in_the_comparisons_own_page():
    page = (ROOT / "experiments/compare/README.md").read_text(encoding="utf-8")
    table = dict(re.findall(r"^\| `([^`]+)` \| (.+) \|$", page, re.MULTILINE))
    assert set(CONDITIONS) == {*COMPENSATORS, RETUNED}
    assert {name: table[name].replace("`", "") for name in CONDITIONS} == CONDITIONS


def test_retuned_controllers_share_a_row_and_an_added_one_has_one():
    rows = glossary(["without", "retuned 4.5, 5", "retuned 3, 2", "mine"])
    assert [name for name, _ in rows] == ["without", RETUNED, "mine"]
    assert all(words for _, words in rows)
