"""Marks a PrusaSlicer 2.5 file with the comments of its descendants.

`orca(text)` and `bambu(text)` take the text of a file and give it with the
layer, feature, size, wipe, object and block comments that OrcaSlicer and
BambuStudio write (their GCodeProcessor's reserved tags). The moves are
PrusaSlicer's, byte for byte: such a file shows how a dialect is read, and not
how that slicer plans. Knows no file names.
"""
import re

FEATURES = {
    'Perimeter': 'Inner wall', 'External perimeter': 'Outer wall', 'Overhang perimeter': 'Overhang wall',
    'Internal infill': 'Sparse infill', 'Solid infill': 'Internal solid infill', 'Top solid infill': 'Top surface',
    'Bridge infill': 'Bridge', 'Internal bridge infill': 'Internal Bridge', 'Ironing': 'Ironing', 'Gap fill': 'Gap infill',
    'Support material': 'Support', 'Support material interface': 'Support interface', 'Wipe tower': 'Prime tower',
    'Skirt/Brim': 'Skirt', 'Custom': 'Custom',
}

# The settings that a reader of these files may want, by their new names.
SETTINGS = {
    'retract_length': 'retraction_length', 'retract_speed': 'retraction_speed', 'deretract_speed': 'deretraction_speed',
    'retract_before_travel': 'retraction_minimum_travel', 'retract_lift': 'z_hop', 'fill_pattern': 'sparse_infill_pattern',
    'fill_density': 'sparse_infill_density', 'travel_speed': 'travel_speed', 'layer_height': 'layer_height',
    'nozzle_diameter': 'nozzle_diameter', 'filament_diameter': 'filament_diameter', 'wipe': 'wipe',
    'use_relative_e_distances': 'use_relative_e_distances', 'use_firmware_retraction': 'use_firmware_retraction',
    'default_acceleration': 'default_acceleration', 'infill_acceleration': 'sparse_infill_acceleration',
    'gcode_flavor': 'gcode_flavor', 'machine_max_acceleration_x': 'machine_max_acceleration_x',
    'machine_max_acceleration_y': 'machine_max_acceleration_y',
}


def orca(text):
    """OrcaSlicer for a printer that is not Bambu's: PrusaSlicer's tags, its own feature names."""
    return '\n'.join(remark(text, 'OrcaSlicer', lambda line: line)) + '\n'


def bambu(text):
    """BambuStudio, or OrcaSlicer for one of Bambu's printers: a blank after the `;`, other words."""
    tags = [(re.compile(r'^;LAYER_CHANGE$'), '; CHANGE_LAYER'), (re.compile(r'^;Z:'), '; Z_HEIGHT: '),
            (re.compile(r'^;HEIGHT:'), '; LAYER_HEIGHT: '), (re.compile(r'^;WIDTH:'), '; LINE_WIDTH: '),
            (re.compile(r'^;TYPE:'), '; FEATURE: '), (re.compile(r'^;WIPE_(START|END)$'), r'; WIPE_\1')]

    def tag(line):
        for pattern, new in tags:
            line, n = pattern.subn(new, line)
            if n:
                break
        return line
    return '\n'.join(remark(text, 'BambuStudio', tag)) + '\n'


def remark(text, slicer, tag):
    """The lines of the file: header and configuration blocks made new, each mark passed to `tag`."""
    head, config = text.split('; prusaslicer_config = begin\n')
    config = config.split('; prusaslicer_config = end')[0]
    layers = head.count('\n;LAYER_CHANGE\n')
    yield '; HEADER_BLOCK_START'
    yield f'; {slicer} comments on a file of PrusaSlicer 2.5.0: marked anew, not sliced by {slicer}'
    yield f'; total layer number: {layers}'
    yield '; HEADER_BLOCK_END'
    yield ''
    yield '; EXECUTABLE_BLOCK_START'
    for line in head.split('\n')[1:]:
        if line.startswith(';TYPE:'):
            line = ';TYPE:' + FEATURES[line[len(';TYPE:'):]]
        # Since 2.0 both number their objects this way; PrusaSlicer leaves out the colon.
        line = re.sub(r'^(; (?:stop )?printing object .*) id:(\d+) copy (\d+)$', r'\1 id:\2 copy \3', line)
        yield tag(line)
    yield '; EXECUTABLE_BLOCK_END'
    yield ''
    yield '; CONFIG_BLOCK_START'
    for line in config.splitlines():
        key, _, value = line[2:].partition(' = ')
        if key in SETTINGS:
            yield f'; {SETTINGS[key]} = {value}'
    yield '; CONFIG_BLOCK_END'
