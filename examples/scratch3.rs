use insonify::tracking::pose::Pose;
fn main() {
    let pose = Pose::from_matrix(&insonify::phantom::default_pose(insonify::phantom::Phantom::Abdomen)).unwrap();
    let p = pose.turned(45f64.to_radians(), 0.0, (-8f64).to_radians());
    let d = p.probe_to_world().transform_vector(&nalgebra::Vector3::new(-12.0, 2.0, 0.0));
    println!("{} {}", p.probe_to_world(), pose.position_mm() + d);
}
