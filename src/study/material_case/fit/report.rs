//! Table, lines of a case, and plots of fitted parameters.

use std::fmt;

use super::{Estimate, MaterialFit};
use insonify_base::table::{Cell, Table};
use insonify_mechanics::tissue::viscoelastic::point::{Knee, Structure};
use insonify_report::plot::{Axis, Marker, Plot, Series};

/// Number of points of a drawn curve.
const CURVE_POINTS: usize = 120;

impl MaterialFit {
    /// Plots, each with the stem of its file.
    pub fn plots(&self) -> Vec<(&'static str, Plot)> {
        [self.moduli(), self.stiffness()].into_iter().flatten().collect()
    }

    fn moduli(&self) -> Option<(&'static str, Plot)> {
        let fit = self.dynamic.as_ref()?;
        let (k, g) = (fit.order.value, fit.modulus_kpa.value);
        let angle = 0.5 * std::f64::consts::PI * k;
        let ends = [f64::INFINITY, 0.0];
        let frequencies = fit.points.iter().map(|point| point.frequency_rad_s);
        let [low, high] = frequencies.fold(ends, |[low, high], frequency| [low.min(frequency), high.max(frequency)]);
        let line = |share: f64| {
            [low, high]
                .map(|frequency| [frequency, g * share * frequency.powf(k)])
                .to_vec()
        };
        let measured = |part: fn(&super::Modulus) -> f64| {
            let points = fit.points.iter();
            points
                .map(|point| [point.frequency_rad_s, part(point)])
                .collect::<Vec<_>>()
        };
        let series = vec![
            Series::line("G', storage", 0, line(angle.cos())),
            Series::points("G', storage", 0, Marker::Ring, measured(|modulus| modulus.storage_kpa)),
            Series::line("G'', loss", 1, line(angle.sin())),
            Series::points("G'', loss", 1, Marker::Ring, measured(|modulus| modulus.loss_kpa)),
        ];
        let title = format!("Moduli: rings measured, lines of a spring-pot of order {k:.3}");
        let (x, y) = (Axis::log("angular frequency, rad/s"), Axis::log("modulus, kPa"));
        Some(("dynamic-moduli", Plot::new(title, x, y, series)))
    }

    fn stiffness(&self) -> Option<(&'static str, Plot)> {
        let fit = self.creep.as_ref()?;
        let largest = fit.points.iter().map(|point| point[0]).fold(0.0, f64::max);
        let knee = match (fit.knee_shear, fit.stiffening) {
            (Some(knee), Some(stiffening)) => Knee {
                strain: knee.value,
                stiffening: stiffening.value,
            },
            _ => Knee::INFINITE,
        };
        let strains = (0..=CURVE_POINTS).map(|point| largest * point as f64 / CURVE_POINTS as f64);
        let law = strains.map(|strain| [strain, fit.modulus_kpa.value * knee.factor(strain)]);
        let series = vec![
            Series::points("measured", 0, Marker::Cross, fit.points.clone()),
            Series::line("fitted law", 1, law.collect()),
        ];
        let title = "Stiffness from creep against strain";
        let (x, y) = (Axis::linear("shear strain"), Axis::linear("G, kPa s^k"));
        Some(("stiffness", Plot::new(title, x, y, series)))
    }

    /// Lines of a case file and of a material of a scenario with the fitted parameters.
    fn lines(&self) -> String {
        let order = self.dynamic.as_ref().map(|fit| fit.order.value);
        let order = order.or(self.creep.as_ref().map(|fit| fit.order)).unwrap_or_default();
        let modulus = match (&self.creep, &self.dynamic) {
            (Some(fit), _) => fit.modulus_kpa.value,
            (None, Some(fit)) => fit.modulus_kpa.value,
            (None, None) => return String::new(),
        };
        let mut case = format!("law = \"spring-pot\"\norder = {order:.5}\nmodulus_kpa = {modulus:.6}\n");
        let mut scenario = format!("shear_kpa = {modulus:.6}\n");
        if let Some(fit) = &self.creep
            && let (Some(knee), Some(stiffening)) = (fit.knee_shear, fit.stiffening)
        {
            let memory = match fit.memory {
                Structure::Rate => "rate",
                Structure::LoadIntegral => "load-integral",
            };
            let (knee, stiffening) = (knee.value, stiffening.value);
            case += &format!("knee_shear = {knee:.5}\nstiffening = {stiffening:.4}\nmemory = \"{memory}\"\n");
            // The relative strain of simple shear is sqrt(3)/2 of it.
            let [knee, stiffening] = [0.75f64.sqrt() * knee, stiffening / 0.75];
            scenario += &format!("knee_strain = {knee:.5}\nstiffening = {stiffening:.4}\n");
        }
        format!("as lines of a case:\n{case}\nas lines of [[tissue.material]] in a scenario:\n{scenario}")
    }
}

impl fmt::Display for MaterialFit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut table = Table::new(["parameter", "value", "standard error", "unit", "from"].map(Cell::from));
        let mut row = |name: &str, estimate: Estimate, unit: &str, source: &str| {
            let [value, error] = [estimate.value, estimate.standard_error].map(|x| Cell::number(format!("{x:.6}")));
            table.row("", [name.into(), value, error, unit.into(), source.into()]);
        };
        if let Some(fit) = &self.dynamic {
            row("order k", fit.order, "", "moduli");
            row("G", fit.modulus_kpa, "kPa s^k", "moduli");
        }
        if let Some(fit) = &self.creep {
            row("G0", fit.modulus_kpa, "kPa s^k", "creep");
            let estimates = [("knee gamma0", fit.knee_shear), ("stiffening a", fit.stiffening)];
            for (name, estimate) in estimates {
                estimate
                    .into_iter()
                    .for_each(|estimate| row(name, estimate, "", "creep"));
            }
        }
        f.write_str(&table.text("  ", &[]))?;
        if let Some(fit) = &self.dynamic {
            let [storage, loss] = fit.slopes;
            writeln!(
                f,
                "\nslopes of G' {storage:.4} and of G'' {loss:.4}; G''/G' {:.4}, of a spring-pot tan(pi k/2) = {:.4}",
                fit.loss_tangent, fit.spring_pot_loss_tangent
            )?;
        }
        if let Some(fit) = &self.creep {
            writeln!(
                f,
                "\ncreep evaluated with order {:.4}: {} moduli, {:.2} % off the fitted law (root mean square){}",
                fit.order,
                fit.points.len(),
                100.0 * fit.rms,
                if fit.knee_shear.is_none() {
                    "; the modulus does not rise with strain: no knee"
                } else {
                    ""
                }
            )?;
        }
        write!(f, "\n{}", self.lines())
    }
}
