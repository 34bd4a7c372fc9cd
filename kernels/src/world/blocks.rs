//! BC1 and BC3 images on the CPU: whole RGBA8 images in, blocks out, and back.
//!
//! Texels are row-major, 4 bytes each, red first. Block formats: Direct3D 11.3 functional specification, section 19.5
//! ("Block Compression Formats"). The encoder is `texpresso`, in its fast setting: the colour line of a block runs between
//! the extremes along its principal axis.

use texpresso::{Algorithm, Format, Params};

/// A block format of node payloads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BlockFormat {
    /// 8 bytes a block: a line of colours (565 end points), alpha 0 or 255.
    Bc1,
    /// 16 bytes a block: BC1's colours, and an alpha line of 8 values with 8-bit end points.
    Bc3,
}

impl BlockFormat {
    /// Bytes of a 4 x 4 block.
    pub const fn block_bytes(self) -> usize {
        match self {
            BlockFormat::Bc1 => 8,
            BlockFormat::Bc3 => 16,
        }
    }

    /// Bytes of an image of `width` x `height` texels (both are padded to multiples of 4).
    pub const fn image_bytes(self, width: usize, height: usize) -> usize {
        width.div_ceil(4) * height.div_ceil(4) * self.block_bytes()
    }

    const fn format(self) -> Format {
        match self {
            BlockFormat::Bc1 => Format::Bc1,
            BlockFormat::Bc3 => Format::Bc3,
        }
    }
}

/// How much effort the encoder spends on a block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effort {
    /// Range fit: about a microsecond a block.
    Fast,
    /// Iterated cluster fit: tens of microseconds a block, for the few blocks that are worth it.
    Best,
}

/// Encodes an RGBA8 image. Texels with alpha below 128 become BC1's transparent black.
///
/// `weights` says how much an error in red, green and blue matters.
///
/// # Panics
/// If `rgba` does not hold `width * height * 4` bytes.
pub fn encode(format: BlockFormat, rgba: &[u8], width: usize, height: usize, weights: [f32; 3], effort: Effort) -> Vec<u8> {
    assert_eq!(rgba.len(), width * height * 4, "an RGBA8 image of {width} x {height} texels");
    let algorithm = match effort {
        Effort::Fast => Algorithm::RangeFit,
        Effort::Best => Algorithm::IterativeClusterFit,
    };
    let params = Params { algorithm, weights, weigh_colour_by_alpha: false };
    let mut blocks = vec![0; format.image_bytes(width, height)];
    let mut output = blocks.chunks_exact_mut(format.block_bytes());
    for block_y in 0..height.div_ceil(4) {
        for block_x in 0..width.div_ceil(4) {
            let mut texels = [[0; 4]; 16];
            let mut mask = 0;
            for (i, texel) in texels.iter_mut().enumerate() {
                let (x, y) = (block_x * 4 + i % 4, block_y * 4 + i / 4);
                if x < width && y < height {
                    texel.copy_from_slice(&rgba[(y * width + x) * 4..][..4]);
                    mask |= 1 << i;
                }
            }
            let block = output.next().expect("image_bytes counts every block");
            format.format().compress_block_masked(texels, mask, params, block);
        }
    }
    blocks
}

/// Decodes an image to RGBA8.
///
/// # Panics
/// If `blocks` does not hold [`BlockFormat::image_bytes`] bytes.
pub fn decode(format: BlockFormat, blocks: &[u8], width: usize, height: usize) -> Vec<u8> {
    assert_eq!(blocks.len(), format.image_bytes(width, height), "a {format:?} image of {width} x {height} texels");
    let mut rgba = vec![0; width * height * 4];
    let blocks_wide = width.div_ceil(4);
    for (index, block) in blocks.chunks_exact(format.block_bytes()).enumerate() {
        let (block_x, block_y) = (index % blocks_wide, index / blocks_wide);
        for (i, texel) in format.format().decompress_block(block).iter().enumerate() {
            let (x, y) = (block_x * 4 + i % 4, block_y * 4 + i / 4);
            if x < width && y < height {
                rgba[(y * width + x) * 4..][..4].copy_from_slice(texel);
            }
        }
    }
    rgba
}

/// A BC3 alpha block whose 16 decoded values are never below `needed`, and as little above as the format allows.
///
/// Interpolated values are taken as exact fractions rounded down, so that a decoder which rounds either way stays above.
pub fn alpha_block_at_least(needed: [u8; 16]) -> [u8; 8] {
    let highest = needed.iter().copied().max().unwrap_or(0);
    let lowest = needed.iter().copied().min().unwrap_or(0);
    // Six-value mode holds 255 by itself: its line spans only the rest.
    let highest_below_full = needed.iter().copied().filter(|&v| v < 255).max().unwrap_or(254);
    let candidates = [(highest, lowest), (lowest.min(highest_below_full), highest_below_full)];
    let mut best: Option<(u32, [u8; 8])> = None;
    for (first, second) in candidates {
        let palette = alpha_palette(first, second);
        let mut bits = 0u64;
        let mut excess = 0u32;
        let mut complete = true;
        for (i, &value) in needed.iter().enumerate() {
            let choice = (0..8).filter(|&k| palette[k] >= value).min_by_key(|&k| palette[k]);
            let Some(k) = choice else {
                complete = false;
                break;
            };
            bits |= (k as u64) << (3 * i);
            excess += u32::from(palette[k] - value);
        }
        if complete && best.as_ref().is_none_or(|(least, _)| excess < *least) {
            let b = bits.to_le_bytes();
            best = Some((excess, [first, second, b[0], b[1], b[2], b[3], b[4], b[5]]));
        }
    }
    best.expect("the eight-value line reaches the highest value needed").1
}

/// The 8 values of a BC3 alpha block, fractions rounded down.
fn alpha_palette(first: u8, second: u8) -> [u8; 8] {
    let (a, b) = (u32::from(first), u32::from(second));
    let mix = |k: u32, n: u32| u8::try_from(((n - k) * a + k * b) / n).expect("a mean of two bytes");
    if first > second {
        [first, second, mix(1, 7), mix(2, 7), mix(3, 7), mix(4, 7), mix(5, 7), mix(6, 7)]
    } else {
        [first, second, mix(1, 5), mix(2, 5), mix(3, 5), mix(4, 5), 0, 255]
    }
}
