"""The bar above the page in a real browser: STOP and Esc in every state."""

import cv2
import numpy as np
import pytest

from experiments.dashboard.server.server import shell_of
from experiments.dashboard.tabs.tour import ENDED_BY_WORD
from tests.support.in_browser.page import CUT_OFF
from tests.support.shell_alone import CONTRAST, opened
from tests.support.waiting import wait_for

SIZES = ((1280, 800), (800, 600), (390, 844))


def test_stop_is_there_before_the_page_is_and_says_at_once_that_it_heard(chromium, program):
    page = opened(chromium, program)
    stop, state = page.locator("#rig-stop"), page.locator("#rig-state")
    assert stop.inner_text() == "■ STOP"
    assert stop.evaluate(CONTRAST) >= 4.5
    program.obeys = False
    stop.click()
    assert state.inner_text() == "Stopping ..."  # before any answer came
    wait_for("the stop", lambda: program.stops == ["STOP on a page (127.0.0.1)"], 5.0)
    program.state = "stopped"
    page.get_by_text("Stopped, motors at 0 V").wait_for()
    assert program.stopped()
    program.obeys = True
    page.keyboard.press("Escape")
    wait_for("Esc", program.stopped, 5.0)
    stop.focus()
    page.keyboard.press("Enter")
    wait_for("the key Enter on the button", program.stopped, 5.0)
    places = []
    for width, height in SIZES:
        page.set_viewport_size({"width": width, "height": height})
        box = stop.bounding_box()
        places.append((box["x"], box["y"], box["height"]))
        assert box["x"] >= 0
        assert box["y"] >= 0
        assert box["height"] >= 44  # a thumb's
    assert len(set(places)) == 1  # it never moves
    page.context.close()


@pytest.mark.slow
def test_the_words_of_a_button_are_whole_however_narrow_its_panel_is(chromium, program):
    words = "servo: breakaway volts, gain, time constant, limits and dead bands of both axes"
    program.server.gui.add_button(words, order=-1)
    page = opened(chromium, program, viewport={"width": 1024, "height": 768})
    page.get_by_role("button", name="breakaway").wait_for(timeout=120e3)
    assert page.evaluate(CUT_OFF) == []
    short, long = (
        page.get_by_role("button", name=name).bounding_box() for name in ("Start", "breakaway")
    )
    assert short["height"] < long["height"]  # of several lines, as many as the font needs
    page.context.close()


@pytest.mark.slow
def test_esc_stops_whatever_has_the_focus_and_closes_a_list(chromium, program):
    page = opened(chromium, program)
    page.get_by_text("what stays").wait_for(timeout=120e3)
    for what in (
        page.get_by_role("textbox").first,
        page.get_by_role("checkbox", name="Arm"),
        page.get_by_role("button", name="▶ Start"),
        page.locator("canvas").first,
    ):
        what.click(force=True)
        page.keyboard.press("Escape")
        wait_for(f"Esc at {what}", program.stopped, 5.0)
    chosen = page.get_by_role("combobox", name="Protocol")
    chosen.click()
    page.get_by_role("option", name="steps").wait_for()
    page.keyboard.press("Escape")
    page.get_by_role("option", name="steps").wait_for(state="hidden")
    wait_for("Esc in an open list", program.stopped, 5.0)
    page.get_by_text("line 59").scroll_into_view_if_needed()
    assert page.locator("#rig-stop").is_visible()
    page.locator("#rig-stop").click()
    wait_for("STOP over a scrolled page", program.stopped, 5.0)
    page.context.close()


@pytest.mark.slow
def test_a_click_enlarges_a_picture_and_esc_closes_it_alone_at_0_volts(chromium, program):
    grey = np.full((300, 400, 3), 128, np.uint8)
    program.server.gui.add_image(grey, label="a figure", order=-1)
    program.state = "balancing"
    page = chromium.new_page()
    page.goto(program.link)
    page.locator("#rig-state", has_text="Balancing").wait_for()
    picture = page.locator('img[src^="blob:"]').first
    picture.wait_for(timeout=120e3)
    large = page.locator(".mantine-Modal-body img")
    for state, words, stops in (
        ("stopped", "Stopped, motors at 0 V", False),
        ("balancing", "Balancing", True),
        ("running", "Run is on", True),
        ("pause", "Pause", True),
    ):
        program.state, program.stops = state, []
        page.locator("#rig-state", has_text=words).wait_for()
        picture.click()
        large.wait_for()
        page.keyboard.press("Escape")
        large.wait_for(state="hidden")
        if stops:
            page.get_by_text("Stopped, motors at 0 V").wait_for()
        page.wait_for_timeout(300)
        assert bool(program.stops) is stops, state
    program.state, program.stops = "balancing", []
    page.locator("#rig-state", has_text="Balancing").wait_for()
    page.set_viewport_size({"width": 390, "height": 844})
    picture.wait_for()
    wide = picture.bounding_box()["width"]
    picture.click()
    wait_for("a larger picture", lambda: large.bounding_box()["width"] > 1.5 * wide, 10.0)
    page.keyboard.press("Escape")
    large.wait_for(state="hidden")
    page.set_viewport_size({"width": 1280, "height": 720})
    page.keyboard.press("Escape")  # no picture is open
    wait_for("Esc", program.stopped, 5.0)
    program.state = "balancing"
    picture.click()
    large.wait_for()
    page.route("**/alive", lambda route: route.abort())
    page.get_by_text("Connection lost").wait_for(timeout=20e3)
    page.keyboard.press("Escape")  # nobody knows whether a run is on
    wait_for("Esc without a connection", program.stopped, 5.0)
    page.close()


@pytest.mark.slow
def test_a_tab_stays_chosen_when_the_window_becomes_a_phones(chromium, program):
    tabs = program.server.gui.add_tab_group(order=-1)
    for name in ("Run", "Gap"):
        with tabs.add_tab(name):
            program.server.gui.add_markdown(f"the tab {name}")
    page = opened(chromium, program)
    page.get_by_role("tab", name="Gap").click(timeout=120e3)
    page.get_by_text("the tab Gap").wait_for()
    for width, height in ((390, 844), (1280, 720)):
        page.set_viewport_size({"width": width, "height": height})
        page.wait_for_timeout(1500)
        page.get_by_text("the tab Gap").wait_for(timeout=10e3)
        assert page.evaluate(CUT_OFF) == []
    page.context.close()


@pytest.mark.slow
def test_a_button_that_names_a_tab_opens_it_on_a_wide_page_and_on_a_phone(chromium, program):
    program.server.gui.add_button(ENDED_BY_WORD[1], order=-2)
    tabs = program.server.gui.add_tab_group(order=-1)
    for name in ("Results", "Replay"):
        with tabs.add_tab(name):
            program.server.gui.add_markdown(f"inside of {name}")
    page = opened(chromium, program)
    for width, height in ((1280, 720), (390, 844)):
        page.set_viewport_size({"width": width, "height": height})
        page.wait_for_timeout(1500)
        page.get_by_role("tab", name="Results").click(timeout=120e3)
        page.get_by_text("inside of Results").wait_for()
        page.get_by_role("button", name=ENDED_BY_WORD[1]).click()
        page.get_by_text("inside of Replay").wait_for(timeout=10e3)
    page.context.close()


def below(one) -> float:
    """Where an element ends [px]."""
    box = one.bounding_box()
    return box["y"] + box["height"]


@pytest.mark.slow
@pytest.mark.parametrize("phone", [False, True])
def test_stop_on_a_folded_page_and_on_a_phone(chromium, program, phone):
    settings = {"viewport": {"width": 390, "height": 844}, "has_touch": True} if phone else {}
    page = opened(chromium, program, **settings)
    page.get_by_text("what stays").wait_for(timeout=120e3)
    if phone:
        canvas, sheet = page.locator("canvas").first, page.locator(".mantine-Paper-root").first
        top = sheet.bounding_box()["y"]
        wait_for("the table above the sheet", lambda: below(canvas) <= top + 1, 10.0)
        assert sheet.bounding_box()["width"] == 390
        page.get_by_text("Connected").tap()  # folds the panel
        page.locator("#rig-stop").tap()
    else:
        page.mouse.click(1267, 60)  # the panel's arrow
        page.get_by_text("what stays").wait_for(state="hidden")
        page.locator("#rig-stop").click()
    wait_for("STOP", program.stopped, 5.0)
    page.context.close()


REACHED = """() => {
  const stop = document.getElementById("rig-stop"), box = stop.getBoundingClientRect();
  const words = document.getElementById("rig-state").getBoundingClientRect(), wrong = [];
  for (const [x, y] of [[0.1, 0.1], [0.9, 0.1], [0.5, 0.5], [0.1, 0.9], [0.9, 0.9]]) {
    const top = document.elementFromPoint(box.x + x * box.width, box.y + y * box.height);
    if (top !== stop) wrong.push("STOP lies below " + (top ? top.outerHTML.slice(0, 80) : "?"));
  }
  const text = document.createRange();
  text.selectNodeContents(document.getElementById("rig-state"));
  const said = text.getBoundingClientRect();
  const bar = document.getElementById("rig-bar").getBoundingClientRect();
  if (said.bottom > bar.bottom || said.top < bar.top) wrong.push("words reach out of the bar");
  if (said.right > words.right + 1) wrong.push("words lie under a button");
  return wrong; }"""


@pytest.mark.slow
@pytest.mark.parametrize("size", [(390, 844), (320, 568), (844, 390)])
def test_on_a_phone_stop_is_reached_in_every_state_and_words_fit(chromium, program, size):
    """Unfolded, folded, scrolled, below an open list, a message, and without a connection."""
    viewport = {"width": size[0], "height": size[1]}
    page = opened(chromium, program, viewport=viewport, has_touch=True)
    stop, kept = page.locator("#rig-stop"), page.get_by_text("what stays")
    first = stop.bounding_box()

    def reached(state: str, *, answered: bool = True) -> None:
        page.wait_for_timeout(700)  # the sheet's height is taken over
        assert page.evaluate(REACHED) == [], state
        assert stop.bounding_box() == first, state
        stop.tap(timeout=5e3)
        if answered:
            page.get_by_text("Stopped, motors at 0 V").wait_for()
            assert program.stopped(), state
            page.locator("#rig-state", has_text="Run is on").wait_for()

    reached("before viser's own page is there")
    kept.wait_for(timeout=120e3)
    reached("unfolded")
    page.get_by_text("line 59").scroll_into_view_if_needed()
    reached("scrolled")
    page.get_by_role("combobox", name="Protocol").tap()
    page.get_by_role("option", name="steps").wait_for()
    reached("a list is open")
    page.keyboard.press("Escape")
    if size[0] < 520:
        page.get_by_text("Connected").tap()
        kept.wait_for(state="hidden")
        reached("folded")
    for client in program.server.get_clients().values():
        client.add_notification(
            "a long message " * 20, "of many words " * 40, auto_close_seconds=60
        )
    page.get_by_text("of many words").first.wait_for()
    reached("a message")
    if size[0] < 520:
        page.get_by_text("Connected").tap()
        kept.wait_for()
        reached("a message and the sheet")
        page.get_by_text("Connected").tap(timeout=5e3)  # no message lies over the sheet's handle
        kept.wait_for(state="hidden")
    program.state = "stopping"
    page.get_by_text("the plate is levelled").wait_for()
    reached("stopping, below a message")
    page.route("**/alive", lambda route: route.abort())
    page.route("**/stop", lambda route: route.abort())
    page.get_by_text("Connection lost").wait_for(timeout=20e3)
    reached("lost", answered=False)
    page.get_by_text("STOP was not answered").wait_for()
    page.context.close()


WIDTHS = """() => [...document.querySelectorAll("canvas, img, b, button")].map(one => {
  const box = one.getBoundingClientRect(); return [one.id, box.left, box.right, box.height]; })"""
INK = """id => { const one = document.getElementById(id);
  return one.getContext("2d").getImageData(0, 0, one.width, one.height).data.some(v => v); }"""


@pytest.mark.parametrize(
    ("width", "height"), [pytest.param(1280, 720, marks=pytest.mark.slow), (390, 844)]
)
def test_the_big_view_shows_table_curves_and_camera_and_stops(chromium, program, width, height):
    shell = shell_of(program.server)
    image = cv2.imencode(".jpg", np.full((60, 80, 3), 128, np.uint8))[1].tobytes()
    shell.camera = lambda: image
    curve = {"t_s": [0.0, 1.0, 2.0], "x_m": [None, 0.01, 0.04], "y_m": [None, 0.02, 0.05]}
    shell.live = lambda: {
        **{"side_m": 0.275, "radius_m": 0.02, "ball_m": [0.04, 0.05], "target_m": [0.01, 0.01]},
        **{"rms_m": 0.0123, "run": "run 1 of 2", "title": "<b>let go</b>", "t_s": 7.4},
        **{"duration_s": 16.0, "ask": "place the ball", "curve": curve},
    }
    page = chromium.new_context(viewport={"width": width, "height": height}).new_page()
    page.goto(program.link)
    with page.expect_popup() as coming:
        page.get_by_role("button", name="Big view ↗").click()
    view = coming.value
    view.set_viewport_size({"width": width, "height": height})
    view.get_by_text("7 of 16").wait_for()
    assert [view.locator(f"#{one}").inner_text() for one in ("off", "rms")] == ["5.0", "1.23"]
    assert view.locator("#run").inner_text() == "<b>let go</b>: run 1 of 2"
    assert view.locator("#ask").inner_text() == "Please place the ball"
    view.locator("#camera").wait_for(state="visible")
    for name, left, right, high in view.evaluate(WIDTHS):
        assert left >= 0, name
        assert right <= width, name
        assert high > 40 or name not in ("plate", "curve", "camera"), name
    assert all(view.evaluate(INK, one) for one in ("plate", "curve"))
    shell.camera = bytes
    view.locator("#camera").wait_for(state="hidden")
    view.keyboard.press("Escape")
    wait_for("Esc", program.stopped, 5.0)
    view.locator("#rig-stop").click()
    wait_for("STOP", program.stopped, 5.0)
    page.context.close()


@pytest.mark.slow
def test_a_stop_that_nobody_answers_sends_to_the_switch(chromium, program):
    page = opened(chromium, program)
    page.route("**/stop", lambda route: route.abort())
    page.locator("#rig-stop").click()
    page.get_by_text("STOP was not answered. The motors may still have power: use the").wait_for()
    page.context.close()


def test_stop_is_asked_again_until_it_is_answered_and_its_warning_stays(chromium, program):
    page, tried = opened(chromium, program), []
    page.route("**/stop", lambda route: (tried.append(1), route.abort()))
    page.locator("#rig-stop").click()
    state = page.locator("#rig-state")
    state.get_by_text("STOP was not answered").wait_for()
    for _ in range(8):  # the answers to `alive` between them do not take it away
        page.wait_for_timeout(200)
        assert "STOP was not answered" in state.inner_text()
    assert 3 <= len(tried) <= 20
    assert program.stops == []
    program.obeys = False
    page.unroute("**/stop")
    page.get_by_text("Stopping ...").wait_for()
    program.state = "stopped"
    page.get_by_text("Stopped, motors at 0 V").wait_for()
    assert program.stops == ["STOP on a page (127.0.0.1)"]  # once it is answered, no more
    page.wait_for_timeout(600)
    assert len(program.stops) == 1
    page.context.close()


@pytest.mark.slow
def test_a_stop_that_was_not_answered_is_asked_no_more_of_a_table_at_rest(chromium, program):
    page, tried = opened(chromium, program), []
    page.route("**/stop", lambda route: (tried.append(1), route.abort()))
    page.locator("#rig-stop").click()
    page.get_by_text("STOP was not answered").wait_for()
    program.state = "stopped"
    page.get_by_text("Stopped, motors at 0 V").wait_for()
    page.wait_for_timeout(300)
    many = len(tried)
    page.wait_for_timeout(600)
    assert len(tried) == many
    page.context.close()


GROUND = """() => ["body", "div:has(> div > [data-dock-root])"].map(
  one => getComputedStyle(document.querySelector(one)).backgroundColor)"""


@pytest.mark.slow
def test_each_page_is_light_or_dark_by_itself_without_being_loaded_anew(chromium, program):
    light, dark = opened(chromium, program), opened(chromium, program, color_scheme="dark")
    grounds = []
    for page, looks, other in ((light, "light", "Dark"), (dark, "dark", "Light")):
        page.get_by_text("what stays").wait_for(timeout=120e3)
        assert page.locator("html").get_attribute("data-looks") == looks
        grounds.append(page.evaluate(GROUND))
        page.evaluate("window.kept = 1")
        page.get_by_role("button", name=other, exact=True).click()
    assert light.evaluate(GROUND) == grounds[1] != dark.evaluate(GROUND) == grounds[0]
    assert light.evaluate("window.kept") == dark.evaluate("window.kept") == 1  # tabs, films, fields
    light.goto(light.url + "?darkMode")  # viser's own way
    light.get_by_role("button", name="Light", exact=True).wait_for()  # it keeps what was chosen
    light.get_by_text("what stays").wait_for(timeout=120e3)
    assert light.evaluate(GROUND) == grounds[1]
    assert "darkMode" not in light.url
    light.context.close()
    dark.context.close()


@pytest.mark.slow
def test_stop_is_in_sight_of_who_has_enlarged_the_page(chromium, program):
    """Two fingers move what is seen over the page, as a phone's keyboard does."""
    page = opened(
        chromium, program, viewport={"width": 390, "height": 844}, has_touch=True, is_mobile=True
    )
    stop, first = page.locator("#rig-stop"), page.locator("#rig-stop").bounding_box()
    fingers = page.context.new_cdp_session(page)
    fingers.send("Emulation.setPageScaleFactor", {"pageScaleFactor": 2})
    page.mouse.move(100, 20)  # over the bar: a wheel over the 3-D view is that view's
    page.mouse.wheel(80, 200)
    moved = "Math.min(visualViewport.offsetLeft, visualViewport.offsetTop)"
    wait_for("what is seen is moved", lambda: page.evaluate(moved) > 30, 10.0)
    wait_for("STOP in its corner", lambda: stop.bounding_box() == first, 10.0)
    page.context.close()
