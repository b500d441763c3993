//! Whole frames: the pixels themselves.

use insonify_gpu::{Gpu, Readback, row_stride};
use insonify_imaging::effects::Effects;
use insonify_imaging::parity::check_lossy;
use insonify_imaging::synth::Synthesizer;

use super::case::{BIASES, Case, check_all};
use super::scenes;
use crate::support::gpu::{backend, gpu_or_skip, gpu_without_features};
use crate::support::image::assert_within;
use crate::support::scene::{self, SHAPES};

#[test]
fn all_effects_on_every_probe_shape() {
    let mut cases = Vec::new();
    for (at, (name, shape)) in SHAPES.into_iter().enumerate() {
        let mut settings = scene::settings(scene::probe(shape, 40.0, 24, 96), Effects::all());
        settings.has_needle = true;
        settings.effects.slice.boundary =
            [Default::default(), insonify_imaging::effects::slice::Boundary::Nearest][at % 2];
        settings.effects.thickness = None;
        let state = scenes::with_needle(scenes::oblique_pose());
        cases.push(Case::new(
            name,
            scenes::random_anatomy(),
            settings.clone(),
            state.clone(),
        ));
        settings.effects.thickness = Some(Default::default());
        settings.effects.noise = None;
        cases.push(Case::new(
            format!("{name}, thick"),
            scenes::oblique_anatomy(),
            settings,
            state,
        ));
    }
    check_all(&cases);
}

#[test]
fn all_effects_on_deforming_tissue_with_a_bent_needle() {
    let (anatomy, state) = scenes::pressed();
    let mut settings = scene::settings(scene::small_probe(), Effects::all());
    settings.has_needle = true;
    let state = scenes::with_needle(state);
    check_all(&[Case::new("pressed", anatomy, settings, state)]);
}

/// What a host reads through a texture of its own.
fn seen(gpu: &Gpu, texture: &wgpu::Texture) -> Vec<u8> {
    let (width, height) = (texture.width(), texture.height());
    let stride = row_stride(width);
    let mut readback = Readback::new(gpu, "texture", stride * u64::from(height)).expect("read-back");
    gpu.submit("texture", |recorder| {
        let buffer = readback.raw();
        let layout = wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(stride as u32),
            rows_per_image: None,
        };
        let to = wgpu::TexelCopyBufferInfo { buffer, layout };
        recorder
            .encoder()
            .copy_texture_to_buffer(texture.as_image_copy(), to, texture.size());
        Ok(())
    })
    .expect("a copy");
    let mut pixels = vec![0; (width * height) as usize];
    let (width, stride) = (width as usize, stride as usize);
    readback.read_rows(gpu, &mut pixels, width, stride).expect("pixels");
    pixels
}

#[test]
fn the_hosts_texture_shows_new_frames_after_a_change_of_settings() {
    let Some(gpu) = gpu_or_skip() else {
        return;
    };
    let settings = scene::settings(scene::small_probe(), Effects::all());
    let mut synth = Synthesizer::new(scenes::flat_layers(), settings, backend(gpu.clone())).expect("a synthesizer");
    let state = scene::straight();
    synth.render_to_texture(&state).expect("a frame");
    let texture = synth.texture().expect("a texture").clone();
    let before = seen(&gpu, &texture);

    let mut settings = synth.settings().clone();
    settings.effects.tone.get_or_insert_default().gain_db += 12.0;
    synth.set(settings.clone()).expect("more gain");
    synth.render_to_texture(&state).expect("a frame");
    assert_eq!(synth.texture(), Some(&texture));
    let after = seen(&gpu, &texture);
    assert_eq!(after, synth.render(&state).expect("a frame").pixels);
    assert_ne!(after, before);

    settings.image.width += 8;
    synth.set(settings).expect("a wider image");
    synth.render_to_texture(&state).expect("a frame");
    let wider = synth.texture().expect("a texture");
    assert_eq!(wider.width(), texture.width() + 8);
    assert_eq!(seen(&gpu, wider), synth.render(&state).expect("a frame").pixels);
}

#[test]
fn realistic_frames_differ_by_one_grey_level_at_most() {
    // Layers under a realistic grid: no sample is near a label's edge by design, so no bound is wide.
    let probe = scene::probe(SHAPES[1].1, 80.0, 128, 256);
    let mut effects = Effects::usual();
    effects.texture = None;
    let case = Case::new(
        "realistic",
        scenes::flat_layers(),
        scene::sized(probe, effects, 320, 240),
        scene::straight(),
    );
    let exact = case
        .exact()
        .expect("the reference")
        .render(&case.state)
        .expect("a frame")
        .pixels
        .clone();
    let gpus: Vec<_> = gpu_or_skip().into_iter().collect();
    let twins = case.twins(&gpus).expect("backends").into_iter();
    let frames = twins.map(|mut twin| twin.render(&case.state).expect("a frame").pixels.clone());
    let lossy = check_lossy(&case, &BIASES).expect("verdicts").into_iter();
    for pixels in frames.chain(lossy.map(|verdict| verdict.pixels.found)) {
        let allowed: Vec<[u8; 2]> = exact
            .iter()
            .map(|&g| [g.saturating_sub(1), g.saturating_add(1)])
            .collect();
        assert_within("realistic frame", [320, 240], &pixels, &exact, &allowed);
        assert!(
            exact.iter().filter(|&&grey| grey > 40).count() > 5000,
            "something is to be seen"
        );
    }
}

#[test]
fn an_image_larger_than_one_binding_is_cut_into_bands() {
    // 4,200 x 4,200 pixels: the scan map takes 141 MB, a binding holds 134 MB.
    let Some(gpu) = gpu_without_features() else {
        return;
    };
    let probe = scene::probe(SHAPES[2].1, 40.0, 8, 16);
    let mut effects = scene::bare();
    effects.noise = Some(Default::default());
    // A middle grey, so that the noise of the last rows shows unclamped.
    effects.tone = Some(Default::default());
    let case = Case::new(
        "large",
        scenes::flat_layers(),
        scene::sized(probe, effects, 4200, 4200),
        scene::straight(),
    );
    let mut on_gpu = case.on(backend(gpu.clone())).expect("the GPU");
    let bands = on_gpu
        .plan()
        .bands(on_gpu.tables(), gpu.limits().max_storage_buffer_binding_size);
    assert!(bands.len() > 1, "the image must not fit one binding: {bands:?}");
    let found = on_gpu.render(&case.state).expect("a frame").pixels.clone();
    drop(on_gpu);
    let mut on_cpu = case.on(insonify_imaging::synth::Backend::Cpu).expect("the CPU");
    let expected = &on_cpu.render(&case.state).expect("a frame").pixels;
    let allowed: Vec<[u8; 2]> = expected
        .iter()
        .map(|&g| [g.saturating_sub(1), g.saturating_add(1)])
        .collect();
    assert_within("several bands", [4200, 4200], &found, expected, &allowed);
    let differing = found.iter().zip(expected).filter(|(a, b)| a != b).count();
    println!("{differing} of {} pixels differ by one grey level", found.len());
}
