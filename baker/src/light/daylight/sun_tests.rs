//! Tests of the sun: positions against references, irradiance against the IES clear sky, the disc against its
//! solid angle.

use super::*;

const BERLIN: Location = Location {
    latitude: 52.5,
    longitude: 13.4,
    utc_offset: 2.0,
    date: (2024, 6, 21),
    north: 0.0,
    refraction: true,
};

/// NREL's worked example of the SPA (Reda & Andreas 2004, table A5.1): azimuth 194.34024°, elevation before
/// refraction 39.87205°.
#[test]
fn position_matches_the_spa_example() {
    let golden = Location {
        latitude: 39.742476,
        longitude: -105.1786,
        utc_offset: -7.0,
        date: (2003, 10, 17),
        north: 0.0,
        refraction: false,
    };
    let hour = 12.0 + 30.5 / 60.0;
    let (azimuth, elevation) = position(&golden, hour).unwrap();
    assert!(
        (azimuth - 194.34024).abs() < 1e-3 && (elevation - 39.87205).abs() < 1e-3,
        "{azimuth} {elevation}"
    );
    let (direction, same) = direction(&golden, hour);
    assert_eq!(same, elevation);
    let (a, e) = (azimuth.to_radians(), elevation.to_radians());
    let expected = DVec3::new(a.sin() * e.cos(), e.sin(), -a.cos() * e.cos());
    assert!((direction.as_dvec3() - expected).length() < 1e-6);
}

#[test]
fn the_sun_runs_from_east_over_south_to_west() {
    let (morning, _) = direction(&BERLIN, 7.0);
    let (noon, height) = direction(&BERLIN, 13.1);
    let (evening, _) = direction(&BERLIN, 19.0);
    assert!(morning.x > 0.5 && evening.x < -0.5 && noon.z > 0.3 && noon.x.abs() < 0.03);
    // Solstice: 90° − latitude + obliquity.
    assert!((height - (90.0 - 52.5 + 23.44)).abs() < 0.05, "{height}");
    // North turned to +X: south, where the sun is at noon, is −X.
    let (turned, _) = direction(&Location { north: 90.0, ..BERLIN }, 13.1);
    assert!(turned.x < -0.3 && (turned.y - noon.y).abs() < 1e-6);
    assert!((turned.x + noon.z).abs() < 1e-5 && (turned.z - noon.x).abs() < 1e-5);
}

#[test]
fn a_date_out_of_reach_is_an_error_not_a_panic() {
    assert!(check(&BERLIN).is_ok());
    for date in [(9000, 1, 1), (2024, 13, 1), (2024, 0, 1), (2024, 1, 77)] {
        let location = Location { date, ..BERLIN };
        assert!(check(&location).is_err(), "{date:?}");
        assert_eq!(direction(&location, 12.0).0, Vec3::NEG_Y);
    }
}

/// IES RP-21 (1984) for a clear sky: E_dn = 128 exp(−0.21 m) klx, m = 1/sin(elevation); within 15 % at
/// turbidity 2.
#[test]
fn irradiance_matches_the_ies_clear_sky() {
    for elevation in [10.0, 20.0, 30.0, 45.0, 60.0, 75.0, 90.0f64] {
        let published = 128.0 * (-0.21 / elevation.to_radians().sin()).exp();
        let ours = luminance_of(clear_air_irradiance(elevation, 2.0));
        println!("{elevation}: {ours} {published}");
        assert!((ours / published - 1.0).abs() < 0.15, "{elevation}°: {ours} against {published}");
    }
    // More turbid is darker, lower is redder, and nothing at the horizon jumps.
    let at = |e, t| clear_air_irradiance(e, t);
    assert!(luminance_of(at(45.0, 5.0)) < luminance_of(at(45.0, 2.0)));
    let (high, low) = (at(60.0, 3.0), at(5.0, 3.0));
    assert!(low.x / low.z > 2.0 * high.x / high.z);
    assert!((at(0.0, 3.0) - at(-0.2, 3.0)).length() < 1e-9 && at(-30.0, 3.0).is_finite());
    assert!((luminance_of(SUN_COLOUR) - 1.0).abs() < 1e-3);
}

/// Flat-disc limit: the fraction above a line at distance h = e/δ below the centre is 1 − (acos h − h √(1 −
/// h²))/π.
#[test]
fn the_disc_fades_by_its_area() {
    let delta = 0.2665f64.to_radians();
    for h in [-1.0, -0.9, -0.3, 0.0, 0.2, 0.7, 1.0f64] {
        let flat = 1.0 - (h.acos() - h * (1.0 - h * h).sqrt()) / std::f64::consts::PI;
        assert!((visible_fraction(h * delta, delta) - flat).abs() < 1e-5, "{h}");
    }
    assert_eq!((visible_fraction(0.1, 0.0), visible_fraction(-0.1, 0.0)), (1.0, 0.0));
    // A wide disc whose solid angle is counted on a grid.
    let (delta, elevation) = (0.5f64, 0.2f64);
    let (mut above, mut all) = (0.0, 0.0);
    let n = 2000;
    for i in 0..n {
        let cosine = 1.0 - (1.0 - delta.cos()) * (i as f64 + 0.5) / n as f64;
        for j in 0..n {
            let phi = TAU * (j as f64 + 0.5) / n as f64;
            let y = cosine * elevation.sin() + (1.0 - cosine * cosine).sqrt() * phi.sin() * elevation.cos();
            all += 1.0;
            above += if y > 0.0 { 1.0 } else { 0.0 };
        }
    }
    assert!((visible_fraction(elevation, delta) - above / all).abs() < 1e-4);
}

fn disc(elevation: f64, delta: f64, horizon: bool) -> SunDisc {
    let direction = DVec3::new(0.6 * elevation.cos(), elevation.sin(), -0.8 * elevation.cos()).as_vec3();
    SunDisc { direction, irradiance: Rgb::ONE, half_angle: delta as f32, horizon }
}

/// Every sample lies on the visible part, `invert` undoes it, and equal cells of `u` get equal solid angle:
/// the number of uniformly spread points that `invert` puts in each of 64 cells, χ² with 63 degrees of
/// freedom below 119 (p = 2·10⁻⁵).
#[test]
fn disc_samples_are_uniform() {
    for (elevation, delta, horizon) in [
        (0.5, 0.0047, true),
        (0.002, 0.0047, true),
        (-0.003, 0.0047, true),
        (-0.0046, 0.0047, true),
        (0.1, 0.3, true),
        (-0.2, 0.3, true),
        (-0.2, 0.3, false),
        (0.3, 1.0, true),
        (0.00002, 0.00005, true),
    ] {
        let disc = disc(elevation, delta, horizon);
        let cap = Cap::new(&disc).unwrap();
        for i in 0..32 {
            for j in 0..32 {
                let u = Vec2::new((i as f32 + 0.5) / 32.0, (j as f32 + 0.5) / 32.0);
                let exact = cap.sample(f64::from(u.x), f64::from(u.y));
                let sample = disc.sample(u);
                assert!((sample.length() - 1.0).abs() < 1e-6 && (sample.as_dvec3() - exact).length() < 1e-6);
                assert!(!horizon || sample.y >= 0.0);
                assert!(
                    exact.cross(cap.centre).length() <= delta.sin() * (1.0 + 1e-6) && cap.contains(exact)
                );
                assert!((cap.invert(exact).as_vec2() - u).length() < 1e-4, "{disc:?} {u}");
                assert_eq!(disc.pdf(sample), (1.0 / cap.solid_angle()) as f32);
            }
        }
        assert_eq!(disc.pdf(-disc.direction), 0.0);
        assert!(disc.invert(-disc.direction).is_none());
        // Points uniform over the whole cap (by its own polar map), kept when visible.
        let whole = Cap::new(&SunDisc { horizon: false, ..disc }).unwrap();
        let (mut counts, mut total, mut state) = ([0u32; 64], 0, 1u64);
        for _ in 0..40_000 {
            let mut next = || {
                state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
                (state >> 11) as f64 / (1u64 << 53) as f64
            };
            let point = whole.sample(next(), next());
            if !horizon || point.y > 0.0 {
                let u = cap.invert(point) * 7.999999;
                counts[u.x as usize * 8 + u.y as usize] += 1;
                total += 1;
            }
        }
        let part = f64::from(total) / 40_000.0;
        let expected_part =
            if horizon { visible_fraction(cap.centre.y.asin(), f64::from(disc.half_angle)) } else { 1.0 };
        assert!(
            (part - expected_part).abs() < 5.0 * (expected_part / 40_000.0).sqrt(),
            "{part} {expected_part}"
        );
        let mean = f64::from(total) / 64.0;
        if mean > 5.0 {
            let chi2: f64 = counts.iter().map(|&n| (f64::from(n) - mean).powi(2) / mean).sum();
            assert!(chi2 < 119.0, "{elevation} {delta}: χ² = {chi2}");
        }
    }
}

/// E = π L sin²δ cos θ for a disc wholly above a surface's horizon.
#[test]
fn a_surface_gets_its_share_of_the_disc() {
    let sun = Sun {
        disc_angle: 40.0,
        track: SunTrack::Authored(vec![SunKey {
            hour: 3.0,
            direction: DVec3::Y,
            irradiance: DVec3::new(1.0, 2.0, 0.0),
        }]),
    };
    let disc = at(&sun, None, 22.0).unwrap();
    let normal = Vec3::new(0.6, 0.8, 0.0);
    let n = 256;
    let mut sum = 0.0;
    for i in 0..n * n {
        let u = Vec2::new((i % n) as f32 + 0.5, (i / n) as f32 + 0.5) / n as f32;
        sum += f64::from(normal.dot(disc.sample(u)));
    }
    let e = disc.irradiance.y as f64 * sum / (n * n) as f64;
    assert!((e / (2.0 * 0.8) - 1.0).abs() < 1e-4, "{e}");
}

#[test]
fn authored_tracks_interpolate_around_midnight() {
    let key = |hour, direction: DVec3, e| SunKey { hour, direction, irradiance: DVec3::splat(e) };
    let track = vec![key(6.0, DVec3::X, 0.0), key(12.0, DVec3::Y, 100.0), key(18.0, DVec3::NEG_X, 0.0)];
    let sun = Sun { disc_angle: 0.0, track: SunTrack::Authored(track) };
    assert!(at(&sun, None, 6.0).is_none() && at(&sun, None, 0.0).is_none() && at(&sun, None, 18.0).is_none());
    let nine = at(&sun, None, 9.0).unwrap();
    assert!((nine.direction - Vec3::new(0.5, 0.5, 0.0).normalize()).length() < 1e-6);
    assert_eq!(nine.irradiance, Rgb::splat(50.0));
    assert_eq!((nine.sample(Vec2::splat(0.3)), nine.horizon), (nine.direction, false));
    // Between 18 and 6 the directions are opposite: the nearer key's holds, never NaN.
    let opposite = Sun {
        track: SunTrack::Authored(vec![key(18.0, DVec3::NEG_X, 1.0), key(20.0, DVec3::X, 3.0)]),
        ..sun
    };
    let middle = at(&opposite, None, 19.0).unwrap();
    assert_eq!((middle.direction, middle.irradiance), (Vec3::X, Rgb::splat(2.0)));
    let wrapped = at(&opposite, None, 1.0).unwrap();
    assert!((wrapped.irradiance.x - (3.0 - 2.0 * 5.0 / 22.0)).abs() < 1e-5 && wrapped.direction.is_finite());
    // One key holds all day; a track below the horizon still shines.
    let one = Sun { disc_angle: 1.0, track: SunTrack::Authored(vec![key(23.0, DVec3::NEG_Y, 4.0)]) };
    assert_eq!(at(&one, None, 3.5).unwrap().direction, Vec3::NEG_Y);
    assert!(at(&Sun { disc_angle: 1.0, track: SunTrack::Authored(vec![]) }, None, 3.5).is_none());
}

#[test]
fn sunrise_is_continuous() {
    let sun = Sun { disc_angle: 0.533, track: SunTrack::Computed { turbidity: 3.0 } };
    let light = |hour: f64| {
        at(&sun, Some(&BERLIN), hour).map_or(0.0, |disc| luminance_of(disc.irradiance.as_dvec3()))
    };
    let mut last = light(3.0);
    assert_eq!(last, 0.0);
    let mut minute = 0;
    while minute < 180 {
        minute += 1;
        let now = light(3.0 + f64::from(minute) / 60.0);
        assert!(now >= last && now - last < 0.6, "minute {minute}: {last} → {now}");
        last = now;
    }
    assert!(last > 10.0);
    assert!(at(&sun, None, 12.0).is_none());
}

/// Of NOAA's solar calculator (gml.noaa.gov/grad/solcalc, after Meeus 1998, "Astronomical Algorithms"): the
/// hours of sunrise and sunset at Greenwich, for which the centre's zenith angle without refraction is
/// 90.833°; `None` where the sun stays up, or down, all day.
fn noaa_rise_and_set(latitude: f64, (year, month, day): (i32, u32, u32)) -> Option<[f64; 2]> {
    let midnight = JulianDate::from_utc(year, month, day, 0, 0, 0.0, 0.0).unwrap().julian_date();
    let event = |side: f64| {
        let mut hour = 12.0;
        // The sun moves on until the event.
        for _ in 0..5 {
            let t = (midnight + hour / 24.0 - 2_451_545.0) / 36_525.0;
            let l = (280.46646 + t * (36_000.769_83 + t * 0.000_303_2)).to_radians();
            let m = (357.52911 + t * (35_999.050_29 - 0.000_153_7 * t)).to_radians();
            let e = 0.016_708_634 - t * (0.000_042_037 + 0.000_000_126_7 * t);
            let centre = m.sin() * (1.914_602 - t * (0.004_817 + 0.000_014 * t))
                + (2.0 * m).sin() * (0.019_993 - 0.000_101 * t)
                + (3.0 * m).sin() * 0.000_289;
            let node = (125.04 - 1934.136 * t).to_radians();
            let apparent = l + (centre - 0.005_69 - 0.004_78 * node.sin()).to_radians();
            let seconds = 21.448 - t * (46.815 + t * (0.000_59 - t * 0.001_813));
            let tilt = (23.0 + (26.0 + seconds / 60.0) / 60.0 + 0.002_56 * node.cos()).to_radians();
            let (declination, y) = ((tilt.sin() * apparent.sin()).asin(), (0.5 * tilt).tan().powi(2));
            let equation_of_time = y * (2.0 * l).sin() - 2.0 * e * m.sin()
                + 4.0 * e * y * m.sin() * (2.0 * l).cos()
                - 0.5 * y * y * (4.0 * l).sin()
                - 1.25 * e * e * (2.0 * m).sin();
            let latitude = latitude.to_radians();
            let cosine = 90.833f64.to_radians().cos() / (latitude.cos() * declination.cos())
                - latitude.tan() * declination.tan();
            let angle = (-1.0..=1.0).contains(&cosine).then(|| cosine.acos())?;
            hour = 12.0 + (side * angle - equation_of_time) * 12.0 / std::f64::consts::PI;
        }
        Some(hour)
    };
    Some([event(-1.0)?, event(1.0)?])
}

/// The first and the last hour with sun of the real sun's disc over a place on Greenwich's meridian.
fn rise_and_set(latitude: f64, date: (i32, u32, u32), refraction: bool) -> Option<[f64; 2]> {
    let sun = Sun { disc_angle: 0.533, track: SunTrack::Computed { turbidity: 3.0 } };
    let location = Location { latitude, longitude: 0.0, utc_offset: 0.0, date, north: 0.0, refraction };
    let is_up = |hour: f64| at(&sun, Some(&location), hour).is_some();
    let end = |mut night: f64| {
        let mut day = 12.0;
        for _ in 0..30 {
            let middle = 0.5 * (day + night);
            if is_up(middle) { day = middle } else { night = middle }
        }
        day
    };
    (is_up(12.0) && !is_up(0.0) && !is_up(24.0)).then(|| [end(0.0), end(24.0)])
}

/// The upper limb leaves the horizon within a minute of NOAA's times; without refraction two minutes to half
/// an hour too early, and it rises as much too late.
#[test]
fn the_sun_rises_and_sets_when_noaa_says() {
    let mut events = 0;
    for latitude in [0.0, 25.0, 48.0, 60.0, 66.0, -48.0] {
        for (month, day) in [(1, 20), (3, 20), (5, 15), (6, 21), (8, 1), (9, 22), (12, 21)] {
            let date = (2026, month, day);
            let expected = noaa_rise_and_set(latitude, date);
            let found = rise_and_set(latitude, date, true);
            assert_eq!(found.is_some(), expected.is_some(), "{latitude}° {month}-{day}: {found:?}");
            let (Some(expected), Some(found)) = (expected, found) else { continue };
            let off = [0, 1].map(|i| 60.0 * (found[i] - expected[i]));
            let without = rise_and_set(latitude, date, false);
            let early = without.map(|without| [0, 1].map(|i| 60.0 * (without[i] - expected[i])));
            println!("{latitude}° {month}-{day}: {expected:?}, off {off:.2?} minutes, {early:.1?} without");
            assert!(off.iter().all(|minutes| minutes.abs() < 1.0), "{latitude}° {month}-{day}: {off:?}");
            // (At 66° in December it does not rise at all.)
            assert!(early.is_none_or(|[rise, set]| rise > 2.0 && set < -2.0), "{early:?}");
            events += 1;
        }
    }
    // Only at 66° in June it stays up.
    assert_eq!(events, 6 * 7 - 1);
}

/// Against the formulas of NOAA's solar calculator; and what is seen grows with what is, from nadir to
/// zenith, without a jump.
#[test]
fn refraction_is_that_of_the_standard_atmosphere_and_monotone() {
    let noaa = |e: f64| {
        let tan = e.to_radians().tan();
        let seconds = match e {
            5.0.. => 58.1 / tan - 0.07 / tan.powi(3) + 0.000_086 / tan.powi(5),
            _ => 1735.0 + e * (-518.2 + e * (103.4 + e * (-12.79 + e * 0.711))),
        };
        seconds / 3600.0
    };
    for tenth in -5..850 {
        let elevation = f64::from(tenth) / 10.0;
        let (found, expected) = (refraction(elevation), noaa(elevation));
        assert!((found - expected).abs() < 0.01, "{elevation}°: {found}, expected {expected}");
    }
    // What is seen at the horizon, and deep twilight, which is left where it is.
    assert!((SEEN_AT_HORIZON + refraction(SEEN_AT_HORIZON)).abs() < 1e-5);
    assert!((0.0..0.06).contains(&refraction(-6.0)) && (0.0..0.02).contains(&refraction(-18.0)));
    let seen = |elevation: f64| elevation + refraction(elevation);
    let of_disc = |elevation: f64| elevation + refraction(elevation.max(SEEN_AT_HORIZON));
    for hundredth in -9000..9000 {
        let [low, high] = [hundredth, hundredth + 1].map(|hundredth| f64::from(hundredth) / 100.0);
        for seen in [&seen as &dyn Fn(f64) -> f64, &of_disc] {
            let step = seen(high) - seen(low);
            assert!((0.005..0.03).contains(&step), "{low}°: {step}");
        }
    }
}

/// The hour between `low` and `high` at which the sun's centre stands at `elevation` degrees.
fn hour_at(location: &Location, elevation: f64, mut low: f64, mut high: f64) -> f64 {
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if disc_direction(location, middle).1 < elevation { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// A hundredth of a degree above and below, and everywhere the disc straddles the horizon: what is seen of it
/// is all its light, samples stand above the horizon, and the light grows with the visible part.
#[test]
fn the_sun_at_the_horizon() {
    let sun = Sun { disc_angle: 0.533, track: SunTrack::Computed { turbidity: 3.0 } };
    let mut last = 0.0;
    for elevation in [-0.266, -0.1, -0.01, -1e-4, 0.0, 1e-4, 0.01, 0.1, 0.266] {
        let hour = hour_at(&BERLIN, elevation, 3.0, 9.0);
        assert!((disc_direction(&BERLIN, hour).1 - elevation).abs() < 1e-6);
        let disc = at(&sun, Some(&BERLIN), hour).unwrap();
        let light = luminance_of(disc.irradiance.as_dvec3());
        assert!(light.is_finite() && light > last, "{elevation}: {light}");
        last = light;
        for i in 0..64u8 {
            let u = Vec2::new(f32::from(i % 8) + 0.5, f32::from(i / 8) + 0.5) / 8.0;
            let sample = disc.sample(u);
            let pdf = disc.pdf(sample);
            assert!(sample.y >= 0.0 && (sample.length() - 1.0).abs() < 1e-6, "{elevation}: {sample}");
            assert!(pdf > 0.0 && pdf.is_finite(), "{elevation}: {pdf}");
            let back = disc.invert(sample).unwrap();
            assert!(elevation <= -0.26 || (back - u).abs().max_element() < 2e-3, "{elevation}: {u} {back}");
        }
    }
    // A disc without extent is there or not.
    let point = Sun { disc_angle: 0.0, ..sun };
    let light = |elevation| at(&point, Some(&BERLIN), hour_at(&BERLIN, elevation, 3.0, 9.0));
    assert!(light(-0.01).is_none() && light(0.01).is_some());
}

/// At 80° N: a sun at every hour of midsummer, none at midwinter, and a sky that is finite and not negative
/// all year. At the pole on an equinox the disc straddles the horizon all day.
#[test]
fn polar_day_and_night() {
    use crate::scene::Sky;
    let sun = Sun { disc_angle: 0.533, track: SunTrack::Computed { turbidity: 3.0 } };
    let location = |latitude, date| Location {
        latitude,
        longitude: 15.0,
        utc_offset: 1.0,
        date,
        north: 0.0,
        refraction: true,
    };
    let sky = Sky::HosekWilkie { turbidity: 3.0, ground_albedo: 0.6 };
    let suns =
        |location: &Location| (0..24).filter(|&h| at(&sun, Some(location), f64::from(h)).is_some()).count();
    let (summer, winter) = (location(80.0, (2026, 6, 21)), location(80.0, (2026, 12, 21)));
    assert_eq!((suns(&summer), suns(&winter)), (24, 0));
    let equinox = location(90.0, (2026, 3, 20));
    assert!(suns(&equinox) > 0);
    let mut brightest = [0.0f32; 3];
    for (location, brightest) in [summer, winter, equinox].iter().zip(&mut brightest) {
        for hour in 0..24 {
            if let Some(disc) = at(&sun, Some(location), f64::from(hour)) {
                assert!(disc.irradiance.is_finite() && disc.irradiance.min_element() >= 0.0);
                assert!(disc.sample(Vec2::splat(0.3)).y >= 0.0);
            }
            for d in [Vec3::Y, Vec3::X, Vec3::new(0.6, 0.64, -0.48), Vec3::new(0.8, 1e-6, 0.6)] {
                let radiance =
                    crate::light::daylight::sky::radiances(&sky, Some(location), f64::from(hour), &[d])[0];
                assert!(
                    radiance.is_finite() && radiance.min_element() >= 0.0 && radiance.max_element() > 0.0
                );
                *brightest = brightest.max(radiance.max_element());
            }
        }
    }
    // Midwinter at 80° N is nautical twilight at best: the sun stays 13° below the horizon.
    assert!(brightest[1] < 1e-4 * brightest[0], "{brightest:?}");
}
