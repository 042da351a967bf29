"""``evergym play`` as a person meets it: headless Chromium loads the page, drives, hands over, and sees the success.

The pictures it takes are kept in ``runs/browser`` (or in the folder that ``EVERGYM_ARTEFACTS`` names). Without Chromium
the test is skipped, and says so; with ``EVERGYM_BROWSER_REQUIRED`` set, as the gate sets it, that is a failure.
"""

from __future__ import annotations

import os
import re
import shutil
import signal
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

CHECKOUT = Path(__file__).resolve().parents[2]
CHROMIUM = next(
    (path for name in ("chromium", "chromium-browser", "google-chrome") if (path := shutil.which(name))), None
)
PATIENCE = 600.0  # [s] until something is seen: WebGL in software on a busy machine; nothing here is a benchmark
SIZE = {"width": 720, "height": 480}
"""Of the window while the robot moves: the less canvas, the less work without a graphics card."""
PICTURE = {"width": 1280, "height": 860}

if CHROMIUM is None and not os.environ.get("EVERGYM_BROWSER_REQUIRED"):
    pytest.skip(
        "the browser test needs Chromium, which is not installed (Debian: apt-get install chromium)",
        allow_module_level=True,
    )

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def artefacts() -> Path:
    """Where the pictures are kept."""
    folder = Path(os.environ.get("EVERGYM_ARTEFACTS", CHECKOUT / "runs" / "browser"))
    folder.mkdir(parents=True, exist_ok=True)
    return folder


@pytest.fixture
def served(tmp_path: Path) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """``evergym play`` in a process of its own, and the page's address."""
    words = ["play", "--family", "held_out", "--index", "0", "--port", "0", "--no-browser", "--speed", "2"]
    words += ["--env-options", "time_limit_s=3600"]  # a slow machine must not run out of the robot's time
    code = "import sys; from evergym.agents.cli import main; sys.exit(main(sys.argv[1:]))"
    process = subprocess.Popen(
        [sys.executable, "-c", code, *words, "--folder", str(tmp_path / "episodes")],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        # A shell that runs tests in the background lets its children ignore Ctrl-C.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    try:
        assert process.stdout is not None
        address = ""
        for line in process.stdout:
            if found := re.search(r"http://127\.0\.0\.1:\d+", line):
                address = found[0]
                break
        assert address, process.stderr.read() if process.stderr else ""
        yield process, address
    finally:
        if process.poll() is None:
            process.kill()
        process.communicate()


@pytest.fixture
def browser() -> Iterator[Any]:
    """Headless Chromium with WebGL in software."""
    sync_api = pytest.importorskip("playwright.sync_api")
    if CHROMIUM is None:
        pytest.fail("EVERGYM_BROWSER_REQUIRED is set, but Chromium is not installed.")
    flags = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    with sync_api.sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=CHROMIUM, args=flags, timeout=1e3 * PATIENCE)
        yield chromium
        chromium.close()


class Tab:
    """A page of the robot, read as a person reads it."""

    def __init__(self, browser: Any, address: str) -> None:
        self.page = browser.new_page(viewport=SIZE)
        self.page.set_default_timeout(1e3 * PATIENCE)
        self.errors: list[str] = []
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.goto(address, wait_until="commit")

    def take_picture(self, path: Path) -> None:
        """Keep a picture of the page in a window of usual size."""
        for button in self.page.locator(".mantine-Notification-closeButton").all():
            button.click()
        self.page.set_viewport_size(PICTURE)
        time.sleep(3.0)  # the canvas has no text to wait for
        self.page.screenshot(path=path)
        self.page.set_viewport_size(SIZE)

    def read(self, name: str) -> str:
        return str(self.page.inner_text(f"[data-reading={name}]"))

    def numbers(self, name: str) -> list[float]:
        return [float(text) for text in re.findall(r"-?\d+\.\d+", self.read(name))]

    def wait(self, name: str, condition: Callable[[str], bool], what: str) -> None:
        """Wait until a reading meets a condition."""
        end = time.monotonic() + PATIENCE
        while not condition(text := self.read(name)):
            assert time.monotonic() < end, f"{what}: still '{text}' after {PATIENCE:.0f} s"
            time.sleep(0.2)

    def is_still(self) -> bool:
        """Whether the tip stays where it is while the robot's time goes on."""
        before, time_before = self.read("tip"), self.numbers("time")[0]
        self.wait("time", lambda _: self.numbers("time")[0] > time_before + 0.5, "time goes on")
        return self.read("tip") == before

    def wait_banner(self, text: str) -> None:
        self.wait("banner", lambda shown: text in shown, f"banner '{text}'")


def drop_sockets(address: str) -> None:
    """Connect as browsers do and vanish: in the middle of a request, of the handshake, and just after it."""
    host, port = address.removeprefix("http://").split(":")
    upgrade = (
        f"GET / HTTP/1.1\r\nHost: {host}:{port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n"
    )
    for request in ("GET / HT", upgrade, upgrade + "Sec-WebSocket-Protocol: viser-v1.1.1\r\n\r\n"):
        with socket.create_connection((host, int(port))) as client:
            client.sendall(request.encode())
            time.sleep(0.2)
            client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))  # a reset, no goodbye


def test_a_robot_under_ones_hands(served: tuple[subprocess.Popen[str], str], browser: Any, artefacts: Path) -> None:
    process, address = served
    tab = Tab(browser, address)
    tab.wait_banner("Ready")
    tab.take_picture(artefacts / "1-ready.png")
    start = tab.numbers("tip")
    assert len(start) == 3

    # A slider: the first one is the insertion; its end is full speed ahead. The tip moves along +z.
    slider = tab.page.get_by_role("slider").first
    slider.focus()
    slider.press("End")
    tab.wait_banner("You drive")
    tab.wait("tip", lambda _: tab.numbers("tip")[2] > start[2] + 1.0, "the tip moves with the slider")

    # Keys: pull the tendon, then let go.
    tab.page.evaluate("document.activeElement.blur()")
    for _ in range(5):
        tab.page.keyboard.press("o")
        time.sleep(0.2)  # taps; quicker ones are a key that is held
    tab.wait("pull", lambda _: tab.numbers("pull")[0] > 0.1, "the tendon is pulled by keys")
    tab.page.keyboard.press("x")
    tab.wait("tip", lambda _: tab.is_still(), "X stops the robot")
    tab.page.keyboard.press("p")
    tab.wait_banner("Paused")

    # A second tab shows the same robot and can reset it for both; sockets that drop are nobody's business.
    other = Tab(browser, address)
    other.wait("tip", lambda text: text == tab.read("tip"), "both tabs show the same tip")
    drop_sockets(address)
    other.page.keyboard.press("r")
    tab.wait_banner("Ready")
    assert tab.numbers("tip") == start

    # Hand over in one tab, reload the other in mid-episode.
    other.page.keyboard.press("c")
    # On a starved machine the page may be read so seldom that the drive is over before it is seen.
    other.wait("banner", lambda text: "duty cycle drives" in text or "Target reached" in text, "the controller drives")
    other.take_picture(artefacts / "2-duty-cycle.png")
    tab.page.reload(wait_until="commit")
    other.wait_banner("Target reached")
    tab.wait_banner("Target reached")
    assert tab.numbers("tip-error")[0] <= 5.0
    assert tab.read("tip") == other.read("tip") != start
    tab.take_picture(artefacts / "3-reached.png")

    # Save, close the tabs, and end by Ctrl-C: quietly, with exit code 0.
    folder = Path(process.args[-1])  # type: ignore[index]
    tab.page.keyboard.press("t")
    end = time.monotonic() + PATIENCE
    while not list(folder.glob("*.episode.npz")):
        assert time.monotonic() < end, "T saves no episode"
        time.sleep(0.2)
    assert tab.errors == other.errors == []
    other.page.close()
    process.send_signal(signal.SIGINT)
    output, errors = process.communicate(timeout=PATIENCE)
    assert (process.returncode, errors) == (0, "")
    assert "Stopped." in output
