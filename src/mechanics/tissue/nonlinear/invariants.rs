//! Invariants of stress and strain.

/// Returns the von Mises stress, sqrt(3/2 s : s) with s the deviator: the stress in uniaxial tension, sqrt(3) times
/// that in simple shear.
pub fn von_mises(stress: &[[f64; 3]; 3]) -> f64 {
    let [[xx, xy, xz], [_, yy, yz], [_, _, zz]] = *stress;
    let differences = (xx - yy).powi(2) + (yy - zz).powi(2) + (zz - xx).powi(2);
    (0.5 * differences + 3.0 * (xy * xy + yz * yz + xz * xz)).sqrt()
}

/// Returns the relative strain e_r = sqrt(((e1 - e2)^2 + (e2 - e3)^2 + (e3 - e1)^2) / 2) of a strain (`D` = 2: plane
/// strain, with third principal strain 0), and its deviator within the `D` axes. Computed from invariants, without
/// principal strains: e_r^2 = 3/2 e : e with e the deviator.
#[inline]
pub fn relative_strain<const D: usize>(strain: &[[f64; D]; D]) -> (f64, [[f64; D]; D]) {
    let mean = (0..D).map(|i| strain[i][i]).sum::<f64>() / 3.0;
    let mut deviator = *strain;
    let mut square = (3 - D) as f64 * mean * mean;
    for (i, row) in deviator.iter_mut().enumerate() {
        row[i] -= mean;
        square += row.iter().map(|x| x * x).sum::<f64>();
    }
    ((1.5 * square).sqrt(), deviator)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tissue::law::{Law, Linear, NoKeys};
    use crate::tissue::material::Material;
    use crate::tissue::nonlinear::Sheet;

    #[test]
    fn the_von_mises_stress_of_simple_states() {
        let [s, t] = [7.0, 3.0];
        let tension = [[0.0; 3], [0.0, s, 0.0], [0.0; 3]];
        let shear = [[0.0, 0.0, t], [0.0; 3], [t, 0.0, 0.0]];
        let pressure = [[-s, 0.0, 0.0], [0.0, -s, 0.0], [0.0, 0.0, -s]];
        for (stress, expected) in [(tension, s), (shear, 3f64.sqrt() * t), (pressure, 0.0)] {
            assert!((von_mises(&stress) - expected).abs() < 1e-14, "{stress:?}");
            // A pressure changes nothing.
            let mut pressed = stress;
            (0..3).for_each(|i| pressed[i][i] -= 11.0);
            assert!((von_mises(&pressed) - expected).abs() < 1e-14, "{pressed:?}");
        }
    }

    /// In plane strain, uniaxial strain e gives 2 mu e, simple shear g sqrt(3) mu g, whatever Poisson's ratio.
    #[test]
    fn the_von_mises_stress_in_plane_strain() {
        for poisson in [0.0, 0.3, 0.49] {
            let material = Material::new(6.0, poisson).unwrap();
            let [_, mu] = material.lame_kpa();
            let nodes = vec![[0.0, 0.0], [2.0, 0.0], [0.0, 3.0]];
            let sheet = Sheet::plane_strain(
                nodes,
                vec![[0, 1, 2]],
                &[Linear::new(material, NoKeys {}).unwrap()],
                1.0,
            )
            .unwrap();
            for (u, expected) in [
                ([0.0, 0.0, 0.2, 0.0, 0.0, 0.0], 2.0 * mu * 0.1),
                ([0.0, 0.0, 0.0, 0.0, 0.3, 0.0], 3f64.sqrt() * mu * 0.1),
            ] {
                let mises_kpa = sheet.von_mises_kpa(&u, &sheet.stresses_kpa(&u, &u))[0];
                assert!(
                    (mises_kpa - expected).abs() < 1e-12,
                    "{poisson}: {mises_kpa} for {expected}"
                );
            }
        }
    }
}
