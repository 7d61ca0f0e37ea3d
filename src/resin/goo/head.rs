//! What a GOO file says besides its pictures: the head, and each layer's definition.
//!
//! Takes bytes, gives plain values; and the other way round. All numbers are
//! big-endian. Source: Elegoo's "Goo Format Spec V1.2" (of the format V3.0), which
//! names the fields in order; where each lies follows from their sizes. One list of
//! fields serves reading and writing ([`Pass`]). Knows no picture and no file.

/// The first bytes of a file.
pub(super) const MAGIC: [u8; 12] = *b"V3.0\x07\0\0\0DLP\0";
/// The bytes behind the last layer.
pub(super) const END: [u8; 11] = *b"\0\0\0\x07\0\0\0DLP\0";
/// What ends the previews, each layer's definition and each picture.
pub(super) const DELIMITER: [u8; 2] = *b"\r\n";

/// Sides of the previews, px, and where they begin. RGB565, row by row from the top.
pub(super) const PREVIEWS: [(u32, usize); 2] = [(116, 194), (290, 27_108)];
/// Where the numbers begin, behind names and previews.
pub(super) const SETTINGS_AT: usize = 195_310;
/// Bytes of the head as the specification has it.
pub(super) const HEAD_BYTES: usize = 195_477;
/// Bytes that a head has at least: up to the figure that tells where layers begin.
pub(super) const LEAST_HEAD_BYTES: usize = 195_474;
/// Bytes of a layer's definition.
pub(super) const DEFINITION_BYTES: usize = 70;

/// A way of the plate, mm, and how fast, mm/min.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Way {
    pub(super) mm: f32,
    pub(super) mm_min: f32,
}

/// Names at the beginning of a file, each cut off where its field ends.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Names {
    /// The program that wrote it, and its version.
    pub(super) program: [String; 2],
    /// `YYYY-MM-DD hh:mm:ss`.
    pub(super) created: String,
    /// The printer, its type, and the resin's profile.
    pub(super) printer: [String; 2],
    pub(super) profile: String,
    /// Levels of anti-aliasing, grey and blur: nothing that changes how pictures are read.
    pub(super) levels: [u16; 3],
}

/// The numbers of the head.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Settings {
    pub(super) layers: u32,
    /// Pixels along a row and a column.
    pub(super) panel_px: [u16; 2],
    /// Whether pictures are mirrored left to right, and top to bottom.
    pub(super) mirror: [u8; 2],
    /// Sides of the panel, mm.
    pub(super) panel_mm: [f32; 2],
    pub(super) machine_z_mm: f32,
    pub(super) layer_mm: f32,
    pub(super) exposure_s: f32,
    /// 0: `light_off_s` counts; 1: the waits.
    pub(super) delay_mode: u8,
    pub(super) light_off_s: f32,
    /// Before the lift, after it, and after the way back; bottom layers first.
    pub(super) waits_s: [[f32; 3]; 2],
    pub(super) bottom_exposure_s: f32,
    pub(super) bottom_layers: u32,
    /// Bottom layers first.
    pub(super) lift: [Way; 2],
    pub(super) retract: [Way; 2],
    /// The second stage of each.
    pub(super) lift2: [Way; 2],
    pub(super) retract2: [Way; 2],
    /// Power of the light, 0 to 255; bottom layers first.
    pub(super) light: [u16; 2],
    /// Whether the layers' definitions count, or these.
    pub(super) by_layer: u8,
    pub(super) print_time_s: u32,
    pub(super) volume_mm3: f32,
    pub(super) mass_g: f32,
    pub(super) price: f32,
    pub(super) currency: [u8; 8],
    /// Where the first layer's definition begins in the file.
    pub(super) layers_at: u32,
    /// Whether brightness goes to 255. Real files that say no go there too.
    pub(super) grey: u8,
    pub(super) transition_layers: u16,
}

/// What stands before a layer's picture.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Definition {
    /// Whether the print pauses here, and how high the plate goes then, mm.
    pub(super) pause: u16,
    pub(super) pause_z_mm: f32,
    /// Where the layer ends, mm above the plate.
    pub(super) top_mm: f32,
    pub(super) exposure_s: f32,
    pub(super) light_off_s: f32,
    pub(super) waits_s: [f32; 3],
    pub(super) lift: [Way; 2],
    pub(super) retract: [Way; 2],
    pub(super) light: u16,
    pub(super) delimiter: [u8; 2],
    /// Of the picture, from its magic byte to its checksum.
    pub(super) bytes: u32,
}

/// Goes over fields in the order in which they stand in a file.
trait Pass {
    /// Reads into these bytes, or writes them.
    fn bytes(&mut self, field: &mut [u8]);

    fn u8(&mut self, field: &mut u8) {
        let mut bytes = [*field];
        self.bytes(&mut bytes);
        [*field] = bytes;
    }

    fn u16(&mut self, field: &mut u16) {
        let mut bytes = field.to_be_bytes();
        self.bytes(&mut bytes);
        *field = u16::from_be_bytes(bytes);
    }

    fn u32(&mut self, field: &mut u32) {
        let mut bytes = field.to_be_bytes();
        self.bytes(&mut bytes);
        *field = u32::from_be_bytes(bytes);
    }

    fn f32(&mut self, field: &mut f32) {
        let mut bits = field.to_bits();
        self.u32(&mut bits);
        *field = f32::from_bits(bits);
    }

    fn way(&mut self, way: &mut Way) {
        self.f32(&mut way.mm);
        self.f32(&mut way.mm_min);
    }

    /// A text, filled up with zeros to so many bytes.
    fn text(&mut self, field: &mut String, length: usize) {
        let mut bytes = vec![0; length];
        let mut end = field.len().min(length - 1);
        while !field.is_char_boundary(end) {
            end -= 1;
        }
        bytes[..end].copy_from_slice(&field.as_bytes()[..end]);
        self.bytes(&mut bytes);
        let text = bytes.split(|&b| b == 0).next().unwrap_or_default();
        *field = String::from_utf8_lossy(text).into_owned();
    }
}

/// Reads; what is beyond the end is left as it was.
struct Reading<'a>(&'a [u8]);

impl Pass for Reading<'_> {
    fn bytes(&mut self, field: &mut [u8]) {
        if let Some((bytes, rest)) = self.0.split_at_checked(field.len()) {
            field.copy_from_slice(bytes);
            self.0 = rest;
        }
    }
}

struct Writing(Vec<u8>);

impl Pass for Writing {
    fn bytes(&mut self, field: &mut [u8]) {
        self.0.extend_from_slice(field);
    }
}

impl Names {
    fn pass(&mut self, pass: &mut impl Pass) {
        pass.text(&mut self.program[0], 32);
        pass.text(&mut self.program[1], 24);
        pass.text(&mut self.created, 24);
        pass.text(&mut self.printer[0], 32);
        pass.text(&mut self.printer[1], 32);
        pass.text(&mut self.profile, 32);
        self.levels.iter_mut().for_each(|level| pass.u16(level));
    }

    /// From the bytes of a head.
    pub(super) fn read(head: &[u8]) -> Names {
        let mut names = Names::default();
        names.pass(&mut Reading(head.get(MAGIC.len()..).unwrap_or_default()));
        names
    }
}

impl Settings {
    fn pass(&mut self, pass: &mut impl Pass) {
        pass.u32(&mut self.layers);
        self.panel_px.iter_mut().for_each(|px| pass.u16(px));
        self.mirror.iter_mut().for_each(|flag| pass.u8(flag));
        self.panel_mm.iter_mut().for_each(|mm| pass.f32(mm));
        pass.f32(&mut self.machine_z_mm);
        pass.f32(&mut self.layer_mm);
        pass.f32(&mut self.exposure_s);
        pass.u8(&mut self.delay_mode);
        pass.f32(&mut self.light_off_s);
        self.waits_s.iter_mut().flatten().for_each(|s| pass.f32(s));
        pass.f32(&mut self.bottom_exposure_s);
        pass.u32(&mut self.bottom_layers);
        self.lift.iter_mut().for_each(|way| pass.way(way));
        self.retract.iter_mut().for_each(|way| pass.way(way));
        self.lift2.iter_mut().for_each(|way| pass.way(way));
        self.retract2.iter_mut().for_each(|way| pass.way(way));
        self.light.iter_mut().for_each(|power| pass.u16(power));
        pass.u8(&mut self.by_layer);
        pass.u32(&mut self.print_time_s);
        pass.f32(&mut self.volume_mm3);
        pass.f32(&mut self.mass_g);
        pass.f32(&mut self.price);
        pass.bytes(&mut self.currency);
        pass.u32(&mut self.layers_at);
        pass.u8(&mut self.grey);
        pass.u16(&mut self.transition_layers);
    }

    /// From the bytes of a head, which may end before the last fields.
    pub(super) fn read(head: &[u8]) -> Settings {
        let mut settings = Settings::default();
        settings.pass(&mut Reading(head.get(SETTINGS_AT..).unwrap_or_default()));
        settings
    }
}

impl Definition {
    fn pass(&mut self, pass: &mut impl Pass) {
        pass.u16(&mut self.pause);
        pass.f32(&mut self.pause_z_mm);
        pass.f32(&mut self.top_mm);
        pass.f32(&mut self.exposure_s);
        pass.f32(&mut self.light_off_s);
        self.waits_s.iter_mut().for_each(|s| pass.f32(s));
        self.lift.iter_mut().for_each(|way| pass.way(way));
        self.retract.iter_mut().for_each(|way| pass.way(way));
        pass.u16(&mut self.light);
        pass.bytes(&mut self.delimiter);
        pass.u32(&mut self.bytes);
    }

    pub(super) fn read(bytes: &[u8; DEFINITION_BYTES]) -> Definition {
        let mut definition = Definition::default();
        definition.pass(&mut Reading(bytes));
        definition
    }

    pub(super) fn write(mut self) -> Vec<u8> {
        let mut bytes = Writing(Vec::with_capacity(DEFINITION_BYTES));
        self.pass(&mut bytes);
        bytes.0
    }
}

/// The bytes of a head. `previews` are the small and the large one as RGB565.
pub(super) fn write(mut names: Names, mut settings: Settings, previews: &[Vec<u16>; 2]) -> Vec<u8> {
    let mut bytes = Writing(Vec::with_capacity(HEAD_BYTES));
    bytes.0.extend(MAGIC);
    names.pass(&mut bytes);
    for (preview, (side, at)) in previews.iter().zip(PREVIEWS) {
        debug_assert_eq!(bytes.0.len(), at);
        let pixels = (side * side) as usize;
        bytes.0.extend(preview.iter().take(pixels).flat_map(|pixel| pixel.to_be_bytes()));
        bytes.0.resize(at + 2 * pixels, 0);
        bytes.0.extend(DELIMITER);
    }
    settings.pass(&mut bytes);
    bytes.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_lie_where_the_specification_has_them() {
        let names = Names {
            program: ["ä".repeat(20), "1.0".to_owned()],
            created: "2026-01-02 03:04:05".to_owned(),
            profile: "grey".to_owned(),
            levels: [8, 1, 2],
            ..Names::default()
        };
        let settings = Settings {
            layers: 3,
            layers_at: HEAD_BYTES as u32,
            transition_layers: 7,
            by_layer: 1,
            bottom_layers: 5,
            ..Settings::default()
        };
        let head = write(names.clone(), settings, &[vec![0x1234], vec![]]);
        assert_eq!(head.len(), HEAD_BYTES);
        // Offsets as readers of others have them.
        let check = |at: usize, expect: &[u8]| assert_eq!(&head[at..at + expect.len()], expect, "{at}");
        check(0, b"V3.0\x07\0\0\0DLP\0");
        check(68, b"2026-01-02 03:04:05\0");
        check(156, b"grey\0");
        check(188, &[0, 8, 0, 1, 0, 2, 0x12, 0x34, 0, 0]);
        check(27_106, b"\r\n");
        check(195_308, b"\r\n\0\0\0\x03");
        check(195_373, &[0, 0, 0, 5]);
        check(195_445, &[1]);
        check(195_470, &[0, 2, 0xfb, 0x95, 0, 0, 7]);
        assert_eq!(Settings::read(&head), settings);
        let read = Names::read(&head);
        assert_eq!(read.program[0], "ä".repeat(15), "cut between letters, with a zero behind");
        assert_eq!((read.created, read.levels), (names.created, names.levels));
        assert_eq!(Settings::read(&head[..LEAST_HEAD_BYTES]).layers_at, HEAD_BYTES as u32);
    }

    #[test]
    fn a_definition_has_seventy_bytes() {
        let definition =
            Definition { top_mm: 0.05, light: 255, delimiter: DELIMITER, bytes: 23, ..Definition::default() };
        let bytes = definition.write();
        assert_eq!(bytes.len(), DEFINITION_BYTES);
        assert_eq!(bytes[6..10], 0.05_f32.to_be_bytes());
        assert_eq!(bytes[62..], [0, 255, 0x0d, 0x0a, 0, 0, 0, 23]);
        assert_eq!(Definition::read(bytes.as_slice().try_into().expect("seventy")), definition);
    }
}
