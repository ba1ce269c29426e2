"""What the server of pages gives to the page it is for, and refuses to others.

Usage: test_server.py TOOTHPREP SOURCE_FOLDER
"""
import http.client
import json
import os
import socket
import sys
import time
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "support"))
sys.path.insert(0, str(Path(__file__).resolve().parent))
from command_test import CommandTest
from viewer import Viewer


class Server(CommandTest):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.run_ok("specimen", "block", "-o", "block.vdb", "--voxel-mm", "0.4")
        cls.viewer = Viewer("block.vdb", cwd=cls.folder)
        cls.addClassCleanup(cls.viewer.end)

    def ask(self, path, host=None, method="GET", headers=None, token=None):
        """(status, headers, body) of a path after the token."""
        connection = http.client.HTTPConnection("127.0.0.1", self.viewer.port, timeout=30)
        try:
            connection.putrequest(method, f"/{self.viewer.token if token is None else token}/{path}", skip_host=True,
                                  skip_accept_encoding=True)
            connection.putheader("Host", host or f"127.0.0.1:{self.viewer.port}")
            for name, value in (headers or {}).items():
                connection.putheader(name, value)
            connection.endheaders()
            answer = connection.getresponse()
            return answer.status, dict(answer.getheaders()), answer.read()
        finally:
            connection.close()

    def raw(self, request, wait=30):
        """What comes back of bytes that are sent, until the server closes."""
        with socket.create_connection(("127.0.0.1", self.viewer.port), timeout=wait) as line:
            try:
                line.sendall(request)
                answer = b""
                while chunk := line.recv(65536):
                    answer += chunk
                return answer
            except ConnectionError:
                return b""

    def assert_alive(self):
        self.assertEqual(self.ask("scene")[0], 200)

    def test_the_page_its_parts_and_its_facts_are_there(self):
        status, headers, body = self.ask("")
        self.assertEqual((status, headers["Content-Type"]), (200, "text/html; charset=utf-8"))
        import re
        parts = re.findall(rb'(?:src|href)="([^"]+)"', body)
        self.assertGreater(len(parts), 8)
        for part in parts:
            self.assertEqual(self.ask(part.decode())[0], 200, part)
        scene = json.loads(self.ask("scene")[2])
        self.assertEqual(scene["kind"], "surfaces")
        self.assertEqual(scene["layers"], ["block.vdb"])
        # The paper's block: 8 mm, its top face at y = 0.
        for got, wanted in zip(sum(scene["bounds"], []), (-4, -8, -4, 4, 0, 4)):
            self.assertAlmostEqual(got, wanted, delta=0.05)

    def test_the_policy_allows_this_server_alone(self):
        _, headers, _ = self.ask("")
        policy = dict(p.strip().split(" ", 1) for p in headers["Content-Security-Policy"].split(";"))
        self.assertEqual(policy["default-src"], "'none'")
        self.assertEqual(policy["script-src"], "'self'")
        self.assertEqual(policy["style-src"], "'self'")
        self.assertEqual(policy["frame-ancestors"], "'none'")
        self.assertEqual(policy["connect-src"], f"'self' ws://127.0.0.1:{self.viewer.port}")
        self.assertEqual(headers["X-Content-Type-Options"], "nosniff")
        self.assertEqual(headers["Referrer-Policy"], "no-referrer")
        self.assertEqual(headers["Cache-Control"], "no-store")

    def test_nothing_without_the_token(self):
        wrong = self.viewer.token[:-1] + ("0" if self.viewer.token[-1] != "0" else "1")
        for token in ("", wrong, self.viewer.token[:-1], self.viewer.token + "0", self.viewer.token.upper() + "X"):
            status, headers, body = self.ask("", token=token)
            self.assertEqual((status, body), (403, b"Forbidden\n"), token)
            self.assertEqual(headers.get("Connection"), "close")
        self.assertIn(b" 403 ", self.raw(f"GET / HTTP/1.1\r\nHost: 127.0.0.1:{self.viewer.port}\r\n\r\n".encode()))

    def test_each_start_has_another_token(self):
        other = Viewer("block.vdb", cwd=self.folder)
        try:
            self.assertNotEqual(other.token, self.viewer.token)
            self.assertEqual(self.ask("", token=other.token)[0], 403)
        finally:
            other.end()

    def test_foreign_hosts_are_refused(self):
        port = self.viewer.port
        for host in ("evil.example", f"evil.example:{port}", "127.0.0.1", "127.0.0.1:1", f"127.0.0.1.evil.example:{port}",
                     f"@127.0.0.1:{port}", f"10.0.0.1:{port}", ":", f":{port}"):
            self.assertEqual(self.ask("", host=host)[0], 403, host)
        self.assertEqual(self.ask("", host=f"localhost:{port}")[0], 200)
        self.assertIn(b" 403 ", self.raw(f"GET /{self.viewer.token}/ HTTP/1.1\r\nConnection: close\r\n\r\n".encode()))

    def test_foreign_origins_are_refused(self):
        own = f"http://127.0.0.1:{self.viewer.port}"
        for origin in ("http://evil.example", "null", own + ".evil.example", f"https://127.0.0.1:{self.viewer.port}"):
            self.assertEqual(self.ask("scene", headers={"Origin": origin})[0], 403, origin)
        self.assertEqual(self.ask("scene", headers={"Origin": own})[0], 200)

    def test_no_path_leads_to_a_file(self):
        self.write("secret.txt", "secret")
        for path in ("secret.txt", "block.vdb", "../secret.txt", "%2e%2e/secret.txt", "..%2fsecret.txt", "/etc/passwd",
                     "../../../../../../etc/passwd", "....//etc/passwd", "%00", "page.css/../../etc/passwd", "page.css%00.html",
                     os.path.join(self.folder, "secret.txt"), ".", "..", "page.html"):
            status, _, body = self.ask(path)
            self.assertEqual((status, body), (404, b"Not Found\n"), path)

    def test_only_what_asks_is_answered(self):
        for method in ("POST", "PUT", "DELETE", "OPTIONS", "TRACE", "PATCH"):
            self.assertEqual(self.ask("scene", method=method)[0], 405, method)
        status, headers, body = self.ask("scene", method="HEAD")
        self.assertEqual((status, body), (200, b""))
        self.assertEqual(int(headers["Content-Length"]), len(self.ask("scene")[2]))

    def test_queries_that_name_nothing_are_refused(self):
        for query in ("", "layer=0", "layer=1&frame=0&seen=-1", "layer=-1&frame=0&seen=-1", "layer=0&frame=0&seen=1",
                      "layer=0&frame=-1&seen=-1", "layer=0&frame=0&seen=-2", "layer=0&frame=x&seen=-1",
                      "layer=99999999999999999999&frame=0&seen=-1", "layer=0&frame=0&seen=-1x"):
            self.assertEqual(self.ask(f"blocks?{query}")[0], 404, query)
        self.assertEqual(self.ask("blocks?layer=0&frame=0&seen=-1")[0], 200)
        self.assertEqual(self.ask("trace")[0], 404)  # there is none
        self.assertEqual(self.ask("feed")[0], 404)

    def test_large_requests_and_nonsense_are_dropped(self):
        start = f"GET /{self.viewer.token}/ HTTP/1.1\r\nHost: 127.0.0.1:{self.viewer.port}\r\n"
        for request in (start + "X: " + 20000 * "a" + "\r\n\r\n", start + "Content-Length: 1000000\r\n\r\n" + 100000 * "b",
                        "GET /" + 100000 * "a", 70000 * "\0", "\x16\x03\x01" + 100 * "x" + "\r\n\r\n"):
            self.assertNotIn(b" 200 ", self.raw(request.encode("latin1")))
        self.assert_alive()

    def test_a_thousand_connections_are_not_too_many_for_it(self):
        lines = []
        try:
            for _ in range(1000):
                try:
                    lines.append(socket.create_connection(("127.0.0.1", self.viewer.port), timeout=5))
                except OSError:
                    break
            self.assertGreater(len(lines), 500)
            # All but some were closed at once; the others after a while without a request.
            time.sleep(0.5)
            self.assertLess(len(os.listdir(f"/proc/{self.viewer.process.pid}/fd")), 150)
        finally:
            for line in lines:
                line.close()
        end = time.monotonic() + 30
        while True:
            try:
                self.assert_alive()
                break
            except OSError:
                self.assertLess(time.monotonic(), end)
                time.sleep(0.1)

    def test_who_sends_no_request_is_dropped(self):
        begin = time.monotonic()
        self.assertEqual(self.raw(b"GET /", wait=60), b"")
        self.assertLess(time.monotonic() - begin, 50)


class Command(CommandTest):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.run_ok("specimen", "block", "-o", "block.vdb", "--voxel-mm", "0.4")

    def fails(self, *arguments):
        done = self.run_tool("view", "--no-open", *arguments)
        self.assertEqual((done.returncode, done.stdout), (1, ""), done.stderr)
        self.assertEqual(len(done.stderr.strip().splitlines()), 1, done.stderr)
        return done.stderr

    def test_ends_by_ctrl_c_with_status_0(self):
        stderr, status = Viewer("block.vdb", cwd=self.folder).end()
        self.assertEqual(status, 0)
        self.assertIn("Ctrl-C", stderr)

    def test_listens_on_the_loopback_address_and_the_port_asked_for(self):
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        viewer = Viewer("block.vdb", "--port", str(port), cwd=self.folder)
        try:
            self.assertEqual((viewer.host, viewer.port), ("127.0.0.1", port))
            table = Path("/proc/net/tcp").read_text(encoding="ascii").splitlines()
            listening = [line.split()[1] for line in table if line.split()[3] == "0A" and line.split()[1].endswith(f":{port:04X}")]
            self.assertEqual(listening, [f"0100007F:{port:04X}"])
            self.assertIn("give another --port", self.fails("block.vdb", "--port", str(port)))
        finally:
            viewer.end()

    def test_wrong_inputs_are_named(self):
        self.run_ok("specimen", "molar", "-o", "molar.vdb", "--voxel-mm", "0.4")
        self.write("path.csv", "time_s,x_mm,y_mm,z_mm\n0,0,5,0\n0.1,0,4.9,0\n")
        self.run_ok("replay", "--tooth", "block.vdb", "--bur", "ball:D2", "--trajectory", "path.csv", "-o", "trace.h5")
        self.assertIn("trace.h5: --tooth", self.fails("trace.h5"))
        self.assertIn("recorded on another tooth", self.fails("trace.h5", "--tooth", "molar.vdb"))
        self.assertIn("three recordings", self.fails("trace.h5", "trace.h5", "trace.h5", "--tooth", "block.vdb"))
        self.assertIn("--tooth goes with a recording", self.fails("block.vdb", "--tooth", "molar.vdb"))
        self.assertIn("missing.vdb", self.fails("missing.vdb"))
        self.write("score.json", '{"schema": "else"}')
        self.assertIn("not a result of `score`", self.fails("score.json"))
        os.mkdir(os.path.join(self.folder, "empty"))
        self.assertIn("neither deviation.ply nor prepared.ply", self.fails("empty"))
        self.assertIn("'here' is no address", self.fails("block.vdb", "--bind", "here"))
        self.assertIn("cannot listen on 192.0.2.1:0", self.fails("block.vdb", "--bind", "192.0.2.1"))


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
