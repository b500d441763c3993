use super::*;
use crate::tissue::error::LinearError;

#[test]
fn lame_parameters_follow_the_text_books() {
    // Young's modulus and Poisson's ratio recovered from lambda and mu.
    for (young, nu) in [(1.0, 0.0), (3.5, 0.3), (10.0, 0.49), (2.0, -0.5)] {
        let [lambda, mu] = Material::new(young, nu).unwrap().lame_kpa();
        assert!((mu * (3.0 * lambda + 2.0 * mu) / (lambda + mu) / young - 1.0).abs() < 1e-14);
        assert!((lambda / (2.0 * (lambda + mu)) - nu).abs() < 1e-15);
    }
}

#[test]
fn poisson_lies_between_minus_one_and_a_half() {
    for nu in [0.0, -0.0, -0.3, -0.999, 0.49999] {
        assert!(Material::new(5.0, nu).is_ok(), "{nu}");
    }
    for nu in [0.5, 0.6, -1.0, -2.0, f64::NAN, f64::INFINITY] {
        let error = Material::new(5.0, nu).unwrap_err();
        assert!(error.key == "poisson", "{nu}");
    }
    let text = Material::new(5.0, 0.5).unwrap_err().to_string();
    assert!(
        text.contains("`poisson` is 0.5") && text.contains("below 0.5"),
        "{text}"
    );
}

#[test]
fn young_is_above_zero_and_finite() {
    for young in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e-310, 1e308] {
        let error = Material::new(young, 0.49).unwrap_err();
        assert!(error.key == "young_kpa", "{young}");
    }
    let text = Material::new(-3.0, 0.4).unwrap_err().to_string();
    assert!(text.contains("`young_kpa` is -3") && text.contains("above 0"), "{text}");
}

#[test]
fn regions_without_a_material_are_counted() {
    let nodes = vec![
        [0.0; 3],
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.0, 0.0, 1.0],
        [0.0, 0.0, -1.0],
    ];
    let mesh = TetMesh::new(nodes, vec![[0, 1, 2, 3], [0, 2, 1, 4]], vec![4, 7]).unwrap();
    let soft = Material::new(2.0, 0.45).unwrap();
    let hard = Material::new(20.0, 0.3).unwrap();
    let some = Materials::new(None, &[(4, soft)]).unwrap();
    let error = some.check(&mesh).unwrap_err();
    assert_eq!(error, LinearError::NoMaterial { regions: vec![(7, 1)] });
    assert!(error.to_string().contains("region 7 (1 tetrahedra)"), "{error}");
    let both = Materials::new(Some(hard), &[(4, soft)]).unwrap();
    assert_eq!(both.check(&mesh).unwrap(), vec![soft, hard]);
    assert_eq!(both.named_regions().collect::<Vec<_>>(), vec![4]);
    assert_eq!(Materials::uniform(soft).of(-3), Some(&soft));
}

#[test]
fn a_region_has_one_material() {
    let soft = Material::new(2.0, 0.45).unwrap();
    let error = Materials::new(None, &[(1, soft), (1, soft)]).unwrap_err();
    assert!(
        error.to_string().starts_with("region 1 has two materials: 2 kPa, 0.45"),
        "{error}"
    );
}
