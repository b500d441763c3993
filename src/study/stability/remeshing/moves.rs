//! Cases of moves: out and back, overlapping, refused, and chosen by where the tip is.

use crate::stability::fixtures::{BACKENDS, Now, Problem, Start, bits, state, two_parts};
use crate::stability::record::{Record, Unexpected};
use insonify_base::real::Real;
use insonify_mechanics::tissue::dofs::NO_DOF;
use insonify_mechanics::tissue::element::DegenerateElement;
use insonify_mechanics::tissue::material::Material;
use insonify_mechanics::tissue::remesh::corner::best_corner;
use insonify_mechanics::tissue::remesh::{AdaptedMesh, Level, Precision, RemeshError, RemesherOptions};
use insonify_mesh::{Locator, NO_ELEMENT};

/// Moves a node away and back, many times.
pub(crate) fn out_and_back(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let rounds = record.effort().pick(60, 1000);
    for poisson in [0.45, 0.499, 0.4999] {
        let start = Start::new(record.seed(), poisson)?;
        for backend in BACKENDS {
            let subject = format!("{}, nu {poisson}", backend.name);
            let mut exact = backend.follow(&start, Level::Exact, RemesherOptions::default())?;
            let (before, mut changed, mut rows_left) = (bits(&exact), 0, 0);
            for n in 0..rounds {
                start.go(&mut exact, &start.free, n..n + 1, |exact, _| {
                    rows_left += exact.undo()?.map_or(1, |report| report.support_size);
                    Ok(())
                })?;
                changed += usize::from(bits(&exact) != before);
            }
            record.zero(
                format!("rounds after which K^c has changed, exact, {subject}"),
                changed as f64,
            );
            record.zero(format!("rows of S left, exact, {subject}"), rows_left as f64);
            // Level I refuses f32 beyond this Poisson's ratio, as the case of its accuracy tests.
            if backend.precision == Precision::Single && poisson > RemesherOptions::default().single_poisson_limit {
                continue;
            }
            let mut single = backend.follow(&start, Level::I, RemesherOptions::default())?;
            for n in 0..rounds {
                start.go(&mut single, &start.free, n..n + 1, |single, _| {
                    single.undo()?;
                    Ok(())
                })?;
            }
            let state = Now::of(single.mesh())?;
            let error = state.error_of_all(&mut single)?;
            record.under(
                format!("error of K^-1 after {rounds} rounds, level I, {subject}"),
                error,
                start.allowed(&state, backend),
            );
        }
    }
    Ok(())
}

/// Moves nodes whose supports overlap.
pub(crate) fn overlapping(record: &mut Record<'_>) -> Result<(), Unexpected> {
    for poisson in [0.45, 0.499] {
        let start = Start::new(record.seed(), poisson)?;
        let is_free = |corners: &&[u32; 4]| corners.iter().all(|node| start.free.contains(node));
        let element = start.mesh.elements().iter().find(is_free);
        let [a, b, c, d] = *element.ok_or_else(|| Unexpected::new("no element without a fixed node"))?;
        let sequences: [(&str, &[u32]); 3] = [
            ("two neighbours", &[a, b]),
            ("the same node twice", &[a, a]),
            ("every node of an element, some twice", &[a, b, a, c, d, b]),
        ];
        for backend in BACKENDS {
            for level in [Level::I, Level::Exact] {
                // Level I refuses single precision so close to incompressible.
                if level == Level::I && backend.precision == Precision::Single && poisson > 0.49 {
                    continue;
                }
                for (name, nodes) in sequences {
                    let mut adaptation = backend.follow(&start, level, RemesherOptions::default())?;
                    let mut moves_made = 0;
                    for (n, node) in (0..).zip(nodes) {
                        start.go(&mut adaptation, &[*node], n..n + 1, |_, _| {
                            moves_made += 1;
                            Ok(())
                        })?;
                    }
                    let subject = format!("{name}, level {level}, {}, nu {poisson}", backend.name);
                    record.zero(
                        format!("moves that did not fit, {subject}"),
                        (nodes.len() - moves_made) as f64,
                    );
                    let state = Now::of(adaptation.mesh())?;
                    let error = state.error_of_all(&mut adaptation)?;
                    record.under(
                        format!("error of K^-1, {subject}"),
                        error,
                        start.allowed(&state, backend),
                    );
                }
            }
        }
    }
    Ok(())
}

/// Returns the point at `height` times the corner's own height above the opposite face of an element, for the corner at
/// `corner_index`.
fn above_face(mesh: &AdaptedMesh, element: u32, corner_index: usize, height: f64) -> [f64; 3] {
    let weight = |corner| {
        if corner == corner_index {
            height
        } else {
            (1.0 - height) / 3.0
        }
    };
    mesh.point(element, std::array::from_fn(weight))
}

/// Finds an element without fixed nodes and the index of a corner that can be moved almost onto the opposite face
/// without inverting any other element.
fn flattenable(start: &Start, height: f64) -> Result<(u32, usize), Unexpected> {
    let mesh = start.mesh.clone().with_condition_limit(f64::INFINITY);
    let places = (0..mesh.elements().len() as u32).flat_map(|element| (0..4).map(move |corner| (element, corner)));
    let fits = |&(element, corner): &(u32, usize)| {
        let corners = mesh.elements()[element as usize];
        let is_free = corners.iter().all(|node| start.free.contains(node));
        is_free
            && mesh
                .assess(corners[corner], above_face(&mesh, element, corner, height))
                .is_ok()
    };
    let flattenable_corner = places.into_iter().find(fits);
    flattenable_corner.ok_or_else(|| Unexpected::new("no node can be moved almost onto a face"))
}

/// Tests moves that invert or flatten elements, at every level, and the choice of another corner.
pub(super) fn spoiling(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let start = Start::new(record.seed(), 0.45)?;
    let (element, corner) = flattenable(&start, 1e-8)?;
    let node = start.mesh.elements()[element as usize][corner];
    let height_position = |height: f64| above_face(&start.mesh, element, corner, height);
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
        ("beyond the opposite face", node, height_position(-0.5), &is_element),
        ("onto the opposite face", node, height_position(0.0), &is_flat),
        ("within 1e-8 of it", node, height_position(1e-8), &is_thin),
        ("to NaN", node, [0.0, f64::NAN, 0.0], &is_position),
        ("to infinity", node, [f64::INFINITY, 0.0, 0.0], &is_position),
        ("a node that is not there", count, [0.0; 3], &is_node),
    ];
    for backend in BACKENDS {
        for level in [Level::I, Level::II, Level::III, Level::IV, Level::Exact] {
            let mut adaptation = backend.follow(&start, level, RemesherOptions::default())?;
            start.go(&mut adaptation, &[start.free[3]], 0..2, |_, _| Ok(()))?;
            let before = state(&adaptation);
            let mut changed = 0;
            for (name, node, position, expected) in &moves {
                let answer = adaptation.move_node(*node, *position);
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
    let tip = height_position(1e-12);
    let chosen = best_corner(&start.mesh, element, tip, |_| false)?;
    record.zero(
        "the corner that the tip would flatten was taken",
        f64::from(chosen.node == node),
    );
    record.under("Jacobian condition with the corner taken", chosen.condition, 1e3);
    let no_corner = best_corner(&start.mesh, element, tip, |candidate| candidate != node);
    record.refused(
        "the others taken already",
        no_corner,
        |error| matches!(error, RemeshError::NoCorner { unfit, .. } if unfit.len() == 4),
    );
    Ok(())
}

/// Tests a mesh limit that lets a node come so close to a face that the update is nearly singular.
pub(crate) fn near_singular(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let mut start = Start::new(record.seed(), 0.45)?;
    let (element, thin_corner) = flattenable(&start, 1e-8)?;
    let node = start.mesh.elements()[element as usize][thin_corner];
    start.mesh = start.mesh.with_condition_limit(f64::INFINITY);
    let limit = RemesherOptions::default().reciprocal_limit;
    let corners = start.mesh.elements()[element as usize];
    let is_apart = |candidate: &u32| {
        corners
            .iter()
            .all(|corner| !start.mesh.neighbours(*corner).contains(candidate))
    };
    let others: Vec<u32> = start.free.iter().copied().filter(is_apart).collect();
    for backend in BACKENDS.iter().filter(|backend| backend.precision == Precision::Double) {
        for level in [Level::I, Level::Exact] {
            let mut refusals = 0;
            for height in [1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8] {
                let mut adaptation = backend.follow(&start, level, RemesherOptions::default())?;
                // Other nodes stay away from their base, so that moving back is an update too, not a return to the
                // base.
                start.go(&mut adaptation, &others, 0..4, |_, _| Ok(()))?;
                let before = state(&adaptation);
                let subject = format!("height {height:.0e}, level {level}, {}", backend.name);
                match adaptation.move_node(node, above_face(&start.mesh, element, thin_corner, height)) {
                    Ok(report) => {
                        record.report(format!("reciprocal condition, {subject}"), report.reciprocal_condition);
                        let below = report.reciprocal_condition < limit;
                        record.zero(format!("accepted below the limit, {subject}"), f64::from(below));
                        let state = Now::of(adaptation.mesh())?;
                        let error = state.error_of_contacts(&adaptation);
                        record.under(
                            format!("error of K^c, {subject}"),
                            error,
                            start.allowed(&state, backend),
                        );
                        let forces = vec![1.0; start.contacts.len()];
                        let mut displacement = vec![0.0; start.mesh.dofs().free()];
                        let (mesh, remesher) = adaptation.parts();
                        let residual = remesher.displacement_refined(mesh, &forces, &mut displacement)?;
                        record.under(
                            format!("backward error after one refinement, {subject}"),
                            residual,
                            1e-12,
                        );
                        // Moving back uses the same capacitance in reverse.
                        adaptation.undo()?;
                        let returned = Now::of(adaptation.mesh())?;
                        let error = returned.error_of_contacts(&adaptation);
                        record.under(
                            format!("error of K^c after moving back, {subject}"),
                            error,
                            start.allowed(&returned, backend),
                        );
                    }
                    refused => {
                        refusals += 1;
                        record.refused(format!("refused, {subject}"), refused, |error| match error {
                            RemeshError::Singular {
                                node: named,
                                reciprocal_condition,
                                ..
                            } => *named == node && *reciprocal_condition < limit,
                            _ => false,
                        });
                        record.zero(
                            format!("changed by the refusal, {subject}"),
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

/// Locates a point by walks from every element and with a fresh locator; records how many answers differ from the
/// first, and returns that first answer.
fn elements_named<T: Real>(record: &mut Record<'_>, problem: &Problem, subject: &str, p: [f64; 3]) -> u32 {
    let locator = Locator::<T>::new(&problem.mesh);
    let point = p.map(T::of);
    let element = locator.locate(point, NO_ELEMENT).element;
    let element_again = Locator::<T>::new(&problem.mesh).locate(point, NO_ELEMENT).element;
    let starts = 0..problem.mesh.elements().len() as u32;
    let differing = starts
        .filter(|start| locator.locate(point, *start).element != element)
        .count();
    let different = differing + usize::from(element_again != element);
    record.zero(format!("answers that differ, {subject}"), different as f64);
    element
}

/// Tests tips on vertices, edges and faces, inside, and outside the tissue.
pub(super) fn places(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let start = Start::new(record.seed(), 0.45)?;
    let (parts, _) = two_parts()?;
    let mut two_parts = Problem::new(parts, Material::new(10.0, 0.45)?);
    two_parts.fix(&[0, 1, 2], |p| p[2] == 0.0, |_| [0.0; 3]);
    let mesh = AdaptedMesh::new(
        &two_parts.mesh,
        &two_parts.materials.check(&two_parts.mesh)?,
        &two_parts.dofs(),
    )?;
    let is_free = |corners: &[u32; 4]| corners.iter().all(|node| !mesh.dofs().of(*node).contains(&NO_DOF));
    let free = (0..).zip(mesh.elements()).find(|(_, corners)| is_free(corners));
    let (element, corners) = free.ok_or_else(|| Unexpected::new("no element without a fixed node"))?;
    let places = [
        ("on a vertex", [0.0, 0.0, 1.0, 0.0], 1),
        ("on an edge", [0.5, 0.0, 0.5, 0.0], 2),
        ("on a face", [0.25, 0.25, 0.5, 0.0], 3),
        ("inside", [0.25; 4], 4),
    ];
    for (name, weights, corners_there) in places {
        let p = mesh.point(element, weights);
        let named = elements_named::<f64>(record, &two_parts, &format!("{name}, f64"), p);
        elements_named::<f32>(record, &two_parts, &format!("{name}, f32"), p);
        record.zero(format!("tips not found, {name}"), f64::from(named == NO_ELEMENT));
        // The corner moved to the tip, chosen from the element itself and from the one that the locator names.
        for start in [element, named] {
            let choices = [&mesh, &mesh.clone()].map(|mesh| best_corner(mesh, start, p, |_| false));
            let [choice, repeated] = &choices;
            record.zero(
                format!("choices that differ, {name}, element {start}"),
                f64::from(choice != repeated),
            );
            let Ok(corner) = choice else { continue };
            let corners_here = mesh.elements()[start as usize];
            record.zero(
                format!("choices outside the element, {name}, element {start}"),
                f64::from(!corners_here.contains(&corner.node)),
            );
            if start == element && corners_there < 4 {
                let weight = corners
                    .iter()
                    .position(|node| *node == corner.node)
                    .map_or(0.0, |index| weights[index]);
                record.zero(
                    format!("choices that flatten the element, {name}"),
                    f64::from(weight == 0.0),
                );
            }
        }
    }
    for (name, p) in [
        ("outside", [-3.0, 5.0, 5.0]),
        ("far outside", [1e6, 0.0, 0.0]),
        ("in a gap between parts", [11.0, 5.0, 5.0]),
        ("at NaN", [f64::NAN, 5.0, 5.0]),
    ] {
        let named = elements_named::<f64>(record, &two_parts, &format!("{name}, f64"), p);
        let single = elements_named::<f32>(record, &two_parts, &format!("{name}, f32"), p);
        record.zero(
            format!("elements found where there are none, {name}"),
            f64::from(named != NO_ELEMENT || single != NO_ELEMENT),
        );
        let choice = best_corner(&mesh, named, p, |_| false);
        record.refused(format!("a corner for a tip {name}"), choice, |error| {
            matches!(error, RemeshError::NoElement { .. })
        });
    }
    // A vertex that may not be moved: moving any other corner there would flatten the element.
    let fixed_element = (0..).zip(start.mesh.elements()).find_map(|(element, corners)| {
        let fixed_node = corners
            .iter()
            .find(|node| start.mesh.dofs().of(**node).contains(&NO_DOF))?;
        Some((element, *fixed_node))
    });
    let (element, fixed_node) = fixed_element.ok_or_else(|| Unexpected::new("no fixed node"))?;
    let choice = best_corner(&start.mesh, element, start.mesh.nodes()[fixed_node as usize], |_| false);
    record.refused("a corner for a tip on a fixed vertex", choice, |error| {
        matches!(error, RemeshError::NoCorner { .. })
    });
    Ok(())
}
