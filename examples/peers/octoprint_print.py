"""Prints a file with OctoPrint, headless: octoprint_print.py FILE.gcode PORT BAUD

For examples/stream_figures. OctoPrint (AGPL-3.0) is run as an installed tool for
measuring, from this interpreter's packages; nothing of it is part of this project.
Starts a server of its own in a temporary folder, uploads and prints by the public
API, ends the server. Exit status 1 when any of that fails.
"""
import http.client
import json
import pathlib
import secrets
import signal
import socket
import subprocess
import sys
import tempfile
import time
import urllib.request

START_WITHIN_S = 60
LOOK_EVERY_S = 0.5  # coarse, so that asking costs the server nothing

CONFIG = """
api: {{key: {key}}}
accessControl: {{autologinLocal: false}}
feature: {{sdSupport: false, modelSizeDetection: false}}
gcodeAnalysis: {{runAt: never}}
plugins:
  _disabled: [announcements, backup, discovery, errortracking, file_check, firmware_check,
              pi_support, pluginmanager, softwareupdate, tracking, virtual_printer]
serial:
  additionalPorts: [{port}]
  autoconnect: true
  baudrate: {baud}
  port: {port}
server: {{firstRun: false, onlineCheck: {{enabled: false}}, pluginBlacklist: {{enabled: false}}}}
"""


class Server:
    """The API of an OctoPrint on this machine."""

    def __init__(self, port, key):
        self.root, self.key = f"http://127.0.0.1:{port}/api/", key

    def ask(self, what, body=None, kind="application/json"):
        request = urllib.request.Request(self.root + what, data=body)
        request.add_header("X-Api-Key", self.key)
        if body is not None:
            request.add_header("Content-Type", kind)
        with urllib.request.urlopen(request, timeout=30) as answer:
            return json.loads(answer.read() or b"null")

    def wait(self, what, done, within_s=float("inf"), every_s=LOOK_EVERY_S):
        deadline = time.monotonic() + within_s
        while True:
            try:
                if done(self.ask(what)):
                    return
            except (OSError, http.client.HTTPException):
                pass  # not up yet; the deadline tells whether it ever is
            if time.monotonic() > deadline:
                sys.exit(f"OctoPrint: {what} did not come to what was wanted")
            time.sleep(every_s)

    def print_file(self, path):
        mark = secrets.token_hex(16).encode()
        body = b"".join((
            b"--", mark, b'\r\nContent-Disposition: form-data; name="print"\r\n\r\ntrue\r\n',
            b"--", mark, b'\r\nContent-Disposition: form-data; name="file"; filename="job.gcode"\r\n',
            b"Content-Type: application/octet-stream\r\n\r\n", path.read_bytes(),
            b"\r\n--", mark, b"--\r\n",
        ))
        self.ask("files/local", body, f"multipart/form-data; boundary={mark.decode()}")


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def main():
    path, port, baud = sys.argv[1:]
    with tempfile.TemporaryDirectory() as folder:
        key, http_port = secrets.token_hex(16), free_port()
        config = CONFIG.format(key=key, port=port, baud=baud)
        pathlib.Path(folder, "config.yaml").write_text(config, encoding="utf-8")
        command = [sys.executable, "-m", "octoprint", "serve", "--basedir", folder,
                   "--host", "127.0.0.1", "--port", str(http_port), "--iknowwhatimdoing"]
        octoprint = subprocess.Popen(command)
        try:
            server = Server(http_port, key)
            server.wait("connection", lambda c: c["current"]["state"] == "Operational", START_WITHIN_S, 0.1)
            server.print_file(pathlib.Path(path))
            server.wait("job", lambda job: job["progress"]["completion"] == 100 and job["state"] == "Operational")
        finally:
            octoprint.send_signal(signal.SIGINT)
            try:
                octoprint.wait(20)
            except subprocess.TimeoutExpired:
                octoprint.kill()
                octoprint.wait()


if __name__ == "__main__":
    main()
