"""Prints a file with Printrun's printcore: printcore_print.py FILE.gcode PORT BAUD

For examples/stream_figures. Printrun (GPL-3.0) is imported as an installed tool for
measuring; nothing of it is part of this project. Exit status 1 when the port never
comes on line.
"""
import sys
import time

from printrun import gcoder
from printrun.printcore import printcore

ONLINE_WITHIN_S = 30
LOOK_EVERY_S = 0.1  # coarse, so that the script itself costs nothing

path, port, baud = sys.argv[1:]
with open(path, encoding="ascii") as file:
    job = gcoder.LightGCode(line.strip() for line in file)
core = printcore(port, int(baud))
deadline = time.monotonic() + ONLINE_WITHIN_S
while not core.online:
    if time.monotonic() > deadline:
        sys.exit("printcore: the printer did not come on line")
    time.sleep(0.01)
core.startprint(job)
while core.printing:
    time.sleep(LOOK_EVERY_S)
# `printing` ends with the last line sent; its `ok` may be under way.
while not core.clear and core.online:
    time.sleep(LOOK_EVERY_S)
core.disconnect()
