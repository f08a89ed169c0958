//! Where the camera stands.

use super::default_viewpoint::DefaultViewpoint;
use super::options::{Options, parse_point};
use crate::geometry::{Bounds, Geometry};
use crate::scene::{Camera, Scene};
use crate::trace::rays::{Hit, NO_TRIANGLE, RayTracer};
use crate::{Error, Result};
use glam::DVec3;
use std::f64::consts::TAU;

/// The camera that is asked for: of the scene, or of the command line; `None` where none is.
///
/// # Errors
/// A name that no camera has; a camera that looks at where it stands.
pub(crate) fn asked(options: &Options, scene: &Scene, geometry: &Geometry) -> Result<Option<Camera>> {
    let of_scene = match &options.camera {
        None => scene.cameras.first().cloned(),
        Some(name) => scene.cameras.iter().find(|camera| camera.name == *name).cloned(),
    };
    let camera = match (of_scene, &options.camera) {
        (Some(camera), _) => camera,
        (None, None) => return Ok(None),
        (None, Some(text)) => {
            let position = parse_point(text).map_err(|_| {
                let names: Vec<String> = scene.cameras.iter().map(|c| format!("{:?}", c.name)).collect();
                let names = if names.is_empty() { "the scene has none".to_owned() } else { names.join(", ") };
                Error::invalid(
                    "--camera",
                    format!("{text:?}: expected the name of a [[camera]] ({names}) or \"x,y,z\""),
                )
            })?;
            Camera {
                name: "view".to_owned(),
                position,
                look_at: Lit::new(geometry).middle(),
                fov: Camera::FOV,
            }
        }
    };
    aimed(camera, options).map(Some)
}

/// One that shows something of most scenes, outside all bodies; `luminance` is what a surface shows.
///
/// # Errors
/// `--look-at` is where it stands.
pub(crate) fn default(
    options: &Options,
    geometry: &Geometry,
    ray_tracer: &RayTracer,
    luminance: &dyn Fn(&Hit) -> f32,
) -> Result<Camera> {
    let bounds = Lit::new(geometry);
    let viewpoint = DefaultViewpoint { geometry, ray_tracer, luminance };
    let (mut camera, is_inside) = usual(&viewpoint, &bounds);
    // From outside everything is in view, unless something stands there that has no texels.
    if is_inside || !viewpoint.is_free(camera.position, 0.0) {
        let usual = (camera.position, camera.look_at);
        (camera.position, camera.look_at) = viewpoint.best(usual, bounds.low, bounds.high);
        camera.fov = INSIDE_FOV;
    }
    aimed(camera, options)
}

/// A camera that looks where the command line says, if it does.
fn aimed(mut camera: Camera, options: &Options) -> Result<Camera> {
    camera.look_at = options.look_at.unwrap_or(camera.look_at);
    camera.fov = options.fov.unwrap_or(camera.fov);
    if camera.look_at == camera.position {
        return Err(Error::invalid("--look-at", "expected another point than the camera's position"));
    }
    Ok(camera)
}

/// Angle of view inside, in degrees.
const INSIDE_FOV: f64 = 80.0;

/// The least length in metres of something that people stand in: what is smaller is looked at from outside.
pub(crate) const SMALLEST_ROOM: f64 = 3.0;

/// The box around what has texels, in the world.
struct Lit {
    low: DVec3,
    high: DVec3,
}

impl Lit {
    fn new(geometry: &Geometry) -> Self {
        let lit = geometry.instances.iter().filter(|instance| instance.lightmap);
        let points = lit.flat_map(|instance| &geometry.positions[instance.vertices.clone()]);
        let bounds = Bounds::of(points.copied());
        Lit { low: bounds.low.as_dvec3() + geometry.origin, high: bounds.high.as_dvec3() + geometry.origin }
    }

    fn middle(&self) -> DVec3 {
        0.5 * (self.low + self.high)
    }
}

/// A camera that shows something of most scenes, and whether it is inside. From outside it looks down at the
/// middle from the south-west. Inside, where hardly any ray leaves the scene upwards from the middle, and
/// that is no body alone, it stands on the same side of the room.
fn usual(viewpoint: &DefaultViewpoint, bounds: &Lit) -> (Camera, bool) {
    /// Rays from the middle, and how many may leave a closed room, by its windows.
    const RAYS: usize = 64;
    const MOST_LEAVING: usize = RAYS / 4;
    /// Of this many free places, one in a room makes it one.
    const ROOMY: usize = 8;
    let (geometry, ray_tracer) = (viewpoint.geometry, viewpoint.ray_tracer);
    let (middle, size) = (bounds.middle(), bounds.high - bounds.low);
    let local = |point: DVec3| (point - geometry.origin).as_vec3();
    let is_covered = |place: DVec3| {
        let leaves = |i: &usize| {
            // Evenly over the upper hemisphere, turned by the golden ratio.
            let (y, phi) = ((*i as f64 + 0.5) / RAYS as f64, *i as f64 * TAU * 0.618_034);
            let r = (1.0 - y * y).sqrt();
            let direction = DVec3::new(r * phi.cos(), y, r * phi.sin()).normalize().as_vec3();
            ray_tracer.nearest_wall(local(place), direction, NO_TRIANGLE).is_none()
        };
        (0..RAYS).filter(leaves).count() <= MOST_LEAVING
    };
    // The middle of a trunk or a statue is covered, too, and nothing around it is. In a room a piece of
    // furniture may stand there.
    let is_room = || {
        if viewpoint.is_free(middle, 0.0) {
            return true;
        }
        let free = viewpoint.free_places(bounds.low, bounds.high);
        ROOMY * free.iter().filter(|place| is_covered(**place)).count() > free.len()
    };
    let name = "default".to_owned();
    if size.max_element() >= SMALLEST_ROOM && is_covered(middle) && is_room() {
        // As far towards that corner as nothing stands in the way, and a little back.
        let back = DVec3::new(-size.x, 0.3 * size.y, size.z);
        let (distance, direction) = (0.5 * back.length(), back.normalize());
        let free = ray_tracer
            .nearest_wall(local(middle), direction.as_vec3(), NO_TRIANGLE)
            .map_or(distance, |hit| hit.t.into());
        let position = middle + direction * (0.9 * free.min(distance));
        let camera = Camera {
            name,
            position,
            look_at: middle - direction * distance - 0.2 * size.y * DVec3::Y,
            fov: INSIDE_FOV,
        };
        return (camera, true);
    }
    let direction = DVec3::new(-0.6, 0.6, 1.0).normalize();
    let distance = 0.5 * size.length() / (0.5 * Camera::FOV.to_radians()).sin();
    (Camera { name, position: middle + direction * distance, look_at: middle, fov: Camera::FOV }, false)
}

#[cfg(test)]
mod tests {
    use super::super::default_viewpoint::tests::{block, divided};
    use super::*;
    use glam::Vec3;

    /// The camera by default, and whether it stands in the box around the geometry.
    fn camera(geometry: &Geometry) -> (Camera, bool) {
        let ray_tracer = RayTracer::new(geometry);
        let camera = default(&Options::new(12.0), geometry, &ray_tracer, &|_| 1.0).unwrap();
        let lit = Lit::new(geometry);
        let at = camera.position;
        let is_within = at.cmpge(lit.low).all() && at.cmple(lit.high).all();
        (camera, is_within)
    }

    /// Boxes seen from outside, in a geometry of one instance.
    fn blocks(boxes: &[[[f32; 3]; 2]]) -> Geometry {
        let mut geometry = Geometry { materials: divided().materials, ..Geometry::default() };
        boxes.iter().for_each(|[low, high]| block(&mut geometry, Vec3::from(*low), Vec3::from(*high), false));
        of_one_instance(geometry)
    }

    fn of_one_instance(mut geometry: Geometry) -> Geometry {
        geometry.instances = vec![crate::geometry::Instance {
            name: String::new(),
            mesh: 0,
            world_from_mesh: glam::DAffine3::IDENTITY,
            triangles: 0..geometry.triangles.len(),
            vertices: 0..geometry.positions.len(),
            lightmap: true,
            has_lightmap_uvs: false,
            lightmap_place: crate::geometry::LightmapPlace::Unsaid,
            density: 1.0,
        }];
        geometry
    }

    #[test]
    fn rooms_are_seen_from_inside_and_things_from_outside() {
        let (camera_of_room, is_within) = camera(&of_one_instance(divided()));
        assert!(is_within && camera_of_room.fov == INSIDE_FOV, "{camera_of_room:?}");
        // A crate; a box that is open at the front, as a shelf; a tree of which the middle lies in the trunk
        // below the crown.
        let shelf = [
            [[0.0, 0.0, 0.0], [0.1, 2.0, 0.5]],
            [[0.9, 0.0, 0.0], [1.0, 2.0, 0.5]],
            [[0.1, 0.0, 0.0], [0.9, 2.0, 0.1]],
            [[0.1, 1.9, 0.1], [0.9, 2.0, 0.5]],
            [[0.1, 0.0, 0.1], [0.9, 0.1, 0.5]],
        ];
        let tree = [[[-0.15, 0.0, -0.15], [0.15, 5.0, 0.15]], [[-2.0, 5.0, -2.0], [2.0, 5.6, 2.0]]];
        for things in [&[[[0.0; 3], [0.5, 1.0, 0.5]]][..], &shelf, &tree] {
            let (camera, is_within) = camera(&blocks(things));
            assert!(!is_within && camera.fov == Camera::FOV, "{things:?}: {camera:?}");
        }
    }
}
