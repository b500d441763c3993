//! Cases of moves that must be refused, and of the state after a refusal.

use super::setup::{BACKENDS, Now, Start, state};
use crate::mechanics::tissue::element::DegenerateElement;
use crate::mechanics::tissue::remesh::corner::best_corner;
use crate::mechanics::tissue::remesh::{AdaptedMesh, Level, Options, Precision, RemeshError};
use crate::study::stability::record::{Record, Unexpected};

/// Returns the point at `height` times the corner's own height above the opposite face of an element, for the corner at `place`.
fn above_face(mesh: &AdaptedMesh, element: u32, place: usize, height: f64) -> [f64; 3] {
    let weight = |corner| if corner == place { height } else { (1.0 - height) / 3.0 };
    mesh.point(element, std::array::from_fn(weight))
}

/// Finds an element without fixed nodes and the index of a corner that can be moved almost onto the opposite face without inverting any
/// other element.
fn flattenable(start: &Start, height: f64) -> Result<(u32, usize), Unexpected> {
    let mesh = start.mesh.clone().with_condition_limit(f64::INFINITY);
    let places = (0..mesh.elements().len() as u32).flat_map(|element| (0..4).map(move |place| (element, place)));
    let fits = |&(element, place): &(u32, usize)| {
        let corners = mesh.elements()[element as usize];
        let is_free = corners.iter().all(|node| start.free.contains(node));
        is_free
            && mesh
                .assess(corners[place], above_face(&mesh, element, place, height))
                .is_ok()
    };
    let found = places.into_iter().find(fits);
    found.ok_or_else(|| Unexpected::new("no node can be moved almost onto a face"))
}

/// Tests moves that invert or flatten elements, at every level, and the choice of another corner.
pub fn spoiling(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let start = Start::new(record.seed(), 0.45)?;
    let (element, place) = flattenable(&start, 1e-8)?;
    let node = start.mesh.elements()[element as usize][place];
    let to = |height: f64| above_face(&start.mesh, element, place, height);
    let count = start.mesh.nodes().len() as u32;
    let is_element = |error: &RemeshError| matches!(error, RemeshError::Element { .. });
    let is_flat = |error: &RemeshError| {
        let cause = match error {
            RemeshError::Element { cause, .. } => cause,
            _ => return false,
        };
        matches!(
            cause,
            DegenerateElement::Flat { .. } | DegenerateElement::Inverted { .. }
        )
    };
    let is_thin = |error: &RemeshError| matches!(error, RemeshError::Condition { .. });
    let is_position = |error: &RemeshError| matches!(error, RemeshError::Position { .. });
    let is_node = |error: &RemeshError| matches!(error, RemeshError::Node { .. });
    let far = start.mesh.nodes()[node as usize].map(|x| x + 50.0);
    let moves: [(&str, u32, [f64; 3], &dyn Fn(&RemeshError) -> bool); 7] = [
        ("50 mm away", node, far, &is_element),
        ("beyond the opposite face", node, to(-0.5), &is_element),
        ("onto the opposite face", node, to(0.0), &is_flat),
        ("within 1e-8 of it", node, to(1e-8), &is_thin),
        ("to NaN", node, [0.0, f64::NAN, 0.0], &is_position),
        ("to infinity", node, [f64::INFINITY, 0.0, 0.0], &is_position),
        ("a node that is not there", count, [0.0; 3], &is_node),
    ];
    for backend in BACKENDS {
        for level in [Level::I, Level::II, Level::III, Level::IV, Level::Exact] {
            let mut adaptation = backend.follow(&start, level, Options::default())?;
            start.go(&mut adaptation, &[start.free[3]], 0..2, |_, _| Ok(()))?;
            let before = state(&adaptation);
            let mut changed = 0;
            for (name, node, to, expected) in &moves {
                let answer = adaptation.move_node(*node, *to);
                record.refused(format!("{name}, level {level}, {}", backend.name), answer, expected);
                changed += usize::from(state(&adaptation) != before);
            }
            record.zero(
                format!("refusals that changed something, level {level}, {}", backend.name),
                changed as f64,
            );
        }
    }
    // With the tip on the face, only the corners of that face are suitable.
    let tip = to(1e-12);
    let chosen = best_corner(&start.mesh, element, tip, |_| false)?;
    record.zero(
        "the corner that the tip would flatten was taken",
        f64::from(chosen.node == node),
    );
    record.under("Jacobian condition with the corner taken", chosen.condition, 1e3);
    let none = best_corner(&start.mesh, element, tip, |other| other != node);
    record.refused(
        "the others taken already",
        none,
        |error| matches!(error, RemeshError::NoCorner { unfit, .. } if unfit.len() == 4),
    );
    Ok(())
}

/// Tests a mesh limit that lets a node come so close to a face that the update is nearly singular.
pub fn near_singular(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let mut start = Start::new(record.seed(), 0.45)?;
    let (element, place) = flattenable(&start, 1e-8)?;
    let node = start.mesh.elements()[element as usize][place];
    start.mesh = start.mesh.with_condition_limit(f64::INFINITY);
    let limit = Options::default().reciprocal_limit;
    let corners = start.mesh.elements()[element as usize];
    let is_apart = |other: &u32| {
        corners
            .iter()
            .all(|corner| !start.mesh.neighbours(*corner).contains(other))
    };
    let others: Vec<u32> = start.free.iter().copied().filter(is_apart).collect();
    for backend in BACKENDS.iter().filter(|backend| backend.precision == Precision::Double) {
        for level in [Level::I, Level::Exact] {
            let mut refusals = 0;
            for height in [1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8] {
                let mut adaptation = backend.follow(&start, level, Options::default())?;
                // Other nodes stay away from their base, so that moving back is an update too, not a return to the base.
                start.go(&mut adaptation, &others, 0..4, |_, _| Ok(()))?;
                let before = state(&adaptation);
                let what = format!("height {height:.0e}, level {level}, {}", backend.name);
                match adaptation.move_node(node, above_face(&start.mesh, element, place, height)) {
                    Ok(report) => {
                        record.report(format!("reciprocal condition, {what}"), report.reciprocal_condition);
                        let below = report.reciprocal_condition < limit;
                        record.zero(format!("accepted below the limit, {what}"), f64::from(below));
                        let now = Now::of(adaptation.mesh())?;
                        let error = now.error_of_contacts(&adaptation);
                        record.under(format!("error of K^c, {what}"), error, start.allowed(&now, backend));
                        let forces = vec![1.0; start.contacts.len()];
                        let mut displacement = vec![0.0; start.mesh.dofs().free()];
                        let (mesh, remesher) = adaptation.parts();
                        let left = remesher.displacement_refined(mesh, &forces, &mut displacement)?;
                        record.under(format!("backward error after one refinement, {what}"), left, 1e-12);
                        // Moving back uses the same capacitance in reverse.
                        adaptation.undo()?;
                        let back = Now::of(adaptation.mesh())?;
                        let error = back.error_of_contacts(&adaptation);
                        record.under(
                            format!("error of K^c after moving back, {what}"),
                            error,
                            start.allowed(&back, backend),
                        );
                    }
                    refused => {
                        refusals += 1;
                        record.refused(format!("refused, {what}"), refused, |error| match error {
                            RemeshError::Singular {
                                node: named,
                                reciprocal_condition,
                                ..
                            } => *named == node && *reciprocal_condition < limit,
                            _ => false,
                        });
                        record.zero(
                            format!("changed by the refusal, {what}"),
                            f64::from(state(&adaptation) != before),
                        );
                    }
                }
            }
            record.report(
                format!("heights refused, level {level}, {}", backend.name),
                f64::from(refusals),
            );
        }
    }
    Ok(())
}
