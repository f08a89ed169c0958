//! How the camera moves.

use crate::args::Motion;
use crate::scene::Scene;
use dataset::pictures::Camera;
use glam::{Mat4, Vec3, Vec4};

/// Metres a second.
const WALK: f64 = 2.0;
/// Degrees a second.
const TURN: f64 = 45.0;
/// Metres that are seen.
const FAR: f32 = 300.0;
/// Seconds between jumps.
const STAY: f64 = 2.0;

/// Clip space from world at a time.
pub fn at(motion: Motion, start: &Camera, scene: &Scene, seconds: f64, [width, height]: [u32; 2]) -> Mat4 {
    let (mut eye, target) = (start.position.as_vec3(), start.look_at.as_vec3());
    let mut ahead = (target - eye).normalize_or(Vec3::NEG_Z);
    let level = Vec3::new(ahead.x, 0.0, ahead.z).normalize_or(Vec3::NEG_Z);
    let turned = |v: Vec3, degrees: f64| glam::Quat::from_rotation_y(degrees.to_radians() as f32) * v;
    match motion {
        Motion::Stand => {}
        Motion::Walk => {
            eye += level * (WALK * seconds) as f32;
            ahead = turned(ahead, 12.0 * (seconds * 0.7).sin());
        }
        Motion::Pan => ahead = turned(ahead, TURN * seconds),
        Motion::Teleport => {
            let jump = (seconds / STAY) as usize;
            eye += scene.copies[jump * 7 % scene.copies.len()];
            ahead = turned(ahead, 110.0 * jump as f64);
            eye += level * (WALK * (seconds % STAY)) as f32;
        }
    }
    let (right, up) = basis(ahead);
    let world = Mat4::from_cols(right.extend(0.0), up.extend(0.0), (-ahead).extend(0.0), eye.extend(1.0));
    // `fov` is from left to right; depth goes from 0 to 1.
    let across = 1.0 / (start.fov as f32 / 2.0).to_radians().tan();
    let down = across * width as f32 / height as f32;
    let [near, far] = [0.1, FAR];
    let depth = far / (near - far);
    let projection = Mat4::from_cols(
        Vec4::new(across, 0.0, 0.0, 0.0),
        Vec4::new(0.0, down, 0.0, 0.0),
        Vec4::new(0.0, 0.0, depth, -1.0),
        Vec4::new(0.0, 0.0, near * depth, 0.0),
    );
    projection * world.inverse()
}

/// To the right, and upwards, of a look ahead.
fn basis(ahead: Vec3) -> (Vec3, Vec3) {
    let right = ahead.cross(Vec3::Y).normalize_or(Vec3::X);
    (right, right.cross(ahead))
}
