use super::*;
use crate::testing::Random;

fn random_block(random: &mut Random, p_bits: [u8; 2]) -> Block {
    let (e0, e1, indices) = (random.draw(), random.draw(), random.draw());
    let endpoint = |r: u64, p: u8| std::array::from_fn(|c| ((r >> (8 * c)) as u8 & !1) | p);
    Block {
        mode: Mode::Six,
        endpoints: [endpoint(e0, p_bits[0]), endpoint(e1, p_bits[1])],
        indices: std::array::from_fn(|i| (indices >> (4 * i)) as u8 & 15),
    }
}

/// What an independent decoder makes of a block.
fn theirs(bytes: &[u8; 16]) -> [u8; 64] {
    let mut texels = [0; 64];
    bcdec_rs::bc7(bytes, &mut texels, 16);
    texels
}

/// The block as written is to both decoders what it was: the anchor rule may mirror it, never change its
/// texels.
fn assert_decodes(block: &Block) {
    let bytes = encode(block);
    let ours = decode(&bytes).unwrap();
    assert_eq!(ours.as_flattened(), theirs(&bytes), "{block:?}");
    assert_eq!(ours, block.texels());
}

#[test]
fn blocks_of_mode_6_decode_as_in_an_independent_decoder() {
    let mut random = Random(1);
    for n in 0..120_000 {
        assert_decodes(&random_block(&mut random, [(n & 1) as u8, (n >> 1 & 1) as u8]));
    }
}

#[test]
fn blocks_of_mode_4_decode_as_in_an_independent_decoder() {
    let mut random = Random(3);
    for n in 0..120_000 {
        let mode = Mode::FOURS[n % 8];
        let mut level = |c| expand(random.draw() as u8 & ((1 << mode.bits(c)) - 1), mode.bits(c));
        let endpoints = [0, 1].map(|_| std::array::from_fn(&mut level));
        let indices = std::array::from_fn(|_| random.draw() as u8 & 31);
        assert_decodes(&Block { mode, endpoints, indices });
    }
}

#[test]
fn every_block_of_these_modes_is_read_as_the_independent_decoder_reads_it() {
    let mut random = Random(2);
    for n in 0..100_000 {
        let mut bytes = [0; 16];
        bytes[..8].copy_from_slice(&random.draw().to_le_bytes());
        bytes[8..].copy_from_slice(&random.draw().to_le_bytes());
        bytes[0] = if n % 2 == 0 { bytes[0] & 0x80 | 0x40 } else { bytes[0] & 0xe0 | 0x10 };
        assert_eq!(decode(&bytes).unwrap().as_flattened(), theirs(&bytes));
        // Reading and writing again gives the same bytes, as texel 0 already obeys the anchor rule.
        assert_eq!(encode(&unpack(&bytes).unwrap()), bytes);
    }
}

#[test]
fn other_modes_are_errors() {
    for mode in [0, 1, 2, 3, 5, 7] {
        let mut bytes = [0xa5; 16];
        bytes[0] = 1 << mode;
        assert!(matches!(decode(&bytes), Err(Error::Unsupported { .. })), "mode {mode}");
    }
    assert!(matches!(decode(&[0; 16]), Err(Error::Invalid { .. })));
}

#[test]
fn palette_runs_from_endpoint_to_endpoint() {
    let endpoints = [[3, 255, 17, 91], [250, 0, 36, 90]];
    let palette = palette(Mode::Six, &endpoints);
    assert_eq!([palette[0], palette[15]], endpoints);
    assert_eq!(palette[8][1], 120); // ((64 − 34) 255 + 32) / 64 = 120.03
}

#[test]
fn weights_are_those_of_the_tables() {
    let indices = std::array::from_fn(|i| i as u8);
    let of = |weights: [i16; 16], n: usize| weights[..n].to_vec();
    let table = |bits: usize| WEIGHTS[bits - 2].iter().map(|w| i16::from(*w)).collect::<Vec<_>>();
    assert_eq!(of(sixty_fourths::<2>(&indices, 0), 4), table(2));
    assert_eq!(of(sixty_fourths::<3>(&indices, 0), 8), table(3));
    assert_eq!(of(sixty_fourths::<4>(&indices, 0), 16), table(4));
}
