//! Millions of rays per second and core, closest hit and any hit, incoherent, per tier and backend:
//! `cargo bench -p baker --bench rays [-- big]` (`big`: also ten million triangles). Times are this thread's
//! CPU time.

use baker::geometry::{Geometry, Material};
use baker::scene::load as load_scene;
use baker::trace::paths::{Sequence, SequenceKind};
use baker::trace::rays::ray_tracer::{RayTracer, offset_point};
use baker::trace::rays::{Backend, Bvh8, Tier};
use glam::{Vec3, vec3};
use std::path::Path;

struct Ray {
    origin: Vec3,
    direction: Vec3,
    from: u32,
}

fn main() {
    let yard = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenes/yard.toml");
    let yard = load_scene(&yard).and_then(|(scene, _)| baker::geometry::load(&scene));
    match yard {
        Ok((geometry, _)) => measure("yard", &geometry, 1 << 19),
        Err(error) => println!("yard: {error}"),
    }
    measure("terrain", &terrain(310), 1 << 19);
    if std::env::args().any(|a| a == "big") {
        measure("big terrain", &terrain(2236), 1 << 17);
    }
}

/// `n × n` tiles of two triangles over 100 m of hills.
fn terrain(n: usize) -> Geometry {
    let mut g = Geometry::default();
    for i in 0..(n + 1) * (n + 1) {
        let [x, z] = [i % (n + 1), i / (n + 1)].map(|k| k as f32 / n as f32 * 100.0);
        // Hills of seven sizes, each half as high as the last, turned against each other.
        let height = (0..7).map(|octave| {
            let (sin, cos) = (octave as f32 * 2.4).sin_cos();
            let k = 0.15 * f32::powi(2.0, octave);
            ((cos * x + sin * z) * k).sin() * ((cos * z - sin * x) * k).cos() * 4.0 / f32::powi(2.0, octave)
        });
        g.positions.push(vec3(x, height.sum(), z));
    }
    let at = |i: usize, j: usize| (j * (n + 1) + i) as u32;
    for (i, j) in (0..n * n).map(|k| (k % n, k / n)) {
        g.triangles.push([at(i, j), at(i, j + 1), at(i + 1, j)]);
        g.triangles.push([at(i + 1, j), at(i, j + 1), at(i + 1, j + 1)]);
    }
    g.material_of = vec![0; g.triangles.len()];
    g.materials.push(Material {
        albedo: Vec3::splat(0.5),
        albedo_max: 1.0,
        alpha: 1.0,
        texture: None,
        alpha_cutoff: None,
        two_sided: true,
        emission: None,
    });
    g
}

/// Rays from random triangles, about as the cosine of their front.
fn rays(g: &Geometry, count: u32) -> Vec<Ray> {
    let sequence = Sequence::new(1, SequenceKind::Texel, 0, 0);
    (0..count)
        .map(|i| {
            let s = sequence.sample(i);
            let from = (s.number(0) * g.triangles.len() as f32) as u32;
            let (a, b) = (s.number(1), s.number(2));
            let (a, b) = if a + b > 1.0 { (1.0 - a, 1.0 - b) } else { (a, b) };
            let normal = g.normal(from as usize);
            let origin = offset_point(&g.corners(from as usize), vec3(1.0 - a - b, a, b), normal);
            let (sin, cos) = (s.number(3) * std::f32::consts::TAU).sin_cos();
            let z = s.number(4) * 2.0 - 1.0;
            let r = (1.0 - z * z).sqrt();
            let direction = (normal + 0.999 * vec3(r * cos, r * sin, z)).normalize_or(Vec3::Y);
            Ray { origin, direction, from }
        })
        .collect()
}

fn measure(name: &str, g: &Geometry, count: u32) {
    let start = cpu_secs();
    let bvh = Bvh8::new(g);
    println!(
        "{name}: {} triangles, built in {:.2} s, {:.0} bytes a triangle (peak of the process so far {} MiB)",
        g.triangles.len(),
        cpu_secs() - start,
        bvh.bytes() as f64 / g.triangles.len() as f64,
        peak_mib()
    );
    let queries = rays(g, count);
    for tier in Tier::ALL {
        let bvh = bvh.clone().with_tier(tier);
        if bvh.tier() == tier {
            report(&format!("obvhs {tier:?}"), &RayTracer::with_hierarchy(g, bvh), &queries);
        }
    }
    if Backend::Embree.is_built() {
        let start = cpu_secs();
        match RayTracer::with_backend(g, Backend::Embree) {
            Ok(embree) => {
                println!("  (embree built in {:.2} s)", cpu_secs() - start);
                report("embree", &embree, &queries);
            }
            Err(error) => println!("  {error}"),
        }
    }
}

fn report(name: &str, rays: &RayTracer, queries: &[Ray]) {
    let nearest = rate(queries, |q| rays.nearest(q.origin, q.direction, q.from).is_some());
    let any = rate(queries, |q| rays.occluded(q.origin, q.direction, f32::INFINITY, q.from));
    println!("  {name:14} closest {nearest:5.2}  any {any:5.2} Mrays/s");
}

/// The best of three runs.
fn rate(queries: &[Ray], mut query: impl FnMut(&Ray) -> bool) -> f64 {
    let mut best = f64::INFINITY;
    for _ in 0..3 {
        let start = cpu_secs();
        let hits = queries.iter().filter(|q| query(q)).count();
        assert!(std::hint::black_box(hits) <= queries.len());
        best = best.min(cpu_secs() - start);
    }
    queries.len() as f64 / best * 1e-6
}

/// CPU time of this thread; where the system does not tell, time since the process began.
fn cpu_secs() -> f64 {
    static START: std::sync::OnceLock<std::time::Instant> = std::sync::OnceLock::new();
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    let nanoseconds = text.split(' ').next().and_then(|n| n.parse::<f64>().ok());
    let elapsed = START.get_or_init(std::time::Instant::now).elapsed().as_secs_f64();
    nanoseconds.map_or(elapsed, |n| n * 1e-9)
}

fn peak_mib() -> u64 {
    let text = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = text.lines().find_map(|l| l.strip_prefix("VmHWM:"));
    line.and_then(|l| l.trim().split(' ').next()?.parse::<u64>().ok()).unwrap_or(0) / 1024
}
