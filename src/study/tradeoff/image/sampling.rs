//! Sampling of a scene: look-up of voxels, location in elements, samples per pixel.

use std::hint::black_box;
use std::time::Instant;

use super::{Compared, Difference, Factor, ImageOptions, Subject, Table, coarsened, compared, inside, picture};
use crate::tradeoff::{Axis, Choice, Column, GREY_LEVELS, Goal, SHIFT_MM};
use insonify::Error;
use insonify_anatomy::acoustics::bank;
use insonify_anatomy::volume::texture::SolidTexture;
use insonify_base::statistics::Spread;
use insonify_imaging::effects::Effects;
use insonify_imaging::effects::tone::Tone;
use insonify_imaging::synth::Backend;
use insonify_imaging::synth::tables::Settings;
use insonify_mesh::locator::Locator;
use insonify_mesh::{Displacement, NO_ELEMENT, TetMesh};

/// One effect on its own over slices, and the grids that refine its sums.
struct Variant {
    name: &'static str,
    keep: fn(&Effects) -> Effects,
    /// Grids from coarse to fine; the last is the gold standard.
    grids: [[u32; 2]; 6],
}

const SAMPLES: [[u32; 2]; 6] = [[256, 64], [256, 128], [256, 256], [256, 512], [256, 1024], [256, 4096]];
const LINES: [[u32; 2]; 6] = [[32, 512], [64, 512], [128, 512], [256, 512], [512, 512], [1024, 512]];

fn bare(effects: &Effects) -> Effects {
    Effects {
        tone: effects.tone.as_ref().map(|_| Tone::linear()),
        ..Effects::default()
    }
}

const VARIANTS: [Variant; 3] = [
    Variant {
        name: "shadow, soft edges",
        keep: |effects| Effects {
            shadow: effects.shadow.clone(),
            ..bare(effects)
        },
        grids: SAMPLES,
    },
    Variant {
        name: "shadow, hard edges",
        keep: |effects| Effects {
            shadow: effects
                .shadow
                .clone()
                .map(|shadow| insonify_imaging::effects::shadow::Shadow {
                    beam_mm: Some(0.0),
                    ..shadow
                }),
            ..bare(effects)
        },
        grids: SAMPLES,
    },
    Variant {
        name: "blur",
        keep: |effects| Effects {
            blur: Some(Default::default()),
            ..bare(effects)
        },
        grids: LINES,
    },
];

/// An effect, and the grid that samples it.
type Sampled = Compared<(&'static str, [u32; 2])>;

const SAMPLED: [Choice<Sampled>; 2] = [
    Factor::new("effect", "effect").of(|row| row.variant.0.to_owned()),
    Factor::new("grid", "grid").of(|row| super::labels::name(row.variant.1)),
];

pub(super) fn sampling(options: &ImageOptions, _: &mut Vec<String>) -> Result<Vec<Table>, Error> {
    let subject = Subject::new(options.voxel_mm)?;
    let mut rows: Vec<Sampled> = Vec::new();
    for variant in VARIANTS {
        // One effect at a time: together, the coarse sampling of one would
        // hide what the other gains from a finer grid.
        let settings = |grid| -> Settings {
            let settings = subject.grid(grid);
            Settings {
                effects: (variant.keep)(&settings.effects),
                ..settings
            }
        };
        let [grids @ .., finest] = variant.grids.map(|grid| coarsened(options, grid));
        let mut gold = subject.on(settings(finest), Backend::CpuF64)?;
        let standard = gold.render(&subject.state)?.pixels.clone();
        let inside = inside(&gold);
        let mut coarser: Option<Difference> = None;
        for grid in grids {
            let mut synth = subject.on(settings(grid), Backend::Cpu)?;
            let picture = picture(&mut synth, &subject.state, options.patience / 2)?;
            let difference = Difference::of(&standard, &picture.pixels, &inside);
            rows.push(Compared {
                variant: (variant.name, grid),
                picture,
                difference,
                flag: difference.flag(coarser.as_ref()),
            });
            coarser = Some(difference);
        }
    }
    let title = "Sampling of shadow (samples) and blur (scanlines), each alone, against the finest in double precision";
    let goal = Goal::new("median_ms", "rms_grey", GREY_LEVELS).choosing("sampling of one effect");
    let table = Table::of("image_sampling", title, &SAMPLED, &compared(), &rows)
        .flagged(&rows, |row| row.flag.clone())
        .against("the finest grid of each, in double precision")
        .seeking(goal.each(&["effect"]).beside(&["p95_ms", "p99_grey", "memory_mb"]));
    Ok(vec![table])
}

/// Textures of coarse and fine structure, with and without a preferred direction.
const TEXTURES: [&str; 3] = ["liver", "muscle", "fat"];
/// Scanlines and samples of the plane through each texture, and number of repetitions.
const PLANE: [usize; 2] = [64, 256];
const REPEATS: usize = 9;
/// Share of the mean echo below which echoes count as equally dark.
const DARKEST: f64 = 1e-2;

/// Look-up method.
struct Lookup {
    name: &'static str,
    look: fn(&SolidTexture, [f32; 3]) -> f32,
}

const LOOKUPS: [Lookup; 2] = [
    Lookup {
        name: "nearest voxel",
        look: nearest,
    },
    Lookup {
        name: "trilinear",
        look: |texture, place| texture.sample(place),
    },
];

/// Returns the multiplier of the nearest voxel.
fn nearest(texture: &SolidTexture, place_mm: [f32; 3]) -> f32 {
    let (size, spacing) = (texture.size(), texture.spacing_mm());
    let index: [usize; 3] = std::array::from_fn(|axis| {
        let voxel = (place_mm[axis] / spacing[axis] as f32).round() as i64;
        voxel.rem_euclid(size[axis] as i64) as usize
    });
    texture.data()[index[0] + size[0] * (index[1] + size[1] * index[2])]
}

/// Returns the positions of a plane oblique to a texture's axes, scanline by scanline, mm.
fn positions() -> Vec<[f64; 3]> {
    let [lines, samples] = PLANE;
    let position = |index: usize| {
        let [line, sample] = [index / samples, index % samples].map(|count| count as f64);
        [0.31 * line, 0.23 * sample, 0.11 * line - 0.07 * sample]
    };
    (0..lines * samples).map(position).collect()
}

fn decibels(amplitude: f64) -> f64 {
    20.0 * amplitude.max(DARKEST).log10()
}

/// Look-ups of a texture by a method.
struct LookupRow {
    texture: &'static str,
    method: &'static str,
    /// Times of a look-up, ns.
    time_ns: Option<Spread>,
    rms_db: f64,
    rms_grey: f64,
}

const LOOKED_UP: [Choice<LookupRow>; 2] = [
    Factor::new("texture", "texture").of(|row| row.texture.to_owned()),
    Factor::new("look", "look-up").of(|row| row.method.to_owned()),
];

const LOOKUP_COLUMNS: [Column<LookupRow>; 4] = [
    Axis::log(
        "look_ns",
        "ns a look-up",
        "time of a look-up on one thread (median), ns",
    )
    .of(|row| Some(row.time_ns?.median_ms)),
    Axis::log("p95_ns", "p95 ns", "time of a look-up on one thread (95 of 100), ns")
        .of(|row| Some(row.time_ns?.p95_ms)),
    Axis::log("rms_db", "RMS dB", "root mean square error of the echo, dB").of(|row| Some(row.rms_db)),
    Axis::log(
        "rms_grey",
        "RMS grey",
        "the same after log compression, grey levels of 255",
    )
    .of(|row| Some(row.rms_grey)),
];

pub(crate) fn lookups() -> Table {
    let (positions, range_db) = (positions(), Tone::default().dynamic_range_db);
    let singles: Vec<[f32; 3]> = positions
        .iter()
        .map(|position| position.map(|coordinate| coordinate as f32))
        .collect();
    let mut rows = Vec::new();
    for name in TEXTURES {
        let Some(texture) = bank::make(name, 0) else { continue };
        for method in LOOKUPS {
            let mut nanoseconds = Vec::with_capacity(REPEATS);
            for _ in 0..REPEATS {
                let start = Instant::now();
                let sum: f32 = singles.iter().map(|position| (method.look)(&texture, *position)).sum();
                // A sum that nothing reads would be optimised away, look-ups included.
                black_box(sum);
                nanoseconds.push(start.elapsed().as_secs_f64() * 1e9 / singles.len() as f64);
            }
            let squares = positions.iter().zip(&singles).map(|(position, single)| {
                let [exact, echo] = [texture.sample(*position), f64::from((method.look)(&texture, *single))];
                (decibels(echo) - decibels(exact)).powi(2)
            });
            let rms_db = (squares.sum::<f64>() / positions.len() as f64).sqrt();
            rows.push(LookupRow {
                texture: name,
                method: method.name,
                time_ns: Spread::of(nanoseconds),
                rms_db,
                rms_grey: 255.0 * rms_db / range_db,
            });
        }
    }
    let goal = Goal::new("look_ns", "rms_grey", GREY_LEVELS).choosing("look-up of solid textures");
    let title = "Look-ups of solid textures by themselves: the nearest voxel against trilinear";
    Table::of("image_lookup", title, &LOOKED_UP, &LOOKUP_COLUMNS, &rows)
        .against("trilinear look-ups in double precision")
        .seeking(goal.over(&["texture"]).beside(&["p95_ns", "rms_db"]))
}

const BOX_MM: [[f64; 3]; 2] = [[-60.0, 0.0, -40.0], [60.0, 100.0, 40.0]];
const FRAMES: usize = 8;
/// Number of points located by exhaustive search.
const EXHAUSTIVE: usize = 200;

/// Returns the nodes of a frame: an indentation that comes and goes, and a swirl.
fn nodes(mesh: &TetMesh, frame: usize) -> Vec<[f64; 3]> {
    let share = (frame as f64 / FRAMES as f64 * std::f64::consts::PI).sin();
    let press = Displacement::Indentation {
        centre_mm: [5.0, 10.0, 0.0],
        direction: [0.1, 1.0, 0.0],
        depth_mm: 12.0 * share,
        radius_mm: 22.0,
    };
    mesh.nodes()
        .iter()
        .map(|&node| {
            let displacement = press.apply(node);
            [0, 1, 2].map(|axis| node[axis] + displacement[axis])
        })
        .collect()
}

/// Returns the points of a plane through the box, scanline by scanline, shifted slightly in every frame as by a hand.
fn points(count: usize, frame: usize) -> Vec<[f64; 3]> {
    let side = (count as f64).sqrt().ceil() as usize;
    let shift = 0.3 * frame as f64;
    (0..count)
        .map(|index| {
            let (line, sample) = (index / side, index % side);
            let across = -50.0 + 100.0 * (line as f64 + 0.37) / side as f64;
            let depth = 2.0 + 96.0 * (sample as f64 + 0.41) / side as f64;
            [across + shift, depth, 0.2 * across + 0.1 * depth - 9.0 + shift]
        })
        .collect()
}

/// Returns the smallest barycentric coordinate of a point in an element.
fn least(nodes: &[[f64; 3]], corners: [u32; 4], p: [f64; 3]) -> f64 {
    let [a, b, c, d] = corners.map(|corner| nalgebra::Vector3::from(nodes[corner as usize]));
    let p = nalgebra::Vector3::from(p);
    let volume = |a: nalgebra::Vector3<f64>,
                  b: nalgebra::Vector3<f64>,
                  c: nalgebra::Vector3<f64>,
                  d: nalgebra::Vector3<f64>| { (b - a).cross(&(c - a)).dot(&(d - a)) };
    let whole_volume = volume(a, b, c, d);
    let parts = [
        volume(p, b, c, d),
        volume(a, p, c, d),
        volume(a, b, p, d),
        volume(a, b, c, p),
    ];
    parts
        .map(|volume| volume / whole_volume)
        .into_iter()
        .fold(f64::INFINITY, f64::min)
}

/// Returns the lowest-numbered element that contains a point, by exhaustive search.
fn exhaustive(mesh: &TetMesh, nodes: &[[f64; 3]], p: [f64; 3]) -> u32 {
    let holding = mesh
        .elements()
        .iter()
        .position(|&corners| least(nodes, corners, p) >= 0.0);
    holding.map_or(NO_ELEMENT, |element| element as u32)
}

/// Results of one method: time per point in each frame, and differences from exhaustive search.
#[derive(Default)]
struct Location {
    nanoseconds: Vec<f64>,
    differing: usize,
    off_mm: f64,
}

impl Location {
    fn timed(&mut self, started: Instant, points: usize) {
        self.nanoseconds
            .push(started.elapsed().as_secs_f64() * 1e9 / points as f64);
    }

    /// Counts a different element only if the point is not, within rounding, on a face of the elements found.
    fn judge(&mut self, locator: &Locator<f64>, mesh: &TetMesh, nodes: &[[f64; 3]], p: [f64; 3], answers: [u32; 2]) {
        let [located, exact] = answers;
        if located == exact {
            return;
        }
        let on_a_face = [located, exact]
            .iter()
            .filter(|element| **element != NO_ELEMENT)
            .all(|&element| least(nodes, mesh.elements()[element as usize], p).abs() < 1e-9);
        if !on_a_face {
            self.differing += 1;
        }
        if located != NO_ELEMENT && exact != NO_ELEMENT {
            let [a, b] = [located, exact].map(|element| nalgebra::Vector3::from(locator.to_reference(element, p)));
            self.off_mm = self.off_mm.max((a - b).norm());
        }
    }
}

/// A method of location in a mesh.
struct LocationRow {
    method: &'static str,
    nodes: usize,
    elements: usize,
    location: Location,
}

impl LocationRow {
    /// Times of a point in each frame, ns.
    fn time_ns(&self) -> Option<Spread> {
        Spread::of(self.location.nanoseconds.clone())
    }
}

const LOCATED: [Choice<LocationRow>; 2] = [
    Factor::new("method", "method").of(|row| row.method.to_owned()),
    Factor::new("mesh", "mesh").of(|row| format!("{} nodes", row.nodes)),
];

const LOCATION_COLUMNS: [Column<LocationRow>; 5] = [
    Axis::log("elements", "elements", "elements of the mesh").of(|row| Some(row.elements as f64)),
    Axis::log("point_ns", "ns a point", "time of a point (median of frames), ns")
        .of(|row| Some(row.time_ns()?.median_ms)),
    Axis::log("p95_ns", "p95 ns", "time of a point (95 of 100 frames), ns").of(|row| Some(row.time_ns()?.p95_ms)),
    Axis::linear("differing", "differ", "answers that differ from the exhaustive search")
        .of(|row| Some(row.location.differing as f64)),
    Axis::log("off_mm", "mm off", "largest error of a reference position, mm").of(|row| Some(row.location.off_mm)),
];

pub(super) fn location(options: &ImageOptions, _: &mut Vec<String>) -> Result<Vec<Table>, Error> {
    let mut rows = Vec::new();
    for &count in &options.nodes {
        let mesh = TetMesh::over_box(BOX_MM[0], BOX_MM[1], count)?;
        let mut locator = Locator::<f64>::new(&mesh);
        let [mut walk, mut grid, mut exhaustively] = [Location::default(), Location::default(), Location::default()];
        let mut elements = vec![NO_ELEMENT; options.points];
        for frame in 0..FRAMES {
            let nodes = nodes(&mesh, frame);
            locator.update(&nodes)?;
            let points = points(options.points, frame);
            let started = Instant::now();
            let mut before = NO_ELEMENT;
            for (element, &p) in elements.iter_mut().zip(&points) {
                // As in a frame: start from the element of the last frame, otherwise from the previous sample.
                let start = if *element == NO_ELEMENT { before } else { *element };
                *element = locator.locate(p, start).element;
                before = *element;
            }
            walk.timed(started, points.len());
            let started = Instant::now();
            let from_grid: Vec<u32> = points.iter().map(|&p| locator.locate(p, NO_ELEMENT).element).collect();
            grid.timed(started, points.len());
            let step = (points.len() / EXHAUSTIVE).max(1);
            let tried: Vec<usize> = (0..points.len()).step_by(step).collect();
            let started = Instant::now();
            let exact: Vec<u32> = tried
                .iter()
                .map(|&index| exhaustive(&mesh, &nodes, points[index]))
                .collect();
            exhaustively.timed(started, tried.len());
            for (&index, &exact) in tried.iter().zip(&exact) {
                walk.judge(&locator, &mesh, &nodes, points[index], [elements[index], exact]);
                grid.judge(&locator, &mesh, &nodes, points[index], [from_grid[index], exact]);
            }
        }
        // The first frame has no start elements.
        walk.nanoseconds.remove(0);
        let methods = [
            ("walk from the last frame", walk),
            ("search grid", grid),
            ("every element", exhaustively),
        ];
        rows.extend(methods.map(|(method, location)| LocationRow {
            method,
            nodes: mesh.nodes().len(),
            elements: mesh.elements().len(),
            location,
        }));
    }
    let title = "Point location in a deforming mesh, double precision, one thread, against trying every element";
    let goal = Goal::new("point_ns", "off_mm", SHIFT_MM).choosing("point location in the mesh");
    let table = Table::of("image_location", title, &LOCATED, &LOCATION_COLUMNS, &rows)
        .flagged(&rows, |row| {
            let differing = row.location.differing;
            (differing > 0).then(|| format!("{differing} answers differ from the exhaustive search"))
        })
        .against("every element tried")
        .seeking(goal.each(&["mesh"]).beside(&["p95_ns", "differing"]));
    Ok(vec![table])
}
