"""Runs of one program that load its libraries once: half of the time of a short command.

The program stops where its libraries are loaded and relocated, before anything is initialized (started_program.cpp), and a
child process goes on from there for each run: with the arguments, folder, files and environment of that run it initializes the
libraries, runs main() and ends like one that was started anew. TOOTHPREP_PLAIN_STARTS=1 starts it anew for each run.
"""
import atexit
import os
import select
import signal
import socket
import subprocess
import sys
import tempfile
from pathlib import Path


class StartedProgram:
    """Stopped before its first line; one run at a time."""

    def __init__(self, binary, library):
        self.binary = binary
        self.environment = dict(os.environ)
        self.socket, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.process = subprocess.Popen([binary], pass_fds=[theirs.fileno()], stdin=subprocess.DEVNULL, env={
            **self.environment, "LD_PRELOAD": library, "TOOTHPREP_TEST_SOCKET": str(theirs.fileno())})
        theirs.close()
        atexit.register(self.end)

    def end(self):
        self.socket.close()
        self.process.wait()

    def number(self):
        answer = self.socket.recv(4)
        if len(answer) != 4:
            raise RuntimeError(f"{self.binary} does not wait for runs: {self.process.wait()}")
        return int.from_bytes(answer, sys.byteorder, signed=True)

    def run(self, args, cwd, timeout, text, stdin):
        with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err, open(os.devnull, "rb") as nothing:
            request = b"".join(os.fsencode(word) + b"\0" for word in (cwd, self.binary, *args))
            socket.send_fds(self.socket, [request], [nothing.fileno() if stdin == subprocess.DEVNULL else 0, out.fileno(), err.fileno()])
            child = self.number()
            late = not select.select([self.socket], [], [], timeout)[0]
            if late:
                os.kill(child, signal.SIGKILL)
            status = self.number()
            said = [read(file, text) for file in (out, err)]
        if late:
            raise subprocess.TimeoutExpired([self.binary, *args], timeout, *said)
        return subprocess.CompletedProcess([self.binary, *args], os.waitstatus_to_exitcode(status), *said)


def read(file, text):
    file.seek(0)
    content = file.read()
    return content.decode().replace("\r\n", "\n").replace("\r", "\n") if text else content


IDLE = {}  # by the program's path


def run_program(binary, args, cwd, timeout, text=True, stdin=None, **more):
    """As subprocess.run() with captured output does; `more` of its options, a changed environment and sanitizers need a start
    of its own."""
    library = Path(binary).parent / "tests" / "libstarted_program.so"  # absent under sanitizers
    if more or not library.exists() or "TOOTHPREP_PLAIN_STARTS" in os.environ:
        return subprocess.run([binary, *args], cwd=cwd, timeout=timeout, text=text, stdin=stdin, capture_output=True, **more)
    idle = IDLE.setdefault(binary, [])
    program = idle.pop() if idle else StartedProgram(binary, str(library))
    if program.environment != dict(os.environ):
        program = StartedProgram(binary, str(library))
    done = program.run(args, cwd, timeout, text, stdin)
    idle.append(program)
    return done
