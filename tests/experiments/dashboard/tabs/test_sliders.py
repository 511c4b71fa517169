"""Sliders that act together: what is applied, undone, refused, and shown."""

import json
import threading
from pathlib import Path
from types import SimpleNamespace

import pytest

from experiments.dashboard.server.controls import Controls
from experiments.dashboard.server.input_limits import KP, Range, choice
from experiments.dashboard.session.presets import MOST_KEPT, KeptPresets
from experiments.dashboard.tabs.sliders import OWN, SliderGroup
from tests.support.greyed import why

ROWS = [("P", KP, 2.0), ("D", Range(0.0, 1.0, 0.1), 0.5)]
PRESETS = {"begin": (2.0, 0.5), "wild": (99.0, 0.0)}


class Group:
    """Sliders whose buttons and values are pressed by hand."""

    def __init__(self, kept: KeptPresets | None = None) -> None:
        self.applied: list[list[float]] = []
        self.told: list[tuple] = []
        self.refuses = False
        self.controls = Controls(lambda *what: self.told.append(what), print)
        self.controls.lock = self.controls.lock.joined(1)
        self.handles: dict[str, SimpleNamespace] = {}
        self.buttons: dict[str, SimpleNamespace] = {}
        gui = SimpleNamespace(
            add_dropdown=lambda label, names, initial_value: self._made(label, initial_value),
            add_slider=lambda label, low, high, step, value, hint: self._made(label, value),
            add_button=self._button,
            add_text=lambda label, value, hint: self._made(label, value),
        )
        server = SimpleNamespace(gui=gui)
        self.group = SliderGroup(
            server,  # pyright: ignore[reportArgumentType]
            self.controls,
            ROWS,
            self._apply,
            hint="",
            presets=PRESETS,
            kept=kept,
            check=lambda page: self._apply([]) if self.refuses else None,
        )

    def _made(self, label: str, value: object) -> SimpleNamespace:
        self.handles[label] = SimpleNamespace(value=value)
        return self.handles[label]

    def _button(self, label: str, **looks: str) -> SimpleNamespace:
        self.buttons[label] = SimpleNamespace(
            on_click=lambda act: self.handles.update({label: act})
        )
        return self.buttons[label]

    def _apply(self, values: list[float]) -> None:
        if self.refuses:
            raise ValueError("a run is being recorded")
        self.applied.append(values)

    def put(self, label: str, value: object) -> None:
        """As a page that holds the controls would."""
        handle = self.handles[label]
        handle.value = self.controls.cleaned(1, handle, value)
        self.controls.use(1, handle, handle.value)
        done = threading.Event()
        self.controls.queue.put("then", done.set)
        assert done.wait(10.0)

    def press(self, label: str) -> None:
        self.handles[label](SimpleNamespace(client_id=1))  # pyright: ignore[reportCallIssue]

    def shown(self) -> list:
        """What the page shows once all is done."""
        self.controls.queue.close()
        return [self.handles[label].value for label in ("Preset", "P", "D")]


def test_a_move_a_preset_and_the_reset_are_applied_together_and_undone_in_turn():
    one = Group()
    one.put("P", 3.0)
    one.put("Preset", "wild")
    one.press("Reset to 2 / 0.5")
    for _ in range(4):
        one.press("Undo")
    assert one.shown() == [OWN, 2.0, 0.5]
    top = KP.high
    assert one.applied == [
        [3.0, 0.5],
        [top, 0.0],
        [2.0, 0.5],
        [top, 0.0],
        [3.0, 0.5],
        [2.0, 0.5],
    ]
    assert one.told == [(1, "undo", "nothing was changed yet")]


def test_what_would_be_refused_is_greyed(tmp_path: Path):
    one = Group(KeptPresets(tmp_path / "kept.json", 2))
    undo, keep, forget = (
        one.buttons[label] for label in ("Undo", "Keep by this name", "Forget this name")
    )
    assert why(one.controls, undo) == "nothing was changed yet"
    assert "write a name" in why(one.controls, keep)
    one.put("P", 3.0)
    one.put("Name", "soft")
    assert [why(one.controls, button) for button in (undo, keep)] == ["", ""]
    assert "write the name" in why(one.controls, forget)
    one.press("Keep by this name")
    one.shown()
    assert why(one.controls, forget) == ""
    one.refuses = True
    for handle in (one.handles["P"], one.handles["Preset"], undo, one.buttons["Reset to 2 / 0.5"]):
        assert why(one.controls, handle) == "a run is being recorded"
    assert why(one.controls, keep) == ""  # applies nothing


def test_a_preset_keeps_its_name_until_a_slider_is_moved():
    one = Group()
    one.put("Preset", "wild")
    assert one.shown() == ["wild", KP.high, 0.0]
    one = Group()
    one.put("Preset", "wild")
    one.put("D", 0.3)
    one.put("Preset", OWN)  # changes nothing
    assert one.shown() == [OWN, KP.high, 0.3]
    assert one.group.values == [KP.high, 0.3]


def test_one_slider_that_is_drawn_along_is_one_move(monkeypatch):
    one, now = Group(), [0.0]
    monkeypatch.setattr("experiments.dashboard.tabs.sliders.time.monotonic", lambda: now[0])
    for value in (2.5, 3.0, 3.5):
        one.group._move(0, value)
        one.group._kept[0].now = value
        now[0] += 0.2
    now[0] += 5.0
    one.group._move(0, 4.0)
    assert one.group._past == [[2.0, 0.5], [3.5, 0.5]]
    one.group._move(1, 0.1)
    assert len(one.group._past) == 3
    one.controls.queue.close()


def test_what_is_refused_is_neither_shown_nor_undone():
    one = Group()
    one.refuses = True
    one.put("P", 3.0)
    one.put("Preset", "wild")
    one.press("Undo")
    assert one.shown() == ["begin", 2.0, 0.5]
    assert [what[2] for what in one.told] == [
        "a run is being recorded",
        "a run is being recorded",
        "nothing was changed yet",
    ]


def test_values_kept_by_name_are_in_the_list_of_this_program_and_of_the_next(tmp_path: Path):
    file = tmp_path / "gains.json"
    one = Group(KeptPresets(file, 2))
    one.put("P", 3.0)
    one.put("Name", "  lively $<b>  ")
    one.press("Keep by this name")
    one.put("Preset", "wild")
    one.put("Preset", "lively $<b>")
    assert one.shown() == ["lively $<b>", 3.0, 0.5]
    again = Group(KeptPresets(file, 2))
    again.put("Preset", "lively $<b>")
    again.put("Name", "lively $<b>")
    again.press("Forget this name")
    assert again.shown() == [OWN, 3.0, 0.5]
    assert again.handles["Preset"].options == (OWN, "begin", "wild")
    assert json.loads(file.read_text()) == {}


def test_no_name_hides_another_preset_and_none_is_beyond_measure(tmp_path: Path):
    one = Group(KeptPresets(tmp_path / "gains.json", 2))
    for name in ("", "wild", OWN):
        one.put("Name", name)
        one.press("Keep by this name")
        one.press("Forget this name")
    for name in (5, "x" * 41, "a\x1bb", "\ud800"):
        with pytest.raises(ValueError, match="a name has up to"):
            one.controls.cleaned(1, one.handles["Name"], name)
    one.shown()
    assert [what[1] for what in one.told] == 3 * ["keep", "forget"]
    assert not (tmp_path / "gains.json").exists()


def test_a_file_of_presets_is_read_as_far_as_it_holds_some(tmp_path: Path):
    file = tmp_path / "gains.json"
    kept = {"a": [1, 2], "b": [1], "c": "x", " d": [1, 2], "e": [1, 1e999], "f": [1, None]}
    file.write_text(json.dumps(kept))
    assert dict(KeptPresets(file, 2)) == {"a": [1.0, 2.0]}
    for text in ("[1]", "{", "5", "[" * 100_000):
        file.write_text(text)
        assert dict(KeptPresets(file, 2)) == {}
    file.write_text(json.dumps({f"n{i}": [0, 0] for i in range(MOST_KEPT)}))
    many = KeptPresets(file, 2)
    many.keep("n0", [1, 1])
    with pytest.raises(ValueError, match="forget one first"):
        many.keep("one more", [1, 1])
    many.forget("n0")
    many.keep("one more", [1, 1])


def test_a_kept_name_that_another_preset_has_is_listed_once_and_a_refusal_stays_short(tmp_path):
    file = tmp_path / "gains.json"
    many = {f"name {i}": [1.0, 0.0] for i in range(3 * MOST_KEPT)}
    file.write_text(json.dumps({OWN: [1.0, 0.0], "wild": [1.0, 0.0], **many}))
    group = Group(KeptPresets(file, 2))
    assert group.group._names == (OWN, "begin", "wild", *many)
    with pytest.raises(ValueError, match="that is none of of my own, begin, wild") as told:
        choice("other", group.group._names)
    assert len(str(told.value)) < 200
    with pytest.raises(ValueError, match=r"none of a, b$"):
        choice("other", ["a", "b"])
    group.controls.queue.close()


def test_two_programs_with_one_file_lose_nobodys_presets(tmp_path: Path):
    file = tmp_path / "gains.json"
    one, other = KeptPresets(file, 2), KeptPresets(file, 2)
    one.keep("mine", [1.0, 2.0])
    other.keep("yours", [3.0, 4.0])
    assert dict(KeptPresets(file, 2)) == dict(other) == {"mine": [1.0, 2.0], "yours": [3.0, 4.0]}
    one.forget("mine")
    assert list(one) == list(KeptPresets(file, 2)) == ["yours"]


def test_a_file_that_cannot_be_read_is_kept_beside_the_new_one(tmp_path):
    """Half a file, or one of another version: it was written over."""
    path = tmp_path / "gains.json"
    path.write_text('{"mine": [1.0, 2')
    kept = KeptPresets(path, 3)
    assert not list(kept)
    kept.keep("new", (1.0, 2.0, 3.0))
    assert (tmp_path / "gains.json.1").read_text() == '{"mine": [1.0, 2'
    assert list(KeptPresets(path, 3)) == ["new"]
    kept.keep("next", (1.0, 2.0, 3.0))
    assert not (tmp_path / "gains.json.2").exists()
