//! Cases of needle tip positions: point location and the choice of a corner.

use super::setup::Start;
use crate::base::real::Real;
use crate::mechanics::mesh::{Locator, NONE};
use crate::mechanics::tissue::material::Material;
use crate::mechanics::tissue::remesh::AdaptedMesh;
use crate::mechanics::tissue::remesh::RemeshError;
use crate::mechanics::tissue::remesh::corner::best_corner;
use crate::study::stability::record::{Record, Unexpected};
use crate::study::stability::solving::problem::{Problem, two_parts};

/// Locates a point by walks from every element and with a fresh locator; records how many answers differ from the first, and returns that
/// first answer.
fn elements_named<T: Real>(record: &mut Record<'_>, problem: &Problem, what: &str, p: [f64; 3]) -> u32 {
    let locator = Locator::<T>::new(&problem.mesh);
    let point = p.map(T::of);
    let first = locator.locate(point, NONE).element;
    let again = Locator::<T>::new(&problem.mesh).locate(point, NONE).element;
    let starts = 0..problem.mesh.elements().len() as u32;
    let others = starts
        .filter(|start| locator.locate(point, *start).element != first)
        .count();
    let different = others + usize::from(again != first);
    record.zero(format!("answers that differ, {what}"), different as f64);
    first
}

/// Tests tips on vertices, edges and faces, inside, and outside the tissue.
pub fn places(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let start = Start::new(record.seed(), 0.45)?;
    let (parts, _) = two_parts()?;
    let mut apart = Problem::new(parts, Material::new(10.0, 0.45)?);
    apart.fix(&[0, 1, 2], |p| p[2] == 0.0, |_| [0.0; 3]);
    let mesh = AdaptedMesh::new(&apart.mesh, &apart.materials.check(&apart.mesh)?, &apart.dofs())?;
    let is_free = |corners: &[u32; 4]| corners.iter().all(|node| !mesh.dofs().of(*node).contains(&NONE));
    let inner = (0..).zip(mesh.elements()).find(|(_, corners)| is_free(corners));
    let (element, corners) = inner.ok_or_else(|| Unexpected::new("no element without a fixed node"))?;
    let places = [
        ("on a vertex", [0.0, 0.0, 1.0, 0.0], 1),
        ("on an edge", [0.5, 0.0, 0.5, 0.0], 2),
        ("on a face", [0.25, 0.25, 0.5, 0.0], 3),
        ("inside", [0.25; 4], 4),
    ];
    for (name, weights, corners_there) in places {
        let p = mesh.point(element, weights);
        let named = elements_named::<f64>(record, &apart, &format!("{name}, f64"), p);
        elements_named::<f32>(record, &apart, &format!("{name}, f32"), p);
        record.zero(format!("tips not found, {name}"), f64::from(named == NONE));
        // The corner moved to the tip, chosen from the element itself and from the one that the locator names.
        for from in [element, named] {
            let choices = [&mesh, &mesh.clone()].map(|mesh| best_corner(mesh, from, p, |_| false));
            let [one, two] = &choices;
            record.zero(
                format!("choices that differ, {name}, element {from}"),
                f64::from(one != two),
            );
            let Ok(corner) = one else { continue };
            let here = mesh.elements()[from as usize];
            record.zero(
                format!("choices outside the element, {name}, element {from}"),
                f64::from(!here.contains(&corner.node)),
            );
            if from == element && corners_there < 4 {
                let weight = corners
                    .iter()
                    .position(|node| *node == corner.node)
                    .map_or(0.0, |place| weights[place]);
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
        let named = elements_named::<f64>(record, &apart, &format!("{name}, f64"), p);
        let single = elements_named::<f32>(record, &apart, &format!("{name}, f32"), p);
        record.zero(
            format!("elements found where there are none, {name}"),
            f64::from(named != NONE || single != NONE),
        );
        let choice = best_corner(&mesh, named, p, |_| false);
        record.refused(format!("a corner for a tip {name}"), choice, |error| {
            matches!(error, RemeshError::NoElement { .. })
        });
    }
    // A vertex that may not be moved: moving any other corner there would flatten the element.
    let fixed = (0..).zip(start.mesh.elements()).find_map(|(element, corners)| {
        let held = corners
            .iter()
            .find(|node| start.mesh.dofs().of(**node).contains(&NONE))?;
        Some((element, *held))
    });
    let (element, held) = fixed.ok_or_else(|| Unexpected::new("no fixed node"))?;
    let choice = best_corner(&start.mesh, element, start.mesh.nodes()[held as usize], |_| false);
    record.refused("a corner for a tip on a fixed vertex", choice, |error| {
        matches!(error, RemeshError::NoCorner { .. })
    });
    Ok(())
}
