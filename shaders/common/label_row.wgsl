// Twin of LabelRow in src/imaging/synth/tables.rs.
struct LabelRow {
    echo: f32,
    impedance: f32,
    loss: u32,
    attenuation: u32,
    texture: u32,
    capsule: f32,
    phase: u32,
}
