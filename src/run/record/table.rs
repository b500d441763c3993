//! Table of steps, `steps.csv`: one line per step.

use std::io::{self, Write};

use nalgebra::Vector3;

use crate::input::scenario::guidance::Guidance;
use crate::input::scenario::manipulator::GuideMotion;
use crate::run::Step;
use insonify_mechanics::insertion::ProbeContact;
use insonify_tracking::manipulator::drive::Driven;

/// Columns before the pose of the probe. Their contents are documented in docs/insertion.md.
const NUMBERS: &str = "time_s,base_x_mm,base_y_mm,base_z_mm,base_dx,base_dy,base_dz,tip_x_mm,tip_y_mm,tip_z_mm,\
    tip_deflection_mm,inserted_mm,base_force_x_n,base_force_y_n,base_force_z_n,\
    base_torque_x_nmm,base_torque_y_nmm,base_torque_z_nmm,world_force_x_n,world_force_y_n,world_force_z_n,\
    probe_force_x_n,probe_force_y_n,probe_force_z_n,probe_torque_x_nmm,probe_torque_y_nmm,probe_torque_z_nmm";
/// Columns of the pose of the probe in contact, or of the imaging probe.
const POSE: &str = "probe_x_mm,probe_y_mm,probe_z_mm,probe_qx,probe_qy,probe_qz,probe_qw";
/// Columns of the tissue force on each of the two points that drive the probe, if it has them.
const DRIVEN: &str = "driven_1_force_x_n,driven_1_force_y_n,driven_1_force_z_n,\
    driven_2_force_x_n,driven_2_force_y_n,driven_2_force_z_n,";
/// Columns of a needle guide: commanded and actual posture, lost motion of its slides, and the reading of its force
/// sensor in the base frame of the needle.
const GUIDE: &str = "command_position_mm,command_posture_deg,command_insertion_mm,\
    guide_position_mm,guide_posture_deg,guide_insertion_mm,lost_1_mm,lost_2_mm,lost_3_mm,\
    sensor_force_x_n,sensor_force_y_n,sensor_force_z_n,sensor_torque_x_nmm,sensor_torque_y_nmm,sensor_torque_z_nmm,";
/// Columns of counts, and the duration of the step.
const COUNTS: &str = "contacts,stuck,probe_contacts,remeshes,substeps,iterations,converged,crushed,step_ms";

/// Columns of the geometry from which an insertion is scored; empty where there is no such point.
const GUIDANCE: &str = "tip_dx,tip_dy,tip_dz,measured_tip_x_mm,measured_tip_y_mm,measured_tip_z_mm,\
    array_x_mm,array_y_mm,array_z_mm,plane_nx,plane_ny,plane_nz,\
    entry_at_rest_x_mm,entry_at_rest_y_mm,entry_at_rest_z_mm,entry_x_mm,entry_y_mm,entry_z_mm,\
    target_at_rest_x_mm,target_at_rest_y_mm,target_at_rest_z_mm,target_x_mm,target_y_mm,target_z_mm,\
    target_shown,clearance_mm";

/// Header line.
pub(super) fn head(probe: Option<&ProbeContact>, has_guide: bool) -> String {
    let driven = probe.and_then(|probe| probe.driven_at_mm);
    let driven = if driven.is_some() { DRIVEN } else { "" };
    let guide = if has_guide { GUIDE } else { "" };
    format!("{NUMBERS},{POSE},{GUIDANCE},{driven}{guide}{COUNTS}")
}

pub(super) fn row(step: &Step<'_>, guided: Option<(&GuideMotion, &Driven)>, out: &mut impl Write) -> io::Result<()> {
    let outcome = step.outcome;
    let of_base = outcome.on_hand.in_frame(&step.base);
    let probe = outcome.on_probe.unwrap_or_default();
    let vectors: [Vector3<f64>; 8] = [
        step.base.translation.vector,
        step.base.rotation * Vector3::z(),
        outcome.tip_mm.coords,
        of_base.force_n,
        of_base.torque_nmm,
        outcome.on_hand.force_n,
        probe.force_n,
        probe.torque_nmm,
    ];
    write!(out, "{}", step.time_s)?;
    // The order is that of `NUMBERS`, where deflection and depth follow the tip.
    for (index, vector) in vectors.iter().enumerate() {
        write!(out, ",{},{},{}", vector.x, vector.y, vector.z)?;
        if index == 2 {
            write!(out, ",{},{}", outcome.tip_deflection_mm, outcome.inserted_mm)?;
        }
    }
    let (position, turn) = (step.probe.translation.vector, step.probe.rotation.coords);
    write!(
        out,
        ",{},{},{},{},{},{},{}",
        position.x, position.y, position.z, turn.x, turn.y, turn.z, turn.w
    )?;
    guidance(&step.guidance, out)?;
    for force in step.driven.iter().flatten() {
        write!(out, ",{},{},{}", force.x, force.y, force.z)?;
    }
    if let Some((guided, driven)) = guided {
        for posture in [driven.command, driven.posture] {
            let (a, b, c) = (posture.position_mm, posture.posture_deg, posture.insertion_mm);
            write!(out, ",{a:.6},{b:.6},{c:.6}")?;
        }
        let read = guided.sensor.reading(step.number, &of_base);
        for vector in [driven.lost_mm.into(), read[0], read[1]] {
            write!(out, ",{:.6},{:.6},{:.6}", vector.x, vector.y, vector.z)?;
        }
    }
    writeln!(
        out,
        ",{},{},{},{},{},{},{},{},{:.4}",
        outcome.contacts,
        outcome.stuck,
        outcome.probe_contacts,
        outcome.remeshes,
        outcome.substeps,
        outcome.iterations,
        u8::from(outcome.converged),
        outcome.crushed,
        step.ms
    )
}

fn guidance(guidance: &Guidance, out: &mut impl Write) -> io::Result<()> {
    let mut vector = |vector: Option<Vector3<f64>>| match vector {
        Some(vector) => write!(out, ",{:.6},{:.6},{:.6}", vector.x, vector.y, vector.z),
        None => write!(out, ",,,"),
    };
    let always = [
        guidance.direction,
        guidance.measured_tip.coords,
        guidance.array.coords,
        guidance.normal,
    ];
    always.into_iter().try_for_each(|force| vector(Some(force)))?;
    for places in [guidance.entry, guidance.target] {
        for end in 0..2 {
            vector(places.map(|places| places[end].coords))?;
        }
    }
    write!(out, ",{}", u8::from(guidance.shown))?;
    match guidance.clearance_mm {
        Some(clearance) => write!(out, ",{clearance:.3}"),
        None => write!(out, ","),
    }
}
