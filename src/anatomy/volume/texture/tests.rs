use super::*;
use insonify_base::random::{hash3, unit};
use proptest::prelude::*;

fn noise(size: [usize; 3]) -> Vec<f32> {
    let mut data = Vec::new();
    for k in 0..size[2] {
        for j in 0..size[1] {
            for i in 0..size[0] {
                data.push(0.1 + unit(hash3([i as i32, j as i32, k as i32], [3, 4])[0]));
            }
        }
    }
    data
}

fn mean_square(data: &[f32]) -> f64 {
    data.iter().map(|&x| f64::from(x).powi(2)).sum::<f64>() / data.len() as f64
}

#[test]
fn mean_square_is_one_and_voxel_centres_are_exact() {
    let texture = SolidTexture::new([5, 4, 3], [0.5, 1.0, 2.0], noise([5, 4, 3])).unwrap();
    assert!((mean_square(texture.data()) - 1.0).abs() < 1e-6);
    for (at, &value) in texture.data().iter().enumerate() {
        let position = [
            (at % 5) as f64 * 0.5 - 2.5,
            (at / 5 % 4) as f64 + 8.0,
            (at / 20) as f64 * 2.0 - 12.0,
        ];
        assert_eq!(texture.sample(position), f64::from(value));
        assert_eq!(texture.sample(position.map(|x| x as f32)), value);
    }
}

#[test]
fn a_linear_ramp_is_exact_away_from_the_wrap() {
    let (size, spacing) = ([8, 7, 6], [0.5, 0.75, 1.25]);
    let plane = |[x, y, z]: [f64; 3]| 2.0 + 0.5 * x - 0.25 * y + 0.125 * z;
    let mut data = Vec::new();
    for k in 0..6 {
        for j in 0..7 {
            for i in 0..8 {
                data.push(plane([f64::from(i) * 0.5, f64::from(j) * 0.75, f64::from(k) * 1.25]) as f32);
            }
        }
    }
    let factor = 1.0 / mean_square(&data).sqrt();
    let texture = SolidTexture::new(size, spacing, data).unwrap();
    let mut worst: f64 = 0.0;
    for n in 0..2000 {
        let words = hash3([n, 1, 2], [5, 6]);
        let position = [0, 1, 2].map(|axis| f64::from(unit(words[axis])) * (size[axis] - 1) as f64 * spacing[axis]);
        let expected = plane(position) * factor;
        worst = worst.max((texture.sample(position) - expected).abs());
        let single = f64::from(texture.sample(position.map(|x| x as f32)));
        assert!((single - expected).abs() < 1e-6);
    }
    // Voxels are stored as f32: half a unit in the last place of numbers below 2.
    assert!(worst < 1.2e-7, "{worst}");
}

#[test]
fn size_one_is_constant_along_that_axis() {
    let dot = SolidTexture::new([1, 1, 1], [0.3; 3], vec![7.0]).unwrap();
    assert_eq!(dot.sample([1234.5, -0.01, 1e9]), 1.0);
    let rod = SolidTexture::new([4, 1, 1], [1.0; 3], vec![1.0, 2.0, 3.0, 4.0]).unwrap();
    assert_eq!(rod.sample([1.25, 0.0, 0.0]), rod.sample([5.25, -17.3, 22.9]));
}

#[test]
fn the_wrap_joins_the_last_voxel_to_the_first() {
    let texture = SolidTexture::new([5, 4, 3], [0.5, 1.0, 2.0], noise([5, 4, 3])).unwrap();
    for (axis, period) in texture.period_mm().into_iter().enumerate() {
        for start in [[0.0; 3], [0.3, 1.7, 3.9]] {
            let at = |along: f64| {
                let mut position: [f64; 3] = start;
                position[axis] = along;
                texture.sample(position)
            };
            let last = period - texture.spacing_mm()[axis];
            assert!((at(period - 1e-9) - at(0.0)).abs() < 1e-7 && (at(-1e-9) - at(0.0)).abs() < 1e-7);
            assert!((at(0.5 * (last + period)) - 0.5 * (at(last) + at(0.0))).abs() < 1e-7);
        }
    }
}

proptest! {
    #[test]
    fn it_repeats_and_is_continuous_everywhere(x in -50.0..50.0f64, y in -50.0..50.0f64, z in -50.0..50.0f64) {
        let texture = SolidTexture::new([5, 4, 3], [0.5, 1.0, 2.0], noise([5, 4, 3])).unwrap();
        let here = texture.sample([x, y, z]);
        prop_assert!((here - texture.sample([x + 2.5, y - 8.0, z + 6.0])).abs() < 1e-9);
        // No two voxels differ by more than 1.1 before scaling by at most 2, over at least 0.5 mm.
        prop_assert!((here - texture.sample([x + 1e-6, y, z])).abs() < 1e-5);
    }

    #[test]
    fn no_position_is_out_of_bounds(bits in prop::array::uniform3(any::<u64>())) {
        let texture = SolidTexture::new([5, 4, 3], [0.5, 1.0, 2.0], noise([5, 4, 3])).unwrap();
        texture.sample(bits.map(f64::from_bits));
        texture.sample(bits.map(|bits| f32::from_bits(bits as u32)));
    }
}

/// Mean absolute step across the seam and inside, along each axis.
fn steps(texture: &SolidTexture) -> [(f64, f64); 3] {
    let size = texture.size();
    [0, 1, 2].map(|axis| {
        let (mut seam, mut inside, mut seams, mut insides) = (0.0, 0.0, 0, 0);
        for at in 0..texture.data().len() {
            let voxel = [at % size[0], at / size[0] % size[1], at / size[0] / size[1]];
            let mut next = voxel;
            next[axis] = (voxel[axis] + 1) % size[axis];
            let other = next[0] + size[0] * (next[1] + size[1] * next[2]);
            let step = f64::from((texture.data()[at] - texture.data()[other]).abs());
            if next[axis] == 0 {
                (seam, seams) = (seam + step, seams + 1);
            } else {
                (inside, insides) = (inside + step, insides + 1);
            }
        }
        (seam / f64::from(seams), inside / f64::from(insides.max(1)))
    })
}

#[test]
fn mirror_and_cross_fade_leave_no_step_at_the_seam() {
    let size = [20, 16, 12];
    let ramp: Vec<f32> = (0..20 * 16 * 12)
        .map(|at| 1.0 + (at % 20 + at / 20 % 16 + at / 320) as f32)
        .collect();
    let open = TextureOptions {
        seam: Seam::Periodic,
        ..TextureOptions::default()
    };
    let open = SolidTexture::from_scalar(size, [1.0; 3], ramp.clone(), &open).unwrap();
    assert!(
        steps(&open).iter().all(|(seam, inside)| *seam > 5.0 * inside),
        "the ramp must have a seam to close"
    );

    for (seam, expected) in [
        (Seam::Mirror, [40, 32, 24]),
        (Seam::CrossFade { share: 0.25 }, [15, 12, 9]),
    ] {
        let options = TextureOptions {
            seam,
            ..TextureOptions::default()
        };
        let closed = SolidTexture::from_scalar(size, [1.0; 3], ramp.clone(), &options).unwrap();
        assert_eq!(closed.size(), expected);
        assert!((mean_square(closed.data()) - 1.0).abs() < 1e-6);
        for (across, inside) in steps(&closed) {
            assert!(
                across <= 1.01 * inside,
                "{seam:?}: {across} across the seam, {inside} inside"
            );
        }
    }
}

#[test]
fn cross_fade_keeps_the_contrast_of_noise() {
    let options = TextureOptions {
        seam: Seam::CrossFade { share: 0.5 },
        ..TextureOptions::default()
    };
    let texture = SolidTexture::from_scalar([64, 64, 1], [1.0; 3], noise([64, 64, 1]), &options).unwrap();
    let spread = |data: &[f32]| {
        let mean = data.iter().map(|&x| f64::from(x)).sum::<f64>() / data.len() as f64;
        (mean_square(data) - mean * mean).sqrt() / mean
    };
    let (before, after) = (spread(&noise([64, 64, 1])), spread(texture.data()));
    assert!((after / before - 1.0).abs() < 0.05, "{before} {after}");
}

#[test]
fn log_values_are_decibels_apart() {
    let options = TextureOptions {
        values: Values::Log {
            db_per_unit: 60.0 / 255.0,
        },
        seam: Seam::Periodic,
    };
    let texture = SolidTexture::from_scalar([2, 1, 1], [1.0; 3], vec![0.0, 255.0], &options).unwrap();
    let ratio_db = 20.0 * (texture.data()[1] / texture.data()[0]).log10();
    assert!((ratio_db - 60.0).abs() < 1e-4);
}

#[test]
fn bad_input_is_refused_with_its_values() {
    let make =
        |size, spacing, data: Vec<f32>| SolidTexture::from_scalar(size, spacing, data, &TextureOptions::default());
    let refused = |result: Result<SolidTexture, VolumeError>, text: &str| {
        let error = result.expect_err(text).to_string();
        assert!(error.starts_with(text), "{error}");
    };
    refused(make([0, 1, 1], [1.0; 3], vec![]), "size [0, 1, 1]: expected 1 to 16384");
    refused(
        make([usize::MAX, 2, 2], [1.0; 3], vec![]),
        "size [18446744073709551615, 2, 2]",
    );
    refused(
        make([1, 1, 1], [1.0, 0.0, 1.0], vec![1.0]),
        "spacing [1.0, 0.0, 1.0] mm",
    );
    refused(
        make([1, 1, 1], [1.0, f64::NAN, 1.0], vec![1.0]),
        "spacing [1.0, NaN, 1.0] mm",
    );
    refused(make([2, 1, 1], [1.0; 3], vec![1.0]), "1 voxels for a size that needs 2");
    let negative = SolidTexture::new([3, 1, 1], [1.0; 3], vec![1.0, -1.0, 1.0]);
    refused(negative, "voxel 1 has amplitude -1: expected finite numbers from 0");
    refused(
        make([1, 1, 1], [1.0; 3], vec![f32::INFINITY]),
        "voxel 0 has amplitude inf",
    );
    refused(make([1, 1, 1], [1.0; 3], vec![0.0]), "every voxel is 0");
    let options = TextureOptions {
        seam: Seam::CrossFade { share: 0.6 },
        ..TextureOptions::default()
    };
    let error = SolidTexture::from_scalar([1, 1, 1], [1.0; 3], vec![1.0], &options).unwrap_err();
    assert_eq!(error.to_string(), "share = 0.6, expected above 0 to 0.5");
}

#[test]
fn an_atlas_samples_each_texture_where_it_was_placed() {
    let a = SolidTexture::new([5, 4, 3], [0.5, 1.0, 2.0], noise([5, 4, 3])).unwrap();
    let b = SolidTexture::new([3, 6, 2], [0.7; 3], noise([3, 6, 2])).unwrap();
    let quarter_turn = Placement {
        rotation: [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
        scale: 2.0,
    };
    let atlas = Atlas::pack(&[(&a, Placement::default()), (&b, quarter_turn), (&a, quarter_turn)]).unwrap();
    assert_eq!(atlas.data.len(), a.data().len() + b.data().len());
    assert_eq!(
        atlas.entries.iter().map(|entry| entry.offset).collect::<Vec<_>>(),
        [0, 60, 0]
    );
    let [x, y, z]: [f64; 3] = [1.3, -2.7, 0.4];
    let turned = [y / 2.0, -x / 2.0, z / 2.0];
    for (entry, expected) in [(0, a.sample([x, y, z])), (1, b.sample(turned)), (2, a.sample(turned))] {
        assert!((atlas.sample(entry, [x, y, z]) - expected).abs() < 1e-6);
    }
}

#[test]
fn the_shader_struct_has_the_layout_of_the_entry() {
    let bindings = "@group(0) @binding(0) var<storage, read> atlas: array<f32>;\n\
                    @group(0) @binding(1) var<storage, read> textures: array<TextureEntry>;\n";
    let source = concat!(include_str!("../../../../shaders/common/texture.wgsl"));
    let module = naga::front::wgsl::parse_str(&format!("{bindings}{source}")).unwrap();
    naga::valid::Validator::new(naga::valid::ValidationFlags::all(), naga::valid::Capabilities::empty())
        .validate(&module)
        .unwrap();
    let (_, entry) = module
        .types
        .iter()
        .find(|(_, ty)| ty.name.as_deref() == Some("TextureEntry"))
        .unwrap();
    let naga::TypeInner::Struct { members, span } = &entry.inner else {
        panic!("TextureEntry is no struct");
    };
    let offsets: Vec<(&str, usize)> = members
        .iter()
        .map(|member| (member.name.as_deref().unwrap(), member.offset as usize))
        .collect();
    let row = std::mem::offset_of!(AtlasEntry, to_voxel);
    let expected = [
        ("to_voxel_x", row),
        ("to_voxel_y", row + 16),
        ("to_voxel_z", row + 32),
        ("size", std::mem::offset_of!(AtlasEntry, size)),
        ("offset", std::mem::offset_of!(AtlasEntry, offset)),
    ];
    assert_eq!(offsets, expected);
    assert_eq!(*span as usize, size_of::<AtlasEntry>());
}

proptest::proptest! {
    #[test]
    fn wrapping_is_the_euclidean_remainder(index in -4_000_000i32..4_000_000, length in 1i32..5000) {
        proptest::prop_assert_eq!(super::wrap(index, length), index.rem_euclid(length) as u32);
    }

    #[test]
    fn wrapping_never_leaves_the_texture(index in proptest::num::i32::ANY, length in 1i32..5000) {
        proptest::prop_assert!(super::wrap(index, length) < length as u32);
    }
}
