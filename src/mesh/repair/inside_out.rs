//! Shells that face inward although nothing is around them.
//!
//! Takes a draft, turns shells whose inside would be air. A shell of negative volume
//! within a solid is a cavity and stays. Which shells lie around which is found by a
//! ray upwards from a point of each; a shell that lies within a turned one is turned
//! with it, since whole files come inside out.
use super::draft::Draft;
use super::rays::Columns;
use crate::mesh::report::Mended;
use crate::mesh::shells::{Shell, Shells};

/// Area that the rims of an open shell could enclose at most (as circles), in parts of
/// its own, up to which its volume means anything. A box without its lid has 0.25.
const OPENING: f64 = 0.3;

/// Volume of a shell by area^1.5 up to which it is taken for a sheet; a cube has 0.068.
const SHEET: f64 = 1e-3;

/// Turns shells that are inside out; gives all shells as they are then.
pub(super) fn turn(draft: &mut Draft, mended: &mut Mended) -> Shells {
    let shells = Shells::of(&draft.vertices, &draft.triangles, &draft.pairing.twins);
    if !shells.list.iter().any(is_negative) {
        return shells;
    }
    let turned = inside_out(draft, &shells);
    let count = turned.iter().filter(|&&t| t).count() as u64;
    if count == 0 {
        return shells;
    }
    mended.turned_shells += count;
    for (corners, &shell) in draft.triangles.iter_mut().zip(&shells.of) {
        if turned[shell as usize] {
            corners.swap(1, 2);
        }
    }
    draft.pair();
    super::around::pair(draft);
    Shells::of(&draft.vertices, &draft.triangles, &draft.pairing.twins)
}

/// Whether a shell faces inward, as far as that can be told.
fn is_negative(shell: &Shell) -> bool {
    if shell.open_edges == 0 {
        return shell.volume_mm3 < 0.0;
    }
    let opening_mm2 = shell.rim_mm * shell.rim_mm / (4.0 * std::f64::consts::PI);
    opening_mm2 <= OPENING * shell.area_mm2 && shell.volume_mm3 < -SHEET * shell.area_mm2.powf(1.5)
}

/// For each shell whether it is to be turned.
fn inside_out(draft: &Draft, shells: &Shells) -> Vec<bool> {
    let mut turned = vec![false; shells.list.len()];
    if let [_] = shells.list[..] {
        turned[0] = true;
        return turned;
    }
    // A shell is larger than those within it.
    let volume = |s: u32| shells.list[s as usize].volume_mm3.abs();
    let mut order: Vec<u32> = (0..shells.list.len() as u32).collect();
    order.sort_by(|&a, &b| volume(b).total_cmp(&volume(a)).then(a.cmp(&b)));
    let mut columns = Columns::new(draft);
    for s in order {
        let shell = &shells.list[s as usize];
        let corners = draft.corners(shell.largest as usize);
        let middle = [0, 1, 2].map(|k| (corners[0][k] + corners[1][k] + corners[2][k]) / 3.0);
        let Some(crossed) = columns.above(draft, middle) else { break };
        let (mut winding, mut parent) = (0, None);
        let mut by_shell: Vec<(u32, i32)> =
            crossed.iter().map(|&(t, sign)| (shells.of[t as usize], sign)).collect();
        by_shell.sort_unstable();
        for group in by_shell.chunk_by(|a, b| a.0 == b.0) {
            let around = group[0].0;
            let turns: i32 = group.iter().map(|g| g.1).sum();
            if around == s
                || turns == 0
                || shells.list[around as usize].open_edges > 0
                || volume(around) <= volume(s)
            {
                continue;
            }
            winding += if turned[around as usize] { -turns } else { turns };
            if parent.is_none_or(|p| volume(around) < volume(p)) {
                parent = Some(around);
            }
        }
        turned[s as usize] = match parent {
            Some(p) if turned[p as usize] => true,
            _ => is_negative(shell) && winding <= 0,
        };
    }
    turned
}
