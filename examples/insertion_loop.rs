//! How does a training simulator drive tissue, needle and images? Steps run on a haptic thread at 1 kHz, frames on
//! another thread of the latest whole state; neither waits for the other. A needle with a bevel goes into a block and
//! comes out again; rate and jitter of both threads are printed.
//!
//! `cargo run --release --example insertion_loop -- 10` (seconds; 10 if left out)

use std::error::Error;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use insonify::{
    BEVEL_MM, Backend, Bevel, Finite, FiniteOptions, Flexible, Haptic, Imaging, Instruments, Interaction, LINK_MM,
    Level, Material, Policy, Precision, SceneFile, Setup, Shaft, Simulator, SimulatorOptions, Stiffness, Synthesizer,
    TetMesh,
};
use nalgebra::{Isometry3, Matrix4, Point3, Vector3};

/// The scene. The block is 90 x 80 x 90 mm around the origin; the probe looks along -z from one face, and the
/// needle comes along z through the opposite one. The needle here only asks for its effect: where it is, the steps say.
const SCENE: &str = r#"
volume = { phantom = "two-layer", resolution_mm = 1.0 }
needle = { tip_mm = [8, 0, -40], entry_mm = [8, 0, -45] }
"#;

const TICK: Duration = Duration::from_millis(1);
const SHAFT: Shaft = Shaft {
    length_mm: 200.0,
    radius_mm: 0.64,
};
/// Point where the needle enters, mm, and its depth beyond.
const ENTRY_MM: [f64; 3] = [8.0, 0.0, -45.0];
const DEPTH_MM: f64 = 60.0;

fn main() -> Result<(), Box<dyn Error>> {
    let seconds: f64 = std::env::args().nth(1).map_or(Ok(10.0), |seconds| seconds.parse())?;
    if !(seconds.is_finite() && seconds > 0.0) {
        return Err(format!("it runs for {seconds} s; expected a number above 0").into());
    }
    let scene = SceneFile::parse(SCENE, "insertion_loop")?.resolve(".".as_ref())?;
    let probe = *scene.probe_pose(0, 1).probe_to_world();
    let mesh = block()?;
    let mut anatomy = scene.anatomy;
    anatomy.mesh = Some(Arc::new(mesh.clone()));
    let synthesizer = Synthesizer::new(anatomy, scene.settings, Backend::Cpu)?;
    let options = SimulatorOptions {
        budget: TICK,
        policy: Policy::Ease {
            over: Duration::from_millis(20),
        },
        ..SimulatorOptions::default()
    };
    let simulator = Simulator::new(Box::new(model(mesh)?), synthesizer, 2.0 * SHAFT.radius_mm, options)?;
    let (haptic, imaging) = simulator.split();

    let over = AtomicBool::new(false);
    let (steps, frames) = thread::scope(|scope| {
        let images = scope.spawn(|| image(imaging, &probe, &over));
        let steps = step(haptic, seconds);
        over.store(true, Ordering::Relaxed);
        (steps, images.join())
    });
    let (step_times, overruns) = steps?;
    let frame_times = frames.map_err(|_| "the image thread panicked")??;
    println!("steps, {overruns} over their budget of {TICK:?}");
    step_times.print("step");
    println!("frames of {} threads", image_threads());
    frame_times.print("frame");
    Ok(())
}

/// A mesh over the block.
fn block() -> Result<TetMesh, Box<dyn Error>> {
    let size = Vector3::new(90.0, 80.0, 90.0);
    let to_world = Matrix4::new_translation(&(-size / 2.0)) * Matrix4::new_nonuniform_scaling(&size);
    Ok(TetMesh::over_affine_box(&to_world, 3300)?)
}

/// Soft tissue, held at the face y = -40 mm, and a brachytherapy needle.
fn model(mesh: TetMesh) -> Result<Finite, Box<dyn Error>> {
    let clamped = |&node: &u32| mesh.nodes()[node as usize][1] < -39.9;
    let fixed = (0..mesh.nodes().len() as u32).filter(clamped);
    let bevel = Bevel {
        r_mm: 0.6,
        length_mm: BEVEL_MM,
    };
    let tissue = Interaction {
        friction_n_per_mm: 0.01,
        cutting_n: 0.5,
        puncture_n: 1.0,
        ..Interaction::default()
    };
    let mut model = Finite::new(
        Setup {
            materials: vec![Material::new(20.0, 0.45)?; mesh.elements().len()],
            fixed: fixed.flat_map(|node| [0, 1, 2].map(|axis| (node, axis))).collect(),
            interactions: vec![(mesh.regions()[0], tissue)],
            anatomy: None,
            needle: Box::new(Flexible::springs(SHAFT, Stiffness::default(), LINK_MM, Some(bevel))?),
            probe: None,
            level: Level::Exact,
            precision: Precision::Double,
            options: FiniteOptions::default(),
            mesh,
        },
        |_, _| {},
    )?;
    model.prefetch(&Point3::from(ENTRY_MM), &Vector3::z(), DEPTH_MM, 5.0);
    Ok(model)
}

/// The hand: it pushes the needle in and pulls it out once in ten seconds.
fn instruments(time_s: f64) -> Instruments {
    let reach = DEPTH_MM * (0.5 - 0.5 * (std::f64::consts::TAU * time_s / 10.0).cos());
    let [x, y, z] = ENTRY_MM;
    Instruments {
        base: Isometry3::translation(x, y, z - 1.0 + reach - SHAFT.length_mm),
        probe: None,
        guide: None,
        deposit: false,
    }
}

/// Steps at 1 kHz. A device would read its pose before each and render the forces after it.
fn step(mut haptic: Haptic, seconds: f64) -> Result<(Times, usize), Box<dyn Error>> {
    let (mut times, mut overruns) = (Times::default(), 0);
    let begin = Instant::now();
    let mut due = begin;
    while begin.elapsed().as_secs_f64() < seconds {
        times.begin();
        let forces = haptic.step(&instruments(haptic.time_s()), TICK.as_secs_f64())?;
        times.end();
        overruns += usize::from(forces.overrun.is_some());
        // After a late step the next deadline counts from now.
        due = (due + TICK).max(Instant::now());
        wait(due);
    }
    Ok((times, overruns))
}

/// Sleeps most of the time, for sleep is not exact, and spins the rest.
fn wait(due: Instant) {
    const SPIN: Duration = Duration::from_micros(200);
    while let Some(left) = due
        .checked_duration_since(Instant::now())
        .filter(|left| !left.is_zero())
    {
        if left > SPIN {
            thread::sleep(left - SPIN);
        } else {
            std::hint::spin_loop();
        }
    }
}

/// Leaves one core to the haptic thread.
fn image_threads() -> usize {
    thread::available_parallelism().map_or(1, |cores| (cores.get() - 1).max(1))
}

/// Renders as fast as frames come.
fn image(mut imaging: Imaging, probe: &Matrix4<f64>, over: &AtomicBool) -> Result<Times, String> {
    let pool = insonify_base::parallel::Pool::new(image_threads());
    let pool = pool.map_err(|error| error.to_string())?;
    let mut times = Times::default();
    while !over.load(Ordering::Relaxed) {
        times.begin();
        let rendered = pool.install(|| imaging.frame(probe).map(drop));
        rendered.map_err(|error| error.to_string())?;
        times.end();
    }
    Ok(times)
}

/// When things began, and how long they took.
#[derive(Default)]
struct Times {
    begun: Vec<Instant>,
    took_ms: Vec<f64>,
}

impl Times {
    fn begin(&mut self) {
        self.begun.push(Instant::now());
    }

    fn end(&mut self) {
        self.took_ms.extend(self.begun.last().map(|begun| ms(begun.elapsed())));
    }

    fn print(&self, name: &str) {
        let periods: Vec<f64> = self.begun.windows(2).map(|pair| ms(pair[1] - pair[0])).collect();
        let span_s = periods.iter().sum::<f64>() / 1e3;
        println!(
            "  {} in {span_s:.1} s: {:.0} a second",
            self.begun.len(),
            periods.len() as f64 / span_s
        );
        print_spread("period", periods);
        print_spread(name, self.took_ms.clone());
    }
}

fn ms(time: Duration) -> f64 {
    time.as_secs_f64() * 1e3
}

fn print_spread(name: &str, mut times: Vec<f64>) {
    times.sort_by(f64::total_cmp);
    let at = |share: f64| {
        times
            .get((share * (times.len() as f64 - 1.0)).round() as usize)
            .copied()
    };
    let [median, p95, p99, max] = [0.5, 0.95, 0.99, 1.0].map(|share| at(share).unwrap_or(f64::NAN));
    println!("  {name:>6} ms: median {median:.3}, p95 {p95:.3}, p99 {p99:.3}, max {max:.3}");
}
