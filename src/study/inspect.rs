//! Explanation of a single pixel, traced from its grey level back to the tissue, for debugging a scene.
//!
//! The passes run on the CPU in double precision, up to each pass in turn, and are read at the sample nearest to the
//! pixel.

mod report;

use nalgebra::{Matrix4, Point3, Vector4};

use insonify_imaging::effects::buffers::AMPLITUDE;
use insonify_imaging::effects::pass::Pass;
use insonify_imaging::effects::shadow::downshift::Downshift;
use insonify_imaging::effects::shadow::{UNITS_PER_DB, transmittance};
use insonify_imaging::effects::tone::Tone;
use insonify_imaging::effects::tone::auto_gain::{self, AutoGain};
use insonify_imaging::effects::warp::{BACKGROUND, FOLDED};
use insonify_imaging::synth::layers::{Beam, world_position};
use insonify_imaging::synth::tables::{Anatomy, Settings, Tables};
use insonify_imaging::synth::{Backend, FrameState, SynthError, Synthesizer};
use insonify_mesh::locator::NO_ELEMENT;

pub use report::{
    BlurNeighbour, Corner, LabelReport, MeshReport, PassValue, PixelReport, SampleReport, ShadowReport, TextureReport,
    TissueLoss,
};

/// Blur weights below this share are omitted from reports.
const MIN_WEIGHT: f64 = 1e-4;

/// Explains the pixel at `column` and `row`, counted from the near unmarked corner. Returns `None` outside the image.
pub fn inspect(
    anatomy: &Anatomy,
    settings: &Settings,
    state: &FrameState,
    [column, row]: [usize; 2],
) -> Result<Option<PixelReport>, SynthError> {
    let mut synth = Synthesizer::new(anatomy.clone(), settings.clone(), Backend::CpuF64)?;
    let frame = synth.render(state)?;
    let (width, height, image_to_world) = (frame.width, frame.height, frame.image_to_world);
    if column >= width || row >= height {
        return Ok(None);
    }
    let grey_level = frame.pixels[row * width + column];
    let beam_position = synth.tables().scan_map[row * width + column];
    let centre = [column as f64, row as f64];
    Ok(Some(PixelReport {
        pixel: [column, row],
        grey_level,
        plane_mm: synth.tables().image_grid.to_plane(centre[0], centre[1]),
        world_mm: transform(&image_to_world, [centre[0], centre[1], 0.0]),
        sample: if beam_position[0] < 0.0 {
            None
        } else {
            Some(sample_report(&mut synth, state, beam_position)?)
        },
    }))
}

fn transform(matrix: &Matrix4<f64>, point: [f64; 3]) -> [f64; 3] {
    matrix.transform_point(&Point3::from(point)).into()
}

fn sample_report(
    synth: &mut Synthesizer,
    state: &FrameState,
    beam_position: [f32; 2],
) -> Result<SampleReport, SynthError> {
    let (line, sample) = ((beam_position[0] + 0.5) as usize, (beam_position[1] + 0.5) as usize);
    let index = line * synth.tables().samples() + sample;
    let stages = Stages::run(synth, state, index)?;
    let beam = &stages.last;
    let mut world: [f64; 3] = world_position(synth.tables(), &state.probe_to_world, line, sample).into();
    // Contact moves samples before the mesh carries them back: displacements count from there.
    if synth.tables().settings.effects.contact.is_some() {
        let pressed = synth.render_until("contact", state)?;
        world.copy_from_slice(&pressed.position[index][..3]);
    }
    let tables = synth.tables();
    let reference = beam.position.get(index).map_or(world, |p| [p[0], p[1], p[2]]);
    let label = beam.label.get(index).copied().unwrap_or(0);
    let displacement = [0, 1, 2].map(|axis| world[axis] - reference[axis]);
    Ok(SampleReport {
        beam: beam_position.map(f64::from),
        line,
        sample,
        depth_mm: tables.grid.sample_depth_mm(sample),
        world_mm: world,
        reference_mm: reference,
        displacement_mm: displacement.iter().map(|x| x * x).sum::<f64>().sqrt(),
        mesh: mesh_report(tables, state, beam, index, world),
        label: label_report(tables, label, reference),
        texture: texture_report(tables, label, reference),
        speckle: stages.factor_of("speckle", synth),
        needle_share: beam.needle.get(index).copied(),
        shadow: shadow_report(tables, beam, line, sample),
        auto_gain_db: stages.auto_gain_db(tables, sample),
        gain_db: 20.0
            * tables
                .effects
                .tone
                .gain
                .of::<f64>()
                .get(sample)
                .map_or(0.0, |gain| gain.log10()),
        blur: blur_report(tables, stages.before_blur.as_deref(), line, sample),
        interpolation: corners(beam, beam_position),
        stages: stages.list,
    })
}

/// Value at one sample after each pass of a frame.
struct Stages {
    list: Vec<PassValue>,
    before_blur: Option<Vec<f64>>,
    before_tone: Vec<f64>,
    last: Beam,
}

impl Stages {
    fn run(synth: &mut Synthesizer, state: &FrameState, index: usize) -> Result<Self, SynthError> {
        let writes = |pass: &Pass| {
            let mut bindings = pass.bindings.iter();
            pass.flips || bindings.any(|&(buffer, how)| *buffer == AMPLITUDE && how.writes())
        };
        let names: Vec<&'static str> = synth
            .plan()
            .passes
            .iter()
            .filter(|planned| writes(planned.pass))
            .map(|planned| planned.pass.name)
            .collect();
        let mut stages = Self {
            list: Vec::with_capacity(names.len()),
            before_blur: None,
            before_tone: Vec::new(),
            last: Beam::default(),
        };
        // A pass has megabytes: its amplitudes are kept whole only where a report reads more than the sample.
        for pass in names {
            let beam = synth.render_until(pass, state)?;
            if pass == "blur" {
                stages.before_blur = Some(std::mem::take(&mut stages.last.amplitude));
            } else if pass == "tone" {
                stages.before_tone = std::mem::take(&mut stages.last.amplitude);
            }
            stages.list.push(PassValue {
                pass,
                value: beam.amplitude.get(index).copied().unwrap_or(0.0),
            });
            stages.last = beam;
        }
        Ok(stages)
    }

    /// Returns the automatic gain at a sample depth, dB; `None` without automatic gain.
    fn auto_gain_db(&self, tables: &Tables, sample: usize) -> Option<f64> {
        let tops = auto_gain::tops(tables, &self.last.label);
        let gains = auto_gain::gains(
            &AutoGain::of(tables)?,
            tables.effects.tone.gain.of(),
            &self.before_tone,
            &tops,
        );
        Some(Tone::DB_PER_OCTAVE * auto_gain::at(&gains, sample, tables.samples()))
    }

    /// Returns the ratio of the value after an effect to that before it; `None` without the effect or without an echo.
    fn factor_of(&self, effect: &str, synth: &Synthesizer) -> Option<f64> {
        let belongs = |stage: &PassValue| {
            let mut passes = synth.plan().passes.iter();
            passes.any(|planned| planned.effect == effect && planned.pass.name == stage.pass)
        };
        let start = self.list.iter().position(belongs)?;
        let after = self.list.iter().rfind(|stage| belongs(stage))?.value;
        let before = self.list.get(start.checked_sub(1)?)?.value;
        (before > 0.0).then(|| after / before)
    }
}

fn mesh_report(tables: &Tables, state: &FrameState, beam: &Beam, index: usize, world: [f64; 3]) -> Option<MeshReport> {
    let mesh = tables.anatomy.mesh.as_ref()?;
    let &element = beam.element.get(index)?;
    let flag = beam.position.get(index).map_or(0, |position| position[3] as u32);
    let containing = (element != NO_ELEMENT).then_some(element);
    let nodes = containing.and_then(|element| mesh.elements().get(element as usize).copied());
    Some(MeshReport {
        place: match (containing, flag) {
            (Some(_), FOLDED) => "in a fold of the mesh",
            (Some(_), _) => "in the mesh",
            (None, BACKGROUND) => "its tissue has moved away",
            (None, _) => "outside the mesh",
        },
        element: containing,
        nodes,
        barycentric: nodes.and_then(|nodes| {
            let current = state.nodes.as_deref().unwrap_or(mesh.nodes());
            barycentric(nodes.map(|node| current[node as usize]), world)
        }),
    })
}

/// Returns the barycentric coordinates of a point in a tetrahedron; `None` for one without volume.
fn barycentric(corners: [[f64; 3]; 4], point: [f64; 3]) -> Option<[f64; 4]> {
    let column = |p: [f64; 3]| Vector4::new(p[0], p[1], p[2], 1.0);
    let inverse = Matrix4::from_columns(&corners.map(column)).try_inverse()?;
    Some((inverse * column(point)).into())
}

fn label_report(tables: &Tables, index: u8, reference: [f64; 3]) -> LabelReport {
    let volume = &tables.anatomy.volume;
    let label = volume.labels().get(usize::from(index));
    let tissue = tables.anatomy.tissues.tissue(index);
    let position = transform(volume.world_to_index(), reference);
    let nearest = position.map(|x| (x + 0.5).floor());
    let inside = (0..3).all(|axis| nearest[axis] >= 0.0 && nearest[axis] < volume.size()[axis] as f64);
    LabelReport {
        index,
        value: label.map_or(0, |label| label.value),
        name: label.and_then(|label| label.name.clone()),
        voxel: inside.then(|| nearest.map(|x| x as usize)),
        tissue: tissue.name.to_string(),
        echogenicity_db: tissue.echogenicity_db,
        attenuation_db_cm_mhz: tissue.attenuation_db_cm_mhz,
        occlusion_per_mm: tissue.occlusion_per_mm,
    }
}

fn texture_report(tables: &Tables, label: u8, reference: [f64; 3]) -> Option<TextureReport> {
    let atlas = tables.effects.texture.as_ref()?;
    let entry = tables.label_rows.get(usize::from(label))?.texture.checked_sub(1)?;
    Some(TextureReport {
        name: tables.anatomy.tissues.tissue(label).texture.as_deref()?.to_owned(),
        value: atlas.sample(entry as usize, tables.origin.to_local(reference)),
    })
}

fn shadow_report(tables: &Tables, beam: &Beam, line: usize, sample: usize) -> Option<ShadowReport> {
    let start = line * beam.samples;
    let &units = beam.loss.get(start + sample)?;
    let mut losses: Vec<TissueLoss> = Vec::new();
    let mut add_loss = |cause: &str, mm: f64, db: f64| match losses.iter_mut().find(|loss| loss.by == cause) {
        Some(loss) => {
            loss.mm += mm;
            loss.db += db;
        }
        None if db > 0.0 => losses.push(TissueLoss {
            by: cause.to_owned(),
            mm,
            db,
        }),
        None => {}
    };
    let shadow = tables.settings.effects.shadow.as_ref();
    let needle_db_mm = shadow.map_or(0.0, |shadow| shadow.needle_db_mm);
    let downshift = Downshift::new(tables.settings.probe.transducer().bandwidth);
    let mut above_db = 0.0;
    for crossed in 0..=sample {
        // Only half of a sample's own loss lies before its centre.
        let share = if crossed == sample { 0.5 } else { 1.0 };
        let mm = share * tables.sample_mm();
        let label = beam.label.get(start + crossed).copied().unwrap_or(0);
        let row = tables.label_rows.get(usize::from(label)).copied().unwrap_or_default();
        let [attenuation_db, all_db] = [row.attenuation, row.loss].map(|units| share * f64::from(units) / UNITS_PER_DB);
        // What a pulse feels of it, after what it has lost.
        let before_db = downshift.felt_db(above_db);
        above_db += attenuation_db;
        let felt_db = downshift.felt_db(above_db) - before_db + all_db - attenuation_db;
        add_loss(&tables.anatomy.tissues.tissue(label).name, mm, felt_db);
        if let Some(&fill) = beam.needle.get(start + crossed).filter(|&&fill| fill > 0.0) {
            let shade = beam.shade.get(start + crossed).copied().unwrap_or(0.0);
            add_loss("needle", mm * fill, mm * shade * needle_db_mm);
        }
    }
    losses.sort_by(|a, b| b.db.total_cmp(&a.db));
    Some(ShadowReport {
        transmittance: transmittance(units),
        loss_db: f64::from(units) / UNITS_PER_DB,
        taken_by: losses,
    })
}

fn blur_report(tables: &Tables, before: Option<&[f64]>, line: usize, sample: usize) -> Vec<BlurNeighbour> {
    let (Some(kernel), Some(before)) = (&tables.effects.blur, before) else {
        return Vec::new();
    };
    let taps = kernel.at(sample).enumerate().filter_map(|(tap, weight)| {
        let neighbour = (line + tap).checked_sub(kernel.reach)?;
        (neighbour < tables.lines()).then_some((neighbour, weight))
    });
    let inside: Vec<(usize, f64)> = taps.collect();
    let total: f64 = inside.iter().map(|(_, weight)| weight).sum();
    inside
        .into_iter()
        .map(|(line, weight)| BlurNeighbour {
            line,
            weight: weight / total,
            amplitude: before.get(line * tables.samples() + sample).copied().unwrap_or(0.0),
        })
        .filter(|neighbour| neighbour.weight >= MIN_WEIGHT)
        .collect()
}

fn corners(beam: &Beam, position: [f32; 2]) -> Vec<Corner> {
    let (low, share) = (position.map(|x| x as usize), position.map(|x| f64::from(x.fract())));
    let mut corners = Vec::with_capacity(4);
    for (step_line, of_line) in [(0, 1.0 - share[0]), (1, share[0])] {
        for (step_sample, of_sample) in [(0, 1.0 - share[1]), (1, share[1])] {
            let line = (low[0] + step_line).min(beam.lines - 1);
            let sample = (low[1] + step_sample).min(beam.samples - 1);
            let weight = of_line * of_sample;
            if weight > 0.0 {
                corners.push(Corner {
                    line,
                    sample,
                    weight,
                    grey_level: beam.amplitude.get(line * beam.samples + sample).copied().unwrap_or(0.0),
                });
            }
        }
    }
    corners
}

#[cfg(test)]
mod tests;
