//! Reads RAW files: samples row by row, without a header. The samples are 16-bit unsigned integers or, in `.r32` files, 32-bit floats.

use std::io::{BufRead, Seek, SeekFrom};

use super::depth::Depth;
use super::options::ReadOptions;
use super::raster::{Raster, Stored};
use super::scaling::Statement;
use super::spacing::Spacing;
use crate::decode::fault::Fault;

/// Smallest number of samples for which the byte order is checked.
const JUDGED: usize = 256;
/// The byte order of integers counts as wrong only if their roughness is above this factor times their roughness in the other byte order.
const ROUGHER: f64 = 4.0;
/// The byte order of integers counts as wrong only if their [`roughness`] is above this number. Uniformly distributed random numbers have a
/// roughness of 1/3. Terrain usually has a roughness of up to about 0.05.
const ROUGH: f64 = 0.15;
/// Plausible absolute values of heights that are stored as floats. The height 0 is plausible, too.
const HEIGHTS: std::ops::RangeInclusive<f32> = 1e-6..=1e7;

/// Reads a file of 16-bit integers or 32-bit floats, as `depth` says.
pub(super) fn read(mut input: impl BufRead + Seek, options: &ReadOptions, depth: Depth) -> Result<Raster, Fault> {
    let length = input.seek(SeekFrom::End(0)).map_err(Fault::of_io)?;
    let bytes = u64::from(depth.bits() / 8);
    let [width, height] = match options.raw_size {
        Some(size) => size,
        None => [square(length, bytes).ok_or_else(|| no_square(length, depth))?; 2],
    };
    // A u64 is too small for the product of the largest sizes that can be given.
    let expected = u128::from(width) * u128::from(height) * u128::from(bytes);
    if expected != u128::from(length) {
        return Err(Fault::Unsupported(format!(
            "{width} x {height} samples of {} bits are {expected} bytes, but the file has {length}; {}",
            depth.bits(),
            other_depth(u64::from(width) * u64::from(height), length, depth).unwrap_or("it is truncated, or --raw-size is wrong")
        )));
    }
    let window = options.window_of([width, height], true)?;
    let [x, y, w, h] = window;
    let mut rows = vec![0; w as usize * h as usize * bytes as usize];
    for (row, line) in rows.chunks_exact_mut(w as usize * bytes as usize).zip(y..) {
        let start = (u64::from(line) * u64::from(width) + u64::from(x)) * bytes;
        input.seek(SeekFrom::Start(start)).and_then(|_| input.read_exact(row)).map_err(Fault::of_io)?;
    }
    let (samples, is_swapped) = match depth {
        Depth::Single => floats(&rows, options.raw_big_endian),
        _ => integers(&rows, options.raw_big_endian, w as usize),
    };
    if is_swapped {
        return Err(Fault::Unsupported(format!(
            "its samples look like noise, but like terrain in the other byte order; {} --raw-big-endian",
            if options.raw_big_endian { "leave out" } else { "give" }
        )));
    }
    let order = if options.raw_big_endian { "big-endian" } else { "little-endian" };
    Ok(Raster {
        format: format!("RAW, {}, {order}", depth.words()),
        file_size: [width, height],
        window,
        depth,
        holds_codes: !depth.is_float(),
        stored: Stored::Single(samples),
        absent: Vec::new(),
        no_data: None,
        statement: Statement::default(),
        spacing: Spacing::Unknown,
        orientation: "row 0 is taken as north",
        notes: Vec::new(),
    })
}

/// The edge, in samples, of a square image of `length` bytes with `bytes` bytes per sample; `None` if there is no such square.
fn square(length: u64, bytes: u64) -> Option<u32> {
    let side = ((length / bytes) as f64).sqrt().round() as u64;
    u32::try_from(side).ok().filter(|&side| side > 0 && u64::from(side) * u64::from(side) * bytes == length)
}

fn no_square(length: u64, depth: Depth) -> Fault {
    let squares = [1, 2, 4].into_iter().filter_map(|bytes| square(length, bytes)).map(u64::from);
    let mut hints: Vec<&str> = squares.filter_map(|side| other_depth(side * side, length, depth)).collect();
    if hints.is_empty() {
        hints.push("the file is truncated, or its size must be given: --raw-size WIDTHxHEIGHT");
    }
    Fault::Unsupported(format!(
        "a file of {length} bytes is not a square image with {} bits per sample; {}",
        depth.bits(),
        hints.join(", or ")
    ))
}

/// For a message: the type that the samples probably have, judged by the length of the file, with the remedy; `None` if no known type fits. `depth`:
/// the type that was expected.
fn other_depth(samples: u64, length: u64, depth: Depth) -> Option<&'static str> {
    match (length.checked_div(samples)?, depth) {
        _ if !length.is_multiple_of(samples) => None,
        (1, _) => Some("it seems to have 8 bits per sample, which are 256 levels and show as terraces: export 16 bits"),
        (2, Depth::Single) => Some("it seems to have 16 bits per sample: call it .raw or .r16"),
        (4, Depth::Unsigned16) => Some("it seems to have 32-bit floats: call it .r32"),
        _ => None,
    }
}

/// Returns the samples, and whether they look like terrain only in the other byte order.
fn integers(bytes: &[u8], big_endian: bool, width: usize) -> (Vec<f32>, bool) {
    let (pairs, _) = bytes.as_chunks::<2>();
    let value =
        |pair: &[u8; 2], big_endian: bool| f32::from(if big_endian { u16::from_be_bytes(*pair) } else { u16::from_le_bytes(*pair) });
    let samples: Vec<f32> = pairs.iter().map(|pair| value(pair, big_endian)).collect();
    let is_rough = pairs.len() >= JUDGED && roughness(&samples, width) > ROUGH;
    let is_swapped = is_rough && {
        let swapped: Vec<f32> = pairs.iter().map(|pair| value(pair, !big_endian)).collect();
        roughness(&samples, width) > ROUGHER * roughness(&swapped, width)
    };
    (samples, is_swapped)
}

/// Does the same as [`integers`], for floats. In the wrong byte order, the exponents of floats look random, so few of them are plausible heights.
fn floats(bytes: &[u8], big_endian: bool) -> (Vec<f32>, bool) {
    let (quads, _) = bytes.as_chunks::<4>();
    let value = |quad: &[u8; 4], big_endian: bool| if big_endian { f32::from_be_bytes(*quad) } else { f32::from_le_bytes(*quad) };
    let samples: Vec<f32> = quads.iter().map(|quad| value(quad, big_endian)).collect();
    let heights = |big_endian: bool| {
        quads.iter().map(|quad| value(quad, big_endian)).filter(|sample| *sample == 0.0 || HEIGHTS.contains(&sample.abs())).count()
    };
    let count = quads.len();
    let is_swapped = count >= JUDGED && heights(big_endian) < count / 2 && heights(!big_endian) > count / 10 * 9;
    (samples, is_swapped)
}

/// Mean absolute difference between neighbours in a row, divided by the range of the samples; 0 if all samples are equal.
fn roughness(samples: &[f32], width: usize) -> f64 {
    let (low, high) = samples.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), &sample| (low.min(sample), high.max(sample)));
    let steps = samples.chunks(width).flat_map(|row| row.windows(2).map(|pair| f64::from((pair[1] - pair[0]).abs())));
    let (sum, count) = steps.fold((0.0, 0u32), |(sum, count), step| (sum + step, count + 1));
    if high > low && count > 0 { sum / f64::from(count) / f64::from(high - low) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use super::*;

    fn hill(index: usize) -> f64 {
        let (x, y) = (index % 40, index / 40);
        300.0 + 300.0 * (x as f64 * 0.11).sin().abs() + 5.0 * y as f64
    }

    fn refused(bytes: &[u8], options: &ReadOptions, depth: Depth) -> String {
        match read(Cursor::new(bytes), options, depth) {
            Ok(_) => panic!("accepted"),
            Err(fault) => fault.to_string(),
        }
    }

    fn samples(raster: &Raster) -> Vec<f64> {
        (0..raster.stored.len()).map(|index| raster.stored.at(index)).collect()
    }

    #[test]
    fn floats_and_integers_are_read_in_both_orders() {
        let sized = ReadOptions { raw_size: Some([40, 30]), ..ReadOptions::default() };
        for big in [false, true] {
            let options = ReadOptions { raw_big_endian: big, ..sized.clone() };
            let wrong = ReadOptions { raw_big_endian: !big, ..sized.clone() };
            let order = |bytes: [u8; 4]| if big { bytes } else { [bytes[3], bytes[2], bytes[1], bytes[0]] };
            let floats: Vec<u8> = (0..1200).flat_map(|i| order((hill(i) as f32).to_be_bytes())).collect();
            let raster = read(Cursor::new(&floats), &options, Depth::Single).unwrap_or_else(|fault| panic!("{fault}"));
            assert!(samples(&raster).iter().enumerate().all(|(i, &sample)| (sample - hill(i)).abs() < 1e-4));
            assert!(refused(&floats, &wrong, Depth::Single).contains("other byte order"));
            let integers: Vec<u8> = (0..1200)
                .flat_map(|i| {
                    let code = (hill(i) * 80.0) as u16;
                    if big { code.to_be_bytes() } else { code.to_le_bytes() }
                })
                .collect();
            let raster = read(Cursor::new(&integers), &options, Depth::Unsigned16).unwrap_or_else(|fault| panic!("{fault}"));
            assert!(samples(&raster).iter().enumerate().all(|(i, &sample)| (sample - (hill(i) * 80.0).floor()).abs() < 0.5));
            assert!(refused(&integers, &wrong, Depth::Unsigned16).contains("--raw-big-endian"));
        }
    }

    #[test]
    fn numbers_that_only_look_swapped_are_read() {
        // All samples have 8 bits in the high byte and 0 in the low byte, so they are equally smooth in both orders.
        let wide: Vec<u8> = (0..1200).flat_map(|i| ((hill(i) / 4.0) as u16 * 256).to_le_bytes()).collect();
        let options = ReadOptions { raw_size: Some([40, 30]), ..ReadOptions::default() };
        assert!(read(Cursor::new(&wide), &options, Depth::Unsigned16).is_ok());
        let noise: Vec<u8> = (0..2400u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 13) as u8).collect();
        assert!(read(Cursor::new(&noise), &options, Depth::Unsigned16).is_ok());
    }

    #[test]
    fn lengths_that_do_not_fit_name_what_would() {
        let sized = ReadOptions { raw_size: Some([40, 30]), ..ReadOptions::default() };
        let square = ReadOptions::default();
        assert!(refused(&[1; 4800], &sized, Depth::Unsigned16).contains("32-bit floats: call it .r32"));
        assert!(refused(&[1; 1200], &sized, Depth::Unsigned16).contains("8 bits per sample"));
        assert!(refused(&[1; 2400], &sized, Depth::Single).contains("call it .raw"));
        assert!(refused(&[1; 2399], &sized, Depth::Unsigned16).contains("truncated, or --raw-size is wrong"));
        assert!(refused(&[1; 900], &square, Depth::Unsigned16).contains("8 bits per sample"));
        assert!(refused(&[1; 3600], &square, Depth::Unsigned16).contains(".r32"));
        assert!(refused(&[1; 1001], &square, Depth::Unsigned16).contains("--raw-size WIDTHxHEIGHT"));
        let largest = ReadOptions { raw_size: Some([u32::MAX; 2]), ..ReadOptions::default() };
        assert!(refused(&[1; 8], &largest, Depth::Unsigned16).contains("are 36893488130239234050 bytes, but the file has 8"));
        assert!(refused(&[], &square, Depth::Unsigned16).contains("0 bytes"));
    }
}
