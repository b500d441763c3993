use super::*;

#[test]
fn an_opaque_run_saturates_and_stays_dark() {
    let mut sums = Sums::default();
    let down_to: Vec<u32> = (0..8192)
        .map(|sample| {
            sums.add(sample % BLOCK, [0, units(1e9)]);
            felt(sums.down_to.map(|sums| sums[sample % BLOCK]), [0.0f64; 2])
        })
        .collect();
    assert!(down_to.is_sorted());
    assert_eq!(down_to[8191], MAX_UNITS);
    assert_eq!(transmittance::<f32>(down_to[8191]), 0.0);
}

#[test]
fn what_the_voxels_hold_decides_not_what_a_file_counted() {
    use std::sync::Arc;

    use nalgebra::Matrix4;

    use crate::effects::Effects;
    use crate::synth::tables::{Anatomy, Settings};
    use insonify_anatomy::acoustics::{Preset, TissueTable};
    use insonify_anatomy::volume::LabelVolume;
    use insonify_tracking::probe::{Linear, Probe};

    let with = |voxels: Vec<u8>, counted: u64| {
        let label = |value, name: &str| insonify_anatomy::volume::Label {
            value,
            name: Some(name.into()),
            voxels: counted,
        };
        let labels = vec![label(0, "background"), label(1, "bone")];
        let (tissues, _) = TissueTable::resolve(&labels, &[], Preset::Auto).expect("two known tissues");
        let volume = LabelVolume::new([2, 1, 1], voxels, labels, Matrix4::identity()).expect("two voxels");
        let anatomy = Anatomy {
            volume: Arc::new(volume),
            tissues: Arc::new(tissues),
            textures: Default::default(),
            mesh: None,
        };
        let probe = Probe::new(Linear { width_mm: 40.0 }, 40.0).expect("a probe");
        let settings = Settings::new(probe, [8; 2], Effects::usual());
        wanted(&Tables::new(anatomy, settings).expect("tables"))
    };
    assert_eq!(with(vec![0, 1], 0), Wanted::Yes("1 labels attenuate or occlude".into()));
    assert!(matches!(with(vec![0, 0], 1), Wanted::No(_)));
}
