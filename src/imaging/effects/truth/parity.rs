//! Ground truth: every layer on every backend, alone and in a batch.

use insonify_imaging::synth::layers::Layer;
use insonify_imaging::synth::{Backend, SynthError, Synthesizer};

use crate::support::gpu::{backend, gpu_or_skip};
use crate::support::scene::{everything, frame_of};

/// Share of the pixels whose labels differ where a sample lies within rounding of a face, and with them what is derived
/// of labels.
const TORN: f64 = 2e-3;

#[test]
fn layers_follow_the_reference() {
    let (anatomy, mut settings, _) = everything();
    settings.layers = Layer::ALL.to_vec();
    let states: Vec<_> = (0..5).map(|frame| frame_of(&anatomy, frame)).collect();
    let render = |backend: Backend| {
        let mut synth = Synthesizer::new(anatomy.clone(), settings.clone(), backend).expect("a synthesizer");
        let mut layers = Vec::new();
        let sunk = synth.render_batch(&states, |_, frame| {
            layers.push(frame.layers.clone());
            Ok::<_, SynthError>(())
        });
        sunk.expect("a batch");
        layers
    };
    let expected = render(Backend::CpuF64);
    let others = [Backend::Cpu].into_iter().chain(gpu_or_skip().map(backend));
    for (backend, found) in others.map(render).enumerate() {
        assert_eq!(found.len(), expected.len());
        for (found, expected) in found.iter().zip(&expected) {
            for (layer, (found, expected)) in Layer::ALL.iter().zip(found.iter().zip(expected)) {
                let pairs = || found.iter().zip(expected).map(|(&a, &b)| a.abs_diff(b));
                let unit = match layer {
                    Layer::LabelValue | Layer::LabelIndex | Layer::Sector | Layer::Beyond => 0,
                    _ => 1,
                };
                let torn = pairs().filter(|&difference| difference > unit).count() as f64 / expected.len() as f64;
                assert!(torn <= TORN, "{layer:?}, backend {backend}: {torn}");
                // Every layer says something here, but what is beyond the volume.
                let said = expected.iter().any(|&value| value > 0);
                assert!(said || *layer == Layer::Beyond, "{layer:?}");
            }
        }
    }
}
