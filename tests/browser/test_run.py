"""Tests of the report and the live view of real runs."""

import pytest
from playwright.sync_api import expect

from conftest import shot, wait_until
from test_replay import go_to, now_s


def states(page):
    return page.locator(".plane g.robot").evaluate_all("robots => robots.map(r => r.dataset.state)")


def every_state(page, *asked):
    """Waits until the robots are in these states, while the run continues."""
    shown = "[...document.querySelectorAll('.plane g.robot')].map(robot => robot.dataset.state).join()"
    wait_until(page, f"asked => {shown} === asked", ",".join(asked))


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [1280, 390])
def test_report_replays_its_run(visit, report_address, width, scheme):
    page = visit(report_address, width, scheme)
    assert page.evaluate("performance.getEntriesByType('navigation')[0].domComplete") < 10_000
    go_to(page, 9.9)
    assert states(page) == ["moving"] * 3
    go_to(page, 11)
    assert states(page) == ["moving", "dead", "moving"]
    shot(page, f"report-{width}-{scheme}")
    go_to(page, 13)
    assert states(page) == ["moving"] * 3
    page.get_by_role("button", name="Play").click()
    wait_until(page, "document.querySelector('.scrub').value > 13.2")
    assert now_s(page) > 13
    assert page.evaluate("document.documentElement.scrollWidth") <= width


def test_robot_is_killed_and_restarted_manually(start_run, visit):
    page = visit(start_run(duration_s=600))
    expect(page.locator(".lamp")).to_have_attribute("data-link", "live")
    every_state(page, "moving", "moving", "moving")
    page.get_by_role("button", name="kill r2").click()
    every_state(page, "moving", "dead", "moving")
    # r1 receives from r2 and r2 from r3: edges from and to the dead robot.
    for place, state in enumerate(["dead", "dead", "fresh"]):
        expect(page.locator(".plane .edge").nth(place)).to_have_attribute("data-state", state)
    expect(page.locator(".log")).to_contain_text("kill r2")
    expect(page.locator(".latency tbody tr").first).to_be_visible()
    shot(page, "run-1280-light")
    page.get_by_role("button", name="restart r2").click()
    every_state(page, "moving", "moving", "moving")
    page.get_by_role("button", name="freeze r1").click()
    every_state(page, "frozen", "moving", "moving")
    page.get_by_role("button", name="thaw r1").click()
    every_state(page, "moving", "moving", "moving")


def test_edge_of_a_run_is_cut_and_mended_manually(start_run, visit):
    page = visit(start_run(duration_s=600))
    state = page.locator(".edges tbody tr").first.locator(".state")
    expect(state).to_have_text("fresh")
    page.get_by_role("button", name="cut r2 to r1").click()
    expect(state).to_have_text("cut")
    expect(page.locator(".plane .edge").first).to_have_attribute("data-state", "cut")
    page.get_by_role("button", name="mend r2 to r1").click()
    expect(state).to_have_text("fresh")


def test_finished_run_is_reported_and_not_polled_again(start_run, visit):
    page = visit(start_run(duration_s=8))
    lamp = page.locator(".lamp")
    expect(lamp).to_contain_text("the run has ended, exit code 0")
    expect(page.locator(".end")).to_contain_text("no expectations declared")
    page.wait_for_timeout(3000)
    expect(lamp).to_have_attribute("data-link", "ended")
