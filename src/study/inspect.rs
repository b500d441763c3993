//! What made one pixel: the way from a grey level back to tissue, for people who debug a scene.
//!
//! The passes are run on the CPU in double precision, once up to each of them, and read at the sample nearest to the pixel.

use std::fmt;

use nalgebra::{Matrix4, Point3, Vector4};
use serde::Serialize;

use crate::effects::pass::{Access, Resource};
use crate::effects::shadow::{UNITS_PER_DB, transmittance};
use crate::mechanics::mesh::locator::NONE;
use crate::mechanics::mesh::map::{BACKGROUND, FOLDED};
use crate::synth::layers::{Beam, world_position};
use crate::synth::tables::{Anatomy, Settings, Tables};
use crate::synth::{Backend, FrameState, SynthError, Synthesizer};

/// Blur weights below this share are left out of reports.
const LEAST_WEIGHT: f64 = 1e-4;

/// Everything that is known of a pixel.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PixelReport {
    /// Column and row.
    pub pixel: [usize; 2],
    /// Its grey level in the frame.
    pub grey_level: u8,
    /// Its centre in the probe's plane (lateral, axial), mm.
    pub plane_mm: [f64; 2],
    /// Its centre in the world (LPS), mm.
    pub world_mm: [f64; 3],
    /// The sample that it shows; none outside the sector.
    pub sample: Option<SampleReport>,
}

/// The sample nearest to a pixel, and what each stage made of it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SampleReport {
    /// Scanline and sample that the pixel's centre falls on, as fractional indices.
    pub beam: [f64; 2],
    /// Nearest scanline.
    pub line: usize,
    /// Nearest sample along it.
    pub sample: usize,
    /// Depth of that sample along its beam, mm.
    pub depth_mm: f64,
    /// The sample in the world, mm.
    pub world_mm: [f64; 3],
    /// Where its tissue lies in the reference state, mm.
    pub reference_mm: [f64; 3],
    /// Length of the tissue's displacement, mm.
    pub displacement_mm: f64,
    /// The mesh's part in it; none where no mesh deforms the tissue.
    pub mesh: Option<MeshReport>,
    /// What is imaged there.
    pub label: LabelReport,
    /// The tissue's solid texture; none where it has none or the scene does without textures.
    pub texture: Option<TextureReport>,
    /// Factor that speckle put on the amplitude.
    pub speckle: Option<f64>,
    /// Share of the scan plane's thickness that the needle fills.
    pub needle_share: Option<f64>,
    /// What the way down took; none where nothing takes anything.
    pub shadow: Option<ShadowReport>,
    /// Gain and time-gain compensation at this depth, dB.
    pub gain_db: f64,
    /// Scanlines that the radial blur mixes, with their shares.
    pub blur: Vec<BlurNeighbour>,
    /// The value after each pass that writes it.
    pub stages: Vec<Stage>,
    /// The samples that the pixel is interpolated from.
    pub interpolation: Vec<Corner>,
}

/// Where a sample lies in the mesh.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MeshReport {
    /// In words: inside, in a fold, tissue moved away, or outside.
    pub place: &'static str,
    /// The element that holds it.
    pub element: Option<u32>,
    /// The element's nodes.
    pub nodes: Option<[u32; 4]>,
    /// Barycentric coordinates in the deformed element, one a node.
    pub barycentric: Option<[f64; 4]>,
}

/// A label and its tissue.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LabelReport {
    /// Index in the volume's list.
    pub index: u8,
    /// Value in the file.
    pub value: i64,
    /// Name in the file.
    pub name: Option<String>,
    /// Nearest voxel to the reference position; none outside the volume.
    pub voxel: Option<[usize; 3]>,
    /// Name of the tissue.
    pub tissue: String,
    /// Mean echo of the tissue, dB relative to liver.
    pub echogenicity_db: f64,
    /// Attenuation of the tissue, dB/cm/MHz.
    pub attenuation_db_cm_mhz: f64,
    /// Share of the amplitude that a millimetre of the tissue occludes.
    pub occlusion_per_mm: f64,
}

/// A solid texture at a point.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TextureReport {
    /// Its name.
    pub name: String,
    /// Its value: a factor on the amplitude, mean square 1.
    pub value: f64,
}

/// What the way down to a sample took.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ShadowReport {
    /// Share of the amplitude that is left.
    pub transmittance: f64,
    /// Two-way loss, dB.
    pub loss_db: f64,
    /// Which tissue took how much, the largest first.
    pub taken_by: Vec<Taken>,
}

/// What one tissue, or the needle, took on the way.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Taken {
    /// The tissue, or `needle`.
    pub by: String,
    /// Length of the way through it, mm.
    pub mm: f64,
    /// Two-way loss in it, dB.
    pub db: f64,
}

/// A scanline that the blur mixes in.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct BlurNeighbour {
    /// The scanline.
    pub line: usize,
    /// Its share.
    pub weight: f64,
    /// Its amplitude at the same depth before the blur.
    pub amplitude: f64,
}

/// A value after a pass.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Stage {
    /// The pass.
    pub pass: &'static str,
    /// Echo amplitude (normal liver: 1), or grey level from `tone` on.
    pub value: f64,
}

/// One of the samples that a pixel is interpolated from.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Corner {
    /// Scanline.
    pub line: usize,
    /// Sample along it.
    pub sample: usize,
    /// Its share.
    pub weight: f64,
    /// Its grey level.
    pub grey_level: f64,
}

/// Explains a pixel of a frame: `column` and `row` from the near unmarked corner. None beyond the image.
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
    let at = synth.tables().scan_map[row * width + column];
    let centre = [column as f64, row as f64];
    Ok(Some(PixelReport {
        pixel: [column, row],
        grey_level,
        plane_mm: synth.tables().image_grid.to_plane(centre[0], centre[1]),
        world_mm: transform(&image_to_world, [centre[0], centre[1], 0.0]),
        sample: if at[0] < 0.0 {
            None
        } else {
            Some(sample_report(&mut synth, state, at)?)
        },
    }))
}

fn transform(matrix: &Matrix4<f64>, point: [f64; 3]) -> [f64; 3] {
    matrix.transform_point(&Point3::from(point)).into()
}

fn sample_report(synth: &mut Synthesizer, state: &FrameState, at: [f32; 2]) -> Result<SampleReport, SynthError> {
    let (line, sample) = ((at[0] + 0.5) as usize, (at[1] + 0.5) as usize);
    let index = line * synth.tables().samples() + sample;
    let stages = Stages::run(synth, state, index)?;
    let last = &stages.last;
    let tables = synth.tables();
    let world: [f64; 3] = world_position(tables, &state.probe_to_world, line, sample).into();
    let reference = last.position.get(index).map_or(world, |p| [p[0], p[1], p[2]]);
    let label = last.label.get(index).copied().unwrap_or(0);
    let moved = [0, 1, 2].map(|axis| world[axis] - reference[axis]);
    Ok(SampleReport {
        beam: at.map(f64::from),
        line,
        sample,
        depth_mm: tables.grid.sample_depth_mm(sample),
        world_mm: world,
        reference_mm: reference,
        displacement_mm: moved.iter().map(|x| x * x).sum::<f64>().sqrt(),
        mesh: mesh_report(tables, state, last, index, world),
        label: label_report(tables, label, reference),
        texture: texture_report(tables, label, reference),
        speckle: stages.factor_of("speckle", synth),
        needle_share: last.needle.get(index).copied(),
        shadow: shadow_report(tables, last, line, sample),
        gain_db: 20.0 * tables.gain.of::<f64>().get(sample).map_or(0.0, |gain| gain.log10()),
        blur: blur_report(tables, stages.before_blur.as_deref(), line, sample),
        interpolation: corners(last, at),
        stages: stages.list,
    })
}

/// The value at one sample through the passes of a frame.
struct Stages {
    list: Vec<Stage>,
    before_blur: Option<Vec<f64>>,
    last: Beam,
}

impl Stages {
    fn run(synth: &mut Synthesizer, state: &FrameState, index: usize) -> Result<Self, SynthError> {
        let writes = |bindings: &[(Resource, Access)]| {
            bindings.iter().any(|&(resource, access)| {
                access == Access::Write && matches!(resource, Resource::Amplitude | Resource::AmplitudeNext)
            })
        };
        let names: Vec<&'static str> = synth
            .plan()
            .passes
            .iter()
            .filter(|planned| writes(planned.pass.bindings))
            .map(|planned| planned.pass.name)
            .collect();
        let mut stages = Self {
            list: Vec::with_capacity(names.len()),
            before_blur: None,
            last: Beam::default(),
        };
        for pass in names {
            let beam = synth.render_until(pass, state)?;
            if pass == "blur" {
                stages.before_blur = Some(std::mem::take(&mut stages.last.amplitude));
            }
            stages.list.push(Stage {
                pass,
                value: beam.amplitude.get(index).copied().unwrap_or(0.0),
            });
            stages.last = beam;
        }
        Ok(stages)
    }

    /// The value after an effect over that before it; none without the effect, and where nothing echoes.
    fn factor_of(&self, effect: &str, synth: &Synthesizer) -> Option<f64> {
        let belongs = |stage: &Stage| {
            let mut passes = synth.plan().passes.iter();
            passes.any(|planned| planned.effect == effect && planned.pass.name == stage.pass)
        };
        let first = self.list.iter().position(belongs)?;
        let after = self.list.iter().rfind(|stage| belongs(stage))?.value;
        let before = self.list.get(first.checked_sub(1)?)?.value;
        (before > 0.0).then(|| after / before)
    }
}

fn mesh_report(tables: &Tables, state: &FrameState, beam: &Beam, index: usize, world: [f64; 3]) -> Option<MeshReport> {
    let mesh = tables.anatomy.mesh.as_ref()?;
    let &element = beam.element.get(index)?;
    let flag = beam.position.get(index).map_or(0, |position| position[3] as u32);
    let held = (element != NONE).then_some(element);
    let nodes = held.and_then(|element| mesh.elements().get(element as usize).copied());
    Some(MeshReport {
        place: match (held, flag) {
            (Some(_), FOLDED) => "in a fold of the mesh",
            (Some(_), _) => "in the mesh",
            (None, BACKGROUND) => "its tissue has moved away",
            (None, _) => "outside the mesh",
        },
        element: held,
        nodes,
        barycentric: nodes.and_then(|nodes| {
            let current = state.nodes.as_deref().unwrap_or(mesh.nodes());
            barycentric(nodes.map(|node| current[node as usize]), world)
        }),
    })
}

/// Barycentric coordinates of a point in a tetrahedron; none in one without volume.
fn barycentric(corners: [[f64; 3]; 4], point: [f64; 3]) -> Option<[f64; 4]> {
    let column = |p: [f64; 3]| Vector4::new(p[0], p[1], p[2], 1.0);
    let inverse = Matrix4::from_columns(&corners.map(column)).try_inverse()?;
    Some((inverse * column(point)).into())
}

fn label_report(tables: &Tables, index: u8, reference: [f64; 3]) -> LabelReport {
    let volume = &tables.volume;
    let label = volume.labels().get(usize::from(index));
    let tissue = tables.anatomy.tissues.of(index);
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
    let atlas = tables.atlas.as_ref()?;
    let entry = tables.label_rows.get(usize::from(label))?.texture.checked_sub(1)?;
    Some(TextureReport {
        name: tables.anatomy.tissues.of(label).texture.as_deref()?.to_owned(),
        value: atlas.sample(entry as usize, reference),
    })
}

fn shadow_report(tables: &Tables, beam: &Beam, line: usize, sample: usize) -> Option<ShadowReport> {
    let start = line * beam.samples;
    let &units = beam.loss.get(start + sample)?;
    let mut taken: Vec<Taken> = Vec::new();
    let mut take = |by: &str, mm: f64, db: f64| match taken.iter_mut().find(|taken| taken.by == by) {
        Some(taken) => {
            taken.mm += mm;
            taken.db += db;
        }
        None if db > 0.0 => taken.push(Taken {
            by: by.to_owned(),
            mm,
            db,
        }),
        None => {}
    };
    let needle_db_mm = match &tables.settings.effects.shadow {
        Some(shadow) => shadow.needle_db_mm,
        None => 0.0,
    };
    for at in 0..=sample {
        // A sample sees half of its own loss.
        let share = if at == sample { 0.5 } else { 1.0 };
        let mm = share * tables.sample_mm();
        let label = beam.label.get(start + at).copied().unwrap_or(0);
        let own = tables.label_rows.get(usize::from(label)).map_or(0, |row| row.loss);
        take(
            &tables.anatomy.tissues.of(label).name,
            mm,
            share * f64::from(own) / UNITS_PER_DB,
        );
        if let Some(&fill) = beam.needle.get(start + at).filter(|&&fill| fill > 0.0) {
            take("needle", mm * fill, mm * fill * needle_db_mm);
        }
    }
    taken.sort_by(|a, b| b.db.total_cmp(&a.db));
    Some(ShadowReport {
        transmittance: transmittance(units),
        loss_db: f64::from(units) / UNITS_PER_DB,
        taken_by: taken,
    })
}

fn blur_report(tables: &Tables, before: Option<&[f64]>, line: usize, sample: usize) -> Vec<BlurNeighbour> {
    let (Some(kernel), Some(before)) = (&tables.blur, before) else {
        return Vec::new();
    };
    let taps = kernel.at(sample).enumerate().filter_map(|(tap, weight)| {
        let other = (line + tap).checked_sub(kernel.reach)?;
        (other < tables.lines()).then_some((other, weight))
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
        .filter(|neighbour| neighbour.weight >= LEAST_WEIGHT)
        .collect()
}

fn corners(beam: &Beam, at: [f32; 2]) -> Vec<Corner> {
    let (first, share) = (at.map(|x| x as usize), at.map(|x| f64::from(x.fract())));
    let mut corners = Vec::with_capacity(4);
    for (step_line, of_line) in [(0, 1.0 - share[0]), (1, share[0])] {
        for (step_sample, of_sample) in [(0, 1.0 - share[1]), (1, share[1])] {
            let line = (first[0] + step_line).min(beam.lines - 1);
            let sample = (first[1] + step_sample).min(beam.samples - 1);
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

impl fmt::Display for PixelReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [column, row] = self.pixel;
        let [x, y] = self.plane_mm;
        writeln!(
            f,
            "pixel           column {column}, row {row}: grey level {}",
            self.grey_level
        )?;
        writeln!(f, "probe plane     {x:.3} mm lateral, {y:.3} mm axial")?;
        writeln!(f, "world           {} mm (LPS)", triple(self.world_mm))?;
        match &self.sample {
            Some(sample) => write!(f, "{sample}"),
            None => writeln!(f, "outside the sector: it shows the fill level"),
        }
    }
}

fn triple([x, y, z]: [f64; 3]) -> String {
    format!("({x:.3}, {y:.3}, {z:.3})")
}

impl fmt::Display for SampleReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { line, sample, .. } = self;
        let [exact_line, exact_sample] = self.beam;
        writeln!(
            f,
            "beam            scanline {line}, sample {sample} (exactly {exact_line:.2}, {exact_sample:.2}), {:.3} mm deep",
            self.depth_mm
        )?;
        writeln!(f, "sample          {} mm", triple(self.world_mm))?;
        writeln!(
            f,
            "reference       {} mm, displaced by {:.3} mm",
            triple(self.reference_mm),
            self.displacement_mm
        )?;
        if let Some(mesh) = &self.mesh {
            write!(f, "mesh            {}", mesh.place)?;
            if let (Some(element), Some(nodes)) = (mesh.element, mesh.nodes) {
                write!(f, ": element {element} of nodes {nodes:?}")?;
            }
            if let Some([a, b, c, d]) = mesh.barycentric {
                write!(f, ", barycentric {a:.4}, {b:.4}, {c:.4}, {d:.4}")?;
            }
            writeln!(f)?;
        }
        let label = &self.label;
        write!(f, "label           {}", label.value)?;
        if let Some(name) = &label.name {
            write!(f, " ({name})")?;
        }
        match label.voxel {
            Some(voxel) => writeln!(f, ", voxel {voxel:?}")?,
            None => writeln!(f, ", outside the volume")?,
        }
        writeln!(
            f,
            "tissue          {}: echo {} dB, attenuation {} dB/cm/MHz, occlusion {} per mm",
            label.tissue, label.echogenicity_db, label.attenuation_db_cm_mhz, label.occlusion_per_mm
        )?;
        if let Some(texture) = &self.texture {
            writeln!(f, "texture         {}: x {:.4}", texture.name, texture.value)?;
        }
        if let Some(factor) = self.speckle {
            writeln!(f, "speckle         x {factor:.4}")?;
        }
        if let Some(share) = self.needle_share {
            writeln!(f, "needle          fills {share:.3} of the scan plane's thickness")?;
        }
        if let Some(shadow) = &self.shadow {
            writeln!(
                f,
                "transmittance   {:.6} ({:.2} dB lost on the way down and back)",
                shadow.transmittance, shadow.loss_db
            )?;
            for taken in &shadow.taken_by {
                writeln!(f, "  {:<22} {:>8.2} mm {:>10.3} dB", taken.by, taken.mm, taken.db)?;
            }
        }
        if !self.blur.is_empty() {
            writeln!(f, "blur            of {} scanlines", self.blur.len())?;
            for neighbour in &self.blur {
                writeln!(
                    f,
                    "  scanline {:<13} {:>8.4} x {:>10.5}",
                    neighbour.line, neighbour.weight, neighbour.amplitude
                )?;
            }
        }
        writeln!(f, "gain            {:.2} dB at this depth", self.gain_db)?;
        writeln!(f, "after each pass (echo amplitude; grey level from `tone` on)")?;
        for stage in &self.stages {
            writeln!(f, "  {:<22} {:>12.6}", stage.pass, stage.value)?;
        }
        writeln!(f, "scan conversion between")?;
        for corner in &self.interpolation {
            writeln!(
                f,
                "  scanline {}, sample {:<6} {:>8.4} x {:>10.4}",
                corner.line, corner.sample, corner.weight, corner.grey_level
            )?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
