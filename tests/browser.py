"""A headless browser for tests of pages: the DevTools protocol over two pipes, nothing installed for it."""

import base64
import fcntl
import json
import os
import select
import shutil
import subprocess
import sys
import time

PROGRAMS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
PROGRAM = next(filter(None, map(shutil.which, PROGRAMS)), None)
MISSING = "" if PROGRAM else f"no browser here to show the page in; looked for {', '.join(PROGRAMS)}"
QUIET = """
    --headless --no-sandbox --use-angle=swiftshader --enable-unsafe-swiftshader --disable-quic --no-first-run
    --disable-background-networking --disable-component-update --disable-sync --hide-scrollbars
    --remote-debugging-pipe
"""
# seconds that anything may take on a loaded machine
PATIENCE = 90.0
LAUNCH = """
import os, sys
os.dup2(int(sys.argv[1]), 3)
os.dup2(int(sys.argv[2]), 4)
os.execv(sys.argv[3], sys.argv[3:])
"""


class Browser:
    """One page of a browser; `errors` holds what its console complained of."""

    def __init__(self, profile, width=1280, height=900):
        (there, self._out), (self._in, back) = os.pipe(), os.pipe()
        high = [fcntl.fcntl(end, fcntl.F_DUPFD, 50) for end in (there, back)]
        words = [PROGRAM, *QUIET.split(), f"--user-data-dir={profile}", f"--window-size={width},{height}"]
        self._process = subprocess.Popen(
            [sys.executable, "-c", LAUNCH, *map(str, high), *words, "about:blank"],
            pass_fds=high,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        for end in (there, back, *high):
            os.close(end)
        self._left, self._count, self._session, self.errors, self.asked = b"", 0, None, [], []
        pages = self.send("Target.getTargets")["targetInfos"]
        page = next(one["targetId"] for one in pages if one["type"] == "page")
        self._session = self.send("Target.attachToTarget", targetId=page, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.send(f"{domain}.enable")
        self.resize(width, height)

    def close(self):
        """End the browser and what it started."""
        self._session = None
        try:
            self.send("Browser.close")
            self._process.wait(20)
        finally:
            self._process.kill()
            self._process.wait()
            os.close(self._in)
            os.close(self._out)

    def send(self, method, **parameters):
        """Return the answer to a command; raise what the browser refuses."""
        self._count += 1
        said = {"id": self._count, "method": method, "params": parameters}
        if self._session:
            said["sessionId"] = self._session
        os.write(self._out, json.dumps(said).encode() + b"\0")
        wanted = self._count
        while True:
            heard = self._hear()
            if heard.get("id") == wanted:
                assert "error" not in heard, heard
                return heard["result"]

    def open(self, address):
        """Go to an address and wait until the page says that it is ready."""
        self.send("Page.navigate", url="about:blank")
        self.errors.clear()
        self.send("Page.navigate", url=address)
        began = time.monotonic()
        while self.value("document.documentElement?.dataset.ready") != "yes":
            assert time.monotonic() - began < PATIENCE, f"{address} does not get ready: {self.errors}"
            time.sleep(0.05)

    def value(self, script):
        """Return what a script comes to."""
        answer = self.send("Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def drag(self, start, *places):
        """Press the mouse at a place of the page, draw it over others, and let it go at the last."""

        def mouse(kind, place, **more):
            self.send("Input.dispatchMouseEvent", type=kind, x=place[0], y=place[1], button="left", **more)

        mouse("mousePressed", start, clickCount=1)
        for place in places:
            mouse("mouseMoved", place, buttons=1)
        mouse("mouseReleased", (start, *places)[-1], clickCount=1)

    def key(self, name, code=0):
        """Press a key and let it go."""
        text = {"text": name} if len(name) == 1 else {}
        for kind in ("keyDown", "keyUp"):
            self.send("Input.dispatchKeyEvent", type=kind, key=name, windowsVirtualKeyCode=code, **text)

    def resize(self, width, height):
        """Give the page another size, in pixels."""
        self.send(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=False,
        )

    def prefer(self, scheme):
        """Say that the reader prefers "dark" or "light"."""
        self.send("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])

    def picture(self):
        """Return what is seen, as the bytes of a PNG."""
        return base64.b64decode(self.send("Page.captureScreenshot", format="png")["data"])

    def _hear(self):
        began = time.monotonic()
        while b"\0" not in self._left:
            assert time.monotonic() - began < PATIENCE, "the browser does not answer"
            if select.select([self._in], [], [], 1.0)[0]:
                part = os.read(self._in, 1 << 20)
                assert part, "the browser has ended"
                self._left += part
        one, _, self._left = self._left.partition(b"\0")
        heard = json.loads(one)
        self._note(heard.get("method"), heard.get("params", {}))
        return heard

    def _note(self, method, said):
        if method == "Runtime.exceptionThrown":
            details = said["exceptionDetails"]
            self.errors.append(details.get("exception", {}).get("description") or details["text"])
        elif method == "Runtime.consoleAPICalled" and said["type"] in ("error", "warning", "assert"):
            self.errors.append(" ".join(str(one.get("value")) for one in said["args"]))
        elif method == "Log.entryAdded" and said["entry"]["level"] in ("error", "warning"):
            self.errors.append(said["entry"]["text"])
        elif method == "Network.requestWillBeSent":
            self.asked.append(said["request"]["url"])
