//! Denoised light against the mean of many bakes.

use crate::golden::HONEST;
use crate::scenes::{outdoors, room, sunlit_room};
use crate::statistics::bakes;
use baker::bake::run::Denoise;

/// Denoised light is closer to the truth, its reported error is the true one, and hardly any light is gained.
#[test]
fn the_reported_error_of_denoised_light_is_true() {
    for (case, name, most) in
        [(room(), "room", 0.6), (outdoors(), "outdoors", 0.7), (sunlit_room(), "sunlit room", 0.5)]
    {
        let reference = bakes(&case, 1, 64, |_| {});
        let raw = bakes(&case, 301, 16, |_| {});
        let denoised = bakes(&case, 301, 16, |o| o.denoise = Denoise::Own);
        let (before, after) = (raw.squared_error(&reference), denoised.squared_error(&reference));
        let ratio = denoised.reported_squared_error() / after;
        println!("{name}: {:.3} of the squared error left, estimated ÷ true {ratio:.3}", after / before);
        assert!(after < most * before, "{name}: {after} instead of {before}");
        assert!(HONEST.contains(&ratio), "{name}: estimated ÷ true squared error {ratio}");
        let gained = denoised.mean() / raw.mean() - 1.0;
        println!("{name}: light gained {:.3} %", 100.0 * gained);
        // (The same seeds: noise is the same in both.)
        assert!(gained.abs() < 0.01, "{name}: {gained}");
    }
}
