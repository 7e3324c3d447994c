"""Tests of the live page with a stand-in for the run."""

import re

import pytest
from playwright.sync_api import expect

from conftest import shot
from stand_in import TOKEN

control = pytest.mark.parametrize("stand_in", ["control"], indirect=True)
read_only = pytest.mark.parametrize("stand_in", ["live"], indirect=True)


@pytest.fixture
def names(scene):
    return [robot["name"] for robot in scene["robots"]]


def until(page, stand_in, names, condition, **frame):
    """Sends frames until the page satisfies the condition."""
    for _ in range(600):
        stand_in.frame(names, **frame)
        page.wait_for_timeout(50)
        if condition():
            return
    raise AssertionError("the page never satisfied the condition")


def link(page):
    return page.locator(".lamp").get_attribute("data-link")


def opened(visit, stand_in, names, **options):
    page = visit(stand_in.address, **options)
    until(page, stand_in, names, lambda: link(page) == "live")
    return page


@read_only
def test_frames_move_the_robots(stand_in, visit, names):
    page = opened(visit, stand_in, names)
    first = page.locator(".plane g.robot").first
    before = first.get_attribute("transform"), page.locator(".time").inner_text()
    until(page, stand_in, names, lambda: first.get_attribute("transform") != before[0])
    assert page.locator(".time").inner_text() != before[1]


@read_only
def test_page_without_control_has_no_fault_buttons(stand_in, visit, names):
    page = opened(visit, stand_in, names)
    assert page.get_by_role("button", name=re.compile("kill|freeze|restart|cut|mend")).count() == 0
    expect(page.locator(".edges tbody tr")).to_have_count(3)


@control
def test_click_kills_a_robot_marks_it_and_restart_returns_it(stand_in, visit, names):
    page = opened(visit, stand_in, names)
    circle = page.locator(".plane g.robot").nth(1)
    moving = circle.locator(".reach").evaluate("e => getComputedStyle(e).stroke")
    kill, restart = (page.get_by_role("button", name=f"{act} r2") for act in ("kill", "restart"))
    expect(restart).to_be_hidden()
    kill.click()
    until(page, stand_in, names, lambda: circle.get_attribute("data-state") == "dead")
    assert stand_in.posted == [
        (f"/control?token={TOKEN}", "application/json", {"act": "kill", "robot": "r2"})
    ]
    assert circle.locator(".reach").evaluate("e => getComputedStyle(e).stroke") != moving
    expect(kill).to_be_hidden()
    restart.click()
    until(page, stand_in, names, lambda: circle.get_attribute("data-state") == "moving")
    assert stand_in.posted[-1][2] == {"act": "restart", "robot": "r2"}
    assert circle.locator(".reach").evaluate("e => getComputedStyle(e).stroke") == moving


@control
def test_freeze_button_thaws_a_frozen_robot_by_keyboard(stand_in, visit, names):
    page = opened(visit, stand_in, names)
    page.get_by_role("button", name="freeze r1").focus()
    page.keyboard.press("Enter")
    thaw = page.get_by_role("button", name="thaw r1")
    until(page, stand_in, names, thaw.is_visible)
    page.keyboard.press("Space")
    until(page, stand_in, names, page.get_by_role("button", name="freeze r1").is_visible)
    assert [body["act"] for _, _, body in stand_in.posted] == ["freeze", "thaw"]


@control
def test_edge_is_cut_and_mended(stand_in, visit, names):
    page = opened(visit, stand_in, names)
    page.get_by_role("button", name="cut r2 to <").click()
    page.get_by_role("button", name="mend r2 to <").click()
    until(page, stand_in, names, lambda: len(stand_in.posted) == 2)
    assert [body for _, _, body in stand_in.posted] == [
        {"act": act, "from": "r2", "to": names[2]} for act in ("cut", "mend")
    ]


@control
def test_refusal_is_shown_with_its_reason(stand_in, visit, names):
    page = opened(visit, stand_in, names, tolerated="status of 409")
    stand_in.refusal = "r2 is dead already"
    page.get_by_role("button", name="kill r2").click()
    expect(page.locator(".answer")).to_have_text("kill r2: r2 is dead already")


@read_only
def test_late_and_dropped_frames_are_reported(stand_in, visit, names):
    page = opened(visit, stand_in, names)
    lamp = page.locator(".lamp")
    until(page, stand_in, names, lambda: "behind by 0.9 s; the run is not affected" in lamp.inner_text(), behind_ms=900)
    until(page, stand_in, names, lambda: link(page) == "live")
    dropped = page.locator(".dropped")
    until(page, stand_in, names, lambda: dropped.inner_text() == "7 frames not shown; the run is not affected", dropped=7)
    assert link(page) == "live"
    expect(lamp).to_contain_text("no data for")


@read_only
def test_broken_stream_is_reported_and_reconnected(stand_in, visit, names):
    page = opened(visit, stand_in, names, tolerated="ERR_INCOMPLETE_CHUNKED_ENCODING")
    stand_in.break_off()
    expect(page.locator(".lamp")).to_have_text("no connection: trying again")
    until(page, stand_in, names, lambda: link(page) == "live")
    assert stand_in.connections == 2


@control
def test_page_does_not_reconnect_after_the_end(stand_in, visit, names):
    page = opened(visit, stand_in, names)
    stand_in.send("ended", {"exit": 1, "text": "an expectation was missed"})
    expect(page.locator(".lamp")).to_have_text("the run has ended, exit code 1")
    expect(page.locator(".end")).to_have_text("an expectation was missed")
    stand_in.break_off()
    page.wait_for_timeout(3000)
    assert stand_in.connections == 1
    expect(page.locator(".lamp")).to_have_attribute("data-link", "ended")
    expect(page.get_by_role("button", name="kill r2")).to_be_disabled()


@read_only
def test_events_and_latencies_are_listed_as_text(stand_in, visit, names):
    page = opened(visit, stand_in, names)
    detail = "<b onclick=alert(1)>by hand</b>"
    stand_in.send("happened", {"t_s": 3.25, "kind": "kill", "robot": "r2", "detail": detail})
    stand_in.send("happened", {"t_s": 4.5, "kind": "ready", "robot": "r2", "detail": ""})
    stand_in.send("happened", {"t_s": 4.6, "kind": "contact", "robot": "r1", "detail": "fresh r2"})
    stages = [{"stage": "wake", "worst": "r2", "p50_us": 61.25, "p99_us": 1234.5, "max_us": 8000, "count": 77}]
    stand_in.send("latency", stages)
    expect(page.locator(".log li")).to_have_text(["4.50 s ready r2", f"3.25 s kill r2 {detail}"])
    expect(page.locator(".latency tbody tr")).to_have_text("waker261.3 1230800077".replace(" ", ""))
    expect(page.locator(".marks [title='kill r2, at 3.25 s']")).to_have_count(1)


@control
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [1280, 390])
def test_page_fits_the_window(stand_in, visit, names, width, scheme):
    page = opened(visit, stand_in, names, width=width, scheme=scheme)
    stand_in.state |= {"r2": "dead", "r1": "frozen"}
    stand_in.send("happened", {"t_s": 3.25, "kind": "kill", "robot": "r2", "detail": "by hand"})
    stages = ["wake", "odometry", "compute", "command", "beacon_age", "beacon_delivery"]
    worst = {"worst": "r2", "p50_us": 61.25, "p99_us": 1234.5, "max_us": 8000.0, "count": 77000}
    stand_in.send("latency", [{"stage": stage, **worst} for stage in stages])
    dead = page.locator(".plane g.robot[data-state=dead]")
    until(page, stand_in, names, lambda: dead.count() == 1)
    stand_in.frame(names)
    page.wait_for_timeout(200)
    shot(page, f"live-{width}-{scheme}")
    assert page.evaluate("document.documentElement.scrollWidth") <= width
