"""A real browser without a window, driven over its DevTools protocol: Chromium with its software GL."""
import base64
import json
import os
import shutil
import subprocess
import tempfile
import time
import urllib.request

try:
    import websocket  # python3-websocket
except ImportError:
    websocket = None

PROGRAM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")


def why_not():
    """What the tests of the page lack, or None."""
    if not PROGRAM:
        return "no chromium (scripts/install-packages --ci installs it)"
    return None if websocket else "no python3-websocket (scripts/install-packages --ci installs it)"


class Browser:
    """One browser with one page. What its console says of errors and warnings is collected in `complaints`."""

    def __init__(self, width=1280, height=800):
        self.folder = tempfile.mkdtemp(prefix="toothprep-browser-")
        arguments = ["--headless=new", "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
                     "--remote-debugging-port=0", "--remote-allow-origins=*", f"--user-data-dir={self.folder}", "--no-first-run",
                     "--disable-extensions", "--disable-background-networking", "--disable-component-update", "--mute-audio",
                     f"--window-size={width},{height}", "about:blank"]
        self.process = subprocess.Popen([PROGRAM, *arguments], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        self.complaints, self.number, self.socket = [], 0, None
        try:
            self.socket = websocket.create_connection(self.page_address(), timeout=60, max_size=None)
        except Exception:
            self.close()
            raise
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)

    def page_address(self):
        port_file = os.path.join(self.folder, "DevToolsActivePort")
        end = time.monotonic() + 60
        while time.monotonic() < end:
            try:
                with open(port_file, encoding="utf-8") as file:
                    port = file.readline().strip()
                with urllib.request.urlopen(f"http://127.0.0.1:{port}/json", timeout=10) as answer:
                    pages = json.load(answer)
                return next(page["webSocketDebuggerUrl"] for page in pages if page["type"] == "page")
            except (OSError, StopIteration):
                time.sleep(0.1)
        raise TimeoutError("the browser did not start within 60 s")

    def close(self):
        if self.socket:
            self.socket.close()
        self.process.terminate()
        try:
            self.process.wait(20)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        shutil.rmtree(self.folder, ignore_errors=True)

    def call(self, method, **parameters):
        self.number += 1
        self.socket.send(json.dumps({"id": self.number, "method": method, "params": parameters}))
        while True:
            answer = json.loads(self.socket.recv())
            if answer.get("id") == self.number:
                if "error" in answer:
                    raise RuntimeError(f"{method}: {answer['error']}")
                return answer["result"]
            self.note(answer)

    def note(self, event):
        method, what = event.get("method"), event.get("params", {})
        if method == "Runtime.exceptionThrown":
            self.complaints.append(what["exceptionDetails"].get("exception", {}).get("description", str(what)))
        elif method == "Runtime.consoleAPICalled" and what["type"] in ("error", "warning", "assert"):
            self.complaints.append(" ".join(str(a.get("value", a.get("description"))) for a in what["args"]))
        elif method == "Log.entryAdded" and what["entry"]["level"] in ("error", "warning"):
            self.complaints.append(f"{what['entry']['text']} {what['entry'].get('url', '')}")

    def before_every_page(self, script):
        """Runs a script at the start of every page from now on; returns a function that ends this."""
        identifier = self.call("Page.addScriptToEvaluateOnNewDocument", source=script)["identifier"]
        return lambda: self.call("Page.removeScriptToEvaluateOnNewDocument", identifier=identifier)

    def open(self, address):
        self.call("Page.navigate", url=address)

    def run(self, script):
        """The value of an expression, waited for if it is a promise."""
        answer = self.call("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        if "exceptionDetails" in answer:
            raise RuntimeError(answer["exceptionDetails"].get("exception", {}).get("description", str(answer)))
        return answer["result"].get("value")

    def wait_for(self, condition, seconds=60):
        end = time.monotonic() + seconds
        while not self.run(condition):
            if time.monotonic() > end:
                raise TimeoutError(f"{condition} did not come true within {seconds} s; {self.complaints}")
            time.sleep(0.05)

    def state(self):
        return self.run("window.toothprep.state()")

    def drag(self, begin, end, button="left"):
        self.call("Input.dispatchMouseEvent", type="mousePressed", x=begin[0], y=begin[1], button=button, clickCount=1)
        for i in range(1, 6):
            self.call("Input.dispatchMouseEvent", type="mouseMoved", button=button, buttons=1,
                      x=begin[0] + (end[0] - begin[0]) * i / 5, y=begin[1] + (end[1] - begin[1]) * i / 5)
        self.call("Input.dispatchMouseEvent", type="mouseReleased", x=end[0], y=end[1], button=button, clickCount=1)

    def picture(self, path=None):
        """A PNG of the page, as bytes; to a file too if one is named."""
        data = base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"])
        if path:
            with open(path, "wb") as file:
                file.write(data)
        return data
