"""A headless Chromium, spoken to through its debugging pipe: no driver, no network."""

import base64
import contextlib
import json
import os
import selectors
import shutil
import subprocess
import time

NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
COMMANDS, EVENTS = 3, 4  # descriptors that `--remote-debugging-pipe` reads and writes
TIMEOUT = 120.0  # seconds
# What a drawer holds that is shut, out of sight as a whole, does not stick out.
OVERFLOW = """
[...document.querySelectorAll("body *")].filter(node => {
  for (let box = node; box; box = box.parentElement) {
    const style = getComputedStyle(box), {left, right} = box.getBoundingClientRect();
    if (style.position === "fixed" && (right <= 0 || left >= innerWidth)) return false;
    if (box !== node && ["auto", "scroll"].includes(style.overflowX)) return false;
  }
  const {left, right} = node.getBoundingClientRect();
  return right > document.documentElement.clientWidth + 1 || left < -1;
}).map(node => node.outerHTML.slice(0, 120))
"""


def find():
    """Return the path of a browser, or None."""
    return next(filter(None, map(shutil.which, NAMES)), None)


class Browser:
    """Open pages one after the other, and keep what they said and asked for."""

    def __init__(self, profile):
        ours, theirs = os.pipe(), os.pipe()

        def connect():
            # high copies first, lest one descriptor overwrites another
            read, write = os.dup(ours[0]), os.dup(theirs[1])
            copies = [os.dup2(fd, 50 + i) for i, fd in enumerate((read, write))]
            os.dup2(copies[0], COMMANDS)
            os.dup2(copies[1], EVENTS)

        flags = ["--headless", "--no-sandbox", "--disable-gpu", "--no-first-run"]
        flags += ["--disable-background-networking", "--hide-scrollbars"]
        self.process = subprocess.Popen(
            [
                *(find(), *flags, f"--user-data-dir={profile}"),
                *("--remote-debugging-pipe", "about:blank"),
            ],
            preexec_fn=connect,
            close_fds=False,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(ours[0])
        os.close(theirs[1])
        self.write, self.read = ours[1], theirs[0]
        self.buffer, self.number, self.session = b"", 0, None
        self.events = []
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        attached = self.call("Target.attachToTarget", targetId=target, flatten=True)
        self.session = attached["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")

    def __enter__(self):
        return self

    def __exit__(self, *error):
        with contextlib.suppress(BrokenPipeError):
            self.session = None
            self._send("Browser.close")
        try:
            self.process.wait(20)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        os.close(self.write)
        os.close(self.read)

    def call(self, method, **params):
        """Return the result of a command, and keep the events that come before it."""
        number = self._send(method, **params)
        while True:
            message = self._receive()
            if message.get("id") == number:
                assert "error" not in message, (method, message["error"])
                return message["result"]
            self.events.append(message)

    def open(self, path, width, height=800):
        """Load a file in a window of a width in CSS pixels."""
        self.events.clear()
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=width < 600,
        )
        self.call("Page.navigate", url=path.as_uri())
        while not any(e.get("method") == "Page.loadEventFired" for e in self.events):
            self.events.append(self._receive())

    def prefer(self, scheme):
        """Let pages see a reader who prefers a color scheme, "light" or "dark"."""
        features = [{"name": "prefers-color-scheme", "value": scheme}]
        self.call("Emulation.setEmulatedMedia", features=features)

    def evaluate(self, expression):
        """Return the value of an expression in JavaScript, or of its promise."""
        answer = self.call(
            "Runtime.evaluate",
            expression=expression,
            returnByValue=True,
            awaitPromise=True,
        )
        assert "exceptionDetails" not in answer, answer
        return answer["result"]["value"]

    def overflowing(self):
        """Return what sticks out sideways, and is not inside a box that scrolls."""
        return self.evaluate(OVERFLOW)

    def complaints(self):
        """Return what the page wrote to the console, and what it threw."""
        kinds = "Runtime.consoleAPICalled", "Runtime.exceptionThrown", "Log.entryAdded"
        return [e["params"] for e in self.events if e.get("method") in kinds]

    def requests(self):
        """Return the addresses that the page asked for, its own included."""
        return [
            e["params"]["request"]["url"]
            for e in self.events
            if e.get("method") == "Network.requestWillBeSent"
        ]

    def screenshot(self, path):
        """Write the whole page as PNG."""
        data = self.call("Page.captureScreenshot", captureBeyondViewport=True)["data"]
        path.write_bytes(base64.b64decode(data))

    def _send(self, method, **params):
        self.number += 1
        message = {"id": self.number, "method": method, "params": params}
        if self.session is not None:
            message["sessionId"] = self.session
        os.write(self.write, json.dumps(message).encode() + b"\0")
        return self.number

    def _receive(self):
        end = time.monotonic() + TIMEOUT
        with selectors.DefaultSelector() as selector:
            selector.register(self.read, selectors.EVENT_READ)
            while b"\0" not in self.buffer:
                ready = selector.select(max(0.0, end - time.monotonic()))
                data = os.read(self.read, 1 << 16) if ready else b""
                assert data, "the browser is silent or gone"
                self.buffer += data
        message, _, self.buffer = self.buffer.partition(b"\0")
        return json.loads(message)
