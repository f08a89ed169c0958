//! The bytes of a block, made fewer without loss: arrays of records, one record a texel, are written column
//! by column and compressed.
//!
//! A column is one byte of a record over all texels. Neighbouring texels have the same signs and exponents, a
//! light that does not reach a block is a column of zeros, and counters are alike: all these are long runs.
//! The low bytes of a mantissa stay what they are, noise. The compressor is Zstandard at its fastest level,
//! which costs less than the disk does for the bytes it saves.

/// The fastest level that also codes single bytes by how often they occur.
const LEVEL: i32 = 1;
/// Texels that are turned at a time: so many rows of records fit the nearest cache.
const ROWS: usize = 64;

/// Appends arrays, each with the same number of `rows`, to `out`.
pub(super) fn pack(arrays: &[&[u8]], rows: usize, out: &mut Vec<u8>) {
    let mut columns = vec![0; arrays.iter().map(|array| array.len()).sum()];
    let mut rest = &mut columns[..];
    for array in arrays {
        let (head, tail) = rest.split_at_mut(array.len());
        let width = array.len() / rows.max(1);
        turn(array, head, rows, width);
        rest = tail;
    }
    // (Compressing into memory fails for no content.)
    let packed = zstd::bulk::compress(&columns, LEVEL).unwrap_or_default();
    out.extend_from_slice(&packed);
}

/// Fills arrays with what [`pack`] gave of arrays as long; `None` where the bytes are of others.
pub(super) fn unpack(bytes: &[u8], rows: usize, arrays: &mut [&mut [u8]]) -> Option<()> {
    let length = arrays.iter().map(|array| array.len()).sum();
    let columns = zstd::bulk::decompress(bytes, length).ok().filter(|columns| columns.len() == length)?;
    let mut rest = &columns[..];
    for array in arrays {
        let (head, tail) = rest.split_at_checked(array.len())?;
        let width = array.len() / rows.max(1);
        turn(head, array, width, rows);
        rest = tail;
    }
    Some(())
}

/// Writes the rows of a matrix of bytes as columns.
fn turn(from: &[u8], to: &mut [u8], rows: usize, columns: usize) {
    for row in (0..rows).step_by(ROWS) {
        for column in (0..columns).step_by(ROWS) {
            for r in row..rows.min(row + ROWS) {
                for c in column..columns.min(column + ROWS) {
                    to[c * rows + r] = from[r * columns + c];
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Repeatable bytes.
    fn noise(n: usize) -> Vec<u8> {
        (0..n as u32).map(|i| (i.wrapping_mul(0x9e37_79b9) >> 13) as u8).collect()
    }

    #[test]
    fn arrays_come_back() {
        for rows in [0, 1, 63, 64, 65, 200] {
            let arrays = [noise(3 * rows), Vec::new(), vec![7; rows], noise(130 * rows)];
            let mut bytes = b"before".to_vec();
            pack(&arrays.each_ref().map(Vec::as_slice), rows, &mut bytes);
            let mut back = arrays.each_ref().map(|array| vec![0; array.len()]);
            unpack(&bytes[6..], rows, &mut back.each_mut().map(Vec::as_mut_slice)).expect("whole");
            assert_eq!(back, arrays, "{rows}");
            // Bytes of arrays of other lengths, or cut short, are none.
            let mut longer = vec![0; arrays.iter().map(Vec::len).sum::<usize>() + 1];
            assert!(unpack(&bytes[6..], 1, &mut [&mut longer]).is_none());
            let cut = &bytes[6..bytes.len() - 1];
            assert!(unpack(cut, rows, &mut back.each_mut().map(Vec::as_mut_slice)).is_none());
        }
    }

    #[test]
    fn what_is_alike_in_all_texels_takes_hardly_any_bytes() {
        // One record of a sun in shadow: noise in other places of the record is no hindrance.
        let rows = 4096;
        let random = noise(4 * rows);
        let record = |r: usize| [&[0u8; 12][..], &[4, 0, 4, 0], &random[4 * r..4 * r + 4]].concat();
        let array: Vec<u8> = (0..rows).flat_map(record).collect();
        let mut bytes = Vec::new();
        pack(&[&array], rows, &mut bytes);
        assert!(bytes.len() < 4 * rows + 1000, "{}", bytes.len());
    }
}
