//! What supports are wanted: flags to rules.
use super::positive;
use crate::support::rules::{self, Process, Rules};
use clap::{Args as ClapArgs, ValueEnum};

/// What supports are wanted.
#[derive(ClapArgs, Debug)]
pub(super) struct Wishes {
    /// How branches run
    #[arg(long, value_enum, default_value_t = Method::Tree)]
    pub(super) method: Method,
    /// What matters most: the least material, trunks that do not sway, or the fewest marks
    #[arg(long, value_enum, default_value_t = Prefer::Less)]
    prefer: Prefer,
    /// Diameter of a tip where it touches [default: 0.8 with filament, 0.4 in resin]
    #[arg(long, value_name = "MM", value_parser = positive)]
    tip_mm: Option<f64>,
    /// Farthest that an overhang may be from the nearest tip [default: 3 with filament, 2.5
    /// in resin]
    #[arg(long, value_name = "MM", value_parser = positive)]
    spacing_mm: Option<f64>,
    /// Diameter of a trunk where it stands on the plate [default: 2 with filament, 1 in resin]
    #[arg(long, value_name = "MM", value_parser = positive)]
    trunk_mm: Option<f64>,
    /// Where trunks may stand
    #[arg(long, value_enum, default_value_t = Trunks::Anywhere)]
    trunks: Trunks,
}

/// How branches run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum Method {
    /// Each tip on a column of its own
    Straight,
    /// Branches that meet on their way down
    Tree,
}

/// What matters most.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum Prefer {
    /// The least material
    Less,
    /// Thicker trunks, closer tips
    Stable,
    /// Thinner tips, farther from the part, no feet on it where that can be helped
    Clean,
}

/// Where trunks may stand.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum Trunks {
    /// On the plate only
    Plate,
    /// On the part where there is no way to the plate
    Anywhere,
}

impl Wishes {
    /// The rules that they make.
    pub(super) fn rules(&self, process: Process, layer_mm: f64) -> Rules {
        let prefer = match self.prefer {
            Prefer::Less => rules::Prefer::Less,
            Prefer::Stable => rules::Prefer::Stable,
            Prefer::Clean => rules::Prefer::Clean,
        };
        let mut rules = Rules::usual(process, layer_mm).preferring(prefer);
        if let Some(mm) = self.tip_mm {
            rules.tip_mm = mm;
            rules.branch_mm = rules.branch_mm.max(mm);
        }
        if let Some(mm) = self.trunk_mm {
            rules.trunk_mm = mm;
            rules.branch_mm = rules.branch_mm.min(mm).max(rules.tip_mm);
        }
        rules.trunk_mm = rules.trunk_mm.max(rules.branch_mm);
        rules.foot_mm = rules.foot_mm.max(rules.trunk_mm);
        rules.spacing_mm = self.spacing_mm.unwrap_or(rules.spacing_mm);
        rules.on_model = self.trunks == Trunks::Anywhere;
        rules
    }
}
