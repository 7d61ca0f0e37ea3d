"""What printing a resin job costs between its moves and exposures: resin_figures.py [--load N] [--layers N]

    cargo build --release && python3 examples/resin_figures.py

Prints a made job of 2560 x 1440 px on the mock printer in real time, once for each way to time an exposure
(by the controller, by a pulse of the controller, by the host), while N busy processes for each core keep the
machine from having time (1 by default; 0 for none). The mock's record of what it executed, and when, tells:

- jitter: how much the light was on longer or shorter than the job wants, ms, least and most;
- overhead of a layer beyond its moves and its exposure, ms, median and most: the same moves given to
  the mock without waiting for anything take what moves take; the LCD's own settling time (50 ms here),
  which the profile states, is taken off as well;
- memory of the printing process, MB, its peak, and of its watchdog.

Exit status 1 where a target is missed: 1 ms and 5 ms of jitter, 30 ms of overhead, 80 MB.
"""
import argparse
import os
import pathlib
import signal
import statistics
import struct
import subprocess
import sys
import tempfile
import threading
import time
import zipfile
import zlib

ROOT = pathlib.Path(__file__).resolve().parents[1]
OURS = pathlib.Path(os.environ.get("OUTRIGGER", ROOT / "target/release/outrigger"))
WIDTH, HEIGHT = 2560, 1440
EXPOSURE_S, LEAD_MS, LIFT_MM, SPEED = 0.4, 50, 1.0, 600
TARGETS = {"jitter": {"controller": 1.0, "pulse": 1.0, "host": 5.0}, "overhead_ms": 30, "memory_mb": 80}


def png(layer):
    """A picture with many edges in each row: what costs most to unpack among what slicers write."""
    rows = []
    for y in range(HEIGHT):
        row = bytearray(WIDTH)
        if 100 <= y < HEIGHT - 100:
            for x in range(100 + (layer * 7 + y) % 23, WIDTH - 100, 46):
                row[x:x + 20] = b"\xff" * 20
        rows.append(b"\0" + bytes(row))
    chunk = lambda kind, data: struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    head = struct.pack(">IIBBBBB", WIDTH, HEIGHT, 8, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(b"".join(rows), 6)) + chunk(b"IEND", b"")


def job(path, layers):
    pictures = [png(n) for n in range(4)]
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("config.ini", "\n".join([
            "action = print", "jobDir = made", f"expTime = {EXPOSURE_S}", f"expTimeFirst = {EXPOSURE_S}", "layerHeight = 0.05",
            "numFade = 0", f"numFast = {layers}", "numSlow = 0", ""]))
        archive.writestr("prusaslicer.ini", "\n".join([
            "display_width = 120.96", "display_height = 68.04", f"display_pixels_x = {WIDTH}",
            f"display_pixels_y = {HEIGHT}", "display_mirror_x = 0", "display_mirror_y = 0",
            "display_orientation = landscape", ""]))
        for layer in range(layers):
            archive.writestr(f"made{layer:05}.png", pictures[layer % len(pictures)])


def profile(path, timing, folder):
    light = 'timed_by = "host"' if timing == "host" else 'timed_by = "controller"'
    pulse = 'pulse = "M810 M106 S{power}|G4 P{ms}|M107\\nM810"' if timing == "pulse" else ""
    path.write_text(f'''
name = "figures"
title = "A resin printer for figures"
kind = "msla"
firmware = "marlin"
[bed]
shape = "rectangle"
origin = "corner"
x_mm = 120.96
y_mm = 68.04
z_mm = 150
[serial]
baud = 115200
window = {{ bytes = 120 }}
max_line = 95
dtr_reset = false
[lcd]
width_px = {WIDTH}
height_px = {HEIGHT}
pixels = "grey"
sink = {{ folder = "{folder}" }}
settle_ms = {LEAD_MS}
[light]
on = "M106 S{{power}}"
off = "M107"
{light}
{pulse}
off_when_halted = false
[plate]
homes = "up"
lift = {{ slow_mm = {LIFT_MM}, slow_mm_min = {SPEED}, fast_mm = 0, fast_mm_min = {SPEED} }}
retract = {{ slow_mm = 0, slow_mm_min = {SPEED}, fast_mm_min = {SPEED} }}
settle_ms = 0
rest_ms = 0
top_ms = 0
max_mm_min = {SPEED}
accel_mm_s2 = 100
[macros]
cancel = """
M107
G91
G1 Z20 F100
G90"""
''')


def first_in_line():
    """A board has a processor of its own."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(20))
    except PermissionError:
        print("the mock waits for a core like everybody else: run as root for figures of the host alone")


class Mock:
    def __init__(self, folder, profile_path):
        self.tty, self.log = folder / "tty", folder / "log"
        self.process = subprocess.Popen(
            [OURS, "mock", "--link", self.tty, "--baud", "115200", "--profile", profile_path, "--log", self.log],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, preexec_fn=first_in_line)
        while not self.tty.exists():
            time.sleep(0.01)

    def end(self):
        self.process.send_signal(signal.SIGINT)
        self.process.wait(30)
        lines = [line.split(" ", 6) for line in self.log.read_text().splitlines()]
        return [(float(line[0]), line[6]) for line in lines]


def drain(port):
    """A terminal that nobody reads stops its printer."""
    try:
        while os.read(port, 4096):
            pass
    except OSError:
        pass


def moves_s(folder, profile_path):
    """How long the moves from layer to layer take when nothing is waited for."""
    mock = Mock(folder, profile_path)
    port = os.open(mock.tty, os.O_RDWR | os.O_NOCTTY)
    time.sleep(0.5)
    threading.Thread(target=drain, args=(port,), daemon=True).start()
    os.write(port, b"G28 Z\nG90\n")
    time.sleep(20)
    for n in range(6):
        os.write(port, f"G1 Z{20 + n * 0.05 + LIFT_MM:.2f} F{SPEED}\nG1 Z{20 + (n + 1) * 0.05:.2f} F{SPEED}\nM400\n".encode())
        time.sleep(0.2 if n else 20)
    time.sleep(3)
    os.close(port)
    ends = [at for at, command in mock.end() if command == "M400"]
    return statistics.median(b - a for a, b in zip(ends[1:], ends[2:]))


def peak_mb(pid):
    text = pathlib.Path(f"/proc/{pid}/status").read_text()
    return int(next(line for line in text.splitlines() if line.startswith("VmHWM")).split()[1]) / 1e3


def printed(folder, path, profile_path):
    mock = Mock(folder, profile_path)
    process = subprocess.Popen(
        [OURS, "print", path, "--port", mock.tty, "--profile", profile_path, "--ready", "--state", folder / "state"],
        stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    peak = watchdog = 0.0
    while process.poll() is None:
        try:
            peak = max(peak, peak_mb(process.pid))
            for child in pathlib.Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split():
                if b"light-watch" in pathlib.Path(f"/proc/{child}/cmdline").read_bytes():
                    watchdog = max(watchdog, peak_mb(child))
        except (OSError, StopIteration):
            pass
        time.sleep(0.2)
    told = process.stderr.read().decode()
    if process.returncode:
        sys.exit(f"the print ended with {process.returncode}: {told}")
    return mock.end(), peak, watchdog, next((line for line in told.splitlines() if "exposures" in line), "")


def main():
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    words.add_argument("--load", type=int, default=1, help="busy processes for each core")
    words.add_argument("--layers", type=int, default=60)
    asked = words.parse_args()
    missed = []
    with tempfile.TemporaryDirectory() as name:
        top = pathlib.Path(name)
        job(top / "job.sl1", asked.layers)
        busy = []
        for timing in ["controller", "pulse", "host"]:
            folder = top / timing
            folder.mkdir()
            profile(folder / "p.toml", timing, folder / "lcd")
            if timing == "controller":
                (folder / "calm").mkdir()
                ways_s = moves_s(folder / "calm", folder / "p.toml")
                print(f"moves of a layer alone: {ways_s * 1e3:.1f} ms; {asked.layers} layers, exposure "
                      f"{EXPOSURE_S * 1e3:.0f} ms, {asked.load} busy processes for each of {os.cpu_count()} cores")
                busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"])
                        for _ in range(asked.load * os.cpu_count())]
            try:
                log, peak, watchdog, told = printed(folder, top / "job.sl1", folder / "p.toml")
            except BaseException:
                for one in busy:
                    one.kill()
                raise
            on = [at for at, command in log if command.startswith("M106")]
            off = [at for at, command in log if command == "M107"][-len(on):]
            jitter = [(b - a - EXPOSURE_S) * 1e3 for a, b in zip(on, off)]
            layers = [(b - a) - EXPOSURE_S - LEAD_MS / 1e3 - ways_s for a, b in zip(off, off[1:])]
            over = sorted(layer * 1e3 for layer in layers[1:])
            worst = max(abs(min(jitter)), abs(max(jitter)))
            print(f"{timing:>10}: jitter {min(jitter):+.2f} to {max(jitter):+.2f} ms; overhead of a layer "
                  f"{statistics.median(over):.1f} ms, 95 % {over[int(len(over) * 0.95)]:.1f}, most {over[-1]:.1f}; "
                  f"memory {peak:.1f} MB and {watchdog:.1f} of the watchdog")
            print(f"{'':>12}{told}")
            if worst > TARGETS["jitter"][timing]:
                missed.append(f"{timing}: jitter of {worst:.2f} ms")
            if statistics.median(over) > TARGETS["overhead_ms"]:
                missed.append(f"{timing}: overhead of {statistics.median(over):.1f} ms")
            if peak > TARGETS["memory_mb"]:
                missed.append(f"{timing}: {peak:.1f} MB")
        for one in busy:
            one.kill()
    for miss in missed:
        print("missed:", miss)
    sys.exit(bool(missed))


if __name__ == "__main__":
    main()
