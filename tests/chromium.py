"""Drives a headless Chromium through its debugging protocol: opens a page, evaluates scripts, sends input, takes pictures."""

import base64
import json
import os
import pathlib
import shutil
import subprocess
import tempfile
import time

import pytest
import websocket

NAMES = ("chromium", "chromium-browser", "google-chrome")


def find():
    """The browser's path, or None."""
    return next(filter(None, map(shutil.which, NAMES)), None)


def require(what):
    """Skips the test where there is no browser; in the project's own check a page that nobody opened is a failure."""
    if find() is None:
        message = f"no Chromium on the PATH: {what} is not tested (scripts/env installs it where it may)"
        pytest.fail(message) if os.environ.get("LACUNA_REQUIRE_DATA") else pytest.skip(message)


class Page:
    """One page of a browser of its own; what it asks of the network and says on its console is kept."""

    def __init__(self, url, width=1280, height=900, javascript=True):
        # Helpers of the browser may write there a moment longer than itself.
        self.folder = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        self.process = subprocess.Popen(
            [find(), "--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--remote-debugging-port=0",
             "--remote-allow-origins=*", f"--user-data-dir={self.folder.name}", f"--window-size={width},{height}", "about:blank"],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        self.serial, self.requests, self.messages, self.loaded = 0, [], [], False
        self.socket = websocket.create_connection(self._address(), timeout=60, suppress_origin=True)
        for domain in ("Page", "Runtime", "Network", "Log", "Performance"):
            self.call(f"{domain}.enable")
        self.call("Emulation.setScriptExecutionDisabled", value=not javascript)
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
        started = time.perf_counter()
        self.call("Page.navigate", url=url)
        self.wait(lambda: self.loaded)
        self.seconds_to_load = time.perf_counter() - started

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.socket.close()
        self.process.terminate()
        self.process.wait(timeout=30)
        self.folder.cleanup()

    def _address(self):
        port = pathlib.Path(self.folder.name) / "DevToolsActivePort"
        deadline = time.monotonic() + 60
        while time.monotonic() < deadline:
            if port.is_file() and len(lines := port.read_text().split("\n")) > 1:
                break
            time.sleep(0.05)
        import urllib.request
        with urllib.request.urlopen(f"http://127.0.0.1:{lines[0]}/json/list", timeout=60) as answer:
            pages = json.load(answer)
        return next(page["webSocketDebuggerUrl"] for page in pages if page["type"] == "page")

    def _receive(self):
        message = json.loads(self.socket.recv())
        method, parameters = message.get("method"), message.get("params", {})
        if method == "Network.requestWillBeSent":
            self.requests.append(parameters["request"]["url"])
        elif method in ("Runtime.consoleAPICalled", "Runtime.exceptionThrown", "Log.entryAdded"):
            self.messages.append(json.dumps(parameters))
        elif method == "Page.loadEventFired":
            self.loaded = True
        return message

    def call(self, method, **parameters):
        self.serial += 1
        self.socket.send(json.dumps({"id": self.serial, "method": method, "params": parameters}))
        while True:
            message = self._receive()
            if message.get("id") == self.serial:
                assert "error" not in message, message
                return message["result"]

    def busy(self):
        """Seconds of processor time that the page's thread has taken: unlike the clock's, they bear a busy machine."""
        metrics = {metric["name"]: metric["value"] for metric in self.call("Performance.getMetrics")["metrics"]}
        return metrics["ThreadTime"] if "ThreadTime" in metrics else metrics["TaskDuration"]

    def wait(self, true, seconds=300):
        """Until a condition holds; it may be a script."""
        deadline = time.monotonic() + seconds
        while not (self.run(true) if isinstance(true, str) else true()):
            assert time.monotonic() < deadline, f"not within {seconds} s: {true}"
            if callable(true):
                self._receive()
            else:
                time.sleep(0.05)

    def run(self, script):
        """The value of a JavaScript expression."""
        result = self.call("Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in result, result
        return result["result"].get("value")

    def mouse(self, kind, x, y, **more):
        """mousePressed, mouseMoved, mouseReleased or mouseWheel at a point of the window."""
        self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, **({"button": "left", "buttons": 1, "clickCount": 1} | more))

    def key(self, key, code):
        self.call("Input.dispatchKeyEvent", type="keyDown", key=key, code=code)
        self.call("Input.dispatchKeyEvent", type="keyUp", key=key, code=code)

    def picture(self, path):
        path.write_bytes(base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"]))
