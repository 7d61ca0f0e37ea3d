//! What supports must be like: plain numbers, and how thick a branch is by what it carries.

/// How what is printed is made solid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Process {
    /// Melted filament: tips stay a gap below the part.
    Filament,
    /// Resin: tips reach into the part.
    Resin,
}

/// What matters most where not all can be had.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Prefer {
    /// The least material.
    #[default]
    Less,
    /// Trunks that do not sway.
    Stable,
    /// The fewest marks on the part.
    Clean,
}

/// What supports must be like.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rules {
    /// How the part is made.
    pub process: Process,
    /// Diameter of a tip where it touches, mm.
    pub tip_mm: f64,
    /// Farthest that an overhanging place may be from the nearest tip, mm.
    pub spacing_mm: f64,
    /// Length of the cone between tip and branch, mm.
    pub head_mm: f64,
    /// Diameter of the thinnest branch, mm.
    pub branch_mm: f64,
    /// Diameter of the thinnest trunk where it stands on the plate, mm.
    pub trunk_mm: f64,
    /// Diameter of a foot on the plate, mm.
    pub foot_mm: f64,
    /// Height in which a trunk widens to its foot, mm.
    pub foot_height_mm: f64,
    /// Steepest lean of a branch, degrees from the vertical.
    pub lean_deg: f64,
    /// Distance that branches keep from the part, mm.
    pub clearance_mm: f64,
    /// Space between a tip and the part, mm; negative where it reaches into the part.
    pub gap_mm: f64,
    /// What overhangs lower than this above the plate is caught by it, mm; islands are not.
    pub caught_mm: f64,
    /// Most length of a branch, counted from its farthest tip, a diameter.
    pub slenderness: f64,
    /// Tips that a trunk of the thinnest diameter carries.
    pub trunk_tips: f64,
    /// Feet may stand on the part where there is no way to the plate.
    pub on_model: bool,
    /// What a foot on the part costs, as mm³ of material.
    pub landing_mm3: f64,
}

impl Rules {
    /// What people use: for filament with a nozzle of 0.4 mm and this layer height, mm; for
    /// resin whatever the layers are.
    #[must_use]
    pub fn usual(process: Process, layer_mm: f64) -> Rules {
        match process {
            Process::Filament => Rules {
                process,
                tip_mm: 0.8,
                spacing_mm: 3.0,
                head_mm: 2.0,
                branch_mm: 1.2,
                trunk_mm: 2.0,
                foot_mm: 4.0,
                foot_height_mm: 0.8,
                lean_deg: 45.0,
                clearance_mm: 0.8,
                gap_mm: layer_mm,
                caught_mm: 2.5 * layer_mm,
                slenderness: 60.0,
                trunk_tips: 16.0,
                on_model: true,
                landing_mm3: 60.0,
            },
            Process::Resin => Rules {
                process,
                tip_mm: 0.4,
                spacing_mm: 2.5,
                head_mm: 1.5,
                branch_mm: 0.7,
                trunk_mm: 1.0,
                foot_mm: 3.0,
                foot_height_mm: 0.6,
                lean_deg: 45.0,
                clearance_mm: 0.5,
                gap_mm: -0.15,
                caught_mm: 0.0,
                slenderness: 60.0,
                trunk_tips: 16.0,
                on_model: true,
                landing_mm3: 20.0,
            },
        }
    }

    /// The same with what matters most.
    #[must_use]
    pub fn preferring(mut self, prefer: Prefer) -> Rules {
        match prefer {
            Prefer::Less => {}
            Prefer::Stable => {
                self.slenderness /= 2.0;
                self.trunk_tips /= 2.0;
                self.branch_mm *= 1.25;
                self.trunk_mm *= 1.25;
                self.spacing_mm *= 0.8;
            }
            Prefer::Clean => {
                self.tip_mm *= 0.75;
                self.landing_mm3 *= 10.0;
                self.clearance_mm *= 1.5;
            }
        }
        self
    }

    /// In cells of which side what must be held is gathered, mm: what lies in the cell of a
    /// held place is a quarter of the spacing away from it at most.
    #[must_use]
    pub fn cell_mm(&self) -> f64 {
        self.spacing_mm / 4.0
    }

    /// Sideways by how much a mm down, at most.
    #[must_use]
    pub fn slope(&self) -> f64 {
        self.lean_deg.clamp(0.0, 80.0).to_radians().tan()
    }

    /// Radius of a branch that carries so many tips, the farthest of them so far up, mm.
    ///
    /// A column under load bends by the fourth power of its radius, so a load asks for its
    /// fourth root.
    #[must_use]
    pub fn radius_mm(&self, tips: u32, length_mm: f64) -> f64 {
        let carried = self.trunk_mm / 2.0 * (f64::from(tips.max(1)) / self.trunk_tips).powf(0.25);
        let slender = length_mm / self.slenderness / 2.0;
        carried.max(slender).max(self.branch_mm / 2.0)
    }

    /// Radius of a trunk where it stands on the plate.
    #[must_use]
    pub fn trunk_radius_mm(&self, tips: u32, length_mm: f64) -> f64 {
        self.radius_mm(tips, length_mm).max(self.trunk_mm / 2.0)
    }

    /// What branches keep free around their middle, as thin as they may be, mm.
    #[must_use]
    pub fn free_mm(&self) -> f64 {
        self.branch_mm / 2.0 + self.clearance_mm
    }
}
