use super::*;
use crate::tissue::factor::Factor;
use crate::tissue::remesh::testing::{adapted, inverse};

fn source(mesh: &AdaptedMesh, kind: &str) -> Source {
    match kind {
        "f32" => Source::Single(Arc::new(inverse(mesh).cast())),
        "f64" => Source::Double(inverse(mesh)),
        _ => Source::Columns(Columns::new(
            Arc::new(Factor::new(mesh.stiffness()).expect("a factor")),
            100,
        )),
    }
}

#[test]
fn each_source_gives_what_it_can() {
    let mesh = adapted(0.45);
    let [single, double] = [Precision::Single, Precision::Double];
    for level in [Level::I, Level::II, Level::III, Level::IV, Level::Exact] {
        let dense_only = level != Level::Exact;
        for (kind, wanted, expected) in [
            ("f32", single, Some(single)),
            ("f32", double, None),
            ("f64", single, Some(if dense_only { single } else { double })),
            ("f64", double, Some(double)),
            ("columns", single, (!dense_only).then_some(double)),
            ("columns", double, (!dense_only).then_some(double)),
        ] {
            let result = make(level, wanted, &source(&mesh, kind), &mesh, RemesherOptions::default());
            match (result, expected) {
                (Ok(remesher), Some(expected)) => {
                    assert_eq!(
                        (remesher.level(), remesher.precision()),
                        (level, expected),
                        "{kind} {wanted}"
                    );
                }
                (
                    Err(RemeshError::Unsuited {
                        level: of,
                        precision,
                        reason,
                    }),
                    None,
                ) => {
                    assert_eq!((of, precision), (level, wanted));
                    assert!(reason.contains("inverse"), "{reason}");
                }
                (result, _) => panic!("{level} {kind} {wanted}: {:?}", result.map(|result| result.level())),
            }
        }
    }
}
