//! Report on a pixel, as data and as text.

use std::fmt;

use serde::Serialize;

use insonify_base::text;

/// Explanation of a pixel.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PixelReport {
    /// Column and row.
    pub pixel: [usize; 2],
    /// Grey level in the frame.
    pub grey_level: u8,
    /// Pixel centre in the probe's plane (lateral, axial), mm.
    pub plane_mm: [f64; 2],
    /// Pixel centre in the world (LPS), mm.
    pub world_mm: [f64; 3],
    /// Sample shown by the pixel; `None` outside the sector.
    pub sample: Option<SampleReport>,
}

/// Sample nearest to a pixel, with its value after each stage.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SampleReport {
    /// Scanline and sample at the pixel's centre, as fractional indices.
    pub beam: [f64; 2],
    /// Nearest scanline.
    pub line: usize,
    /// Nearest sample along the scanline.
    pub sample: usize,
    /// Depth of the sample along its beam, mm.
    pub depth_mm: f64,
    /// World position of the sample, mm; where skin is pressed to the array, the position that its tissue comes from.
    pub world_mm: [f64; 3],
    /// Position of the tissue in the reference state, mm.
    pub reference_mm: [f64; 3],
    /// Magnitude of the tissue's displacement, mm.
    pub displacement_mm: f64,
    /// Location in the mesh; `None` if no mesh deforms the tissue.
    pub mesh: Option<MeshReport>,
    /// Label at the sample, and its tissue.
    pub label: LabelReport,
    /// Solid texture of the tissue; `None` if it has none or the scene disables textures.
    pub texture: Option<TextureReport>,
    /// Factor of speckle on the amplitude, including the echoes of surfaces and needles that interfere with it.
    pub speckle: Option<f64>,
    /// Share of the scan plane's thickness filled by the needle.
    pub needle_share: Option<f64>,
    /// Losses above the sample; `None` if there are none.
    pub shadow: Option<ShadowReport>,
    /// Gain and time-gain compensation at this depth, dB.
    pub gain_db: f64,
    /// Automatic gain at this depth, dB; `None` without automatic gain.
    pub auto_gain_db: Option<f64>,
    /// Scanlines mixed by the radial blur, with their weights.
    pub blur: Vec<BlurNeighbour>,
    /// Value after each pass that writes it.
    pub stages: Vec<PassValue>,
    /// Samples from which the pixel is interpolated.
    pub interpolation: Vec<Corner>,
}

/// Location of a sample in the mesh.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MeshReport {
    /// Location in words: inside, in a fold, tissue moved away, or outside.
    pub place: &'static str,
    /// Element that contains the sample.
    pub element: Option<u32>,
    /// Nodes of the element.
    pub nodes: Option<[u32; 4]>,
    /// Barycentric coordinates in the deformed element, one per node.
    pub barycentric: Option<[f64; 4]>,
}

/// Label and its tissue.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LabelReport {
    /// Index in the volume's list of labels.
    pub index: u8,
    /// Label value in the file.
    pub value: i64,
    /// Label name in the file.
    pub name: Option<String>,
    /// Nearest voxel to the reference position; `None` outside the volume.
    pub voxel: Option<[usize; 3]>,
    /// Name of the tissue.
    pub tissue: String,
    /// Mean echo of the tissue, dB relative to liver.
    pub echogenicity_db: f64,
    /// Attenuation of the tissue, dB/cm/MHz.
    pub attenuation_db_cm_mhz: f64,
    /// Share of the amplitude that one millimetre of the tissue occludes.
    pub occlusion_per_mm: f64,
}

/// Solid texture at a point.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TextureReport {
    /// Name of the texture.
    pub name: String,
    /// Value of the texture: a factor on the amplitude, mean square 1.
    pub value: f64,
}

/// Losses along the scanline above a sample.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ShadowReport {
    /// Share of the amplitude that remains on this scanline; the echo is scaled by the mean over the beam.
    pub transmittance: f64,
    /// Two-way loss, dB.
    pub loss_db: f64,
    /// Loss in each tissue, largest first.
    pub taken_by: Vec<TissueLoss>,
}

/// Loss in one tissue or in the needle.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TissueLoss {
    /// Name of the tissue, or `needle`.
    pub by: String,
    /// Path length in it, mm.
    pub mm: f64,
    /// Two-way loss in it, dB.
    pub db: f64,
}

/// Scanline that contributes to the blur.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct BlurNeighbour {
    /// Index of the scanline.
    pub line: usize,
    /// Weight in the blur.
    pub weight: f64,
    /// Amplitude at the same depth before the blur.
    pub amplitude: f64,
}

/// Value of the sample after a pass.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PassValue {
    /// Name of the pass.
    pub pass: &'static str,
    /// Echo amplitude (normal liver: 1), or grey level from `tone` on.
    pub value: f64,
}

/// Sample from which a pixel is interpolated.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Corner {
    /// Index of the scanline.
    pub line: usize,
    /// Index of the sample along the scanline.
    pub sample: usize,
    /// Interpolation weight.
    pub weight: f64,
    /// Grey level of the sample.
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

/// Shortens a name from a file to one line.
fn named(name: &str) -> String {
    text::head(name, text::WIDEST_NAME)
}

fn triple([x, y, z]: [f64; 3]) -> String {
    format!("({x:.3}, {y:.3}, {z:.3})")
}

impl SampleReport {
    /// Writes mesh element, label, tissue and texture.
    fn fmt_anatomy(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
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
        Ok(())
    }
}

impl fmt::Display for SampleReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { line, sample, .. } = self;
        let [exact_line, exact_sample] = self.beam;
        // In the order in which a pixel comes about, from its place to scan conversion, so that a reader who
        // misses an echo can stop at the first line that is off.
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
        self.fmt_anatomy(f)?;
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
            for loss in &shadow.taken_by {
                writeln!(f, "  {:<22} {:>8.2} mm {:>10.3} dB", named(&loss.by), loss.mm, loss.db)?;
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
