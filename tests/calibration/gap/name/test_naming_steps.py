"""What an investigation tells whoever waits: every step, and the names found so far."""

from calibration.gap import investigate
from rig.log import Log
from tests.support.gap.tables import RIG
from tests.support.worlds import WORLDS


def test_every_step_is_told_and_what_is_found_so_far():
    columns, _, _ = WORLDS["wide_dead_zone"](4300)
    told: list[tuple[str, int, int]] = []
    found = investigate(
        [Log.from_columns(columns)],
        RIG,
        until="name",
        quick=True,
        progress=lambda *step: told.append(step),
    )
    naming = [(stage, done) for stage, done, _ in told if stage.startswith("name")]
    assert naming[0] == ("name: looking for an effect", 0)
    assert naming[-1] == ("name", 5)
    assert {done for _, done in naming} == set(range(6))
    names = [effect.name for effect in found.findings.effects]
    assert names
    assert any(f"beside {names[0]}" in stage for stage, _ in naming)
    assert [told[0], told[-1]] == [("baseline", 0, 1), ("add and prove", 1, 1)]
    assert all(0 <= done <= total for _, done, total in told)
