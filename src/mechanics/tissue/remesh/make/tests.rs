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
        for (kind, asked, given) in [
            ("f32", single, Some(single)),
            ("f32", double, None),
            ("f64", single, Some(if dense_only { single } else { double })),
            ("f64", double, Some(double)),
            ("columns", single, (!dense_only).then_some(double)),
            ("columns", double, (!dense_only).then_some(double)),
        ] {
            let made = make(level, asked, &source(&mesh, kind), &mesh, RemesherOptions::default());
            match (made, given) {
                (Ok(remesher), Some(given)) => {
                    assert_eq!(
                        (remesher.level(), remesher.precision()),
                        (level, given),
                        "{kind} {asked}"
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
                    assert_eq!((of, precision), (level, asked));
                    assert!(reason.contains("inverse"), "{reason}");
                }
                (made, _) => panic!("{level} {kind} {asked}: {:?}", made.map(|made| made.level())),
            }
        }
    }
}
