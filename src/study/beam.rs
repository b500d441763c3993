//! Table I of Wang et al. 2023: remote centres of motion (RCM) and centres of motion (COM) of a 1 mm steel needle in a
//! phantom and in porcine muscle, beside the values computed here. [`case`] studies a user's own needle, [`measure`]
//! finds needles in CT, and [`compare`] holds them against computed ones.

pub mod case;
pub mod compare;
pub mod measure;

use super::tradeoff::{Axis, Choice, Column, Factor, Figure, Study, Table};
use insonify_base::machine::Machine;
use insonify_mechanics::needle::beam::material::Ogden;
use insonify_mechanics::needle::beam::{
    Base, BeamError, BeamLayer, Compression, FoundationBeam, Material, Problem, Shape, bending_stiffness_nmm2,
};

/// Length of the tissue before compression, mm. An assumption: Wang et al. 2023 do not state it.
pub(crate) const INITIAL_LENGTH_MM: f64 = 50.0;
/// Displacements of the base, mm. Wang et al.'s stage also moves as far to the other side, which gives the same
/// centres.
pub(crate) const DISPLACEMENTS_MM: [f64; 6] = [2.5, 5.0, 7.5, 10.0, 12.5, 15.0];
/// Inserted depths, mm.
pub(crate) const DEPTHS_MM: [f64; 3] = [20.0, 40.0, 60.0];
/// Distances from the base to the entry, mm.
pub(crate) const CONTROLS_MM: [f64; 2] = [20.0, 40.0];
/// Element length used by Wang et al., mm.
pub const ELEMENT_MM: f64 = 1.0;

/// Tissue of Wang et al. 2023.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tissue {
    /// Name used in the paper.
    pub name: &'static str,
    /// Hyperelastic material.
    pub material: Material,
    /// Compression model that fits the tissue best in the paper.
    pub compression: Compression,
}

/// PVC phantom and porcine muscle.
pub(crate) const TISSUES: [Tissue; 2] = [
    Tissue {
        name: "PVC",
        material: Material::Ogden(Ogden {
            mu_kpa: 12.72,
            alpha: -1.0,
        }),
        compression: Compression::UEng,
    },
    Tissue {
        name: "PSM",
        material: Material::Ogden(Ogden {
            mu_kpa: 3.63,
            alpha: 8.74,
        }),
        compression: Compression::UTru,
    },
];

/// Published RCM measured, COM measured and COM simulated, mm below the entry, indexed by tissue, control distance and
/// inserted depth.
const PUBLISHED: [[[[f64; 3]; 3]; 2]; 2] = [
    [
        [[9.7, 10.3, 11.3], [10.9, 24.3, 21.3], [9.0, 31.1, 25.9]],
        [[8.4, 10.9, 11.4], [6.8, 23.9, 21.0], [2.6, 37.5, 25.5]],
    ],
    [
        [[12.6, 13.4, 12.7], [21.0, 25.7, 23.8], [26.2, 39.5, 35.0]],
        [[11.9, 10.6, 11.8], [20.6, 25.7, 23.1], [22.6, 38.5, 33.8]],
    ],
];

/// A needle of the published table; centres of motion in mm below the entry.
#[derive(Clone, Copy)]
struct PublishedNeedle {
    tissue: Tissue,
    control_distance_mm: f64,
    inserted_mm: f64,
    rcm_mm: f64,
    com_measured_mm: f64,
    com_simulated_mm: f64,
}

impl PublishedNeedle {
    /// Needles in the order of the table.
    fn all() -> impl Iterator<Item = Self> {
        let of_depths = |tissue, control_distance_mm, by_depth: [[f64; 3]; 3]| {
            let depths = DEPTHS_MM.into_iter().zip(by_depth);
            depths.map(move |(inserted_mm, [rcm_mm, com_measured_mm, com_simulated_mm])| Self {
                tissue,
                control_distance_mm,
                inserted_mm,
                rcm_mm,
                com_measured_mm,
                com_simulated_mm,
            })
        };
        TISSUES
            .into_iter()
            .zip(PUBLISHED)
            .flat_map(move |(tissue, by_control)| {
                let controls = CONTROLS_MM.into_iter().zip(by_control);
                controls.flat_map(move |(control, by_depth)| of_depths(tissue, control, by_depth))
            })
    }

    fn problem(&self) -> Problem {
        problem(
            self.tissue.material,
            self.tissue.compression,
            self.control_distance_mm,
            self.inserted_mm,
            ELEMENT_MM,
        )
    }
}

/// Returns the beam problem of Wang et al.'s needle in one layer of tissue.
pub fn problem(
    material: Material,
    compression: Compression,
    control_distance_mm: f64,
    inserted_mm: f64,
    element_mm: f64,
) -> Problem {
    Problem {
        bending_nmm2: bending_stiffness_nmm2(200.0, 1.0),
        control_distance_mm,
        pivot_mm: 0.0,
        inserted_mm,
        layers: vec![BeamLayer {
            thickness_mm: inserted_mm,
            material,
            compression,
            initial_length_mm: INITIAL_LENGTH_MM,
            friction: 0.0,
            least_ratio: 0.0,
        }],
        element_mm,
    }
}

/// Reproduces the table: the COM of a base driven with the published mean RCM, and the RCM of a base that is free to
/// rotate; also on axes behind the base (`arms_mm`).
///
/// # Errors
/// [`BeamError`] if a needle shape cannot be solved.
pub fn table_one(arms_mm: &[f64]) -> Result<Study, BeamError> {
    let (table, largest_change_mm) = centres_table()?;
    Ok(Study {
        name: "beam-table-one",
        title: "Table 1 of Wang et al. 2023",
        about: vec![
            ("needle", "steel, 200 GPa, 1 mm".to_owned()),
            ("PVC", "Ogden, mu 12.72 kPa, alpha -1, UEng".to_owned()),
            ("PSM", "porcine muscle: Ogden, mu 3.63 kPa, alpha 8.74, UTru".to_owned()),
            (
                "driven",
                "with the published mean RCM; means over displacements of 2.5 to 15 mm".to_owned(),
            ),
            (
                "initial length of the tissue",
                format!("{INITIAL_LENGTH_MM} mm, assumed"),
            ),
        ],
        machine: Machine::here(),
        tables: std::iter::once(Ok(table))
            .chain((!arms_mm.is_empty()).then(|| axis_table(arms_mm)))
            .collect::<Result<_, _>>()?,
        figures: vec![table_one_figure()],
        notes: vec![
            format!("with tissue of 30 mm, or linear tissue, no COM here moves by more than {largest_change_mm:.1} mm"),
            "the table cannot tell models apart: any foundation of 3 mu to 4 mu comes as near".to_owned(),
            "a free base turns about the measured RCM in muscle within 2.7 mm, in the phantom not: there it is deeper"
                .to_owned(),
        ],
    })
}

/// A needle of the table with the centres of motion computed here, mm below the entry.
struct CentresRow {
    needle: PublishedNeedle,
    com_mm: f64,
    rcm_free_mm: f64,
}

const CENTRES_CHOICES: [Choice<CentresRow>; 3] = [
    Factor::new("tissue", "tissue").of(|row| row.needle.tissue.name.to_owned()),
    Factor::new("control_distance_mm", "base before entry").of(|row| format!("{} mm", row.needle.control_distance_mm)),
    Factor::new("inserted_mm", "depth").of(|row| format!("{} mm", row.needle.inserted_mm)),
];

const CENTRES: [Column<CentresRow>; 7] = [
    Axis::linear("inserted", "l", "inserted depth, mm").of(|row| Some(row.needle.inserted_mm)),
    Axis::linear("rcm_published_mm", "RCM published", "RCM as measured, mm").of(|row| Some(row.needle.rcm_mm)),
    Axis::linear("rcm_natural_mm", "RCM free", "RCM of a free base, mm").of(|row| Some(row.rcm_free_mm)),
    Axis::linear("com_measured_mm", "COM measured", "COM as measured, mm").of(|row| Some(row.needle.com_measured_mm)),
    Axis::linear(
        "com_published_mm",
        "COM published",
        "COM as simulated by Wang et al. 2023, mm",
    )
    .of(|row| Some(row.needle.com_simulated_mm)),
    Axis::linear("com_mm", "COM here", "COM, mm").of(|row| Some(row.com_mm)),
    Axis::linear(
        "difference_mm",
        "difference",
        "COM here less COM of Wang et al. 2023, mm",
    )
    .of(|row| Some(row.com_mm - row.needle.com_simulated_mm)),
];

/// The table, and the largest change of a COM (mm) with other initial lengths of the tissue.
fn centres_table() -> Result<(Table, f64), BeamError> {
    let mut rows = Vec::new();
    let mut largest_change_mm: f64 = 0.0;
    for needle in PublishedNeedle::all() {
        let centres_at = |initial_length_mm: f64| {
            let mut problem = needle.problem();
            problem.layers[0].initial_length_mm = initial_length_mm;
            centres(&problem, needle.rcm_mm)
        };
        let [com_mm, rcm_free_mm] = centres_at(INITIAL_LENGTH_MM)?;
        // The initial length is an assumption: how far results hang on it becomes a note.
        for other in [30.0, f64::INFINITY] {
            largest_change_mm = largest_change_mm.max((centres_at(other)?[0] - com_mm).abs());
        }
        rows.push(CentresRow {
            needle,
            com_mm,
            rcm_free_mm,
        });
    }
    let title = "Table I: centres of motion, mm below the entry";
    let table = Table::of("table-one", title, &CENTRES_CHOICES, &CENTRES, &rows);
    Ok((table, largest_change_mm))
}

/// A needle of the table whose free base turns about an axis behind it.
struct AxisRow {
    needle: PublishedNeedle,
    /// Distance of the axis behind the base, mm.
    arm_mm: f64,
    /// RCM, mm below the entry.
    rcm_mm: f64,
    /// Displacement of the base over that of the axis.
    base_share: f64,
}

const AXIS_CHOICES: [Choice<AxisRow>; 4] = [
    Factor::new("tissue", "tissue").of(|row| row.needle.tissue.name.to_owned()),
    Factor::new("control_distance_mm", "base before entry").of(|row| format!("{} mm", row.needle.control_distance_mm)),
    Factor::new("inserted_mm", "depth").of(|row| format!("{} mm", row.needle.inserted_mm)),
    Factor::new("pivot_mm", "axis behind base").of(|row| format!("{} mm", row.arm_mm)),
];

const AXIS: [Column<AxisRow>; 3] = [
    Axis::linear("rcm_published_mm", "RCM published", "RCM as measured, mm").of(|row| Some(row.needle.rcm_mm)),
    Axis::linear("rcm_mm", "RCM here", "RCM, mm").of(|row| Some(row.rcm_mm)),
    Axis::linear(
        "base_share",
        "base/axis",
        "displacement of the base over that of the axis",
    )
    .of(|row| Some(row.base_share)),
];

/// RCM of a base that turns freely about an axis behind it, as Wang et al.'s rotary stage does (section II-C; they
/// state no distance).
fn axis_table(arms_mm: &[f64]) -> Result<Table, BeamError> {
    let mut rows = Vec::new();
    for needle in PublishedNeedle::all() {
        for &arm_mm in arms_mm {
            let mut problem = needle.problem();
            problem.pivot_mm = arm_mm;
            let mut beam = FoundationBeam::new(&problem)?;
            // The published RCM is a mean over these displacements: in nonlinear tissue each of them gives another.
            let (mut rcm_mm, mut base_share) = (0.0, 0.0);
            for displacement_mm in DISPLACEMENTS_MM {
                let slope = None;
                let shape = beam.solve(&Base { displacement_mm, slope })?;
                rcm_mm += shape.rcm_mm().unwrap_or(f64::NAN) / DISPLACEMENTS_MM.len() as f64;
                base_share += shape.points[0].u_mm / displacement_mm / DISPLACEMENTS_MM.len() as f64;
            }
            rows.push(AxisRow {
                needle,
                arm_mm,
                rcm_mm,
                base_share,
            });
        }
    }
    let title = "RCM of a free base whose axis lies behind it, mm below the entry";
    Ok(Table::of("axis", title, &AXIS_CHOICES, &AXIS, &rows))
}

fn table_one_figure() -> Figure {
    Figure {
        marker: vec!["inserted_mm"],
        joined: false,
        ..Figure::new(
            "beam-table-one",
            "COM against Wang et al.'s simulation",
            "table-one",
            ["com_published_mm", "com_mm"],
            "tissue",
        )
    }
}

/// Returns the mean COM for a prescribed RCM and the mean RCM of a free base, mm.
fn centres(problem: &Problem, rcm: f64) -> Result<[f64; 2], BeamError> {
    let mut beam = FoundationBeam::new(problem)?;
    let (mut com, mut natural) = (0.0, 0.0);
    let count = DISPLACEMENTS_MM.len() as f64;
    for displacement_mm in DISPLACEMENTS_MM {
        let mut shape = |slope| beam.solve(&Base { displacement_mm, slope });
        let slope = -displacement_mm / (problem.control_distance_mm + rcm);
        let mean = |depth: Option<f64>| depth.unwrap_or(f64::NAN) / count;
        com += mean(Shape::com_mm(&shape(Some(slope))?));
        natural += mean(Shape::rcm_mm(&shape(None)?));
    }
    Ok([com, natural])
}
