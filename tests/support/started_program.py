"""Runs of one program that load its libraries once: half of the time of a short command.

The program stops where its libraries are loaded and relocated, before anything is initialized (started_program.cpp), and a
child process goes on from there for each run: with the arguments, folder, files and environment of that run it initializes the
libraries, runs main() and ends like one that was started anew. TOOTHPREP_PLAIN_STARTS=1 starts it anew for each run.
"""
import atexit
import functools
import os
import select
import signal
import socket
import struct
import subprocess
import tempfile
import threading
from pathlib import Path


ENDED = "i4q14q"  # status; struct rusage: two times in s and us, then ru_maxrss and others


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

    def answer(self, form):
        answer = self.socket.recv(struct.calcsize(form))
        if not answer:
            raise RuntimeError(f"{self.binary} does not wait for runs: {self.process.wait()}")
        return struct.unpack(form, answer)

    def run(self, args, cwd, timeout, stdin, out, err):
        """Its exit status, CPU time, s, and memory at most, KB."""
        request = b"".join(os.fsencode(word) + b"\0" for word in (cwd, self.binary, *args))
        with open(os.devnull, "rb") as nothing:
            files = [nothing.fileno() if stdin == subprocess.DEVNULL else 0, out.fileno(), err.fileno()]
            socket.send_fds(self.socket, [request], files)
        child, = self.answer("i")
        if not select.select([self.socket], [], [], timeout)[0]:
            os.kill(child, signal.SIGKILL)
            self.answer(ENDED)
            raise subprocess.TimeoutExpired([self.binary, *args], timeout)
        status, user_s, user_us, system_s, system_us, peak_kb, *_ = self.answer(ENDED)
        return status, user_s + system_s + 1e-6 * (user_us + system_us), peak_kb


def start_anew(binary, args, cwd, timeout, stdin, out, err):
    """The same of a process of its own."""
    child = subprocess.Popen([binary, *args], cwd=cwd, stdin=stdin, stdout=out, stderr=err)
    timer = threading.Timer(timeout, child.kill)
    timer.start()
    _, status, used = os.wait4(child.pid, 0)
    timer.cancel()
    child.returncode = os.waitstatus_to_exitcode(status)
    return status, used.ru_utime + used.ru_stime, used.ru_maxrss


def read(file, text):
    file.seek(0)
    content = file.read()
    return content.decode().replace("\r\n", "\n").replace("\r", "\n") if text else content


IDLE = {}  # by the program's path


def run_program(binary, args, cwd, timeout, text=True, stdin=None, anew=False, **more):
    """As subprocess.run() with captured output does; with `more` of its options always in a start of its own. Without them the
    result also has cpu_s and peak_mb, of the process and its children; libraries count in full only where it was started anew."""
    if more:
        return subprocess.run([binary, *args], cwd=cwd, timeout=timeout, text=text, stdin=stdin, capture_output=True, **more)
    library = Path(binary).parent / "tests" / "libstarted_program.so"  # absent under sanitizers
    idle, program = IDLE.setdefault(binary, []), None
    if not anew and library.exists() and "TOOTHPREP_PLAIN_STARTS" not in os.environ:
        program = idle.pop() if idle else StartedProgram(binary, str(library))
        if program.environment != dict(os.environ):
            program = StartedProgram(binary, str(library))
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        run = program.run if program else functools.partial(start_anew, binary)
        status, cpu_s, peak_kb = run(args, cwd, timeout, stdin, out, err)
        done = subprocess.CompletedProcess([binary, *args], os.waitstatus_to_exitcode(status), read(out, text), read(err, text))
    done.cpu_s, done.peak_mb = cpu_s, peak_kb / 1024
    if program:
        idle.append(program)
    return done
