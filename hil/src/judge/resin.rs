//! What must hold of every resin print, from what the board's light did and the display showed.
//!
//! Takes the job's layers, pulses of the light and pictures with their times; gives how long each
//! layer was exposed in how many pulses, and all that is wrong. Knows no host: who lies is found
//! out here.
//!
//! - A pulse has one picture from its beginning to its end, the plate at its layer's height.
//! - It lasts no longer than the layer's exposure by more than [`LONGER_MOST`].
//! - No layer comes after a later one.
//! - In a print that is whole, what each pixel got is what the job has for it, by [`DOSE_MOST`].
use crate::world::plate::Shown;
use outrigger::printer::exposure::script::Layer;
use outrigger::printer::mock::Pulse;

/// Longer than its exposure by this share is no pulse.
pub const LONGER_MOST: f64 = 0.05;

/// What a pixel gets differs from the job's by no more than this share.
pub const DOSE_MOST: f64 = 0.01;

/// So far from its height the plate may be, mm.
const Z_MOST_MM: f64 = 0.001;

/// A pixel of a picture, for doses; each layer has some of them, like no other.
const PIXELS: u32 = 16;

/// What came of the exposures.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Exposed {
    /// Of each layer each pulse's length, s; one that never ended is not among them.
    pub pulses_s: Vec<Vec<f64>>,
    /// The most that a pulse was longer than its exposure, as a share of it; below 0: shorter.
    pub longest: Option<f64>,
    /// Pulses that are longer than they may be, or on to the end, with their beginnings, ns.
    pub too_long: Vec<(u64, String)>,
    /// What else is wrong.
    pub wrong: Vec<String>,
}

/// Whether a layer has that pixel in its picture.
pub fn lit(layer: u32, pixel: u32) -> bool {
    // All layers have the first, as a part has a core.
    pixel == 0 || layer.wrapping_mul(0x9e37_79b9).rotate_left(pixel).count_ones().is_multiple_of(2)
}

/// Goes through all pulses. `speed`: how many times faster than life the machine is.
pub fn exposed(layers: &[Layer], light: &[Pulse], shown: &[Shown], speed: f64) -> Exposed {
    let mut done = Exposed { pulses_s: vec![Vec::new(); layers.len()], ..Exposed::default() };
    let mut last = 0;
    for pulse in light {
        let begin_ns = pulse.begin.at_ns;
        let at_s = begin_ns as f64 / 1e9;
        let end_ns = pulse.end.map_or(u64::MAX, |end| end.at_ns);
        let picture = shown.iter().rev().find(|(at_ns, _)| *at_ns <= begin_ns).and_then(|(_, layer)| *layer);
        let Some((n, layer)) = picture.and_then(|n| Some((n, layers.get(n as usize)?))) else {
            done.wrong.push(format!("the light was on without a picture at {at_s:.4} s"));
            continue;
        };
        // A light that does not go off at all is told as that; dark in it is better than a picture.
        let own_ns = begin_ns + u64::from(layer.exposure_ms) * 1_000_000;
        let changes = |at_ns: u64, to: Option<u32>| {
            (begin_ns + 1..end_ns).contains(&at_ns) && (to.is_some() || at_ns < own_ns)
        };
        let what = format!("layer {} at {at_s:.4} s", n + 1);
        if let Some((at_ns, to)) = shown.iter().find(|(at_ns, to)| changes(*at_ns, *to)) {
            let when_s = *at_ns as f64 / 1e9;
            done.wrong.push(format!("{what}: the picture became {to:?} in the light, at {when_s:.4} s"));
        }
        for z_mm in [Some(pulse.begin), pulse.end].into_iter().flatten().map(|m| m.z_mm) {
            if (z_mm - layer.z_mm).abs() > Z_MOST_MM {
                done.wrong.push(format!("{what}: exposed at Z {z_mm:.4}, not {:.4}", layer.z_mm));
            }
        }
        if pulse.power != layer.power {
            done.wrong.push(format!("{what}: power {}, not {}", pulse.power, layer.power));
        }
        if n < last {
            done.wrong.push(format!("{what}: after layer {}", last + 1));
        }
        last = last.max(n);
        let wants_s = f64::from(layer.exposure_ms) / 1e3;
        match pulse.machine_s(speed) {
            None => done.too_long.push((begin_ns, format!("{what}: the light stays on"))),
            Some(took_s) => {
                let longer = took_s / wants_s - 1.0;
                done.longest = Some(done.longest.map_or(longer, |most| most.max(longer)));
                if longer > LONGER_MOST {
                    done.too_long.push((begin_ns, format!("{what}: lit for {took_s:.4} s, not {wants_s} s")));
                }
                done.pulses_s[n as usize].push(took_s);
            }
        }
    }
    done
}

impl Exposed {
    /// What does not hold of a print that is said to be finished. `again`: how often each layer was
    /// said to be exposed once more.
    pub fn whole(&self, layers: &[Layer], again: impl Fn(u32) -> usize) -> Vec<String> {
        let mut wrong = Vec::new();
        let mut dose = vec![(0.0, 0.0); PIXELS as usize];
        for ((n, layer), pulses) in (0..).zip(layers).zip(&self.pulses_s) {
            let wants_s = f64::from(layer.exposure_ms) / 1e3;
            let took_s: f64 = pulses.iter().sum();
            let (times, most) = (pulses.len(), 1 + again(n));
            if times == 0 || times > most {
                wrong.push(format!("layer {} was exposed {times} times, {most} at most were to be", n + 1));
            }
            // The last of them is whole; who was told has the other beside it.
            let off = (pulses.last().copied().unwrap_or_default() / wants_s - 1.0).abs();
            if off > DOSE_MOST {
                wrong.push(format!("layer {} was exposed for {pulses:?} s, not {wants_s} s", n + 1));
            }
            for (_, (got, wanted)) in (0..).zip(&mut dose).filter(|(pixel, _)| lit(n, *pixel)) {
                *got += if most == 1 { took_s } else { wants_s };
                *wanted += wants_s;
            }
        }
        for (pixel, (got, wanted)) in dose.iter().enumerate() {
            if (got - wanted).abs() > wanted * DOSE_MOST {
                wrong.push(format!("pixel {pixel} got {got:.4} s of light, not {wanted:.4} s"));
            }
        }
        wrong
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use outrigger::printer::mock::Moment;

    fn layers() -> Vec<Layer> {
        let layer =
            |n: u32| Layer { z_mm: f64::from(n) * 0.05, exposure_ms: 2_000, power: 255, ..Layer::default() };
        (1..=3).map(layer).collect()
    }

    fn pulse(from_ms: u64, to_ms: Option<u64>, z_mm: f64) -> Pulse {
        let moment = |ms: u64| Moment { at_ns: ms * 1_000_000, z_mm };
        Pulse { begin: moment(from_ms), end: to_ms.map(moment), power: 255 }
    }

    /// Pulses (from and to, ms, Z), pictures (from, ms): what is wrong, too long, and missing at the end.
    fn check(pulses: &[(u64, Option<u64>, f64)], shown: &[(u64, Option<u32>)], expect: [Option<&str>; 3]) {
        let light: Vec<_> = pulses.iter().map(|(from, to, z)| pulse(*from, *to, *z)).collect();
        let shown: Vec<_> = shown.iter().map(|(ms, layer)| (ms * 1_000_000, *layer)).collect();
        let done = exposed(&layers(), &light, &shown, 1.0);
        let too_long = done.too_long.iter().map(|(_, text)| text.clone()).collect();
        let whole = done.whole(&layers(), |_| 0);
        for (found, expect) in [done.wrong, too_long, whole].iter().zip(expect) {
            match expect {
                Some(text) => assert!(found.iter().any(|w| w.contains(text)), "{text:?} {found:?}"),
                None => assert!(found.is_empty(), "{pulses:?} {found:?}"),
            }
        }
    }

    const PICTURES: [(u64, Option<u32>); 6] =
        [(0, Some(0)), (3_000, None), (4_000, Some(1)), (7_000, None), (8_000, Some(2)), (11_000, None)];

    #[test]
    fn each_demand_is_looked_at() {
        let good = [(500, Some(2_500), 0.05), (4_500, Some(6_510), 0.1), (8_500, Some(10_500), 0.15)];
        let with = |at: usize, to: (u64, Option<u64>, f64)| {
            let mut pulses = good;
            pulses[at] = to;
            pulses
        };
        check(&good, &PICTURES, [None; 3]);
        check(&with(1, (4_500, Some(6_590), 0.1)), &PICTURES, [None, None, Some("layer 2 was")]);
        check(
            &with(1, (4_500, Some(6_610), 0.1)),
            &PICTURES,
            [None, Some("lit for 2.1100"), Some("layer 2 was")],
        );
        check(
            &with(2, (8_500, None, 0.15)),
            &PICTURES,
            [None, Some("stays on"), Some("layer 3 was exposed 0 times")],
        );
        check(&with(0, (500, Some(2_500), 0.06)), &PICTURES, [Some("at Z 0.0600"), None, None]);
        check(
            &with(0, (1_500, Some(3_500), 0.05)),
            &PICTURES,
            [Some("became None in the light"), None, None],
        );
        check(
            &with(0, (3_500, Some(3_600), 0.05)),
            &PICTURES,
            [Some("without a picture"), None, Some("0 times")],
        );
        check(&good[..2], &PICTURES, [None, None, Some("layer 3 was exposed 0 times")]);
        let out_of_order = [(0, Some(1)), (3_000, None), (4_000, Some(0))];
        check(
            &[(500, Some(2_500), 0.1), (4_500, Some(6_500), 0.05)],
            &out_of_order,
            [Some("after layer 2"), None, Some("layer 3")],
        );
    }

    #[test]
    fn every_pixel_has_layers_of_its_own() {
        for pixel in 0..PIXELS {
            assert!((0..40).any(|layer| lit(layer, pixel)));
        }
        assert!((1..PIXELS).any(|pixel| (0..40).any(|layer| !lit(layer, pixel))));
    }
}
