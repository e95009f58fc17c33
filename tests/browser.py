"""A headless Chromium for tests, controlled by its DevTools protocol over a pair of pipes."""

import base64
import fcntl
import io
import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
SWITCHES = [
    "--headless",
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-quic",
    "--disable-dev-shm-usage",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--autoplay-policy=no-user-gesture-required",
    "--remote-debugging-pipe",
]
# the protocol wants its pipes as descriptors 3 and 4
START = """import os, sys
os.dup2(int(sys.argv[1]), 3)
os.dup2(int(sys.argv[2]), 4)
os.execv(sys.argv[3], sys.argv[3:])"""
NEEDS_BROWSER = pytest.mark.skipif(
    CHROMIUM is None, reason="no Chromium here; Debian's package chromium brings it"
)
ERROR_EVENTS = ("Runtime.exceptionThrown", "Runtime.consoleAPICalled", "Log.entryAdded")


def in_browser(test: Callable[..., None]) -> Callable[..., None]:
    """Mark a test that opens pages in Chromium; CI runs these in a job of their own."""
    return pytest.mark.browser(NEEDS_BROWSER(test))


def sheets_of(page: Path) -> int:
    """Return the number of sheets on which a browser prints a page."""
    paper = page.with_suffix(".pdf")
    command = [str(CHROMIUM), "--headless", "--no-sandbox", "--disable-gpu", f"--print-to-pdf={paper}"]
    command += [f"--user-data-dir={page.parent / 'profile'}", page.as_uri()]
    subprocess.run(command, capture_output=True, timeout=120, check=True)
    return len(re.findall(rb"/Type\s*/Page\b", paper.read_bytes()))


class Browser:
    """One page in a browser; use it in a `with` block.

    Attributes:
        complaints: errors and warnings of the console, scripts and loads.
    """

    def __init__(self, profile: Path):
        self.complaints: list[dict[str, Any]] = []
        self._count = 0
        assert CHROMIUM is not None
        with ExitStack() as ours:
            theirs: list[int] = []
            ends = os.pipe(), os.pipe()
            for mine, yours in ((ends[0][1], ends[0][0]), (ends[1][0], ends[1][1])):
                ours.callback(os.close, mine)
                theirs.append(fcntl.fcntl(yours, fcntl.F_DUPFD, 10))
                os.close(yours)
            self._out, self._in = ends[0][1], ends[1][0]
            command = [sys.executable, "-c", START, *map(str, theirs), CHROMIUM, *SWITCHES]
            self._process = subprocess.Popen(
                [*command, f"--user-data-dir={profile}", "about:blank"],
                pass_fds=theirs,
                stderr=subprocess.DEVNULL,
            )
            ours.callback(self._process.wait, 30)
            ours.callback(self._process.terminate)
            for end in theirs:
                os.close(end)
            self._begin()
            self._ours = ours.pop_all()

    def _begin(self) -> None:
        self._rest, self._session = b"", None
        (page,) = [item for item in self._call("Target.getTargets")["targetInfos"] if item["type"] == "page"]
        attached = self._call("Target.attachToTarget", targetId=page["targetId"], flatten=True)
        self._session = attached["sessionId"]
        for domain in ("Page", "Runtime", "Log"):
            self._call(f"{domain}.enable")

    def __enter__(self) -> "Browser":
        return self

    def __exit__(self, *_: object) -> None:
        self._ours.close()

    def open(self, page: Path, width: int, scheme: str, fragment: str = "") -> None:
        """Load a page at a width in pixels, in the colour scheme "light" or "dark"."""
        self._call(
            "Emulation.setDeviceMetricsOverride", width=width, height=900, deviceScaleFactor=1, mobile=False
        )
        self._call("Emulation.setTouchEmulationEnabled", enabled=False)
        self._call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])
        # the same page with another fragment alone would not be loaded anew
        self._call("Page.navigate", url="about:blank")
        self._call("Page.navigate", url=page.as_uri() + fragment)
        self.run("document.readyState === 'complete' || new Promise(done => addEventListener('load', done))")

    def run(self, script: str) -> Any:
        """Return the awaited value of a script as plain data."""
        output = self._call("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in output, output
        return output["result"].get("value")

    def drag(self, start: tuple[float, float], *positions: tuple[float, float]) -> None:
        """Drag the mouse from a position of the page over others to the last one."""

        def mouse(kind: str, position: tuple[float, float], **more: int) -> None:
            self._call(
                "Input.dispatchMouseEvent", type=kind, x=position[0], y=position[1], button="left", **more
            )

        mouse("mousePressed", start, clickCount=1)
        for position in positions:
            mouse("mouseMoved", position, buttons=1)
        mouse("mouseReleased", (start, *positions)[-1], clickCount=1)

    def swipe(self, start: tuple[float, float], *positions: tuple[float, float]) -> None:
        """Move a finger from a position of the window over others to the last one, on a phone."""

        def touch(kind: str, *points: tuple[float, float]) -> None:
            self._call(
                "Input.dispatchTouchEvent", type=kind, touchPoints=[{"x": x, "y": y} for x, y in points]
            )

        touch("touchStart", start)
        for position in positions:
            touch("touchMove", position)
            self.run("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
        touch("touchEnd")

    def as_phone(self, width: int, height: int) -> None:
        """Behave as a phone with a touch screen of a size in its pixels, until the next page."""
        self._call(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=3, mobile=True
        )
        self._call("Emulation.setTouchEmulationEnabled", enabled=True, maxTouchPoints=5)

    def press(self, key: str, code: int = 0) -> None:
        """Press and release a key."""
        text = {"text": key} if len(key) == 1 else {}
        for kind in ("keyDown", "keyUp"):
            self._call("Input.dispatchKeyEvent", type=kind, key=key, windowsVirtualKeyCode=code, **text)

    def look(self) -> np.ndarray:
        """Return a picture of the window, (height, width, 3)."""
        data = base64.b64decode(self._call("Page.captureScreenshot")["data"])
        return np.asarray(Image.open(io.BytesIO(data)).convert("RGB"))

    def _call(self, method: str, **params: Any) -> dict[str, Any]:
        self._count += 1
        message = {"id": self._count, "method": method, "params": params}
        if self._session:
            message["sessionId"] = self._session
        text = json.dumps(message).encode() + b"\0"
        while text:
            text = text[os.write(self._out, text) :]
        while (answer := self._receive()).get("id") != self._count:
            if answer.get("method") in ERROR_EVENTS:
                self.complaints.append(answer["params"])
        assert "error" not in answer, (method, answer)
        return answer["result"]

    def _receive(self) -> dict[str, Any]:
        while b"\0" not in self._rest:
            piece = os.read(self._in, 1 << 16)
            assert piece, "the browser ended"
            self._rest += piece
        message, _, self._rest = self._rest.partition(b"\0")
        return json.loads(message)
