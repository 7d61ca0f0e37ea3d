#!/usr/bin/env python3
"""Slices the models of models.py into the files of this folder.

    python3 slice.py [NAME ...]     all, or those whose name begins with NAME

Needs Debian 12's `prusa-slicer`, `slic3r` and `cura-engine`. CuraEngine also
needs the definitions of Debian's `cura` package: CURA_RESOURCES names its
`resources` folder (default: where the package installs it). Nothing else is
read, so the settings below are the whole provenance of a file. Run again,
PrusaSlicer 2.5 gives another time stamp and sometimes another order of the
infill (it slices on several threads); the others give the same bytes but for
Slic3r's time stamp. So the committed files are the corpus, and this script says
how they came to be.
"""
import os
import subprocess
import sys
import tempfile
from pathlib import Path

sys.dont_write_bytecode = True  # the folder holds data, keep it clean
import remark  # noqa: E402

HERE = Path(__file__).resolve().parent
CURA = Path(os.environ.get('CURA_RESOURCES', '/usr/share/cura/resources'))

# A bed of 220 x 220 mm, a 0.4 mm nozzle, PLA: an Ender-3 in all but name.
START = r'G90\nM83\nM104 S[first_layer_temperature]\nM140 S[first_layer_bed_temperature]\nM190 S[first_layer_bed_temperature]\nM109 S[first_layer_temperature]\nG28 ; home all axes\nG1 Z2 F240\nG1 X2 Y10 F3000\nG1 Z0.28 F240\nG92 E0\nG1 Y120 E12 F1500 ; prime line\nG1 X2.4 F5000\nG1 Y10 E24 F1200\nG92 E0\nG1 Z2 F240'
END = r'G91\nG1 E-2 F2700\nG1 Z10 F240\nG90\nG1 X5 Y200 F3000 ; present the part\nM140 S0\nM104 S0\nM107\nM84 X Y E'

PRUSA = {
    'printer_technology': 'FFF', 'gcode_flavor': 'marlin', 'printer_model': 'own',
    'bed_shape': '0x0,220x0,220x220,0x220', 'max_print_height': 250, 'nozzle_diameter': 0.4,
    'filament_diameter': 1.75, 'filament_type': 'PLA', 'filament_density': 1.24,
    'temperature': 205, 'first_layer_temperature': 210, 'bed_temperature': 60, 'first_layer_bed_temperature': 60,
    'start_gcode': START, 'end_gcode': END, 'use_relative_e_distances': 1,
    'before_layer_gcode': ';BEFORE_LAYER_CHANGE\\nG92 E0\\n;[layer_z]', 'layer_gcode': ';AFTER_LAYER_CHANGE\\n;[layer_z]',
    'layer_height': 0.2, 'first_layer_height': 0.2, 'perimeters': 2, 'top_solid_layers': 3, 'bottom_solid_layers': 2,
    'extrusion_width': 0.45, 'first_layer_extrusion_width': 0.42, 'top_infill_extrusion_width': 0.4,
    'fill_density': '20%', 'fill_pattern': 'triangles', 'top_fill_pattern': 'monotonic',
    'infill_anchor': 2.5, 'infill_anchor_max': 12, 'skirts': 1, 'skirt_distance': 3, 'brim_width': 0,
    'perimeter_speed': 45, 'external_perimeter_speed': 25, 'small_perimeter_speed': 25, 'infill_speed': 80,
    'solid_infill_speed': 80, 'top_solid_infill_speed': 40, 'gap_fill_speed': 40, 'bridge_speed': 60,
    'first_layer_speed': 20, 'travel_speed': 150, 'default_acceleration': 500, 'perimeter_acceleration': 500,
    'infill_acceleration': 1000, 'first_layer_acceleration': 500, 'bridge_acceleration': 1000,
    'retract_length': 5, 'retract_speed': 60, 'deretract_speed': 40, 'retract_before_travel': 2,
    'retract_lift': 0, 'retract_layer_change': 1, 'wipe': 0,
    'cooling': 1, 'fan_always_on': 1, 'max_fan_speed': 100, 'min_fan_speed': 100, 'disable_fan_first_layers': 1,
    'slowdown_below_layer_time': 10, 'min_print_speed': 15,
    'machine_limits_usage': 'emit_to_gcode', 'machine_max_acceleration_e': 5000, 'machine_max_acceleration_x': 500,
    'machine_max_acceleration_y': 500, 'machine_max_acceleration_z': 100, 'machine_max_acceleration_extruding': 500,
    'machine_max_acceleration_retracting': 1000, 'machine_max_acceleration_travel': 500,
    'machine_max_feedrate_e': 60, 'machine_max_feedrate_x': 500, 'machine_max_feedrate_y': 500,
    'machine_max_feedrate_z': 10, 'machine_max_jerk_e': 5, 'machine_max_jerk_x': 8, 'machine_max_jerk_y': 8,
    'machine_max_jerk_z': 0.4, 'machine_min_extruding_rate': 0, 'machine_min_travel_rate': 0,
}

SLIC3R = {
    'gcode_flavor': 'reprap', 'bed_shape': '0x0,220x0,220x220,0x220', 'nozzle_diameter': 0.4, 'filament_diameter': 1.75,
    'temperature': 205, 'first_layer_temperature': 210, 'bed_temperature': 60, 'first_layer_bed_temperature': 60,
    'start_gcode': r'G28 ; home all axes\nG1 Z5 F5000 ; lift nozzle\n', 'end_gcode': r'M104 S0 ; turn off temperature\nG28 X0  ; home X axis\nM84     ; disable motors\n',
    'use_relative_e_distances': 1, 'layer_height': 0.25, 'first_layer_height': 0.25, 'perimeters': 2,
    'top_solid_layers': 3, 'bottom_solid_layers': 3, 'fill_density': '20%', 'fill_pattern': 'rectilinear',
    'skirts': 1, 'retract_length': 1.5, 'retract_lift': 0, 'retract_before_travel': 2, 'travel_speed': 130,
    'notes': '', 'duplicate_distance': 6,
}

CURA_PRINT = {
    'machine_width': 220, 'machine_depth': 220, 'machine_height': 250, 'machine_center_is_zero': 'false',
    'machine_gcode_flavor': 'RepRap (Marlin/Sprinter)', 'machine_nozzle_size': 0.4, 'material_diameter': 1.75,
    'machine_start_gcode': 'M201 X500 Y500 Z100 E5000\nM204 P500 T1000\nG28 ;Home\nG92 E0\nG1 Z2.0 F3000\nG1 X10.1 Y20 Z0.28 F5000.0\nG1 X10.1 Y145.0 Z0.28 F1500.0 E15\nG92 E0\nG1 Z2.0 F3000',
    'machine_end_gcode': 'G91 ;Relative positioning\nG1 E-2 F2700 ;Retract a bit\nG1 Z0.2 E-2 F2400 ;Retract and raise Z\nG1 X5 Y5 F3000 ;Wipe out\nG1 Z10 ;Raise Z more\nG90 ;Absolute positioning\nG1 X0 Y220 ;Present print\nM106 S0 ;Turn-off fan\nM104 S0 ;Turn-off hotend\nM140 S0 ;Turn-off bed\nM84 X Y E ;Disable all steppers but Z',
    'material_print_temperature': 205, 'material_print_temperature_layer_0': 210, 'material_bed_temperature': 60,
    'material_bed_temperature_layer_0': 60, 'layer_height': 0.25, 'layer_height_0': 0.25,
    'line_width': 0.4, 'wall_line_width': 0.4, 'wall_line_width_0': 0.4, 'wall_line_width_x': 0.4, 'skin_line_width': 0.4,
    'infill_line_width': 0.4, 'skirt_brim_line_width': 0.4, 'wall_thickness': 0.8, 'wall_line_count': 2,
    'top_layers': 3, 'bottom_layers': 3, 'initial_bottom_layers': 3, 'top_bottom_pattern': 'lines', 'top_bottom_pattern_0': 'lines',
    'infill_pattern': 'lines', 'infill_sparse_density': 20, 'infill_line_distance': 2.0, 'infill_overlap_mm': 0.1,
    'skin_overlap_mm': 0.02, 'zig_zaggify_infill': 'false', 'infill_sparse_thickness': 0.25,
    'speed_print': 50, 'speed_infill': 50, 'speed_wall': 25, 'speed_wall_0': 25, 'speed_wall_x': 25, 'speed_topbottom': 25,
    'speed_travel': 150, 'speed_layer_0': 20, 'speed_print_layer_0': 20, 'speed_travel_layer_0': 100, 'skirt_brim_speed': 20,
    'retraction_enable': 'true', 'retraction_amount': 5, 'retraction_speed': 45, 'retraction_retract_speed': 45,
    'retraction_prime_speed': 45, 'retraction_min_travel': 1.5, 'retraction_hop_enabled': 'false', 'retraction_hop': 0.2,
    'retraction_combing': 'noskin', 'retraction_combing_max_distance': 30, 'retraction_count_max': 100,
    'retraction_extrusion_window': 10, 'travel_avoid_distance': 0.625, 'relative_extrusion': 'false',
    'adhesion_type': 'skirt', 'skirt_line_count': 2, 'skirt_gap': 5, 'cool_fan_enabled': 'true', 'cool_fan_speed': 100,
    'cool_fan_speed_0': 0, 'cool_fan_speed_min': 100, 'cool_fan_speed_max': 100, 'cool_fan_full_layer': 2,
    'cool_min_layer_time': 10, 'cool_min_speed': 10, 'support_enable': 'false', 'infill_wipe_dist': 0,
    'acceleration_enabled': 'false', 'fill_outline_gaps': 'false', 'filter_out_tiny_gaps': 'true',
}

# name: (slicer, models, settings that differ, flags)
RECIPES = {
    # The demo job: many separate infill beads (no anchors join them), z-hop, a short retraction.
    'demo': ('prusa', ['demo'], dict(retract_length=0.8, retract_lift=0.3, retract_speed=35, fill_pattern='stars', fill_density='15%',
             infill_anchor=0, infill_anchor_max=0, remaining_times=1, layer_height=0.3, first_layer_height=0.3), ['--label-objects']),
    # The daemon's demo: something in it begins in the air, and nothing is told to hold it.
    'lamp': ('prusa', ['lamp'], dict(retract_length=0.8, retract_lift=0.3, retract_speed=35, fill_pattern='stars', fill_density='15%',
             infill_anchor=0, infill_anchor_max=0, remaining_times=1, layer_height=0.3, first_layer_height=0.3), ['--label-objects']),
    'ps25-marlin-rel-triangles': ('prusa', ['bench'], dict(machine_limits_usage='time_estimate_only', infill_anchor=1), []),
    'ps25-marlin-abs-grid': ('prusa', ['bench'], dict(fill_pattern='grid', infill_anchor=0, infill_anchor_max=0,
             use_relative_e_distances=0, before_layer_gcode=';BEFORE_LAYER_CHANGE\\n;[layer_z]',
             start_gcode=START.replace('M83', 'M82')), []),
    'ps25-marlin2-fwretract-rectilinear': ('prusa', ['bench'], dict(gcode_flavor='marlin2', fill_pattern='rectilinear', infill_anchor=0, infill_anchor_max=0,
             use_firmware_retraction=1, default_acceleration=0), []),
    'ps25-marlin-wipe-zhop-honeycomb': ('prusa', ['bench'], dict(layer_height=0.25, first_layer_height=0.25,
             fill_pattern='honeycomb', fill_density='25%', wipe=1,
             retract_before_wipe='70%', retract_lift=0.4, retract_length=2), []),
    'ps25-marlin-two-objects': ('prusa', ['bench', 'comb'], dict(layer_height=0.3, first_layer_height=0.3,
             fill_pattern='cubic', infill_anchor=0, infill_anchor_max=0), ['--merge', '--label-objects']),
    'ps25-marlin-sequential': ('prusa', ['bench', 'comb'], dict(layer_height=0.3, first_layer_height=0.3,
             complete_objects=1, extruder_clearance_radius=15, extruder_clearance_height=10), ['--merge', '--label-objects']),
    'ps25-marlin-gapfill': ('prusa', ['comb'], dict(gap_fill_enabled=1, perimeter_generator='classic', retract_before_travel=1), []),
    'ps25-marlin-comments': ('prusa', ['bench'], dict(gcode_comments=1, fill_pattern='line', layer_height=0.25,
             first_layer_height=0.25), []),
    'ps25-klipper-gyroid': ('prusa', ['bench'], dict(gcode_flavor='klipper', layer_height=0.3, first_layer_height=0.3, fill_pattern='gyroid', fill_density='30%',
             start_gcode=r'START_PRINT BED=[first_layer_bed_temperature] NOZZLE=[first_layer_temperature]\nM83\nSET_PRESSURE_ADVANCE ADVANCE=0.04', end_gcode='END_PRINT',
             machine_limits_usage='time_estimate_only'), ['--label-objects']),
    'ps25-marlin-vase': ('prusa', ['bench'], dict(spiral_vase=1, perimeters=1, top_solid_layers=0, fill_density='0%',
             bottom_solid_layers=3, layer_height=0.25, first_layer_height=0.25), []),
    'slic3r13-rel-comments': ('slic3r', ['bench'], dict(gcode_comments=1, retract_lift=0.3), []),
    'slic3r13-abs': ('slic3r', ['bench'], dict(use_relative_e_distances=0, fill_pattern='honeycomb'), []),
    'cura413-marlin-abs-lines': ('cura', ['demo'], dict(layer_height=0.36, layer_height_0=0.36, infill_sparse_thickness=0.36), []),
    'cura413-marlin-rel-cubic': ('cura', ['bench'], dict(infill_pattern='cubic', infill_line_distance=6.0, relative_extrusion='true'), []),
    'cura413-marlin-zhop-triangles': ('cura', ['bench'], dict(infill_pattern='triangles', infill_line_distance=4.0,
             retraction_hop_enabled='true'), []),
    'cura413-marlin-fwretract-two-meshes': ('cura', ['bench', 'comb'], dict(infill_pattern='grid', infill_line_distance=4.0,
             machine_firmware_retract='true'), []),
}

# name: the file that it is made from, and what marks it anew
REMARKED = {
    'remarked-orca': ('ps25-marlin-two-objects', remark.orca),
    'remarked-bambu': ('ps25-marlin-wipe-zhop-honeycomb', remark.bambu),
}


def ini(settings, folder):
    path = Path(folder) / 'settings.ini'
    path.write_text(''.join(f'{k} = {v}\n' for k, v in settings.items()))
    return path


def prusa(name, models, settings, flags, folder):
    flags = list(flags)
    if '--label-objects' in flags:
        flags.remove('--label-objects')
        settings = {**settings, 'gcode_label_objects': 1}
    return ['prusa-slicer', '--export-gcode', '--load', str(ini({**PRUSA, **settings}, folder)), *flags,
            '--center', '110,110', '--output', f'{name}.gcode', *(f'{m}.stl' for m in models)]


def slic3r(name, models, settings, flags, folder):
    return ['slic3r', '--no-gui', '--load', str(ini({**SLIC3R, **settings}, folder)), *flags,
            '--print-center', '110,110', '--output', f'{name}.gcode', *(f'{m}.stl' for m in models)]


def cura(name, models, settings, flags, folder):
    command = ['CuraEngine', 'slice', '-j', str(CURA / 'definitions/creality_ender3.def.json')]
    for key, value in {**CURA_PRINT, **settings}.items():
        command += ['-s', f'{key}={value}']
    for i, model in enumerate(models):
        # mesh_position_x comes after its mesh: it belongs to that one alone. Two meshes lie side by side.
        x = 110 if len(models) == 1 else 94 + 30 * i
        command += ['-l', f'{model}.stl', '-s', f'mesh_position_x={x - 110}']
    return command + ['-o', f'{name}.gcode']


def main():
    wanted = sys.argv[1:]
    chosen = [n for n in [*RECIPES, *REMARKED] if not wanted or any(n.startswith(w) for w in wanted)]
    env = {**os.environ, 'CURA_ENGINE_SEARCH_PATH': f'{CURA}/definitions:{CURA}/extruders'}
    for name in chosen:
        if name in REMARKED:
            source, marks = REMARKED[name]
            (HERE / f'{name}.gcode').write_text(marks((HERE / f'{source}.gcode').read_text()))
            print(f'{name}: marked anew from {source}')
            continue
        slicer, models, settings, flags = RECIPES[name]
        with tempfile.TemporaryDirectory() as folder:
            command = globals()[slicer](name, models, settings, flags, folder)
            done = subprocess.run(command, cwd=HERE, env=env, capture_output=True, text=True)
        if done.returncode or not (HERE / f'{name}.gcode').exists():
            sys.exit(f'{name}: {command[0]} failed ({done.returncode}):\n{done.stdout[-2000:]}{done.stderr[-2000:]}')
        print(f'{name}: {(HERE / f"{name}.gcode").stat().st_size / 1000:.0f} kB')


if __name__ == '__main__':
    main()
