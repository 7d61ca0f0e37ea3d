//! Whole plans for made parts: what holds of every plan, and what the proof finds when it
//! does not.
use super::super::cut::Cuts;
use super::super::look::Look;
use super::super::proof::{Promise, Proof, prove};
use super::super::rules::Process;
use super::super::section::Sections;
use super::super::site::{Floor, Reason};
use super::super::testing::{Given, OWN, layers, region, seen};
use super::super::tree::{GROUND, Kind, leans_within};
use super::*;
use crate::detect::overhang::SelfSupport;
use crate::layers::polygon::{intersection, union};
use crate::layers::shape::{Place, Point, Region};
use crate::layers::stack::Layer;
use crate::mesh::vector::distance;
use proptest::prelude::*;

const LAYER_MM: f64 = 0.1;

const ALL: [(Placing, Branching); 4] = [
    (Placing::Cover, Branching::Straight),
    (Placing::Fixed, Branching::Vanek),
    (Placing::Fixed, Branching::Tree),
    (Placing::Cover, Branching::Tree),
];

/// A part by its rectangles at a height, 10 mm high.
fn part(at: impl Fn(f64) -> Region) -> Vec<Layer> {
    layers(100, LAYER_MM, at)
}

/// A post that carries a table, 30 mm high.
fn table() -> Vec<Layer> {
    layers(320, LAYER_MM, |z| {
        if z < 30.0 { region(&[[9.0, 9.0, 11.0, 11.0]]) } else { region(&[[0.0, 0.0, 20.0, 20.0]]) }
    })
}

/// Layers with supports cut into them.
fn with_supports(mut part: Vec<Layer>, forest: &Forest, rules: &Rules) -> Vec<Layer> {
    let cuts = Cuts::new(forest, 0.3);
    let raise = rules.gap_mm.max(0.0);
    for layer in &mut part {
        for by in [0.0, raise] {
            let own = cuts.section(layer.bottom_mm - by, layer.top_mm - by);
            layer.aid = union(&layer.aid, &union(&own.body, &own.interface));
        }
    }
    part
}

fn proof(part: &[Layer], look: &Look, made: &Plan, rules: &Rules) -> Proof {
    proof_of(with_supports(part.to_vec(), &made.forest, rules), look, made, rules)
}

fn proof_of(result: Vec<Layer>, look: &Look, plan: &Plan, rules: &Rules) -> Proof {
    let (demand, floating) = (&look.demand, &look.findings.islands.floating_aid);
    let promise = Promise { plan, demand, floating, rules, own: OWN, layer_mm: LAYER_MM };
    let Ok(proof) = prove(&mut Given(result), &promise, rules.gap_mm.max(0.0));
    proof
}

/// What every plan is.
fn is_sound(part: &[Layer], look: &Look, made: &Plan, rules: &Rules) {
    let forest = &made.forest;
    assert_eq!(forest.downward().len(), forest.nodes.len(), "no branch stands on itself");
    let mut lengths = Vec::new();
    for node in &forest.nodes {
        assert!(node.radius_mm >= rules.tip_mm / 4.0 - 1e-9, "{node:?}");
        assert!(node.at_mm[2] >= -1e-9, "{node:?}");
        match node.kind {
            Kind::Plate => assert!(node.down == GROUND && node.at_mm[2].abs() < 1e-9, "{node:?}"),
            Kind::Model => {
                assert_eq!(node.down, GROUND);
                assert!(rules.on_model, "{node:?}");
                // Right on the part.
                let layer = part.iter().find(|l| node.at_mm[2] <= l.top_mm + 1e-6).expect("a layer");
                let at = Point::from_mm(node.at_mm[0], node.at_mm[1]);
                assert!(layer.part.place(at) != Place::Outside || near(part, node.at_mm), "{node:?}");
            }
            Kind::Tip | Kind::Joint => {
                let down = &forest.nodes[node.down as usize];
                assert!(leans_within(node.at_mm, down.at_mm, rules.slope() + 0.05), "{node:?} {down:?}");
                lengths.push(node.at_mm[2] - down.at_mm[2]);
            }
        }
    }
    // Nothing but heads and feet comes near the part.
    let cuts = Cuts::new(forest, 0.0);
    for layer in part.iter().step_by(5) {
        let own = cuts.section(layer.bottom_mm, layer.top_mm);
        let shared = intersection(&own.body, &layer.part).area_mm2();
        let heads = forest.nodes.iter().filter(|n| {
            let tip =
                n.kind == Kind::Tip && n.at_mm[2] > layer.bottom_mm - 0.5 && n.at_mm[2] < layer.top_mm + 1.0;
            let foot = n.kind == Kind::Model && (n.at_mm[2] - layer.bottom_mm).abs() < 0.6;
            tip || foot
        });
        let allowed = heads.count() as f64 * std::f64::consts::PI * rules.tip_mm * rules.tip_mm;
        let close: Vec<_> = forest
            .branches()
            .filter(|b| b.ends_mm[1][2] < layer.top_mm + 1.0 && b.ends_mm[0][2] > layer.bottom_mm - 1.0)
            .collect();
        assert!(shared <= allowed + 1e-3, "{shared} mm² in the part at {}: {close:?}", layer.top_mm);
    }
    // Every need is held by a tip of its region, or told.
    let tips: Vec<_> = made.points.tips.iter().map(|t| &look.demand.needs[t.need as usize]).collect();
    for need in &look.demand.needs {
        let held = tips
            .iter()
            .any(|t| t.region == need.region && distance(t.at_mm, need.at_mm) <= rules.spacing_mm + 1e-9);
        let told = made.points.unheld_mm.contains(&need.at_mm);
        // A lattice's cells are two-dimensional: its tips may be farther in height.
        assert!(held || told || need.area_mm2 < 1e-9, "{need:?}");
    }
    assert!(made.points.tips.len() >= made.points.at_least as usize);
}

fn near(part: &[Layer], at: [f64; 3]) -> bool {
    let p = Point::from_mm(at[0], at[1]);
    part.iter().any(|l| (l.top_mm - at[2]).abs() < 0.5 && l.part.place(p) != Place::Outside)
}

fn check(part: &[Layer], process: Process) -> Vec<Plan> {
    let rules = Rules::usual(process, LAYER_MM);
    let look = seen(part.to_vec(), &rules);
    let plans = ALL.map(|(placing, branching)| {
        let made = plan(&look.demand, &look.space, &rules, placing, branching);
        assert_eq!(made, plan(&look.demand, &look.space, &rules, placing, branching), "deterministic");
        if placing == Placing::Cover {
            is_sound(part, &look, &made, &rules);
            let proof = proof(part, &look, &made, &rules);
            assert!(proof.holds(), "{process:?} {branching:?}: {:?}", proof.words());
        }
        made
    });
    plans.into()
}

#[test]
fn a_table_is_held_and_trees_take_least() {
    for process in [Process::Filament, Process::Resin] {
        let plans = check(&table(), process);
        let volume: Vec<f64> = plans.iter().map(|p| p.forest.volume_mm3()).collect();
        assert!(volume[3] < volume[1], "ours and the baseline: {volume:?}");
        assert!(volume[3] < 0.4 * volume[0], "ours and columns: {volume:?}");
        let tips: Vec<usize> = plans.iter().map(|p| p.points.tips.len()).collect();
        assert!(tips[3] <= tips[1], "{tips:?}");
        assert!(plans[3].points.unheld.is_empty());
        assert!(plans[3].forest.tally().landings_on_model == 0);
    }
}

#[test]
fn an_island_is_held_where_it_begins() {
    let part = part(|z| match z {
        z if z < 3.0 => region(&[[0.0, 0.0, 4.0, 4.0]]),
        z if z < 7.0 => region(&[[0.0, 0.0, 4.0, 4.0], [8.0, 1.0, 8.8, 1.8]]),
        _ => region(&[[0.0, 0.0, 9.0, 4.0]]),
    });
    for process in [Process::Filament, Process::Resin] {
        let made = &check(&part, process)[3];
        let rules = Rules::usual(process, LAYER_MM);
        let tip =
            made.forest.nodes.iter().find(|n| n.kind == Kind::Tip && n.at_mm[2] < 4.0).expect("its tip");
        assert!((tip.at_mm[2] - (3.0 - rules.gap_mm)).abs() < 1e-6, "{tip:?}");
        assert!((tip.at_mm[0] - 8.4).abs() < 1e-6 && (tip.at_mm[1] - 1.4).abs() < 1e-6, "{tip:?}");
    }
}

#[test]
fn what_is_walled_in_stands_on_the_part_or_is_told() {
    // A closed box with a tongue inside that begins in the air.
    let inside = |z: f64| {
        let walls =
            [[0.0, 0.0, 20.0, 1.0], [0.0, 19.0, 20.0, 20.0], [0.0, 0.0, 1.0, 20.0], [19.0, 0.0, 20.0, 20.0]];
        let mut all = walls.to_vec();
        match z {
            z if z < 1.0 => all = vec![[0.0, 0.0, 20.0, 20.0]],
            z if z > 6.0 => all.push([8.0, 8.0, 12.0, 20.0]),
            _ => {}
        }
        region(&all)
    };
    let part = part(inside);
    let mut rules = Rules::usual(Process::Resin, LAYER_MM);
    let look = seen(part.clone(), &rules);
    let made = plan(&look.demand, &look.space, &rules, Placing::Cover, Branching::Tree);
    assert!(made.points.unheld.is_empty(), "{:?}", made.points.unheld);
    assert!(made.forest.tally().landings_on_model > 0 && made.forest.tally().trunks_on_plate == 0);
    assert!(made.points.tips.iter().all(|t| t.head.floor == Floor::Model));
    is_sound(&part, &look, &made, &rules);
    assert!(proof(&part, &look, &made, &rules).holds());
    rules.on_model = false;
    let made = plan(&look.demand, &look.space, &rules, Placing::Cover, Branching::Tree);
    assert!(made.forest.nodes.is_empty());
    assert!(!made.points.unheld.is_empty());
    for unheld in &made.points.unheld {
        assert_eq!(unheld.reason, Reason::Enclosed);
        assert!((unheld.place_mm[2] - 6.0).abs() < 0.11, "{unheld:?}");
    }
    // What was told is no fault of the result.
    assert!(proof(&part, &look, &made, &rules).holds());
}

#[test]
fn a_slot_too_narrow_for_a_tip_is_told() {
    let part = part(|z| match z {
        z if z < 5.0 => region(&[[0.0, 0.0, 5.0, 10.0], [5.3, 0.0, 10.0, 10.0]]),
        _ => region(&[[0.0, 0.0, 10.0, 14.0]]),
    });
    let rules = Rules::usual(Process::Filament, LAYER_MM);
    let look = seen(part, &rules);
    let made = plan(&look.demand, &look.space, &rules, Placing::Cover, Branching::Tree);
    // The slot bridges itself; the ledge behind has its supports.
    assert!(made.points.tips.iter().all(|t| t.head.contact_mm[1] > 10.0), "{:?}", made.points.tips);
}

#[test]
fn the_proof_finds_what_is_amiss() {
    let part = table();
    let rules = Rules::usual(Process::Filament, LAYER_MM);
    let look = seen(part.clone(), &rules);
    let made = plan(&look.demand, &look.space, &rules, Placing::Cover, Branching::Tree);
    let with = |change: &dyn Fn(&mut Plan)| {
        let mut other = made.clone();
        change(&mut other);
        proof_of(with_supports(part.clone(), &other.forest, &rules), &look, &made, &rules)
    };
    assert!(with(&|_| {}).holds());
    // A tip that ends too low, or stands elsewhere.
    let tip = made.forest.nodes.iter().position(|n| n.kind == Kind::Tip).expect("a tip");
    let low = with(&|p| p.forest.nodes[tip].at_mm[2] -= 0.5);
    assert_eq!(low.missing_tips_mm.len(), 1, "{low:?}");
    // A trunk that begins in the air.
    let high = |n: &super::super::tree::Node| n.kind == Kind::Joint && n.at_mm[2] > 10.0;
    let above = made.forest.nodes.iter().position(high).expect("a joint");
    let cut = with(&|p| p.forest.nodes[above].down = GROUND);
    assert!(!cut.floating_mm.is_empty(), "{cut:?}");
    // What the slicer itself began in the air is not ours; at another place it is.
    let with_aid = |x: f64| {
        let mut layers = part.clone();
        let block = region(&[[x, -6.0, x + 2.0, -4.0]]);
        layers.iter_mut().filter(|l| l.bottom_mm > 20.0).for_each(|l| l.aid = block.clone());
        layers
    };
    let theirs = seen(with_aid(5.0), &rules);
    let result = |x: f64| with_supports(with_aid(x), &made.forest, &rules);
    assert!(proof_of(result(5.0), &theirs, &made, &rules).holds());
    assert_eq!(proof_of(result(9.0), &theirs, &made, &rules).floating_mm.len(), 1);
    // Nothing at all.
    let none = with(&|p| p.forest.nodes.clear());
    assert!(!none.missing_tips_mm.is_empty() && !none.holds());
    // A plan that forgot a corner is found out by the overhang that it leaves.
    let mut forgot = made.clone();
    let corner = |at: [f64; 3]| at[0] < 7.0 && at[1] < 7.0;
    let gone: Vec<usize> = (0..forgot.forest.nodes.len())
        .filter(|k| forgot.forest.nodes[*k].kind == Kind::Tip && corner(forgot.forest.nodes[*k].at_mm))
        .collect();
    for k in &gone {
        (forgot.forest.nodes[*k].kind, forgot.forest.nodes[*k].down) = (Kind::Joint, GROUND);
    }
    let found = proof(&part, &look, &forgot, &rules);
    assert!(!gone.is_empty() && !found.far_mm.is_empty() && found.far_mm2 > 1.0, "{found:?}");
    // Where nothing hung before, support takes no hold away; and specks are no overhang.
    let mut before = seen(part.clone(), &rules);
    before.demand.needs.retain(|need| !(need.at_mm[0] < 9.0 && need.at_mm[1] < 9.0));
    let result = with_supports(part.clone(), &forgot.forest, &rules);
    assert_eq!(proof_of(result.clone(), &before, &forgot, &rules).far_mm, Vec::<[f64; 3]>::new());
    let (demand, floating) = (&look.demand, &look.findings.islands.floating_aid);
    let own = SelfSupport { min_area_mm2: found.far_mm2 * 1.1, ..OWN };
    let promise = Promise { plan: &forgot, demand, floating, rules: &rules, own, layer_mm: LAYER_MM };
    let Ok(small) = prove(&mut Given(result), &promise, rules.gap_mm.max(0.0));
    assert_eq!((small.far_mm.len(), small.far_mm2), (0, 0.0));
}

/// A column a little above a slab: under it there is no room for a tip, and what holds the slab
/// does not hold the column.
#[test]
fn an_island_close_above_the_part_is_told() {
    let blocks = [[5.0, 13.0, 7.0, 15.0], [0.0, 11.0, 7.0, 15.0]];
    let part = part(|z| match z {
        z if z > 2.3 && z < 2.7 => region(&[blocks[1]]),
        z if z > 3.3 && z < 3.7 => region(&[blocks[0]]),
        _ => Region::default(),
    });
    let rules = Rules::usual(Process::Filament, LAYER_MM);
    let look = seen(part.clone(), &rules);
    let made = plan(&look.demand, &look.space, &rules, Placing::Cover, Branching::Tree);
    let told: Vec<_> = made.points.unheld.iter().map(|u| (u.island, u.reason)).collect();
    assert_eq!(told, [(true, Reason::NoRoom)]);
    assert!(proof(&part, &look, &made, &rules).holds());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    /// Whatever the part is, a plan is sound, and the result proves it.
    #[test]
    fn any_part_is_held_or_told(
        blocks in prop::collection::vec((0..16_i32, 0..16_i32, 2..9_i32, 2..9_i32, 0..80_i32, 4..60_i32), 1..7),
        resin: bool,
    ) {
        let part = part(|z| {
            let at: Vec<[f64; 4]> = blocks
                .iter()
                .filter(|b| z > f64::from(b.4) / 10.0 && z < f64::from(b.4 + b.5) / 10.0)
                .map(|b| [b.0, b.1, b.0 + b.2, b.1 + b.3].map(f64::from))
                .collect();
            region(&at)
        });
        if part.iter().all(|l| l.part.is_empty()) {
            return Ok(());
        }
        let process = if resin { Process::Resin } else { Process::Filament };
        let rules = Rules::usual(process, LAYER_MM);
        let look = seen(part.clone(), &rules);
        let made = plan(&look.demand, &look.space, &rules, Placing::Cover, Branching::Tree);
        is_sound(&part, &look, &made, &rules);
        let proof = proof(&part, &look, &made, &rules);
        prop_assert!(proof.holds(), "{:?}", proof);
    }
}
