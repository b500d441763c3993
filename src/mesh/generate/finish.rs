//! Final mesh in the world, without the elements outside, and its figures.

use super::contents::Sampler;
use super::draft::Draft;
use super::path::Path;
use super::tissue::{OUTSIDE, Tissue};
use super::{GenerateError, GenerateReport, Generated, RegionVolume};
use crate::TetMesh;
use crate::quality::Quality;

/// Builds the mesh of the elements that are kept. Nodes are numbered in the order of their first element.
pub(super) fn finish(
    draft: &Draft,
    tissue: &Tissue,
    path: &Path,
    sampler: &Sampler,
) -> Result<Generated, GenerateError> {
    let mut numbers = vec![None; draft.nodes.len()];
    let (mut nodes, mut elements, mut regions) = (Vec::new(), Vec::new(), Vec::new());
    for element in draft.kept() {
        let corners = draft.elements[element as usize];
        elements.push(corners.map(|node| {
            *numbers[node as usize].get_or_insert_with(|| {
                nodes.push(tissue.to_world(draft.nodes[node as usize]));
                nodes.len() as u32 - 1
            })
        }));
        regions.push(tissue.regions[usize::from(draft.classes[element as usize])]);
    }
    let mesh = TetMesh::new(nodes, elements, regions)?;
    // In the grid's own coordinates every element is sound; far from the origin of the world rounding may flatten one.
    if !mesh.volumes(mesh.nodes()).all(|volume| volume > 0.0) {
        return Err(GenerateError::Far);
    }
    let quality = Quality::measure(&mesh, mesh.nodes());
    let report = GenerateReport {
        nodes: mesh.nodes().len(),
        elements: mesh.elements().len(),
        parts: quality.face_parts,
        min_dihedral_deg: quality.min_dihedral_deg.min,
        max_jacobian_condition: quality.condition.max,
        regions: volumes(draft, tissue),
        mislabelled_percent: mislabelled_percent(draft, tissue),
        near_mislabelled_percent: path.mislabelled_percent(draft, tissue, sampler),
    };
    Ok(Generated { mesh, report })
}

fn volumes(draft: &Draft, tissue: &Tissue) -> Vec<RegionVolume> {
    let volumes = draft.volumes(tissue.regions.len());
    let region = |class: usize| RegionVolume {
        region: tissue.regions[class],
        voxel_ml: tissue.volumes[class] / 1000.0,
        mesh_ml: volumes[class] / 1000.0,
        error_percent: 100.0 * (volumes[class] / tissue.volumes[class] - 1.0),
    };
    (1..tissue.regions.len()).map(region).collect()
}

fn mislabelled_percent(draft: &Draft, tissue: &Tissue) -> f64 {
    let wrong = |(contents, &class): (&super::contents::Contents, &u8)| contents.volume - contents.volume_of(class);
    let wrong: f64 = draft.contents.iter().zip(&draft.classes).map(wrong).sum();
    let all: f64 = tissue.volumes[usize::from(OUTSIDE) + 1..].iter().sum();
    100.0 * wrong / all
}
