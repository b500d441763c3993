//! How do haptic devices drive a brachytherapy needle and a transrectal probe? As in Goksel et al. 2011 (section V-C):
//! the device of the needle is held across its axis, is given the force along it, and goes through one hole of a
//! template after another without moving aside; two devices of three axes hold the probe at two points, and are damped.
//! Devices are masses here, and a script is the hand.
//!
//! `cargo run --release --example haptics`

use std::error::Error;

use insonify::{
    BEVEL_MM, Bevel, Damper, Finite, FiniteOptions, Flexible, Haptic, HoldOptions, Interaction, LINK_MM, LateralHold,
    Level, Material, Precision, ProbeContact, Setup, Shaft, SimulatorOptions, Stiffness, Template, TemplateGuided,
    TetMesh, TwoPoints,
};
use nalgebra::{Isometry3, Point3, Translation3, Vector3};

const DT_S: f64 = 1e-3;
const DURATION_S: f64 = 3.0;
/// The block, mm: skin at z = 0, the probe below the face y = 0.
const BLOCK_MM: [f64; 3] = [60.0, 60.0, 80.0];
/// Points at which the devices hold the probe, mm behind its end, and its pose at rest.
const HELD_AT_MM: [f64; 2] = [90.0, 150.0];
const PROBE_MM: [f64; 3] = [30.0, -10.0, 75.0];
/// Stiffness (N/mm) and damping (N s/mm) of the hand's grip.
const GRIP: [f64; 2] = [2.0, 0.02];
/// The weight that draws the needle's device aside, N.
const WEIGHT_N: f64 = 0.8;

/// A device as a mass, and where it is.
struct Device {
    mass_kg: f64,
    at_mm: Point3<f64>,
    velocity_mm_s: Vector3<f64>,
}

impl Device {
    fn at(place: Point3<f64>) -> Self {
        Device {
            mass_kg: 0.25,
            at_mm: place,
            velocity_mm_s: Vector3::zeros(),
        }
    }

    /// Makes a step under the force of the hand, which moves towards a place, and the rendered force, N.
    fn step(&mut self, hand_mm: &Point3<f64>, rendered_n: Vector3<f64>, grip: Vector3<f64>) {
        let hand = (hand_mm - self.at_mm) * GRIP[0] - self.velocity_mm_s * GRIP[1];
        let acceleration = (hand.component_mul(&grip) + rendered_n) * (1e3 / self.mass_kg);
        self.velocity_mm_s += acceleration * DT_S;
        self.at_mm += self.velocity_mm_s * DT_S;
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let points = TwoPoints::new(HELD_AT_MM)?;
    let options = SimulatorOptions {
        probe_points: Some(points),
        ..SimulatorOptions::default()
    };
    let mut haptic = Haptic::new(Box::new(model()?), options);

    let length_mm = Shaft::default().length_mm;
    let mut needle = TemplateGuided::new(template(), "A2", Point3::origin())?;
    let mut hub = Device::at(Point3::new(0.0, 0.0, -length_mm));
    let mut hold = LateralHold::new(HoldOptions {
        kp_n_per_mm: 2.0,
        ki_n_per_mm_s: 20.0,
        kd_ns_per_mm: 0.04,
        most_n: 6.0,
    })?;
    let mut pose = Isometry3::from(Translation3::from(PROBE_MM));
    let rest = HELD_AT_MM.map(|at| pose * Point3::new(0.0, 0.0, -at));
    let mut devices = rest.map(Device::at);
    let mut dampers = [Damper::new(0.01)?; 2];

    println!("  time  hole   tip mm  axial N  aside mm  probe N: first, second  stretch mm");
    for step in 0..(DURATION_S / DT_S) as usize {
        let time_s = step as f64 * DT_S;
        if step == 500 || step == 2200 {
            match needle.choose("C3", haptic.outcome()) {
                Ok(()) => println!("the needle goes through C3 from now on"),
                Err(refused) => println!("C3 is refused: {refused}"),
            }
        }
        let measured = points.pose(&[devices[0].at_mm, devices[1].at_mm], &pose)?;
        pose = measured.pose;
        let mut instruments = needle.instruments(&Translation3::from(hub.at_mm).into());
        instruments.probe = Some(pose);
        let forces = haptic.step(&instruments, DT_S)?;

        // The hand pushes and pulls; the hold alone keeps the device in its place aside.
        let axis = Vector3::z_axis();
        let lateral = hold.force(&hub.at_mm, &Point3::origin(), &axis, DT_S);
        let rendered = axis.scale(forces.axial_n()) + lateral + Vector3::x() * WEIGHT_N;
        hub.step(
            &Point3::new(0.0, 0.0, depth_mm(time_s) - length_mm),
            rendered,
            Vector3::z(),
        );
        let on_points = forces.probe_points.unwrap_or_default();
        for ((device, damper), (rest, force)) in devices.iter_mut().zip(&mut dampers).zip(rest.iter().zip(on_points)) {
            let damped = force + damper.force(&device.at_mm, DT_S);
            device.step(&(rest + Vector3::y() * lift_mm(time_s)), damped, Vector3::repeat(1.0));
        }

        if step % 250 == 249 {
            let hole = needle.hole_mm();
            println!(
                "{:5.2} s  x = {:2.0}  {:7.2}  {:7.3}  {:8.4}  {:10.3} {:10.3}  {:10.4}",
                time_s + DT_S,
                hole.x,
                haptic.outcome().tip_mm.z,
                forces.axial_n(),
                hub.at_mm.coords.xy().norm(),
                on_points[0].norm(),
                on_points[1].norm(),
                measured.stretch_mm,
            );
        }
    }
    Ok(())
}

/// Depth of the tip beyond the template that the hand wants, mm: in, out, and in again.
fn depth_mm(time_s: f64) -> f64 {
    let swing = |from: f64, to: f64| (((time_s - from) / (to - from)).clamp(0.0, 1.0) * std::f64::consts::PI).sin();
    45.0 * swing(0.0, 2.0) + 30.0 * swing(2.2, 3.8)
}

/// Way of the probe up against the tissue that the hand wants, mm: from 0.8 s on, 3 mm in half a second.
fn lift_mm(time_s: f64) -> f64 {
    3.0 * ((time_s - 0.8) / 0.5).clamp(0.0, 1.0)
}

/// Nine holes 5 mm apart, 5 mm before the skin.
fn template() -> Template {
    let names = |names: [&str; 3]| names.map(str::to_owned).to_vec();
    Template {
        origin_mm: Point3::new(26.0, 21.0, -5.0),
        steps_mm: [Vector3::x() * 5.0, Vector3::y() * 5.0],
        direction: Vector3::z_axis(),
        columns: names(["A", "B", "C"]),
        rows: names(["1", "2", "3"]),
    }
}

/// Soft tissue on the probe, held at its far end, and a brachytherapy needle.
fn model() -> Result<Finite, Box<dyn Error>> {
    let mesh = TetMesh::over_box([0.0; 3], BLOCK_MM, 500)?;
    let nodes = || (0u32..).zip(mesh.nodes());
    let far = nodes().filter(|(_, place)| place[2] == BLOCK_MM[2]);
    let under = |place: &[f64; 3]| place[1] == 0.0 && (place[0] - PROBE_MM[0]).abs() < 8.0;
    let touched = nodes().filter(|(_, place)| under(place) && place[2] < PROBE_MM[2]);
    let tissue = Interaction {
        friction_n_per_mm: 0.02,
        cutting_n: 0.5,
        puncture_n: 1.0,
        ..Interaction::default()
    };
    let bevel = Bevel {
        r_mm: 0.6,
        length_mm: BEVEL_MM,
    };
    let shaft = Shaft::default();
    let setup = Setup {
        materials: vec![Material::new(10.0, 0.45)?; mesh.elements().len()],
        fixed: far.flat_map(|(node, _)| [0, 1, 2].map(|axis| (node, axis))).collect(),
        interactions: vec![(0, tissue)],
        anatomy: None,
        needle: Box::new(Flexible::springs(shaft, Stiffness::default(), LINK_MM, Some(bevel))?),
        probe: Some(ProbeContact {
            nominal: Translation3::from(PROBE_MM).into(),
            length_mm: BLOCK_MM[2],
            candidates: touched.map(|(node, _)| node).collect(),
            driven_at_mm: Some(HELD_AT_MM),
        }),
        level: Level::Exact,
        precision: Precision::Double,
        options: FiniteOptions::default(),
        mesh,
    };
    Ok(Finite::new(setup, |_, _| {})?)
}
