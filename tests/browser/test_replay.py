"""Tests of the replay of a made-up run whose frames are known."""

import math
import re

import pytest
from playwright.sync_api import expect

from conftest import shot, wait_until


def robot(page, name):
    return page.locator(".plane g.robot").filter(has=page.locator("text", has_text=re.compile(f"^{re.escape(name)}$")))


def now_s(page):
    return float(page.locator(".scrub").input_value())


def go_to(page, t_s):
    page.locator(".scrub").evaluate(
        "(range, t_s) => { range.value = t_s; range.dispatchEvent(new Event('input')); }", t_s
    )


@pytest.fixture
def replay(visit, replay_address):
    return visit(replay_address)


def test_replay_moves_from_play_to_pause(replay):
    robots = replay.locator(".plane g.robot")
    before = robots.first.get_attribute("transform")
    assert now_s(replay) == 0
    replay.get_by_role("button", name="Play").click()
    expect(robots.first).not_to_have_attribute("transform", before)
    wait_until(replay, "document.querySelector('.scrub').value > 0.5")
    replay.get_by_role("button", name="Pause").click()
    paused_s = now_s(replay)
    assert 0.5 < paused_s < 20
    replay.wait_for_timeout(300)
    assert now_s(replay) == paused_s
    expect(replay.locator(".time")).to_have_text(f"{paused_s:.2f} s of 20 s")


def test_replay_stops_at_the_end_and_restarts(replay):
    go_to(replay, 19.8)
    replay.get_by_role("button", name="Play").click()
    expect(replay.get_by_role("button", name="Play")).to_be_visible()
    assert now_s(replay) == 20
    replay.get_by_role("button", name="Play").click()
    wait_until(replay, "document.querySelector('.scrub').value < 15")


def test_scrubber_moves_to_the_clicked_position(replay):
    box = replay.locator(".scrub").bounding_box()
    replay.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    assert abs(now_s(replay) - 10) < 0.2
    expect(replay.locator(".time")).to_contain_text(f"{now_s(replay):.2f} s")


@pytest.mark.parametrize("t_s", [0, 4.95, 6, 13.7, 20])
def test_every_robot_has_the_pose_of_the_frame(replay, scene, frames, t_s):
    go_to(replay, t_s)
    frame = min(frames, key=lambda frame: abs(frame["t_s"] - t_s))
    for place, (told, known) in enumerate(zip(frame["robots"], scene["robots"])):
        replay.locator(".robots tbody tr").nth(place).get_by_role("button").click()
        shown = replay.locator("p.selected").inner_text()
        assert shown.startswith(f"{known['name']}: ")
        x_m, y_m, heading_rad = map(float, re.findall(r"(-?\d+\.\d+) (?:m|rad)", shown)[-3:])
        assert abs(x_m - told["x_m"]) <= 0.00101
        assert abs(y_m - told["y_m"]) <= 0.00101
        assert abs(math.remainder(heading_rad - told["heading_rad"], math.tau)) <= 0.00101
        error = replay.locator(".robots tbody tr").nth(place).locator(".error").inner_text()
        assert abs(float(error) - told["error_m"]) <= 0.00006
    expect(replay.locator(".distance")).to_contain_text(f"{frame['distance_m']:.4f} m")


def test_picture_has_equal_axes_and_shows_front_points(replay, scene, frames):
    def front(told, known):
        ahead_m, heading_rad = known["front_point_m"], told["heading_rad"]
        return told["x_m"] + ahead_m * math.cos(heading_rad), told["y_m"] + ahead_m * math.sin(heading_rad)

    known = [front(*pair) for pair in zip(frames[0]["robots"], scene["robots"])]
    moves = replay.locator(".plane g.robot").evaluate_all("robots => robots.map(r => r.getAttribute('transform'))")
    shown = [tuple(map(float, re.findall(r"-?[\d.]+", move))) for move in moves]
    scale = (shown[1][0] - shown[0][0]) / (known[1][0] - known[0][0])
    for (x, y), (x_m, y_m) in zip(shown[1:], known[1:]):
        assert abs((x - shown[0][0]) - scale * (x_m - known[0][0])) < 0.002 * scale + 0.2
        assert abs((y - shown[0][1]) + scale * (y_m - known[0][1])) < 0.002 * scale + 0.2
    radius = float(replay.locator(".plane .reach").first.get_attribute("r"))
    assert abs(radius - scale * scene["distance_min_m"] / 2) < 0.01 * radius


def test_keys_play_step_and_change_the_speed(replay):
    replay.locator(".plane").focus()
    press = replay.keyboard.press
    press("End")
    assert now_s(replay) == 20
    press("Home")
    press("ArrowRight")
    press("ArrowRight")
    assert now_s(replay) == 2
    press("ArrowLeft")
    press(".")
    assert abs(now_s(replay) - 1.05) < 1e-9
    press(",")
    assert now_s(replay) == 1
    press("+")
    press("+")
    expect(replay.locator(".speed")).to_have_value("4")
    for _ in range(9):
        press("-")
    expect(replay.locator(".speed")).to_have_value("0.25")
    press(" ")
    expect(replay.get_by_role("button", name="Pause")).to_be_visible()
    wait_until(replay, "document.querySelector('.scrub').value > 1")
    press(" ")
    expect(replay.get_by_role("button", name="Play")).to_be_visible()


def test_every_control_is_reached_by_tab_with_an_outline(replay):
    reached = set()
    focused = """() => {
        const at = document.activeElement;
        if (at === document.body) return "the page";
        if (getComputedStyle(at).outlineStyle === "none") return `no outline: ${at.outerHTML}`;
        return at.className || at.textContent || at.dataset.layer;
    }"""
    for _ in range(40):
        replay.keyboard.press("Tab")
        reached.add(replay.evaluate(focused))
    assert not [name for name in reached if name.startswith("no outline")]
    assert {"plane", "play", "scrub", "speed", "pick", "Fit", "Follow"} <= reached, reached


def test_dead_frozen_and_returning_robots_are_marked(replay):
    def states(t_s):
        go_to(replay, t_s)
        shown = replay.locator(".plane g.robot").evaluate_all("robots => robots.map(r => r.dataset.state)")
        listed = replay.locator(".robots tbody .state").all_inner_texts()
        assert shown == listed
        return shown

    gray = "getComputedStyle(document.querySelectorAll('.plane .reach')[1]).stroke"
    moving = replay.evaluate(gray)
    assert states(4.9) == ["moving", "moving", "moving"]
    assert states(6) == ["moving", "dead", "moving"]
    assert replay.evaluate(gray) != moving
    assert replay.locator(".plane .mark").nth(1).get_attribute("d") != ""
    expect(replay.locator(".fault")).to_have_text("kill r2")
    assert states(7.8) == ["moving", "starting", "moving"]
    assert states(8.5) == ["moving", "moving", "moving"]
    assert replay.evaluate(gray) == moving
    assert replay.locator(".plane .mark").nth(1).get_attribute("d") == ""
    assert states(11) == ["frozen", "moving", "moving"]


def test_edges_are_drawn_by_state(replay):
    def edge(place, t_s):
        go_to(replay, t_s)
        arrow = replay.locator(".plane .edge").nth(place)
        return arrow.get_attribute("data-state"), arrow.evaluate(
            """e => {
                const look = getComputedStyle(e.querySelector('.line'));
                return [getComputedStyle(e).opacity, look.stroke, look.strokeDasharray].join();
            }"""
        )

    looks = {}
    # r1 is frozen from 10 s: r2 receives nothing from it. r2 is dead from 5 s to 7.5 s.
    for place, t_s, state in [
        (0, 4.9, "fresh"), (0, 10.1, "stale"), (0, 11, "lost"), (0, 14, "fresh"),
        (0, 6, "dead"), (1, 6, "dead"), (2, 6, "fresh"), (0, 7.8, "lost"), (2, 17.5, "cut"), (2, 19, "fresh"),
    ]:
        found, look = edge(place, t_s)
        assert found == state, f"edge {place} at {t_s} s"
        assert looks.setdefault(state, look) == look
    assert len(set(looks.values())) == 5, looks
    assert all("none" not in looks[state] for state in ("lost", "cut", "dead")), looks
    for state in looks:
        expect(replay.locator(f".legend [data-need=edges] .edge[data-state={state}]")).to_have_count(1)
    # No robot here has spares.
    assert replay.locator(".legend [data-need=spares]").get_attribute("hidden") == ""


def test_robots_in_formation_have_different_colors(visit, report_address):
    page = visit(report_address)
    look = "all => all.map(e => getComputedStyle(e)[{}])"
    bodies = page.locator(".plane .body").evaluate_all(look.format("'fill'"))
    assert len(set(bodies)) == 3, bodies
    swatches = page.locator(".robots .swatch").evaluate_all(look.format("'backgroundColor'"))
    assert swatches == bodies


@pytest.mark.parametrize("width", [1280, 390])
def test_numbers_stay_on_one_line(visit, replay_address, width):
    page = visit(replay_address, width)
    go_to(page, 14.5)
    lines = "all => all.map(e => e.getClientRects().length && e.getBoundingClientRect().height / parseFloat(getComputedStyle(e).lineHeight))"
    for numbers in (".readout .time", ".readout .distance", ".robots td.error"):
        high = page.locator(numbers).evaluate_all(lines)
        assert all(0 < each < 1.9 for each in high), (numbers, high)


def test_overlapping_circles_are_marked_below_distance_d(replay):
    go_to(replay, 12)
    expect(replay.locator(".plane g.near")).to_have_count(0)
    go_to(replay, 14.5)
    expect(replay.locator(".plane g.near")).to_have_count(3)
    expect(replay.locator(".distance")).to_have_class(re.compile("under"))


def test_faults_on_the_time_line_have_labels_and_seek(replay):
    mark = replay.get_by_role("button", name="freeze r1, 10.00 s to 12.00 s")
    box, track = mark.bounding_box(), replay.locator(".marks").bounding_box()
    assert abs((box["x"] - track["x"]) / track["width"] - 0.5) < 0.01
    assert abs(box["width"] / track["width"] - 0.1) < 0.01
    mark.click()
    assert now_s(replay) == 10


def test_hostile_name_is_shown_as_text(replay, scene):
    hostile = scene["robots"][2]["name"]
    assert "<img" in hostile
    expect(replay.locator(".robots tbody th").nth(2)).to_have_text(hostile)
    assert replay.locator("img").count() == 0


def test_picture_zooms_moves_fits_and_marks_the_clicked_robot(replay):
    apart = "(() => { const [a, b] = [...document.querySelectorAll('.plane .front')].map(r => r.getBoundingClientRect().x); return Math.abs(a - b); })()"
    fitted = replay.evaluate(apart)
    replay.get_by_role("button", name="Zoom in").click()
    assert abs(replay.evaluate(apart) / fitted - 1.5) < 0.02
    first = replay.locator(".plane g.robot").first
    before = first.get_attribute("transform")
    box = replay.locator(".plane").bounding_box()
    replay.mouse.move(box["x"] + 30, box["y"] + 30)
    replay.mouse.down()
    replay.mouse.move(box["x"] + 90, box["y"] + 70, steps=4)
    replay.mouse.up()
    assert first.get_attribute("transform") != before
    expect(replay.locator("g.selected")).to_have_count(0)
    replay.get_by_role("button", name="Fit").click()
    assert abs(replay.evaluate(apart) - fitted) < 0.5
    replay.locator(".plane .front").nth(1).click(force=True)
    expect(replay.locator("tr.selected")).to_contain_text("r2")
    expect(replay.locator(".plane .edge.heard")).to_have_count(1)


def test_reduced_motion_plays_in_still_pictures(visit, replay_address):
    count = """() => new Promise((resolve) => {
        let drawn = 0;
        new MutationObserver(() => drawn++).observe(document.querySelector('.plane g.robot'), { attributes: true, attributeFilter: ['transform'] });
        setTimeout(() => resolve(drawn), 2000);
    })"""
    page = visit(replay_address, reduced_motion="reduce")
    page.get_by_role("button", name="Play").click()
    # Two pictures per second; a slow machine draws fewer.
    assert 1 <= page.evaluate(count) <= 5


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [1280, 390])
def test_page_fits_the_window(visit, replay_address, width, scheme):
    page = visit(replay_address, width, scheme)
    go_to(page, 6.5)
    page.wait_for_timeout(200)
    shot(page, f"replay-{width}-{scheme}")
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    light = page.locator(".phalanx-picture").evaluate("e => getComputedStyle(e).backgroundColor") == "rgb(255, 255, 255)"
    assert light == (scheme == "light")
