"""Pages under test, and a browser that records requests and errors.

PAGES: folder with replay.html, live.html, control.html, scene.json and frames.json of a made-up run.
PHALANX: the binary, for pages of real runs. SHOTS: folder for screenshots. `tests/it/browser.rs` sets
all three.
"""

import json
import os
import re
import signal
import subprocess
import threading
import time
from pathlib import Path
from urllib.parse import urlsplit

import pytest
from playwright.sync_api import expect, sync_playwright

from stand_in import StandIn

ROOT = Path(__file__).parents[2]
PAGES = Path(os.environ["PAGES"])
PHALANX = os.environ["PHALANX"]
SHOTS = Path(os.environ["SHOTS"])
# Deadline of every wait, s. Only a hang reaches it.
HANG_S = 120
expect.set_options(timeout=HANG_S * 1000 / 4)


@pytest.fixture(scope="session")
def chromium():
    # Only the loopback address resolves, so that every other request fails and is noticed.
    no_hosts = "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1"
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path="/usr/bin/chromium", args=[no_hosts])
        yield browser
        browser.close()


@pytest.fixture
def visit(chromium):
    """Opens an address. At the end, the page must have made no request to another host and logged no error.

    A test requests its server fixture first, so that its pages are closed before the server.
    """
    contexts, wrong = [], []

    def visit(address, width=1280, scheme="light", tolerated=None, **options):
        context = chromium.new_context(
            viewport={"width": width, "height": 900}, color_scheme=scheme, **options
        )
        contexts.append(context)
        page = context.new_page()
        page.set_default_timeout(HANG_S * 1000 / 4)

        def heard(message):
            if message.type in ("error", "warning"):
                if not (tolerated and re.search(tolerated, message.text)):
                    wrong.append(f"console: {message.text}")

        def asked(request):
            if request.url.startswith("data:"):
                return
            own, other = urlsplit(address), urlsplit(request.url)
            if (own.scheme, own.netloc) != (other.scheme, other.netloc):
                wrong.append(f"asked of elsewhere: {request.url}")
            elif own.scheme == "file" and own.path != other.path:
                wrong.append(f"asked for another file: {request.url}")

        page.on("console", heard)
        page.on("pageerror", lambda error: wrong.append(f"error: {error}"))
        page.on("dialog", lambda dialog: (wrong.append("a dialog opened"), dialog.dismiss()))
        page.on("request", asked)
        page.goto(address)
        return page

    yield visit
    for context in contexts:
        context.close()
    assert wrong == []


@pytest.fixture(scope="session")
def scene():
    return json.loads((PAGES / "scene.json").read_text())


@pytest.fixture(scope="session")
def frames():
    return json.loads((PAGES / "frames.json").read_text())


@pytest.fixture(scope="session")
def replay_address():
    return (PAGES / "replay.html").as_uri()


@pytest.fixture
def stand_in(request, frames):
    """Returns a stand-in with the live page of this name: "live" or "control"."""
    served = StandIn((PAGES / f"{request.param}.html").read_text(), frames)
    yield served
    served.close()


@pytest.fixture(scope="session")
def report_address(tmp_path_factory):
    """Returns the report of a real run in which r2 is killed at 10 s and restarted at 12 s."""
    run_dir = tmp_path_factory.mktemp("report") / "run"
    command = [PHALANX, "run", "scenarios/triangle-kill.toml", "--pace", "lockstep", "--out", run_dir]
    subprocess.run(command, cwd=ROOT, check=True, timeout=HANG_S)
    return (run_dir / "report.html").as_uri()


@pytest.fixture
def start_run(tmp_path):
    """Starts a real run with a live view and control, and returns its address. Interrupts the run at the end."""
    runs = []

    def start_run(duration_s):
        command = [PHALANX, "run", "scenarios/triangle.toml", "--set", f"duration_s={duration_s}"]
        command += ["--set", "expect={}", "--view", "--view-control", "--out", tmp_path / "run"]
        run = subprocess.Popen(command, cwd=ROOT, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True)
        runs.append(run)
        said = []
        for line in run.stderr:
            said.append(line)
            if found := re.search(r"view: (http://\S+)", line):
                # Keeps reading, so that the run never waits for a full pipe.
                threading.Thread(target=run.stderr.read, daemon=True).start()
                return found[1]
        pytest.fail(f"the run names no address: {''.join(said)}")

    yield start_run
    for run in runs:
        run.send_signal(signal.SIGINT)
        run.wait(timeout=HANG_S)


def wait_until(page, expression, argument=None):
    """Polls until a JavaScript expression holds. (Playwright's own wait needs a weaker content security policy.)"""
    deadline = time.monotonic() + HANG_S
    while not page.evaluate(expression, argument):
        assert time.monotonic() < deadline, f"never: {expression}"
        page.wait_for_timeout(30)


def shot(page, name):
    """Saves a screenshot of the whole page for manual review."""
    SHOTS.mkdir(parents=True, exist_ok=True)
    page.screenshot(path=SHOTS / f"{name}.png", full_page=True)
