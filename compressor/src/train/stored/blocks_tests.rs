use super::*;

/// Texels on a line in three channels, whose channel `alone` goes its own way.
fn apart(alone: usize) -> Wanted {
    let texel = |q: usize| {
        let (along, own) = (q as f32, (q * 7 % 16) as f32);
        let mut texel = [40.0 + 8.0 * along, 200.0 - 5.0 * along, 90.0 + 3.0 * along, 60.0 + 6.0 * along];
        texel[alone] = 30.0 + 12.0 * own;
        texel
    };
    let identity = std::array::from_fn(|r| std::array::from_fn(|c| if r == c { 1.0 } else { 0.0 }));
    Wanted::new(&std::array::from_fn(texel), &[identity; 16])
}

#[test]
fn an_independent_channel_has_its_own_indices() {
    for alone in 0..4 {
        let wanted = apart(alone);
        let (six, cost_of_six) = wanted.fit::<Quad>(&[(Mode::Six, principal(&wanted.texels))]);
        let (four, cost_of_four) = wanted.fit::<Quad>(&wanted.fours::<Quad>());
        assert!(matches!(four.mode, Mode::Four { alone: a, .. } if usize::from(a) == alone), "{four:?}");
        assert!(cost_of_four < 0.2 * cost_of_six, "{alone}: {cost_of_four}, mode 6 {cost_of_six}");
        for (block, cost) in [(six, cost_of_six), (four, cost_of_four)] {
            assert!(
                (wanted.cost::<Quad>(&std::array::from_fn(|c| channel(&block, c))) - cost).abs()
                    < 1e-3 * cost,
                "{block:?} costs {cost}"
            );
            // What is stored is what was fitted.
            assert_eq!(crate::bc7::decode(&crate::bc7::encode(&block)).unwrap(), block.texels());
        }
    }
}

#[test]
fn endpoints_are_rounded_and_moved_to_what_their_mode_has() {
    let endpoints = [[0.0, 255.0, 100.3, 77.7], [3.4, 250.1, 128.0, 12.0]];
    for mode in Mode::FOURS {
        let all: Vec<_> = rounded(mode, &endpoints).collect();
        assert_eq!(all.len(), 1);
        for (c, e) in (0..4).flat_map(|c| all[0].iter().map(move |e| (c, e[c]))) {
            let bits = mode.bits(c);
            assert_eq!(expand(e >> (8 - bits), bits), e);
            let up = next(mode, c, e, false);
            assert_eq!(up.is_none(), e == 255);
            assert!(up.is_none_or(|up| up > e && next(mode, c, up, true) == Some(e)), "{mode:?} {c} {e}");
        }
        assert!((0..4).all(|c| (f32::from(all[0][0][c]) - endpoints[0][c]).abs() <= 4.2));
    }
    assert_eq!(rounded(Mode::Six, &endpoints).count(), 4);
    assert_eq!((next(Mode::Six, 0, 1, true), next(Mode::Six, 0, 1, false)), (None, Some(3)));
}
