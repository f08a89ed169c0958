//! Samples go by local light, and gaps without room for an eye are judged by the light at their opening.

use crate::scenes::{bright_and_dim, plate_before_a_wall};
use crate::statistics::bakes;
use baker::bake::run::Integrator;

#[test]
fn a_dim_room_is_hardly_noisier_than_a_bright_one() {
    let case = bright_and_dim();
    // Relative variance in the dim room ÷ that in the bright one.
    let ratio = |integrator| {
        let bakes = bakes(&case, 1, 64, |o| o.integrator = integrator);
        bakes.relative_variance(1e-9..1.0) / bakes.relative_variance(1.0..f64::INFINITY)
    };
    let [by_cache, by_page] = [Integrator::Cached, Integrator::Path].map(ratio);
    println!("dim ÷ bright: {by_cache:.2} by the light of the place, {by_page:.2} by the page's");
    assert!(by_cache < 1.8 && by_page > 2.4, "{by_cache}, {by_page}");
}

#[test]
fn a_gap_behind_a_plate_is_judged_from_its_opening() {
    // In a room; and in a doll's house, where no eye has room anywhere: there each cell is judged by what is
    // seen straight from it.
    let p95 = |scale: f64| {
        let bakes = bakes(&plate_before_a_wall(scale), 1, 8, |_| {});
        let all = bakes.outcomes.iter().map(|outcome| outcome.local.all.expect("light").p95);
        all.sum::<f64>() / bakes.outcomes.len() as f64
    };
    let [room, house] = [1.0, 0.05].map(p95);
    println!("95 % of cells: {room:.2} with room for eyes, {house:.2} without");
    assert!(room < 0.5 * house, "{room}, {house}");
}
