//! Decodes LZW-compressed strips and tiles of TIFF files.
//!
//! The crate `tiff` decodes a tile in pieces, and then does not find the end of some intact streams (GDAL writes such streams). Here, a stream is
//! decoded as a whole. Sources: TIFF 6.0, sections 13 (LZW) and 14 (differencing predictor); *TIFF Technical Note 3* (floating point predictor).

use ::tiff::decoder::DecodingResult;
use ::tiff::tags::ByteOrder;
use half::f16;
use weezl::{BitOrder, LzwStatus, decode::Decoder};

use super::depth::Depth;
use crate::decode::fault::Fault;

/// Largest ratio of decoded to compressed bytes, rounded up: a code of 12 bits represents at most 3839 bytes, and 3839 x 8 / 12 = 2559.3.
const LARGEST_GROWTH: usize = 2560;
/// Largest size of the decoded rows of a strip or tile, bytes. By default, the crate `tiff` has the same limit.
const MAX_BYTES: usize = 1 << 28;

/// How the samples of a strip or tile are stored.
#[derive(Clone, Copy, Debug)]
pub(super) struct Coding {
    pub(super) depth: Depth,
    /// The tag Predictor: 1 = none, 2 = differences of integers, 3 = differences of the bytes of floats.
    pub(super) predictor: u64,
    pub(super) order: ByteOrder,
    /// Width and height of the strip or tile, in samples. A tile may reach beyond the edge of the image.
    pub(super) size: [usize; 2],
}

/// Decodes a stream. Returns the samples of the first `kept[0]` columns in the first `kept[1]` rows, row by row.
///
/// # Errors
/// The stream is damaged or too short, or the decoded rows are larger than 256 MiB.
pub(super) fn decode(stream: &[u8], coding: Coding, kept: [usize; 2]) -> Result<DecodingResult, Fault> {
    let too_short = || Fault::Damaged("an LZW stream ends too early".to_owned());
    let sample_bytes = coding.depth.bits() as usize / 8;
    let row_bytes = coding.size[0].saturating_mul(sample_bytes);
    let bytes = row_bytes.saturating_mul(kept[1]);
    if bytes > MAX_BYTES {
        return Err(Fault::TooLarge(
            "a strip or tile is larger than 256 MiB; write it anew with gdal_translate -co TILED=YES -co COMPRESS=DEFLATE IN OUT.tif"
                .to_owned(),
        ));
    }
    if bytes / LARGEST_GROWTH > stream.len() {
        return Err(too_short());
    }
    let mut data = vec![0; bytes];
    let (mut read, mut written) = (0, 0);
    let mut decoder = Decoder::with_tiff_size_switch(BitOrder::Msb, 8);
    while written < bytes {
        let step = decoder.decode_bytes(&stream[read..], &mut data[written..]);
        read += step.consumed_in;
        written += step.consumed_out;
        match step.status {
            Ok(LzwStatus::Ok) if step.consumed_in + step.consumed_out > 0 => {}
            Ok(_) => break,
            Err(error) => return Err(Fault::Damaged(error.to_string())),
        }
    }
    if written < bytes {
        return Err(too_short());
    }
    let [width, _] = coding.size;
    let patterns: Vec<u64> = data
        .chunks_exact_mut(row_bytes.max(1))
        .flat_map(
            |row| if coding.predictor == 3 { of_float_differences(row, width, sample_bytes) } else { plain(row, sample_bytes, coding) },
        )
        .collect();
    let columns = patterns.chunks_exact(width.max(1)).flat_map(|row| &row[..kept[0].min(width)]).copied();
    Ok(match coding.depth {
        Depth::Unsigned16 => DecodingResult::U16(columns.map(|bits| bits as u16).collect()),
        Depth::Signed16 => DecodingResult::I16(columns.map(|bits| bits as u16 as i16).collect()),
        Depth::Unsigned32 => DecodingResult::U32(columns.map(|bits| bits as u32).collect()),
        Depth::Signed32 => DecodingResult::I32(columns.map(|bits| bits as u32 as i32).collect()),
        Depth::Half => DecodingResult::F16(columns.map(|bits| f16::from_bits(bits as u16)).collect()),
        Depth::Single => DecodingResult::F32(columns.map(|bits| f32::from_bits(bits as u32)).collect()),
        Depth::Double => DecodingResult::F64(columns.map(f64::from_bits).collect()),
    })
}

/// The bit patterns of the samples of a row without a predictor, or with differences of integers.
fn plain(row: &[u8], sample_bytes: usize, coding: Coding) -> Vec<u64> {
    let number = |sum: u64, byte: &u8| sum << 8 | u64::from(*byte);
    let pattern = |bytes: &[u8]| match coding.order {
        ByteOrder::LittleEndian => bytes.iter().rev().fold(0, number),
        ByteOrder::BigEndian => bytes.iter().fold(0, number),
    };
    let mut sum = 0u64;
    row.chunks_exact(sample_bytes)
        .map(|bytes| {
            sum = if coding.predictor == 2 { sum.wrapping_add(pattern(bytes)) } else { pattern(bytes) };
            // Sums wrap around in the width of a sample.
            sum & (u64::MAX >> (64 - 8 * sample_bytes))
        })
        .collect()
}

/// Decodes a row with the floating point predictor to the bit patterns of its samples. The row contains the highest bytes of all samples,
/// then all second bytes, and so on; each byte is stored as its difference from the previous byte.
fn of_float_differences(row: &mut [u8], width: usize, sample_bytes: usize) -> Vec<u64> {
    for at in 1..row.len() {
        row[at] = row[at].wrapping_add(row[at - 1]);
    }
    (0..width).map(|column| (0..sample_bytes).fold(0, |sum, byte| sum << 8 | u64::from(row[byte * width + column]))).collect()
}

#[cfg(test)]
mod tests {
    use weezl::encode::Encoder;

    use super::*;

    fn compressed(bytes: &[u8]) -> Vec<u8> {
        Encoder::with_tiff_size_switch(BitOrder::Msb, 8).encode(bytes).unwrap()
    }

    fn coding(depth: Depth, predictor: u64, order: ByteOrder, size: [usize; 2]) -> Coding {
        Coding { depth, predictor, order, size }
    }

    #[test]
    fn differences_are_summed_in_the_width_of_a_sample() {
        let rows: [[i16; 4]; 2] = [[300, 299, -5, 32_767], [-32_768, 1, 2, 3]];
        for order in [ByteOrder::LittleEndian, ByteOrder::BigEndian] {
            let code = |value: i16| if matches!(order, ByteOrder::LittleEndian) { value.to_le_bytes() } else { value.to_be_bytes() };
            let plain: Vec<u8> = rows.iter().flatten().flat_map(|value| code(*value)).collect();
            let differences =
                |row: &[i16; 4]| [row[0], row[1].wrapping_sub(row[0]), row[2].wrapping_sub(row[1]), row[3].wrapping_sub(row[2])];
            let differing: Vec<u8> = rows.iter().flat_map(differences).flat_map(code).collect();
            for (predictor, bytes) in [(1, plain), (2, differing)] {
                let found = decode(&compressed(&bytes), coding(Depth::Signed16, predictor, order, [4, 2]), [3, 2]).unwrap();
                let DecodingResult::I16(found) = found else { panic!("{found:?}") };
                assert_eq!(found, [300, 299, -5, -32_768, 1, 2]);
            }
        }
    }

    #[test]
    fn bytes_of_floats_are_put_together() {
        let values = [1.5f32, -2.25, 1e-20, 3e8];
        let split: Vec<u8> = (0..4).flat_map(|byte| values.map(|value| value.to_be_bytes()[byte])).collect();
        let differences: Vec<u8> = (0..split.len()).map(|at| split[at].wrapping_sub(if at == 0 { 0 } else { split[at - 1] })).collect();
        let found = decode(&compressed(&differences), coding(Depth::Single, 3, ByteOrder::LittleEndian, [4, 1]), [4, 1]).unwrap();
        let DecodingResult::F32(found) = found else { panic!("{found:?}") };
        assert_eq!(found, values);
    }

    #[test]
    fn short_streams_and_claimed_sizes_are_refused() {
        let stream = compressed(&[7; 64]);
        let refused = |stream: &[u8], size: [usize; 2]| {
            decode(stream, coding(Depth::Unsigned16, 1, ByteOrder::LittleEndian, size), size).unwrap_err().to_string()
        };
        assert!(refused(&stream, [8, 5]).contains("ends too early"));
        assert!(refused(&stream[..3], [8, 4]).contains("ends too early"));
        assert!(refused(&stream, [8192, 8192]).contains("ends too early"));
        assert!(refused(&stream, [usize::MAX, 3]).contains("256 MiB"));
        assert!(decode(&stream, coding(Depth::Unsigned16, 1, ByteOrder::LittleEndian, [8, 4]), [8, 4]).is_ok());
    }
}
