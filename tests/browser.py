"""A page in headless Chromium, driven through the DevTools protocol over two pipes."""

import contextlib
import json
import os
import selectors
import shutil
import subprocess
import tempfile
import time
from pathlib import Path

import pytest

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
needs_browser = pytest.mark.skipif(
    CHROMIUM is None, reason="no Chromium in the PATH (Debian: apt install chromium)"
)
TIMEOUT = 60.0  # s, for any answer


class Page:
    """An open page; a context manager.

    Parameters
    ----------
    path : Path
        Of the HTML file.
    width : int
        Of the window [CSS pixels].

    Attributes
    ----------
    console : list of str
        Messages and uncaught exceptions so far.
    requests : list of str
        Addresses asked for so far, the file itself first.
    """

    def __init__(self, path: Path, width: int = 1280):
        self.console, self.requests, self._events = [], [], []
        self._path, self._width = Path(path).resolve(), width
        self._number, self._session, self._buffer = 0, None, b""

    def __enter__(self):
        with contextlib.ExitStack() as stack:
            profile = stack.enter_context(tempfile.TemporaryDirectory(ignore_cleanup_errors=True))
            of_browser, self._to = os.pipe()
            self._from, to_us = os.pipe()
            stack.callback(os.close, self._to)
            stack.callback(os.close, self._from)
            browser = subprocess.Popen(
                [
                    *("/bin/sh", "-c", f'exec "$0" "$@" 3</dev/fd/{of_browser} 4>/dev/fd/{to_us}', CHROMIUM),
                    *(
                        "--headless=new",
                        "--no-sandbox",
                        "--disable-gpu",
                        "--hide-scrollbars",
                        "--no-first-run",
                    ),
                    *("--disable-dev-shm-usage", "--disable-background-networking"),
                    *("--remote-debugging-pipe", f"--user-data-dir={profile}", "about:blank"),
                ],
                pass_fds=(of_browser, to_us),
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
            stack.callback(browser.wait)
            stack.callback(browser.kill)
            os.close(of_browser)
            os.close(to_us)
            self._open()
            self._closing = stack.pop_all()
        return self

    def __exit__(self, *error):
        self._closing.close()

    def _open(self):
        target = self.send("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.send("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.send(f"{domain}.enable")
        self.resize(self._width)
        self.send("Page.navigate", url=self._path.as_uri())
        self._wait(lambda m: m.get("method") == "Page.loadEventFired")

    def resize(self, width: int, height: int = 900):
        """Give the window another size [CSS pixels]."""
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        self.send("Emulation.setDeviceMetricsOverride", **size)

    def evaluate(self, expression: str):
        """Return the value of a JavaScript expression; an exception in it fails the test."""
        told = self.send("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in told, told["exceptionDetails"]
        return told["result"].get("value")

    def mouse(self, kind: str, x: float, y: float, **more):
        """Dispatch ``mousePressed``, ``mouseReleased``, ``mouseMoved`` or ``mouseWheel`` at a place."""
        self.send("Input.dispatchMouseEvent", type=kind, x=x, y=y, **{"button": "none", **more})

    def send(self, method: str, **parameters):
        """Call a method of the protocol and return its result."""
        self._number += 1
        call = {"id": self._number, "method": method, "params": parameters}
        call |= {"sessionId": self._session} if self._session else {}
        data = json.dumps(call).encode() + b"\0"
        while data:
            data = data[os.write(self._to, data) :]
        answer = self._wait(lambda m: m.get("id") == self._number)
        assert "error" not in answer, f"{method}: {answer['error']}"
        return answer["result"]

    def _wait(self, wanted):
        for i, message in enumerate(self._events):
            if wanted(message):
                return self._events.pop(i)
        end = time.monotonic() + TIMEOUT
        while not wanted(message := self._next(end)):
            self._events.append(message)
        return message

    def _next(self, end: float):
        with selectors.DefaultSelector() as selector:
            selector.register(self._from, selectors.EVENT_READ)
            while b"\0" not in self._buffer:
                assert selector.select(max(0.0, end - time.monotonic())), "the browser does not answer"
                data = os.read(self._from, 1 << 16)
                assert data, "the browser has ended"
                self._buffer += data
        text, _, self._buffer = self._buffer.partition(b"\0")
        message = json.loads(text)
        self._note(message.get("method"), message.get("params", {}))
        return message

    def _note(self, method, told):
        if method == "Runtime.consoleAPICalled":
            self.console.append(" ".join(str(a.get("value", a.get("description"))) for a in told["args"]))
        elif method == "Runtime.exceptionThrown":
            details = told["exceptionDetails"]
            self.console.append(details.get("exception", {}).get("description", details["text"]))
        elif method == "Log.entryAdded":
            self.console.append(told["entry"]["text"])
        elif method == "Network.requestWillBeSent":
            self.requests.append(told["request"]["url"])
