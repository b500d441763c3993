//! Closed surfaces as labels: one a file, named by it, on a grid made for them.

mod solid;

use std::fs;
use std::path::{Path, PathBuf};

use nalgebra::{Matrix4, Vector3};

use super::Segmentation;
use super::folder::{Mask, Union};
use crate::registration::surface::plausible;
use crate::volume::complete::is_body;
use crate::volume::{self, At, Label, LabelVolume, VolumeError};
use insonify_base::memory;
use insonify_base::text::some_of;
use insonify_mesh::file::{SURFACES, SurfaceFile};
use solid::Solid;

/// Largest number of voxels of a grid, and of one whose voxels are stated.
const MOST_VOXELS: f64 = 16e6;
const MOST_STATED: f64 = 256e6;
/// Voxels along the longest side of small surfaces, and the largest voxel unless there would be too many, mm.
const VOXELS_ALONG: f64 = 256.0;
const LARGEST_MM: f64 = 1.0;
/// Space around organs without a body, in which one is closed, mm.
const AROUND_MM: f64 = 40.0;
/// Length below which a body is likely to be in centimetres, mm: between torsos in centimetres and small animals.
const SMALL_BODY_MM: f64 = 60.0;
/// Voxels around a body.
const RIM: f64 = 2.0;

/// Returns the surfaces that a path names: itself, or those in a folder without volumes, by name.
pub(super) fn files(path: &Path) -> Result<Vec<PathBuf>, VolumeError> {
    if !path.is_dir() {
        return Ok(is_surface(path).then(|| path.to_owned()).into_iter().collect());
    }
    let fail = |cause| VolumeError::read(path, cause);
    let mut files = Vec::new();
    for entry in fs::read_dir(path).map_err(fail)? {
        let file = entry.map_err(fail)?.path();
        if super::stem(&file).is_some() {
            return Ok(Vec::new());
        }
        let is_hidden = file
            .file_name()
            .is_some_and(|name| name.to_string_lossy().starts_with('.'));
        if is_surface(&file) && file.is_file() && !is_hidden {
            files.push(file);
        }
    }
    files.sort();
    Ok(files)
}

fn is_surface(path: &Path) -> bool {
    let ending = path
        .extension()
        .map(|ending| ending.to_string_lossy().to_ascii_lowercase());
    // Grids of XML are meshes.
    ending.is_some_and(|ending| ending != "vtu" && SURFACES.contains(&ending.as_str()))
}

/// Grid whose voxels are cubes along the axes of the world.
struct Cubes {
    /// Centre of the first voxel, LPS, mm.
    first_mm: Vector3<f64>,
    voxel_mm: f64,
    size: [usize; 3],
}

impl Cubes {
    /// Grid around a box, its centres at multiples of the voxel, which is chosen unless it is stated.
    fn around([low, high]: [[f64; 3]; 2], has_body: bool, stated_mm: Option<f64>) -> Result<Self, VolumeError> {
        let sides = [0, 1, 2].map(|axis| high[axis] - low[axis]);
        let longest = sides.into_iter().fold(0.0, f64::max);
        let count = |voxel_mm: f64, rim_mm: f64| {
            sides
                .iter()
                .map(|side| (side + 2.0 * rim_mm) / voxel_mm)
                .product::<f64>()
        };
        let rim = |voxel_mm: f64| if has_body { RIM * voxel_mm } else { AROUND_MM };
        let mut voxel_mm = (longest / VOXELS_ALONG).min(LARGEST_MM);
        while count(voxel_mm, rim(voxel_mm)) > MOST_VOXELS {
            voxel_mm *= 1.05;
        }
        // A tenth of the leading digit is a number that can be told.
        let digit = 10f64.powf(voxel_mm.log10().floor() - 1.0);
        let voxel_mm = stated_mm.unwrap_or((voxel_mm / digit).ceil() * digit);
        let rim_mm = rim(voxel_mm);
        let voxels = count(voxel_mm, rim_mm);
        if voxels > MOST_STATED {
            let text = format!(
                "{voxels:.1e} voxels of {voxel_mm} mm; expected at most {MOST_STATED:.1e}: a coarser resolution"
            );
            return Err(VolumeError::option(super::RESOLUTION, text));
        }
        let first = low.map(|low| ((low - rim_mm) / voxel_mm).floor());
        let last = high.map(|high| ((high + rim_mm) / voxel_mm).ceil());
        Ok(Self {
            first_mm: Vector3::from(first) * voxel_mm,
            voxel_mm,
            size: [0, 1, 2].map(|axis| (last[axis] - first[axis]) as usize + 1),
        })
    }

    fn index_to_world(&self) -> Matrix4<f64> {
        Matrix4::new_translation(&self.first_mm) * Matrix4::new_scaling(self.voxel_mm)
    }

    /// Volume that holds a solid as its only label.
    fn mask(&self, solid: &Solid, name: &str) -> Result<LabelVolume, VolumeError> {
        let voxels = solid.voxels(&self.first_mm, self.voxel_mm, self.size);
        let inside = voxels.iter().map(|voxel| u64::from(*voxel)).sum::<u64>();
        let label = |value, name: Option<&str>, voxels| Label {
            value,
            name: name.map(str::to_owned),
            voxels,
        };
        let labels = vec![
            label(0, None, voxels.len() as u64 - inside),
            label(1, Some(name), inside),
        ];
        LabelVolume::new(self.size, voxels, labels, self.index_to_world())
    }
}

/// Reads closed surfaces as one volume; where they overlap, the smaller ones lie above the larger.
pub(super) fn read(path: &Path, files: &[PathBuf], resolution_mm: Option<f64>) -> Result<Segmentation, VolumeError> {
    let mut solids = Vec::new();
    let (mut nameless, mut turned, mut split) = (Vec::new(), Vec::new(), Vec::new());
    for file in files {
        let surface = SurfaceFile::read(file)
            .map_err(|error| volume::foreign::image(file).unwrap_or_else(|| VolumeError::new(error.to_string())))?;
        if surface.is_outside {
            let instead = "give a volume of labels, or a surface; `insonify mesh info` looks into a mesh";
            return Err(VolumeError::unsupported(
                file,
                At::Byte(0),
                "a mesh of tetrahedra",
                instead,
            ));
        }
        let name = file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        match surface.is_ras {
            None => nameless.push(name.clone()),
            Some(true) => turned.push(name.clone()),
            Some(false) => {}
        }
        let mask = |name: String| Mask {
            path: file.clone(),
            name,
        };
        let parts = surface.parts();
        let closed = parts
            .iter()
            .map(|(part, surface)| Some((mask((*part).to_owned()), Solid::new(surface).ok()?)));
        if let Some(closed) = closed.collect::<Option<Vec<_>>>().filter(|closed| !closed.is_empty()) {
            split.push(name);
            solids.extend(closed);
            continue;
        }
        let solid = Solid::new(&surface).map_err(|open| {
            let expected = "a closed surface, whose inside is the label (MeshLab and ParaView close holes)";
            VolumeError::malformed(file, At::Voxels, open, expected)
        })?;
        solids.push((mask(name), solid));
    }
    for (index, (two, _)) in solids.iter().enumerate() {
        if let Some((one, _)) = solids[..index].iter().find(|(one, _)| one.name == two.name) {
            let found = format!("{} and {}", one.path.display(), two.path.display());
            return Err(VolumeError::malformed(path, At::Folder, found, "one file a name"));
        }
    }
    let bounds = crate::registration::bounds(solids.iter().flat_map(|(_, solid)| solid.points().copied()));
    let longest = (0..3).map(|axis| bounds[1][axis] - bounds[0][axis]).fold(0.0, f64::max);
    plausible(longest, None).map_err(|found| VolumeError::new(format!("{}: {found}", path.display())))?;
    let has_body = solids.iter().any(|(mask, _)| is_body(&mask.name));
    let grid = Cubes::around(bounds, has_body, resolution_mm)?;
    // The mask of a solid, its copy as a volume, and the union of all.
    let needed = 3 * grid.size.iter().product::<usize>() as u64;
    memory::check(needed, "a grid of closed surfaces").map_err(|cause| VolumeError::read(path, cause.into()))?;
    let (mut union, mut thin) = (Union::new(grid.size), Vec::new());
    for (mask, solid) in &solids {
        let volume = grid.mask(solid, &mask.name)?;
        if volume.holds(1) {
            union.add(mask, &volume)?;
        } else {
            thin.push(mask.name.clone());
        }
    }
    let covered = union.covered("surfaces");
    let volume = union.volume(grid.size, grid.index_to_world());
    let mut segmentation = Segmentation::from(volume.map_err(|error| error.in_file(path))?);
    let [x, y, z] = grid.size;
    let mut note = format!(
        "{}: {} on a grid of {} mm ({x} x {y} x {z} voxels{}), named by {}",
        path.display(),
        match solids.len() {
            1 => "1 closed surface is a label".to_owned(),
            n => format!("{n} closed surfaces are labels"),
        },
        round(grid.voxel_mm),
        if resolution_mm.is_none() {
            "; `volume.resolution_mm` states another"
        } else {
            ""
        },
        match (&split[..], files.len()) {
            ([], 1) => "its file".to_owned(),
            ([], _) => "their files".to_owned(),
            (split, _) => format!("the objects of {}", some_of(split)),
        }
    );
    if !turned.is_empty() {
        note.push_str(&format!("; turned from RAS, as they state: {}", some_of(&turned)));
    }
    if !nameless.is_empty() {
        note.push_str(&format!(
            "; taken as LPS, as they state no axes: {}",
            some_of(&nameless)
        ));
    }
    if has_body && longest < SMALL_BODY_MM {
        segmentation.warnings.push(format!(
            "the body is {longest:.1} mm long: in centimetres it would be {:.0} mm; is the surface in mm, as it is taken?",
            10.0 * longest
        ));
    }
    segmentation.is_of_surfaces = true;
    segmentation.notes.push(note);
    segmentation.notes.extend(covered);
    if !thin.is_empty() {
        segmentation.warnings.push(format!(
            "thinner than a voxel of {} mm, without a label: {}",
            round(grid.voxel_mm),
            some_of(&thin)
        ));
    }
    Ok(segmentation)
}

/// A length without the digits of its rounding.
fn round(mm: f64) -> f64 {
    (mm * 1e6).round() / 1e6
}

#[cfg(test)]
mod tests;
