//! Scenarios parsed, resolved and run with a model of prescribed response.

mod aimed;
mod guided;
mod parts;
mod points;
mod prescribed;
mod read;
mod stepped;

use std::path::Path;

use super::{Scenario, ScenarioFile};
use insonify_base::document::InputError;

/// Coarse block, fixed at the bottom, with a needle inserted 20 mm along z in 2 s.
const BLOCK: &str = r#"version = 1
[run]
dt_ms = 10
[scene.volume]
phantom = "two-layer"
resolution_mm = 5
[scene.image]
width = 24
height = 16
[tissue]
nodes = 250
[[tissue.fix]]
box_mm = [[-inf, -inf, 40], [inf, inf, inf]]
[[tissue.material]]
region = "phantom_inclusion"
friction_n_per_mm = 0.25
[needle]
length_mm = 100
deposit_s = [1.0]
[[needle.motion.keyframes]]
time_s = 0
tip_mm = [0, 0, -50]
direction = [0, 0, 1]
[[needle.motion.keyframes]]
time_s = 2
tip_mm = [0, 0, -30]
direction = [0, 0, 1]
roll_deg = 90
"#;

fn resolved(text: &str) -> Result<Scenario, InputError> {
    ScenarioFile::parse(text, "block.toml")?.resolve(Path::new("."), |_| {})
}

/// The block with a probe cylinder in its hole, which runs along z, 26 mm from its middle.
fn with_probe() -> String {
    let text = BLOCK.to_owned()
        + r#"
[contact_probe]
radius_mm = 9
length_mm = 120
axis = [0, 0, 1]
end_mm = [0, 0, 0]
within_mm = 3
"#;
    text.replace(
        "[scene.image]",
        "[scene.pose]\nposition_mm = [0, 26, 50]\ndirection = [0, -1, 0]\nlateral = [-1, 0, 0]\n[scene.image]",
    )
}

/// Fixed nodes and axes of linear tissue.
fn fixed(scenario: &Scenario) -> &[(u32, u8)] {
    &scenario.tissue.finite_element().expect("finite elements").fixed
}
