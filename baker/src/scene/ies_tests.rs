//! Tests of IES files: symmetries, units, and files that are wrong.

use super::*;
use std::f64::consts::PI;

/// A file of one lamp with these factors, angles and values.
fn file(multiplier: f64, ballast: f64, vertical: &[f64], horizontal: &[f64], candela: &[f64]) -> String {
    let list = |values: &[f64]| values.iter().map(f64::to_string).collect::<Vec<_>>().join(" ");
    format!(
        "IESNA:LM-63-2002\n[TEST] none\n[MANUFAC] nobody\nTILT=NONE\n1 1000 {multiplier} {} {} 1 2 0 0 0\n{ballast} 1 50\n{}\n{}\n{}\n",
        vertical.len(),
        horizontal.len(),
        list(vertical),
        list(horizontal),
        list(candela)
    )
}

fn parse(text: &str) -> Result<Profile> {
    Profile::parse(text.as_bytes(), "a.ies")
}

fn at(profile: &Profile, vertical: f64, horizontal: f64) -> f64 {
    profile.peak * profile.at(vertical.to_radians(), horizontal.to_radians())
}

#[test]
fn values_are_linear_between_angles_and_nothing_outside() {
    let round = parse(&file(2.0, 0.5, &[0.0, 30.0, 90.0], &[0.0], &[100.0, 50.0, 20.0])).unwrap();
    assert!(round.is_round() && round.peak == 100.0);
    for (vertical, expected) in
        [(0.0, 100.0), (15.0, 75.0), (30.0, 50.0), (60.0, 35.0), (90.0, 20.0), (91.0, 0.0)]
    {
        for horizontal in [0.0, 77.0, 300.0] {
            assert!((at(&round, vertical, horizontal) - expected).abs() < 1e-9, "{vertical}");
        }
    }
    assert_eq!(round.reach(), 90f64.to_radians());
    let narrow = parse(&file(1.0, 1.0, &[0.0, 10.0, 20.0, 90.0], &[0.0], &[9.0, 0.0, 0.0, 0.0])).unwrap();
    assert_eq!(narrow.reach(), 10f64.to_radians());
}

#[test]
fn horizontal_angles_follow_their_symmetry() {
    let value = |h: f64| 10.0 + h;
    for (angles, folds) in [
        (vec![0.0, 45.0, 90.0], [(20.0, 20.0), (160.0, 20.0), (200.0, 20.0), (340.0, 20.0)]),
        (vec![0.0, 90.0, 180.0], [(20.0, 20.0), (160.0, 160.0), (200.0, 160.0), (340.0, 20.0)]),
        (vec![90.0, 180.0, 270.0], [(20.0, 160.0), (160.0, 160.0), (200.0, 200.0), (340.0, 200.0)]),
        (vec![0.0, 180.0, 360.0], [(20.0, 20.0), (160.0, 160.0), (200.0, 200.0), (340.0, 340.0)]),
    ] {
        let candela: Vec<f64> = angles.iter().flat_map(|&h| [value(h), value(h)]).collect();
        let profile = parse(&file(1.0, 1.0, &[0.0, 180.0], &angles, &candela)).unwrap();
        for (asked, same) in folds {
            assert!((at(&profile, 45.0, asked) - value(same)).abs() < 1e-9, "{angles:?}: {asked}");
        }
    }
    // The last quarter is left out: it leads back to where it began.
    let profile = parse(&file(
        1.0,
        1.0,
        &[0.0, 90.0],
        &[0.0, 90.0, 180.0, 270.0],
        &[1.0, 1.0, 2.0, 2.0, 3.0, 3.0, 5.0, 5.0],
    ));
    assert!((at(&profile.unwrap(), 10.0, 315.0) - 3.0).abs() < 1e-9);
}

#[test]
fn flux_is_the_integral_over_all_directions() {
    let even = parse(&file(1.0, 1.0, &[0.0, 180.0], &[0.0], &[7.0, 7.0])).unwrap();
    assert!((even.flux(|_| 1.0) - 4.0 * PI).abs() < 1e-9);
    // A cosine lobe by the degree: π.
    let angles: Vec<f64> = (0..=90).map(f64::from).collect();
    let lobe: Vec<f64> = angles.iter().map(|a| a.to_radians().cos().max(0.0)).collect();
    assert!((parse(&file(1.0, 1.0, &angles, &[0.0], &lobe)).unwrap().flux(|_| 1.0) / PI - 1.0).abs() < 1e-3);
}

#[test]
fn older_labels_tilt_commas_and_dark_profiles_are_read() {
    let old = "a lamp of 1986\r\nTILT=INCLUDE\r\n1\r\n2\r\n0 90\r\n1 0.9\r\n1,1000,1,2,1,1,1,0,0,0\r\n1 1 10\r\n0 90\r\n0\r\n5, 3\r\n";
    assert_eq!(parse(old).unwrap().peak, 5.0);
    let dark = parse(&file(1.0, 1.0, &[0.0, 90.0], &[0.0], &[0.0, 0.0])).unwrap();
    assert!(dark.peak == 0.0 && dark.at(0.5, 0.0) == 0.0 && dark.flux(|_| 1.0) == 0.0);
}

#[test]
fn the_number_after_the_ballast_factor_counts_in_files_before_1995() {
    for (tag, peak) in [
        ("IES:LM-63-2019", 10.0),
        ("IESNA:LM-63-2002", 10.0),
        ("IESNA:LM-63-1995", 10.0),
        ("IESNA91", 11.0),
        ("IESNA:LM-63-1991", 11.0),
        ("a lamp of 1986", 11.0),
    ] {
        let text = format!("{tag}\n[TEST] x\nTILT=NONE\n1 -1 1 2 1 1 2 0 0 0\n1.0 1.1 20\n0 90\n0\n10 10\n");
        for line_end in ["\n", "\r\n", "\r"] {
            let found = parse(&text.replace('\n', line_end)).unwrap().peak;
            assert!((found - peak).abs() < 1e-12, "{tag}: {found}");
        }
    }
}

#[test]
fn utf16_and_marks_are_read() {
    let text = file(2.0, 1.0, &[0.0, 90.0], &[0.0], &[5.0, 3.0]).replace("nobody", "Müller");
    let utf16: Vec<u8> =
        "\u{feff}".encode_utf16().chain(text.encode_utf16()).flat_map(u16::to_le_bytes).collect();
    let marked = format!("\u{feff}{text}").into_bytes();
    let latin1: Vec<u8> = text.chars().map(|c| c as u8).collect();
    for bytes in [utf16, marked, latin1] {
        assert_eq!(Profile::parse(&bytes, "a.ies").unwrap().peak, 10.0);
    }
}

#[test]
fn labels_may_begin_with_the_word_tilt() {
    let good = file(1.0, 1.0, &[0.0, 90.0], &[0.0], &[5.0, 3.0]);
    for label in
        ["TILTED WALL WASHER", "tilt = 45 degrees\n12 W", "TILT=NONE\n[MORE] of it", "TILT 30", "TILT"]
    {
        let text = good.replacen("[TEST]", &format!("{label}\n[TEST]"), 1);
        assert_eq!(parse(&text).unwrap().peak, 5.0, "{label}");
    }
    assert_eq!(parse(&good.replace("TILT=NONE", " Tilt = None ")).unwrap().peak, 5.0);
    assert_eq!(parse(&good.replace("TILT=NONE", "TILT INCLUDE\n1\n1\n0\n1")).unwrap().peak, 5.0);
    let eulumdat = Profile::parse(b"ERCO\n1\n", "a.ldt").unwrap_err().to_string();
    assert!(eulumdat.contains("EULUMDAT is not read"), "{eulumdat}");
}

#[test]
fn what_is_wrong_is_told_with_its_line() {
    let good = file(1.0, 1.0, &[0.0, 90.0], &[0.0], &[5.0, 3.0]);
    for (from, to, told) in [
        ("TILT=NONE", "", "a.ies: no line TILT="),
        ("1 1000 1 2 1 1", "1 1000 1 2 1 2", "a.ies:5: goniometry of type B"),
        ("1 1000 1 2 1 1", "1 1000 1 2 1 3", "a.ies:5: goniometry of type A"),
        ("1 1000 1 2 1 1", "1 1000 1 2 1 9", "a.ies:5: photometric type 9"),
        ("1 1000 1 2 1 1", "1 1000 1 1e9 1 1", "a.ies:5: 1000000000 vertical angles: expected an integer"),
        ("1 1000 1 2 1 1", "1 1000 -1 2 1 1", "a.ies:6: candela multiplier"),
        ("1 1000 1 2 1 1", "1 1000 1 1 1 1", "two vertical angles"),
        ("0 90\n0", "90 0\n0", "a.ies:7: vertical angle 0 after 90"),
        ("0 90\n0", "0 NaN\n0", "a.ies:7: `NaN`"),
        ("5 3", "5 -3", "a.ies:9: a candela value"),
        ("5 3", "5", "a.ies:9: the file ends here"),
    ] {
        assert!(good.contains(from));
        let message = parse(&good.replace(from, to)).unwrap_err().to_string();
        assert!(message.contains(told), "{message}");
    }
    let odd = parse(&file(1.0, 1.0, &[0.0, 90.0], &[0.0, 45.0], &[1.0; 4])).unwrap_err().to_string();
    assert!(odd.contains("horizontal angles from 0 to 45"), "{odd}");
}

#[test]
fn changed_files_are_refused_or_give_finite_light() {
    let whole = file(1.5, 0.9, &[0.0, 30.0, 60.0, 90.0], &[0.0, 90.0, 180.0], &[3.0; 12]);
    let mut state = 1u64;
    let mut random = |below: usize| {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 33) as usize % below
    };
    let mut accepted = 0;
    for _ in 0..20_000 {
        let mut bytes = whole.clone().into_bytes();
        for _ in 0..1 + random(3) {
            let at = random(bytes.len());
            if bytes.len() == 1 {
                break;
            }
            match random(4) {
                0 => bytes[at] = b"0123456789.-e, \nN"[random(17)],
                1 => drop(bytes.remove(at)),
                2 => bytes.truncate(at + 1),
                _ => bytes.insert(at, b"0123456789.-e, \nN"[random(17)]),
            }
        }
        let Ok(profile) = Profile::parse(&bytes, "a.ies") else { continue };
        accepted += 1;
        for (vertical, horizontal) in [(0.0, 0.0), (0.7, 1.0), (PI, 6.2), (1.5, -3.0)] {
            let value = profile.at(vertical, horizontal);
            assert!((0.0..=1.0).contains(&value), "{value}: {}", String::from_utf8_lossy(&bytes));
        }
        assert!(profile.peak.is_finite() && (0.0..=PI).contains(&profile.reach()));
    }
    assert!(accepted > 1000, "{accepted}");
}
