//! What the settings in a file tell that supports go by.
use crate::layers::polygon::{Inside, resolve};
use crate::layers::shape::{MAX_COORDINATE, Point, Region, UNITS_PER_MM};
use outrigger_gcode::dialect::settings::{number_for_tool, setting};
use outrigger_gcode::line::{parse, split_lines};

/// Settings, as far as the file has them.
#[derive(Clone, Debug, Default, PartialEq)]
pub(in crate::merge) struct Told {
    /// The slicer raised Z all along.
    pub(in crate::merge) spiral: bool,
    /// E counts mm³.
    pub(in crate::merge) volumetric: bool,
    /// Of the first filament, mm.
    pub(in crate::merge) filament_mm: Option<f64>,
    /// Extrusion multiplier.
    pub(in crate::merge) multiplier: Option<f64>,
    /// Speed of supports, mm/s.
    pub(in crate::merge) support_mm_s: Option<f64>,
    /// Speed of their interface, mm/s.
    pub(in crate::merge) interface_mm_s: Option<f64>,
    /// The plate, or nothing.
    pub(in crate::merge) bed: Region,
}

impl Told {
    /// Reads the settings in a stretch of the file (its beginning or its end).
    pub(in crate::merge) fn read(&mut self, text: &[u8]) {
        for bytes in split_lines(text) {
            if !bytes.trim_ascii_start().starts_with(b";") {
                continue;
            }
            if let Some((key, value)) = setting(&parse(bytes)) {
                self.set(key, value);
            }
        }
    }

    fn set(&mut self, key: &str, value: &str) {
        let number = number_for_tool(value, 0).filter(|v| *v > 0.0);
        match key {
            "spiral_vase" | "spiral_mode" => self.spiral = value.starts_with('1'),
            "use_volumetric_e" => self.volumetric = value.starts_with('1'),
            "filament_diameter" => self.filament_mm = number.filter(|d| (0.5..=5.0).contains(d)),
            "extrusion_multiplier" | "filament_flow_ratio" => {
                self.multiplier = number.filter(|m| (0.2..=5.0).contains(m));
            }
            "support_material_speed" | "support_speed" => self.support_mm_s = number,
            "support_material_interface_speed" | "support_interface_speed" => {
                let share = value.strip_suffix('%').and_then(|v| number_for_tool(v, 0));
                let own = |share: f64| self.support_mm_s.map(|speed| speed * share / 100.0);
                self.interface_mm_s = number.or(share.filter(|s| *s > 0.0).and_then(own));
            }
            "bed_shape" | "printable_area" => self.bed = bed(value),
            _ => {}
        }
    }
}

/// `0x0,220x0,220x220,0x220`; nothing where it is no such list.
fn bed(value: &str) -> Region {
    let number = |text: &str| {
        let (rest, number) = outrigger_gcode::number::decimal(text.trim().as_bytes()).ok()?;
        let reaches = number.value.abs() < f64::from(MAX_COORDINATE) / UNITS_PER_MM;
        (rest.is_empty() && reaches).then_some(number.value)
    };
    let corner = |text: &str| {
        let (x, y) = text.split_once('x')?;
        Some(Point::from_mm(number(x)?, number(y)?))
    };
    let ring: Option<Vec<Point>> = value.split(',').map(corner).collect();
    ring.map_or_else(Region::default, |ring| resolve([&ring], Inside::NonZero))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_are_read() {
        let mut told = Told::default();
        told.read(b"; filament_diameter = 2.85\n; extrusion_multiplier = 0.95\n; spiral_vase = 0\nG1 X1\n; support_material_interface_speed = 50%\n; support_material_speed = 60\n; bed_shape = 0x0,220x0,220x210,0x210\n");
        assert_eq!((told.filament_mm, told.multiplier), (Some(2.85), Some(0.95)));
        assert_eq!((told.support_mm_s, told.interface_mm_s), (Some(60.0), None));
        told.read(b"; support_material_interface_speed = 50%\n; use_volumetric_e = 1\n; spiral_mode = 1\n");
        assert_eq!(told.interface_mm_s, Some(30.0));
        assert!(told.volumetric && told.spiral);
        assert!((told.bed.area_mm2() - 220.0 * 210.0).abs() < 1e-6);
    }

    #[test]
    fn a_bed_that_is_none_is_nothing() {
        for value in ["", "0x0", "0x0,1x0,1e9x1", "a", "0x0,9x0,999999999x9", "1,2,3"] {
            assert!(bed(value).is_empty(), "{value}");
        }
    }
}
