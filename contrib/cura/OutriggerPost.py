"""Cura post-processing script: runs `outrigger post` on the sliced job.

Cura keeps a job as a list of pieces: a header, the start, one piece for each layer, the end. They go
through a temporary file, and come back cut at the same places, because the scripts behind this one
count on that. Whatever is in doubt, Cura gets the list that it gave.

Licence: MIT or Apache 2.0, at your choice.
"""
import os
import shutil
import subprocess
import tempfile

from ..Script import Script

try:
    from UM.Logger import Logger
    from UM.Message import Message
except ImportError:  # Outside Cura, where the tests are.
    Logger = Message = None

# Cura's window stands still meanwhile; a job for which this is too short is better done on the saved file.
TIMEOUT_S = 600


class InDoubt(Exception):
    """Why the job stays as it was."""


class OutriggerPost(Script):
    """What Cura shows and calls. The name is that of the file, by which Cura finds it."""

    def getSettingDataString(self):
        return """{
            "name": "Outrigger",
            "key": "OutriggerPost",
            "metadata": {},
            "version": 2,
            "settings": {
                "program": {
                    "label": "Program",
                    "description": "The path of the program outrigger, or its name where it is in the PATH.",
                    "type": "str",
                    "default_value": "outrigger"
                },
                "reorder": {
                    "label": "Reorder infill",
                    "description": "Puts the infill into the order in which the head lifts least. The result is proved to print the same.",
                    "type": "bool",
                    "default_value": true
                },
                "supports": {
                    "label": "Grow missing supports",
                    "description": "Grows supports under what would print in the air and has none. Look at the layers before you print.",
                    "type": "bool",
                    "default_value": false
                },
                "material": {
                    "label": "Material",
                    "description": "A name of `outrigger profile list`, which tells how far it bridges and leans.",
                    "type": "str",
                    "default_value": "pla",
                    "enabled": "supports"
                }
            }
        }"""

    def execute(self, data):
        try:
            result = self.process(data)
        except InDoubt as doubt:
            tell("left as it was: %s" % doubt)
            return data
        except Exception as error:  # A fault of ours must not cost the user the export.
            tell("left as it was, because of a fault in the script: %r" % error)
            return data
        return result

    def process(self, data):
        """The pieces of the new job; raises InDoubt."""
        program = find(self.getSettingValueByKey("program"))
        runs = []
        # Supports first: what is reordered then is the infill alone, which supports leave where it is.
        if self.getSettingValueByKey("supports"):
            runs.append(["--supports", "auto", "--material", self.getSettingValueByKey("material")])
        if self.getSettingValueByKey("reorder"):
            runs.append([])
        text = "".join(data)
        with tempfile.TemporaryDirectory(prefix="outrigger-") as folder:
            path = os.path.join(folder, "job.gcode")
            write(path, text)
            for options in runs:
                # In place, as a slicer's hook: a job in doubt stays as it is, and the program ends well.
                run([program, "post", path, *options], folder)
            new = read(path)
        # Why nothing was changed, the program has told.
        return data if new == text else cut(new, data)


def tell(words):
    """In Cura's log, and in its window: what the user asked for may not have been done."""
    if Logger:
        Logger.log("i", "Outrigger: %s", words)
        Message(words, title="Outrigger", lifetime=30).show()
    else:
        print("Outrigger: %s" % words)


def find(program):
    found = shutil.which(os.path.expanduser(program.strip()))
    if not found:
        raise InDoubt("there is no program %r: set its path in the script's settings" % program)
    return found


def run(command, folder):
    environment = dict(os.environ)
    # Cura's own package brings libraries along, which are not those that other programs are made for.
    for name in ("LD_LIBRARY_PATH", "LD_PRELOAD", "DYLD_LIBRARY_PATH"):
        environment.pop(name, None)
    try:
        done = subprocess.run(
            command,
            cwd=folder,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            timeout=TIMEOUT_S,
        )
    except subprocess.TimeoutExpired:
        raise InDoubt("it took longer than %d s" % TIMEOUT_S)
    except OSError as error:
        raise InDoubt("%s cannot be started: %s" % (command[0], error))
    words = done.stdout.decode("utf-8", "replace").strip()
    if words:
        # The file's temporary name tells nobody anything.
        tell(words.replace("outrigger: %s: " % command[2], ""))
    if done.returncode != 0:
        raise InDoubt("the program ended with %d" % done.returncode)


# Line endings and odd bytes pass as they are: newline="" translates none, surrogateescape loses none.
def write(path, text):
    with open(path, "w", encoding="utf-8", errors="surrogateescape", newline="") as file:
        file.write(text)


def read(path):
    with open(path, encoding="utf-8", errors="surrogateescape", newline="") as file:
        return file.read()


def beginning(piece):
    """What of a piece finds it again: all up to its layer's mark, which no run changes; all of it where it has none."""
    if piece.startswith(";LAYER:"):
        mark = 0
    else:
        mark = piece.find("\n;LAYER:") + 1
        if mark == 0:
            return piece
    end = piece.find("\n", mark)
    return piece if end < 0 else piece[: end + 1]


def cut(text, data):
    """`text` in as many pieces as `data`, each beginning where the old one did; raises InDoubt."""
    starts = []
    at = 0
    for number, piece in enumerate(data):
        if number == 0:
            starts.append(0)
            continue
        if not piece:
            starts.append(None)
            continue
        first = beginning(piece)
        found = text.find(first, at)
        # In the middle of a line it is something else that looks alike.
        while found > 0 and text[found - 1] != "\n":
            found = text.find(first, found + 1)
        if found < 0:
            raise InDoubt("piece %d of Cura's list cannot be found in the result" % number)
        starts.append(found)
        at = found + len(first)
    ends = []
    end = len(text)
    for number in reversed(range(len(data))):
        ends.append(end)
        # An empty piece stays empty: it begins where the next one does.
        if starts[number] is not None:
            end = starts[number]
        else:
            starts[number] = end
    return [text[a:b] for a, b in zip(starts, reversed(ends))]
