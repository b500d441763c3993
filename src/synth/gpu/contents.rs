//! Initial contents of the buffers of a plan.

use crate::effects::pass::{Band, Resource};
use crate::synth::tables::Tables;

/// Contents of a buffer before the first frame; empty for buffers that passes write first.
pub(super) fn contents(resource: Resource, tables: &Tables, band: Band) -> Vec<u8> {
    let floats = |values: &[f32]| bytemuck::cast_slice(values).to_vec();
    match resource {
        Resource::Rays => floats(&tables.rays.iter().flatten().map(|&x| x as f32).collect::<Vec<_>>()),
        Resource::Element => vec![0xff; tables.bytes(resource) as usize],
        Resource::Voxels => {
            let mut bytes = tables.volume.voxels().to_vec();
            bytes.resize(bytes.len().next_multiple_of(4), 0);
            bytes
        }
        Resource::LabelRows => bytemuck::cast_slice(&tables.label_rows).to_vec(),
        Resource::TextureEntries => tables
            .atlas
            .as_ref()
            .map_or(Vec::new(), |atlas| bytemuck::cast_slice(&atlas.entries).to_vec()),
        Resource::TextureAtlas => tables.atlas.as_ref().map_or(Vec::new(), |atlas| floats(&atlas.data)),
        Resource::AxialKernel => tables.speckle.as_ref().map_or(Vec::new(), |speckle| {
            floats(&[speckle.axial.of::<f32>(), speckle.ends.of(), speckle.specular.of()].concat())
        }),
        Resource::LateralKernel => tables.speckle.as_ref().map_or(Vec::new(), |speckle| {
            floats(&[speckle.lateral.weights.of::<f32>(), speckle.edges.of()].concat())
        }),
        Resource::BlurKernel => tables
            .blur
            .as_ref()
            .map_or(Vec::new(), |kernel| floats(kernel.weights.of())),
        Resource::PenumbraKernel => tables
            .penumbra
            .as_ref()
            .map_or(Vec::new(), |kernel| floats(kernel.weights.of())),
        Resource::ApertureShifts => bytemuck::cast_slice(&tables.aperture).to_vec(),
        Resource::Clutter => floats(&tables.clutter),
        Resource::Gain => floats(tables.gain.of()),
        Resource::ScanMap => {
            let first = band.first_row as usize * tables.width();
            bytemuck::cast_slice(&tables.scan_map[first..][..band.rows as usize * tables.width()]).to_vec()
        }
        _ => Vec::new(),
    }
}
