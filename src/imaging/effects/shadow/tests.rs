use super::*;

#[test]
fn layers_follow_beer_and_lambert() {
    // 30 mm at 1 dB/mm, then 20 mm at 0.25 dB/mm, sampled ever finer; the last sample's centre lies half a step short.
    for samples in [50usize, 500, 5000] {
        let step = 50.0 / samples as f64;
        let mut down_to = vec![0; samples];
        let own = |i: usize| {
            units(if (i as f64) * step < 30.0 - 1e-9 {
                step
            } else {
                0.25 * step
            })
        };
        accumulate(own, &mut down_to);
        let expected = 30.0 + 0.25 * (20.0 - step / 2.0);
        let found = f64::from(down_to[samples - 1]) / UNITS_PER_DB;
        assert!(
            (found - expected).abs() < 1e-4 * expected,
            "{samples}: {found} dB, not {expected}"
        );
        let amplitude: f64 = transmittance(down_to[samples - 1]);
        assert!((amplitude / 10f64.powf(-expected / 20.0) - 1.0).abs() < 1e-3);
    }
}

#[test]
fn an_opaque_run_saturates_and_stays_dark() {
    let mut down_to = vec![0; 8192];
    accumulate(|_| units(1e9), &mut down_to);
    assert!(down_to.is_sorted());
    assert_eq!(down_to[8191], MOST_UNITS);
    assert_eq!(transmittance::<f32>(down_to[8191]), 0.0);
}

#[test]
fn what_the_voxels_hold_decides_not_what_a_file_counted() {
    use std::sync::Arc;

    use nalgebra::Matrix4;

    use crate::anatomy::acoustics::{Preset, TissueTable};
    use crate::anatomy::volume::LabelVolume;
    use crate::imaging::effects::Effects;
    use crate::imaging::synth::tables::{Anatomy, ImageSize, Settings};
    use crate::tracking::probe::{Probe, ProbeShape};

    let verdict = |voxels: Vec<u8>, counted: u64| {
        let label = |value, name: &str| crate::anatomy::volume::Label {
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
        let settings = Settings {
            seed: 0,
            probe: Probe::new(ProbeShape::Linear { width_mm: 40.0 }, 40.0).expect("a probe"),
            image: ImageSize {
                width: 8,
                height: 8,
                margin: 0.0,
                fill: 0,
                placed: None,
            },
            effects: Effects::usual(),
            has_needle: false,
        };
        wanted(&Tables::new(anatomy, settings).expect("tables"))
    };
    assert_eq!(verdict(vec![0, 1], 0), Ok("1 labels attenuate or occlude".into()));
    assert!(verdict(vec![0, 0], 1).is_err());
}
