//! Kernel file (holds `unsafe`): Intel's Embree 4 behind [`super::ray_tracer::RayTracer`], through the few
//! functions declared here.
//!
//! Not through the crate `embree4-rs`: its newest release (0.0.16, over `embree4-sys` 0.0.12) vendors the
//! headers of 4.2, where a hit ends before `instPrimID`. Libraries from 4.3 on write that field too, four
//! bytes past the crate's struct. The structs here have the layout of 4.3 and newer, which older versions of
//! 4 fill in part.

use super::light_point::LightPoint;
use super::triangle::Hit;
use crate::geometry::Geometry;
use crate::{Error, Result};
use glam::Vec3;
use std::ffi::{c_char, c_int, c_uint, c_void};
use std::ptr;

/// `RTCRay`.
#[derive(Clone, Copy)]
#[repr(C, align(16))]
struct Ray {
    origin: [f32; 3],
    t_near: f32,
    direction: [f32; 3],
    time: f32,
    /// The distance of the hit; in a filter, of the one to decide on; −∞ once an occluder is found.
    t_far: f32,
    mask: u32,
    id: u32,
    flags: u32,
}

/// `RTCHit` with one level of instances.
#[derive(Clone, Copy)]
#[repr(C)]
struct RayEnd {
    normal: [f32; 3],
    u: f32,
    v: f32,
    triangle: u32,
    geometry: u32,
    instance: u32,
    instance_primitive: u32,
}

/// `RTCRayHit`.
#[repr(C, align(16))]
struct RayHit {
    ray: Ray,
    end: RayEnd,
}

/// `RTCRayQueryContext`, which the filter gets back, with what it needs behind it.
#[repr(C)]
struct Context<'a> {
    /// Instance and its primitive: none.
    instance: [u32; 2],
    from: u32,
    t_max: f32,
    /// What it touches does not count.
    end: Option<LightPoint>,
    geometry: &'a Geometry,
    /// Asked about hits on glass.
    passes: &'a dyn Fn(&Hit) -> bool,
}

/// `RTCIntersectArguments`, and `RTCOccludedArguments`, which has the same layout.
#[repr(C)]
struct Arguments {
    flags: c_int,
    features: u32,
    context: *mut c_void,
    filter: Option<unsafe extern "C" fn(*const FilterArguments)>,
    user_geometry: *const c_void,
    /// Only in libraries built with `RTC_MIN_WIDTH`.
    min_width: f32,
}

/// `RTCFilterFunctionNArguments`.
#[repr(C)]
struct FilterArguments {
    valid: *mut c_int,
    user: *mut c_void,
    context: *const c_void,
    ray: *const Ray,
    hit: *const RayEnd,
    count: c_uint,
}

// Names, signatures and values of Embree 4's public headers.
unsafe extern "C" {
    fn rtcNewDevice(config: *const c_char) -> *mut c_void;
    fn rtcReleaseDevice(device: *mut c_void);
    fn rtcGetDeviceError(device: *mut c_void) -> c_int;
    fn rtcNewScene(device: *mut c_void) -> *mut c_void;
    fn rtcReleaseScene(scene: *mut c_void);
    fn rtcSetSceneFlags(scene: *mut c_void, flags: c_int);
    fn rtcCommitScene(scene: *mut c_void);
    fn rtcNewGeometry(device: *mut c_void, kind: c_int) -> *mut c_void;
    fn rtcSetNewGeometryBuffer(
        geometry: *mut c_void,
        kind: c_int,
        slot: c_uint,
        format: c_int,
        stride: usize,
        count: usize,
    ) -> *mut c_void;
    fn rtcCommitGeometry(geometry: *mut c_void);
    fn rtcAttachGeometry(scene: *mut c_void, geometry: *mut c_void) -> c_uint;
    fn rtcReleaseGeometry(geometry: *mut c_void);
    fn rtcIntersect1(scene: *mut c_void, ray: *mut RayHit, arguments: *mut Arguments);
    fn rtcOccluded1(scene: *mut c_void, ray: *mut Ray, arguments: *mut Arguments);
}

const GEOMETRY_TYPE_TRIANGLE: c_int = 0;
const BUFFER_TYPE_INDEX: c_int = 0;
const BUFFER_TYPE_VERTEX: c_int = 1;
const FORMAT_UINT3: c_int = 0x5003;
const FORMAT_FLOAT3: c_int = 0x9003;
const SCENE_FLAG_ROBUST: c_int = 1 << 2;
const SCENE_FLAG_FILTER_FUNCTION_IN_ARGUMENTS: c_int = 1 << 3;
const RAY_QUERY_FLAG_INVOKE_ARGUMENT_FILTER: c_int = 1 << 1;
const NONE: u32 = u32::MAX;

/// A committed scene.
pub(super) struct Scene<'a> {
    geometry: &'a Geometry,
    device: *mut c_void,
    scene: *mut c_void,
}

// SAFETY: Embree's queries on a committed scene may run in any number of threads at once; nothing else is
// called on it.
unsafe impl Send for Scene<'_> {}
// SAFETY: as above.
unsafe impl Sync for Scene<'_> {}

impl<'a> Scene<'a> {
    pub(super) fn new(geometry: &'a Geometry) -> Result<Self> {
        // One thread, so that the hierarchy, and with it which of equally near triangles is found, never
        // depends on how many the machine has. SAFETY: a null-terminated string.
        let device = unsafe { rtcNewDevice(c"threads=1,set_affinity=0".as_ptr()) };
        if device.is_null() {
            // SAFETY: a null device asks for the error of making one.
            let code = unsafe { rtcGetDeviceError(ptr::null_mut()) };
            return Err(Error::unsupported(
                "backend embree",
                format!("the library does not start (error {code})"),
            ));
        }
        // SAFETY: the device lives until `Drop`, and so does the scene.
        let scene = unsafe { rtcNewScene(device) };
        let this = Scene { geometry, device, scene };
        // SAFETY: live handles; the buffers are Embree's own, asked for with the sizes that are then copied.
        unsafe {
            rtcSetSceneFlags(scene, SCENE_FLAG_ROBUST | SCENE_FLAG_FILTER_FUNCTION_IN_ARGUMENTS);
            if !geometry.triangles.is_empty() {
                let mesh = rtcNewGeometry(device, GEOMETRY_TYPE_TRIANGLE);
                fill(mesh, BUFFER_TYPE_VERTEX, FORMAT_FLOAT3, &geometry.positions);
                fill(mesh, BUFFER_TYPE_INDEX, FORMAT_UINT3, &geometry.triangles);
                rtcCommitGeometry(mesh);
                rtcAttachGeometry(scene, mesh);
                rtcReleaseGeometry(mesh);
            }
            rtcCommitScene(scene);
        }
        // SAFETY: a live device.
        match unsafe { rtcGetDeviceError(device) } {
            0 => Ok(this),
            code => Err(Error::unsupported(
                "backend embree",
                format!(
                    "building the hierarchy of {} triangles failed (error {code})",
                    geometry.triangles.len()
                ),
            )),
        }
    }

    pub(super) fn nearest(
        &self,
        origin: Vec3,
        direction: Vec3,
        from: u32,
        passes: &dyn Fn(&Hit) -> bool,
    ) -> Option<Hit> {
        let mut context = self.context(from, f32::INFINITY, None, passes);
        let mut arguments = arguments(&mut context);
        let end = RayEnd {
            normal: [0.0; 3],
            u: 0.0,
            v: 0.0,
            triangle: NONE,
            geometry: NONE,
            instance: NONE,
            instance_primitive: NONE,
        };
        let mut query = RayHit { ray: ray(origin, direction, f32::INFINITY), end };
        // SAFETY: a committed scene; the structs have the library's layout and outlive the call.
        unsafe { rtcIntersect1(self.scene, &mut query, &mut arguments) };
        let RayHit { ray, end } = query;
        let barycentric = Vec3::new(1.0 - end.u - end.v, end.u, end.v);
        (end.geometry != NONE).then_some(Hit { triangle: end.triangle, barycentric, t: ray.t_far })
    }

    pub(super) fn occluded(
        &self,
        origin: Vec3,
        direction: Vec3,
        t_max: f32,
        end: Option<LightPoint>,
        from: u32,
        passes: &dyn Fn(&Hit) -> bool,
    ) -> bool {
        let mut context = self.context(from, t_max, end, passes);
        let mut arguments = arguments(&mut context);
        let mut query = ray(origin, direction, t_max);
        // SAFETY: as in `nearest`.
        unsafe { rtcOccluded1(self.scene, &mut query, &mut arguments) };
        query.t_far == f32::NEG_INFINITY
    }

    fn context<'c>(
        &'c self,
        from: u32,
        t_max: f32,
        end: Option<LightPoint>,
        passes: &'c dyn Fn(&Hit) -> bool,
    ) -> Context<'c> {
        Context { instance: [NONE; 2], from, t_max, end, geometry: self.geometry, passes }
    }
}

impl Drop for Scene<'_> {
    fn drop(&mut self) {
        // SAFETY: made in `new`, released once.
        unsafe {
            rtcReleaseScene(self.scene);
            rtcReleaseDevice(self.device);
        }
    }
}

/// Copies rows of three 4-byte numbers into a new buffer of `mesh`, if Embree has room for it.
///
/// # Safety
/// `mesh` must be live, and `T` three 4-byte numbers of `format`.
unsafe fn fill<T: Copy>(mesh: *mut c_void, kind: c_int, format: c_int, rows: &[T]) {
    const { assert!(size_of::<T>() == 12) };
    // SAFETY: promised by the caller; the buffer has room for as many rows.
    unsafe {
        let buffer = rtcSetNewGeometryBuffer(mesh, kind, 0, format, 12, rows.len());
        if !buffer.is_null() {
            ptr::copy_nonoverlapping(rows.as_ptr().cast::<u8>(), buffer.cast(), size_of_val(rows));
        }
    }
}

fn ray(origin: Vec3, direction: Vec3, t_far: f32) -> Ray {
    Ray {
        origin: origin.to_array(),
        t_near: 0.0,
        direction: direction.to_array(),
        time: 0.0,
        t_far,
        mask: u32::MAX,
        id: 0,
        flags: 0,
    }
}

fn arguments(context: &mut Context) -> Arguments {
    Arguments {
        flags: RAY_QUERY_FLAG_INVOKE_ARGUMENT_FILTER,
        features: u32::MAX,
        context: ptr::from_mut(context).cast(),
        filter: Some(filter),
        user_geometry: ptr::null(),
        min_width: 0.0,
    }
}

/// Refuses hits on the triangle the ray starts on, at the origin or the far end, on what the light at the
/// far end touches, where a cut-out is open, and where glass passes.
unsafe extern "C" fn filter(arguments: *const FilterArguments) {
    // SAFETY: Embree hands over a query of one ray, with the context of `arguments`.
    unsafe {
        let arguments = &*arguments;
        let context = &*arguments.context.cast::<Context>();
        let (ray, hit) = (&*arguments.ray, &*arguments.hit);
        let triangle = hit.triangle as usize;
        let barycentric = Vec3::new(1.0 - hit.u - hit.v, hit.u, hit.v);
        let counts = hit.triangle != context.from
            && ray.t_far > 0.0
            && ray.t_far < context.t_max
            && !context.end.as_ref().is_some_and(|end| {
                ray.t_far >= end.ask_from() && end.touches(context.geometry, hit.triangle)
            })
            && context.geometry.is_solid_at(triangle, barycentric)
            && !(context.geometry.is_glass(triangle)
                && (context.geometry.is_of_neighbour(triangle, barycentric)
                    || (context.passes)(&Hit { triangle: hit.triangle, barycentric, t: ray.t_far })));
        if !counts {
            *arguments.valid = 0;
        }
    }
}
