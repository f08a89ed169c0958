//! xatlas through its C shim (`shim.cpp`): the only unsafe code of the atlas.

use glam::{Vec2, Vec3};

unsafe extern "C" {
    fn baker_xatlas_unwrap(
        positions: *const f32,
        normals: *const f32,
        vertex_count: u32,
        indices: *const u32,
        face_count: u32,
        uvs: *mut f32,
        charts: *mut u32,
    ) -> i32;
}

/// A mesh cut into charts.
pub(super) struct Unwrapped {
    /// Per face, its corners in the plane of its chart.
    pub uvs: Vec<[Vec2; 3]>,
    /// Per face, its chart; `None` where xatlas left the face out.
    pub charts: Vec<Option<u32>>,
}

/// Segments a mesh and flattens its charts. `None` when xatlas fails; the result may still hold bad charts,
/// so check them.
///
/// xatlas has absolute tolerances: positions should be finite, with faces of about unit area and not much
/// further than 10⁵ units from the origin. Runs on the calling thread and depends on nothing but its
/// arguments.
pub(super) fn unwrap(positions: &[Vec3], normals: &[Vec3], faces: &[[u32; 3]]) -> Option<Unwrapped> {
    let vertex_count = u32::try_from(positions.len()).ok()?;
    // Three indices and three edges per face must be countable in 32 bits.
    let face_count = u32::try_from(faces.len()).ok().filter(|&n| n < u32::MAX / 6)?;
    if normals.len() != positions.len()
        || faces.iter().flatten().any(|&v| v >= vertex_count)
        || positions.iter().chain(normals).any(|p| !p.is_finite())
    {
        return None;
    }
    let mut uvs = vec![0.0f32; faces.len() * 6];
    let mut charts = vec![u32::MAX; faces.len()];
    // SAFETY: `Vec3` is three packed `f32` and `[u32; 3]` three `u32`, so the four slices hold exactly the
    // counts passed: 3 floats per vertex, 3 indices per face (each checked above to be below `vertex_count`),
    // 6 uvs and 1 chart per face. The shim writes only those, keeps no pointer, catches every C++ exception,
    // and works on an atlas of its own: xatlas' only global state is the allocator, set once under C++'s
    // guard for local statics.
    let count = unsafe {
        baker_xatlas_unwrap(
            positions.as_ptr().cast(),
            normals.as_ptr().cast(),
            vertex_count,
            faces.as_ptr().cast(),
            face_count,
            uvs.as_mut_ptr(),
            charts.as_mut_ptr(),
        )
    };
    let count = u32::try_from(count).ok()?;
    let corner = |f: &[f32], i: usize| Vec2::new(f[2 * i], f[2 * i + 1]);
    Some(Unwrapped {
        uvs: uvs.chunks_exact(6).map(|f| [corner(f, 0), corner(f, 1), corner(f, 2)]).collect(),
        charts: charts.into_iter().map(|c| (c < count).then_some(c)).collect(),
    })
}
