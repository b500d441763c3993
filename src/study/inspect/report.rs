//! What is told of a pixel, and how it reads.

use std::fmt;

use serde::Serialize;

use crate::text;

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
    /// The sample in the world, mm; where skin is pressed to the array, the place that its tissue comes from.
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
    /// Factor that speckle put on the amplitude, the echoes of surfaces and needles included, which interfere with it.
    pub speckle: Option<f64>,
    /// Share of the scan plane's thickness that the needle fills.
    pub needle_share: Option<f64>,
    /// What the way down took; none where nothing takes anything.
    pub shadow: Option<ShadowReport>,
    /// Gain and time-gain compensation at this depth, dB.
    pub gain_db: f64,
    /// Automatic gain there, dB, if there is any.
    pub auto_gain_db: Option<f64>,
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
    /// Share of the amplitude that is left on this scanline; the echo sees the mean over the beam.
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

/// A name from a file, on one line.
fn named(name: &str) -> String {
    text::head(name, text::WIDEST_NAME)
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
            write!(f, " ({})", named(name))?;
        }
        match label.voxel {
            Some(voxel) => writeln!(f, ", voxel {voxel:?}")?,
            None => writeln!(f, ", outside the volume")?,
        }
        writeln!(
            f,
            "tissue          {}: echo {} dB, attenuation {} dB/cm/MHz, occlusion {} per mm",
            named(&label.tissue),
            label.echogenicity_db,
            label.attenuation_db_cm_mhz,
            label.occlusion_per_mm
        )?;
        if let Some(texture) = &self.texture {
            writeln!(f, "texture         {}: x {:.4}", named(&texture.name), texture.value)?;
        }
        if let Some(factor) = self.speckle {
            writeln!(
                f,
                "speckle         x {factor:.4}, with the echoes of surfaces and needles"
            )?;
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
                writeln!(
                    f,
                    "  {:<22} {:>8.2} mm {:>10.3} dB",
                    named(&taken.by),
                    taken.mm,
                    taken.db
                )?;
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
        write!(f, "gain            {:.2} dB at this depth", self.gain_db)?;
        match self.auto_gain_db {
            Some(db) => writeln!(f, ", and {db:+.2} dB of automatic gain")?,
            None => writeln!(f)?,
        }
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
