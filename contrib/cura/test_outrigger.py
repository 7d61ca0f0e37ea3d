#!/usr/bin/env python3
"""Tests of OutriggerPost.py without Cura: python3 contrib/cura/test_outrigger.py [PATH OF outrigger]"""
import importlib.util
import os
import pathlib
import re
import stat
import sys
import tempfile
import types
import unittest

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parent.parent
PROGRAM = str(ROOT / "target/release/outrigger")


class Script:
    """What Cura's base class gives to a script: its settings."""

    def __init__(self):
        import json

        described = json.loads(self.getSettingDataString())["settings"]
        self.values = {key: setting["default_value"] for key, setting in described.items()}
        self.values["program"] = PROGRAM

    def getSettingValueByKey(self, key):
        return self.values[key]


def load():
    """The script as Cura's plugin loads it: as a module below `scripts`, beside `Script`."""
    for name in ("plugin", "plugin.scripts"):
        sys.modules[name] = types.ModuleType(name)
        sys.modules[name].__path__ = []
    sys.modules["plugin.Script"] = types.ModuleType("plugin.Script")
    sys.modules["plugin.Script"].Script = Script
    name = "plugin.scripts.OutriggerPost"
    spec = importlib.util.spec_from_file_location(name, HERE / "OutriggerPost.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


POST = load()


def pieces(name):
    """A job as Cura keeps it: the header, the start, a piece for each layer, the end."""
    text = (ROOT / "gcode/corpus" / name).read_bytes().decode("utf-8", "surrogateescape")
    # What stands behind the last layer Cura writes only after the scripts.
    text = text.split("\n;SETTING_3")[0]
    header, rest = re.split(r"(?<=\n)(?=M140|G21|M104|M105|M190|T0)", text, maxsplit=1)
    found = [header, *re.split(r"(?<=\n)(?=;LAYER:)", rest)]
    last, end = re.split(r"(?<=\n)(?=M140 S0\n)", found[-1], maxsplit=1)
    return [*found[:-1], last, end]


class Cura(unittest.TestCase):
    def post(self, data, **values):
        script = POST.OutriggerPost()
        script.values.update(values)
        return script.execute(list(data))

    def test_infill_is_reordered_and_pieces_stay_pieces(self):
        for name in ("cura413-marlin-abs-lines.gcode", "cura413-marlin-zhop-triangles.gcode"):
            data = pieces(name)
            result = self.post(data)
            self.assertFalse(result == data, name)
            self.assertEqual([POST.beginning(p) for p in result], [POST.beginning(p) for p in data], name)
            self.assertEqual(result[0], data[0])
            # Nobody's comment is lost.
            comments = lambda job: sorted(line for line in "".join(job).split("\n") if line.startswith(";"))
            self.assertEqual([c for c in comments(result) if not c.startswith(";TYPE:")],
                             [c for c in comments(data) if not c.startswith(";TYPE:")])

    def test_the_demo_in_one_piece(self):
        data = [(ROOT / "gcode/corpus/demo.gcode").read_text()]
        result = self.post(data)
        self.assertEqual(len(result), 1)
        self.assertFalse(result == data)

    def test_supports_and_then_the_order(self):
        data = pieces("cura413-marlin-rel-cubic.gcode")
        supported = self.post(data, supports=True, reorder=False)
        both = self.post(data, supports=True)
        for result in (supported, both):
            self.assertEqual([POST.beginning(p) for p in result], [POST.beginning(p) for p in data])
        self.assertGreater("".join(supported).count(";TYPE:SUPPORT"), "".join(data).count(";TYPE:SUPPORT"))
        # Nothing of the slicer's is lost.
        lines = iter("".join(supported).split("\n"))
        self.assertTrue(all(line in lines for line in "".join(data).split("\n")))
        self.assertFalse(both == supported)

    def test_in_doubt_the_list_is_what_it_was(self):
        data = pieces("cura413-marlin-abs-lines.gcode")
        for values in (
            {"program": "/nowhere/outrigger"},
            {"program": "false"},
            {"program": "true"},
            {"reorder": False, "supports": False},
            {"supports": True, "reorder": False, "material": "no such material"},
        ):
            self.assertTrue(self.post(data, **values) == data, values)
        for odd in ([], [""], ["G28\n"], ["\ud800;LAYER:0\n"], ["\udce9\r\n", "", "x"]):
            self.assertEqual(self.post(odd), odd)

    def test_a_result_that_lost_a_layer_is_refused(self):
        data = [";FLAVOR:Marlin\n", ";LAYER:0\nG1\n", ";LAYER:1\nG1\n", "M104 S0\n"]
        with tempfile.TemporaryDirectory() as folder:
            program = os.path.join(folder, "cuts")
            pathlib.Path(program).write_text('#!/bin/sh\nsed -i "/LAYER:1/d" "$2"\n')
            os.chmod(program, stat.S_IRWXU)
            self.assertEqual(self.post(data, program=program), data)

    def test_pieces_are_cut_where_they_were(self):
        data = [";H\n", "M1\n;LAYER_COUNT:2\n", "M9\n;LAYER:0\nG1 X1\n", "", ";LAYER:1\nG1 X1\n", ";LAYER:1\nG2\n", "M104 S0\n"]
        text = "".join(data).replace("G1 X1\n", "G1 X2\nG1 X1\nM117 ;LAYER:1\n")
        result = POST.cut(text, data)
        self.assertEqual("".join(result), text)
        self.assertEqual(result[2], "M9\n;LAYER:0\nG1 X2\nG1 X1\nM117 ;LAYER:1\n")
        self.assertEqual(result[5:], data[5:])


if __name__ == "__main__":
    if len(sys.argv) > 1 and not sys.argv[1].startswith("-"):
        PROGRAM = sys.argv.pop(1)
    unittest.main()
