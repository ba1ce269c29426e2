"""The program as a server of pages: started, its address read, ended by Ctrl-C."""
import os
import re
import signal
import subprocess
from urllib.parse import urlsplit

from command_test import BINARY


class Viewer:
    """`toothprep view` (or `live --view`) on the given arguments; address, host, port and token of its page."""

    def __init__(self, *arguments, cwd, command="view"):
        environment = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")}
        self.process = subprocess.Popen([BINARY, command, *arguments], cwd=cwd, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                                        text=True, env=environment)
        self.address = (self.process.stdout.readline() if command == "view" else self.line("view: ")).strip()
        if not re.fullmatch(r"http://[^/]+:\d+/[0-9a-f]{32}/", self.address):
            self.process.kill()
            raise AssertionError(f"no address but '{self.address}': {self.process.communicate()[1]}")
        parts = urlsplit(self.address)
        self.host, self.port, self.token = parts.hostname, parts.port, parts.path.strip("/")

    def line(self, start):
        """What follows `start` in the first line of stderr that begins so."""
        for line in self.process.stderr:
            if line.startswith(start):
                return line[len(start):]
        return ""

    def end(self):
        """(stderr, status) after Ctrl-C."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
        try:
            return self.process.communicate(timeout=60)[1], self.process.returncode
        finally:
            self.process.kill()
