//! The table of hard cases, run quickly, and tables that must fail.

use insonify_mechanics::tissue::assembly::Stiffness;
use insonify_mechanics::tissue::dofs::Dofs;
use insonify_mechanics::tissue::factor::Factor;
use insonify_mechanics::tissue::inverse::{invert, sampled_residual};
use insonify_mechanics::tissue::material::Material;
use insonify_mechanics::tissue::symmetric::Symmetric;
use insonify_mesh::TetMesh;
use insonify_study::stability::{Effort, GROUPS, HardCase, Record, Unexpected, run, select};

/// Runs a group; what does not hold is named with its figure, its limit and, where there is one, the error.
fn check(name: &str) {
    let cases = select(GROUPS, Some(name));
    assert!(!cases.is_empty(), "no group {name}");
    let report = run(&cases, Effort::Quick, &mut |_, _| {});
    assert!(report.failed() == 0, "{report}");
}

#[test]
fn elements_solvers_and_inverse_hold() {
    check("Elements, solvers, inverse");
}

#[test]
fn tissue_laws_hold() {
    check("Tissue laws");
}

#[test]
fn remeshing_holds() {
    check("Remeshing");
}

#[test]
fn contact_needle_and_time_hold() {
    check("Contact, needle, time");
}

#[test]
fn fading_memory_holds() {
    check("Fading memory");
}

#[test]
fn images_hold() {
    check("Images");
}

#[test]
fn motion_from_echoes_holds() {
    check("Motion from echoes");
}

#[test]
fn paths_drives_and_measured_needles_hold() {
    check("Paths, drives, measured needles");
}

#[test]
fn every_group_is_tested() {
    let names: Vec<&str> = GROUPS.iter().map(|group| group.name).collect();
    assert_eq!(
        names,
        [
            "Elements, solvers, inverse",
            "Tissue laws",
            "Remeshing",
            "Contact, needle, time",
            "Fading memory",
            "Images",
            "Motion from echoes",
            "Paths, drives, measured needles"
        ],
        "a test for each, please"
    );
}

/// The residual of a dense inverse of which every entry has been scaled.
fn scaled_inverse(record: &mut Record<'_>, scale: f64) -> Result<(), Unexpected> {
    let mesh = TetMesh::over_box([0.0; 3], [10.0; 3], 60)?;
    let floor = (0..).zip(mesh.nodes()).filter(|(_, p)| p[2] == 0.0);
    let dofs = Dofs::new(
        mesh.nodes().len(),
        floor.flat_map(|(node, _)| [0, 1, 2].map(|axis| (node, axis))),
    );
    let materials = vec![Material::new(10.0, 0.45)?; mesh.elements().len()];
    let stiffness = Stiffness::assemble(&mesh, &materials, &dofs)?;
    let right: Symmetric<f64> = invert(&Factor::new(&stiffness)?, &mut |_, _| {})?;
    let mut scaled = Symmetric::from_fn(right.size(), |i, j| right.get(i, j) * scale);
    let residual = sampled_residual(&stiffness, &mut scaled, &[0, 31, 62])?;
    record.under("|K X e - e| of the inverse", residual, 1e-11);
    record.report("something else", 1.0);
    Ok(())
}

fn verdict(run_case: fn(&mut Record<'_>) -> Result<(), Unexpected>) -> (bool, String) {
    let case = HardCase {
        name: "a scaled compliance",
        criterion: "residual under 1e-11",
        covers: &["cpu f64"],
        seed: 99,
        run: run_case,
    };
    let report = run(&[("Seeded", &case)], Effort::Quick, &mut |_, _| {});
    (report.failed() == 0, report.to_string())
}

#[test]
fn a_compliance_that_is_slightly_wrong_or_no_number_is_reported_as_failed() {
    let (holds, text) = verdict(|record| scaled_inverse(record, 1.0));
    assert!(holds && !text.contains("FAILS"), "{text}");
    let (holds, text) = verdict(|record| scaled_inverse(record, 1.0 + 1e-6));
    assert!(!holds && text.contains("FAILS"), "{text}");
    assert!(
        text.contains("|K X e - e| of the inverse: 1.0e-6, at most 1.0e-11 expected"),
        "{text}"
    );
    let (holds, text) = verdict(|record| scaled_inverse(record, f64::NAN));
    assert!(!holds && text.contains("|K X e - e| of the inverse: NaN"), "{text}");
}
