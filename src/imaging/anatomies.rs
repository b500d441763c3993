//! Labelled volumes with closed-form geometry, for measurements and tests. World coordinates are in mm; a probe at the
//! identity pose looks from the origin along +y.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::sync::Arc;

use crate::effects::{Effects, blur::Blur, noise::Noise};
use crate::synth::FrameState;
use crate::synth::tables::{Anatomy, Settings};
use insonify_anatomy::acoustics::{Preset, Tissue, TissueTable, presets};
use insonify_anatomy::phantom::{Phantom, PhantomOptions, default_pose, make};
use insonify_anatomy::volume::texture::SolidTexture;
use insonify_anatomy::volume::{Label, LabelVolume};
use insonify_base::random::hash3;
use insonify_mesh::TetMesh;
use insonify_tracking::probe::{Linear, Probe, ProbeShape};
use nalgebra::{Matrix4, Rotation3, Translation3, Vector3};

/// Acoustics of one label.
#[derive(Clone, Copy, Debug)]
pub struct Acoustics {
    /// Mean echo, dB.
    pub echo_db: f64,
    /// One-way attenuation, dB/cm/MHz.
    pub attenuation_db_cm_mhz: f64,
    /// Occlusion per mm, 0 to 1.
    pub occlusion_per_mm: f64,
    /// Acoustic impedance, MRayl.
    pub impedance_mrayl: f64,
    /// Name of the texture, if any.
    pub texture: Option<&'static str>,
}

/// Acoustics with an echo of 0 dB and no other property.
pub const PLAIN: Acoustics = Acoustics {
    echo_db: 0.0,
    attenuation_db_cm_mhz: 0.0,
    occlusion_per_mm: 0.0,
    impedance_mrayl: 1.5,
    texture: None,
};

/// Acoustics of a label that returns no echo (-200 dB).
pub const SILENT: Acoustics = Acoustics {
    echo_db: -200.0,
    ..PLAIN
};

fn tissue(index: usize, acoustics: Acoustics) -> Tissue {
    Tissue {
        name: Cow::Owned(format!("tissue_{index}")),
        texture: acoustics.texture.map(Cow::Borrowed),
        texture_scale: 1.0,
        texture_direction: None,
        echogenicity_db: acoustics.echo_db,
        attenuation_db_cm_mhz: acoustics.attenuation_db_cm_mhz,
        occlusion_per_mm: acoustics.occlusion_per_mm,
        impedance_mrayl: acoustics.impedance_mrayl,
        ..presets::all()[0].clone()
    }
}

/// Voxel grid of a volume.
#[derive(Clone, Copy, Debug)]
pub struct Frame {
    /// Voxels along each axis, 1 or more.
    pub size: [usize; 3],
    /// Transform from voxel index to world, mm.
    pub index_to_world: Matrix4<f64>,
}

impl Frame {
    /// Creates a grid with equal spacing along all axes (mm), centred at `centre`.
    pub fn around(centre: [f64; 3], size: [usize; 3], spacing: f64) -> Self {
        let mut index_to_world = Matrix4::from_diagonal_element(spacing);
        index_to_world[(3, 3)] = 1.0;
        for axis in 0..3 {
            index_to_world[(axis, 3)] = centre[axis] - spacing * (size[axis] as f64 - 1.0) / 2.0;
        }
        Self { size, index_to_world }
    }

    /// Returns the grid turned about its centre, with a different spacing along each axis.
    pub fn oblique(self) -> Self {
        let middle = self.size.map(|n| (n as f64 - 1.0) / 2.0);
        let centre = self.index_to_world.transform_point(&middle.into());
        let turn = Rotation3::from_euler_angles(0.31, -0.52, 0.83).to_homogeneous();
        let stretch = Matrix4::new_nonuniform_scaling(&Vector3::new(0.9, 1.2, 1.05));
        let linear = turn
            * self
                .index_to_world
                .fixed_view::<3, 3>(0, 0)
                .into_owned()
                .to_homogeneous()
            * stretch;
        let back = Translation3::from(-Vector3::from(middle)).to_homogeneous();
        let index_to_world = Translation3::from(centre.coords).to_homogeneous() * linear * back;
        Self { index_to_world, ..self }
    }

    /// Returns the grid scaled by `factors` along the world axes, about the world origin.
    pub fn stretched(self, factors: [f64; 3]) -> Self {
        let index_to_world = Matrix4::new_nonuniform_scaling(&Vector3::from(factors)) * self.index_to_world;
        Self { index_to_world, ..self }
    }

    /// Returns the world bounding box of all voxels, mm.
    pub fn bounds(&self) -> [[f64; 3]; 2] {
        let mut bounds = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
        for corner in 0..8usize {
            let index = [0, 1, 2].map(|axis| (corner >> axis & 1) as f64 * self.size[axis] as f64 - 0.5);
            let world = self.index_to_world.transform_point(&index.into());
            for axis in 0..3 {
                bounds[0][axis] = bounds[0][axis].min(world[axis]);
                bounds[1][axis] = bounds[1][axis].max(world[axis]);
            }
        }
        bounds
    }
}

/// Creates an anatomy whose label at each voxel is `label(world position of the voxel's centre)`; label 0 is the
/// background, and label `i` has the acoustics `tissues[i]`.
///
/// # Panics
/// If the frame is empty or singular.
pub fn anatomy_from(frame: Frame, tissues: &[Acoustics], label: impl Fn([f64; 3]) -> u8) -> Anatomy {
    let [nx, ny, nz] = frame.size;
    let mut voxels = Vec::with_capacity(nx * ny * nz);
    for k in 0..nz {
        for j in 0..ny {
            for i in 0..nx {
                let world = frame
                    .index_to_world
                    .transform_point(&[i as f64, j as f64, k as f64].into());
                voxels.push(label([world.x, world.y, world.z]));
            }
        }
    }
    // One label for each tissue, in their order, so that a label indexes the tissue table directly.
    let labels = (0..tissues.len())
        .map(|index| Label {
            value: index as i64,
            name: None,
            voxels: voxels.iter().filter(|&&voxel| usize::from(voxel) == index).count() as u64,
        })
        .collect();
    let volume = LabelVolume::new(frame.size, voxels, labels, frame.index_to_world).expect("a volume");
    Anatomy {
        volume: Arc::new(volume),
        tissues: Arc::new(TissueTable {
            tissues: tissues
                .iter()
                .enumerate()
                .map(|(index, &acoustics)| tissue(index, acoustics))
                .collect(),
            of_label: (0..tissues.len() as u8).collect(),
            ..TissueTable::default()
        }),
        textures: BTreeMap::new(),
        mesh: None,
    }
}

/// Creates a single tissue that extends far beyond any beam used here.
pub fn uniform(acoustics: Acoustics) -> Anatomy {
    anatomy_from(
        Frame::around([0.0, 60.0, 0.0], [4, 4, 4], 100.0),
        &[SILENT, acoustics],
        |_| 1,
    )
}

/// Creates slabs perpendicular to y: label `i + 1` starts at `depths[i]` (mm), and label 0 lies above the first.
pub fn layers(frame: Frame, depths: &[f64], tissues: &[Acoustics]) -> Anatomy {
    anatomy_from(frame, tissues, |p| {
        depths.iter().filter(|&&depth| p[1] >= depth).count() as u8
    })
}

/// Creates a ball of label 2 in a box of label 1.
pub fn ball(frame: Frame, centre: [f64; 3], radius: f64, tissues: &[Acoustics]) -> Anatomy {
    anatomy_from(frame, tissues, |p| {
        let square: f64 = (0..3).map(|axis| (p[axis] - centre[axis]).powi(2)).sum();
        1 + u8::from(square <= radius * radius)
    })
}

/// Draws a random label for every voxel, so that every sample lies near a boundary.
///
/// # Panics
/// If the frame is empty or singular.
pub fn random(frame: Frame, tissues: &[Acoustics], seed: u32) -> Anatomy {
    let to_index = frame.index_to_world.try_inverse().expect("an invertible frame");
    anatomy_from(frame, tissues, |p| {
        let index = to_index.transform_point(&p.into());
        let point = [index.x, index.y, index.z].map(|x| x.round() as i32);
        (hash3(point, [seed, 77])[0] >> 8) as u8 % tissues.len() as u8
    })
}

/// Creates a texture of hashed amplitudes whose axes differ in length and spacing.
///
/// # Panics
/// Never: all amplitudes are above zero.
pub fn hashed_texture() -> Arc<SolidTexture> {
    let size = [9, 8, 7];
    let data = (0..size.iter().product::<usize>())
        .map(|index| 0.25 + insonify_base::random::unit(hash3([index as i32, 3, 5], [8, 13])[0]))
        .collect();
    Arc::new(SolidTexture::new(size, [1.1, 0.9, 1.4], data).expect("a texture"))
}

/// Adds a mesh of about `nodes` nodes over a box (mm) to an anatomy.
///
/// # Panics
/// If the box is empty.
pub fn with_mesh(mut anatomy: Anatomy, [min, max]: [[f64; 3]; 2], nodes: usize) -> Anatomy {
    anatomy.mesh = Some(Arc::new(TetMesh::over_box(min, max, nodes).expect("a mesh")));
    anatomy
}

/// Returns the two-layer phantom at 3 mm resolution under a linear probe, with all default effects and noise.
pub fn two_layers() -> (Anatomy, Settings, FrameState) {
    let coarse = PhantomOptions {
        resolution_mm: Some(3.0),
        seed: 1,
    };
    let volume = make(Phantom::TwoLayer, &coarse).unwrap();
    let (tissues, _) = TissueTable::resolve(volume.labels(), &[], Preset::Auto).unwrap();
    let anatomy = Anatomy {
        volume: Arc::new(volume),
        tissues: Arc::new(tissues),
        textures: BTreeMap::new(),
        mesh: None,
    };
    let shape = ProbeShape::Linear(Linear { width_mm: 38.0 });
    let mut probe = Probe::new(shape, 60.0).unwrap();
    (probe.lines, probe.samples) = (64, 32);
    let mut effects = Effects::usual();
    effects.blur = Some(Blur {
        width_mm: Some(0.6),
        growth_mm_cm: Some(0.06),
    });
    effects.noise = Some(Noise::default());
    let settings = Settings {
        seed: 1,
        ..Settings::new(probe, [32, 24], effects)
    };
    (anatomy, settings, FrameState::at(default_pose(Phantom::TwoLayer)))
}
