"""Headless Chromium, driven by its DevTools protocol: opens a page, inspects it, and takes screenshots."""

import base64
import itertools
import json
import shutil
import subprocess
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import websocket

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
"""Names of the program, by distribution."""

PHONE, DESKTOP = (390, 844), (1280, 900)
"""Width and height of the screen."""

PATIENCE = 30.0
"""Seconds that anything may take."""

_SEEN = """(() => ({
  width: window.innerWidth,
  scrollWidth: document.documentElement.scrollWidth,
  images: Array.from(document.images, image => [image.alt, image.complete ? image.naturalWidth : 0]),
  anchors: Array.from(document.querySelectorAll('a[href^="#"]'), link => link.getAttribute('href').slice(1))
    .filter(id => !document.getElementById(id)),
  doubled: Array.from(document.querySelectorAll('[id]'), node => node.id).filter((id, at, all) => all.indexOf(id) < at),
}))()"""


@dataclass(frozen=True)
class Seen:
    """A page as a browser sees it.

    Attributes
    ----------
    width, scroll_width : int
        Of the window, and of the document: where it is wider, the page scrolls sideways.
    images : tuple
        Alternative text and width of each, 0 where it did not load.
    dangling, doubled : tuple of str
        Anchors that lead nowhere, and identifiers that occur twice.
    errors : tuple of str
        Of the console and of scripts, and requests over the network.
    """

    width: int
    scroll_width: int
    images: tuple[tuple[str, int], ...]
    dangling: tuple[str, ...]
    doubled: tuple[str, ...]
    errors: tuple[str, ...]


def browser_program() -> str | None:
    """Path of a Chromium, None where there is none."""
    return next(filter(None, map(shutil.which, NAMES)), None)


@dataclass
class Tab:
    """A tab of a running browser."""

    socket: websocket.WebSocket
    numbers: Iterator[int] = field(default_factory=lambda: itertools.count(1))
    events: list[dict[str, Any]] = field(default_factory=list)

    def ask(self, method: str, **parameters: object) -> dict[str, Any]:
        """Send a command and wait for its reply; events of the page are collected meanwhile."""
        number = next(self.numbers)
        self.socket.send(json.dumps({"id": number, "method": method, "params": parameters}))
        while True:
            message = json.loads(self.socket.recv())
            if message.get("id") == number:
                assert "error" not in message, message["error"]
                return message["result"]
            self.events.append(message)

    def open(self, page: Path, size: tuple[int, int]) -> Seen:
        """Open a file on a screen of a size and look at it."""
        self.events.clear()
        width, height = size
        self.ask("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1,
                 mobile=size == PHONE)  # fmt: skip
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.ask(f"{domain}.enable")
        self.ask("Page.navigate", url=page.resolve().as_uri())
        self._wait("Page.loadEventFired")
        found = self.ask("Runtime.evaluate", expression=_SEEN, returnByValue=True)["result"]["value"]
        return Seen(
            found["width"], found["scrollWidth"], tuple(map(tuple, found["images"])), tuple(found["anchors"]),
            tuple(found["doubled"]), tuple(filter(None, map(_error, self.events))),
        )  # fmt: skip

    def picture(self, path: Path, top: float = 0.0, height: float | None = None) -> Path:
        """Save a screenshot of the page, or of a part of it, `top` and `height` in pixels."""
        size = self.ask("Page.getLayoutMetrics")["cssContentSize"]
        tall = size["height"] - top if height is None else min(height, size["height"] - top)
        clip = {"x": 0, "y": top, "width": size["width"], "height": tall, "scale": 1}
        answer = self.ask("Page.captureScreenshot", format="png", captureBeyondViewport=True, clip=clip)
        path.write_bytes(base64.b64decode(answer["data"]))
        return path

    def print(self, path: Path) -> Path:
        """Save the printed page as PDF."""
        path.write_bytes(base64.b64decode(self.ask("Page.printToPDF", paperWidth=8.27, paperHeight=11.69)["data"]))
        return path

    def _wait(self, event: str) -> None:
        while not any(message.get("method") == event for message in self.events):
            self.events.append(json.loads(self.socket.recv()))


@contextmanager
def browser(program: str, folder: Path) -> Iterator[Tab]:
    """Run a headless browser with an empty profile in a folder."""
    command = [
        program, "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--no-first-run",
        "--remote-debugging-port=0", "--remote-allow-origins=*", f"--user-data-dir={folder}", "about:blank",
    ]  # fmt: skip
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        socket = websocket.create_connection(_address(folder, process), timeout=PATIENCE)
        try:
            yield Tab(socket)
        finally:
            socket.close()
    finally:
        process.terminate()
        process.wait(PATIENCE)


def _address(folder: Path, process: subprocess.Popen[bytes]) -> str:
    """Address of the browser's first tab, once it is up."""
    port_file = folder / "DevToolsActivePort"
    port = _soon(
        lambda: port_file.read_text().split()[0] if port_file.exists() and port_file.read_text() else None, process
    )
    return str(_soon(lambda: _first_tab(port), process))


def _first_tab(port: str) -> str | None:
    with urllib.request.urlopen(f"http://127.0.0.1:{port}/json/list", timeout=PATIENCE) as answer:
        tabs = json.load(answer)
    return next((tab["webSocketDebuggerUrl"] for tab in tabs if tab["type"] == "page"), None)


def _soon(answer: Any, process: subprocess.Popen[bytes]) -> Any:
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        assert process.poll() is None, f"the browser ended with {process.returncode}"
        found = answer()
        if found is not None:
            return found
        time.sleep(0.05)
    raise TimeoutError("the browser did not come up")


def _error(message: dict[str, Any]) -> str | None:
    """Error in an event of the browser, None where there is none."""
    parameters = message.get("params", {})
    match message.get("method"):
        case "Runtime.exceptionThrown":
            return str(parameters["exceptionDetails"])
        case "Runtime.consoleAPICalled":
            return str(parameters["args"]) if parameters["type"] in ("error", "assert") else None
        case "Log.entryAdded":
            return str(parameters["entry"]["text"]) if parameters["entry"]["level"] == "error" else None
        case "Network.requestWillBeSent":
            address = str(parameters["request"]["url"])
            return None if address.startswith(("file:", "data:")) else f"asked the network for {address}"
    return None
