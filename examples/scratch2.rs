use insonify::effects::*;
use insonify::synth::{tables::*, *};
use insonify::tracking::{pose::Pose, probe::*};
use std::sync::Arc;
fn main() {
    let volume = insonify::phantom::make(insonify::phantom::Phantom::Abdomen, &Default::default()).unwrap();
    let (tissues, _) = insonify::tissue::TissueTable::resolve(volume.labels(), &[], Default::default()).unwrap();
    let probe = Probe::new(ProbeShape::Curvilinear { radius_mm: 60.0, angle_deg: 70.0 }, 150.0).unwrap();
    let colours: Vec<[u8; 3]> = (0..volume.labels().len()).map(|l| tissues.of(l as u8).colour).collect();
    let anatomy = Anatomy { volume: Arc::new(volume), tissues: Arc::new(tissues), textures: Default::default(), mesh: None };
    let (w, h) = (640, 480);
    let settings = Settings { seed: 1, probe, image: ImageSize { width: w, height: h, margin: 0.02, fill: 0 }, effects: Effects::usual(), has_needle: false };
    let pose = Pose::from_matrix(&insonify::phantom::default_pose(insonify::phantom::Phantom::Abdomen)).unwrap();
    println!("{}", pose.probe_to_world());
    let mut synth = Synthesizer::new(anatomy.clone(), settings.clone(), Backend::Cpu).unwrap();
    let args: Vec<f64> = std::env::args().skip(1).map(|a| a.parse().unwrap()).collect();
    let n = args.len() / 6;
    let mut sheet = vec![0u8; w * h * n * 2 * 3];
    let sw = w * 2;
    for v in 0..n {
        let a = &args[v * 6..][..6];
        // dx dy dz in probe frame, rotate rock tilt deg
        let p = pose.turned(a[3].to_radians(), a[4].to_radians(), a[5].to_radians());
        let mut m = *p.probe_to_world();
        let d = p.probe_to_world().transform_vector(&nalgebra::Vector3::new(a[0], a[1], a[2]));
        for i in 0..3 { m[(i, 3)] += d[i]; }
        let st = FrameState::at(m);
        let f = synth.render(&st).unwrap().clone();
        let b = synth.beam().unwrap();
        let lab = layers::Layer::Labels.image(&b, synth.tables(), &m);
        for y in 0..h { for x in 0..w {
            let g = f.pixels[y * w + x];
            let o = ((v * h + y) * sw + x) * 3;
            sheet[o..o + 3].copy_from_slice(&[g, g, g]);
            let o = ((v * h + y) * sw + w + x) * 3;
            sheet[o..o + 3].copy_from_slice(&colours[lab[y * w + x] as usize]);
        } }
    }
    insonify::output::png::write_rgb("/tmp/sheet.png".as_ref(), sw, h * n, &sheet).unwrap();
}
