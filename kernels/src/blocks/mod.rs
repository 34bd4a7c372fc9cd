//! Encoder and decoder for BC1 and BC3 images on the CPU. They convert whole RGBA8 images to blocks, and back. [`alpha_block_at_least`] makes a
//! single alpha block.
//!
//! Texels are row-major, 4 bytes each, red first. Block formats: Direct3D 11.3 functional specification, section 19.5 ("Block Compression Formats").
//! The encoder is `texpresso`.

use rayon::prelude::*;
use texpresso::{Algorithm, Format, Params};

/// A block format of node payloads and of detail textures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BlockFormat {
    /// 8 bytes per block: a palette of up to 4 colours, which follows from two 5:6:5 end points; alpha is 0 or 255.
    Bc1,
    /// 16 bytes per block: colours as in BC1, and 8 alpha values. Either all 8 are spaced evenly between two 8-bit end points, or 6 are, and the
    /// other two are 0 and 255.
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
    /// The range fit of `texpresso`, the fastest: the end points of a block are its extreme colours along the principal axis of its colours. A block
    /// of one colour has a fit of its own.
    Fast,
    /// The range fit, improved by `refine` in blocks that lie completely inside the image. It is much faster than the cluster fit, with nearly
    /// its quality.
    Refined,
    /// The iterated cluster fit of `texpresso`, the slowest. Meant for small images whose quality matters most, such as maps of normal cones.
    Best,
}

/// Encodes an RGBA8 image. In BC1, texels with alpha below 128 become transparent black.
///
/// `weights`: relative importance of errors in red, green and blue.
///
/// # Panics
/// If `rgba` does not hold `width * height * 4` bytes.
pub fn encode(format: BlockFormat, rgba: &[u8], width: usize, height: usize, weights: [f32; 3], effort: Effort) -> Vec<u8> {
    assert_eq!(rgba.len(), width * height * 4, "`rgba` must hold {width} x {height} RGBA8 texels");
    let algorithm = match effort {
        Effort::Fast | Effort::Refined => Algorithm::RangeFit,
        Effort::Best => Algorithm::IterativeClusterFit,
    };
    let params = Params { algorithm, weights, weigh_colour_by_alpha: false };
    let across = width.div_ceil(4);
    let mut blocks = vec![0; format.image_bytes(width, height)];
    let each = blocks.par_chunks_mut(format.block_bytes()).with_min_len(256).enumerate();
    each.for_each(|(index, block)| {
        let (left, top) = (index % across * 4, index / across * 4);
        let mut texels = [[0; 4]; 16];
        let mut mask = 0;
        for (i, texel) in texels.iter_mut().enumerate() {
            let (x, y) = (left + i % 4, top + i / 4);
            if x < width && y < height {
                texel.copy_from_slice(&rgba[(y * width + x) * 4..][..4]);
                mask |= 1 << i;
            }
        }
        format.format().compress_block_masked(texels, mask, params, block);
        if effort == Effort::Refined && mask == 0xffff {
            let colours = texels.map(|[r, g, b, _]| [r, g, b].map(f32::from));
            let at = format.block_bytes() - 8;
            refine((&mut block[at..]).try_into().expect("a block ends with 8 bytes of colour"), &colours, weights);
        }
    });
    blocks
}

/// Improves the colours of a block in at most two iterations. Each iteration computes the end points by least squares for the given indices, and then
/// chooses the nearest palette entry for each texel. Quantisation of the end points can raise the weighted squared error, so an iteration that does
/// not lower the error is discarded and ends the search. Blocks in BC1's three-colour mode are not changed.
fn refine(block: &mut [u8; 8], texels: &[[f32; 3]; 16], weights: [f32; 3]) {
    // Share of the first end point in palette entries 0 to 3.
    const SHARE: [f32; 4] = [1.0, 0.0, 2.0 / 3.0, 1.0 / 3.0];
    let mut ends = [u16::from_le_bytes([block[0], block[1]]), u16::from_le_bytes([block[2], block[3]])];
    if ends[0] <= ends[1] {
        return;
    }
    let palette = |ends: [u16; 2]| {
        let [a, b] = ends.map(expand565);
        SHARE.map(|s| [0, 1, 2].map(|c| s * a[c] + (1.0 - s) * b[c]))
    };
    let distance = |a: &[f32; 3], b: &[f32; 3]| (0..3).map(|c| weights[c] * (a[c] - b[c]).powi(2)).sum::<f32>();
    let mut indices = u32::from_le_bytes([block[4], block[5], block[6], block[7]]);
    let colours = palette(ends);
    let mut error: f32 = texels.iter().enumerate().map(|(i, t)| distance(t, &colours[(indices >> (2 * i)) as usize & 3])).sum();
    for _ in 0..2 {
        let (mut aa, mut ab, mut bb) = (0.0, 0.0, 0.0);
        let (mut ax, mut bx) = ([0.0; 3], [0.0; 3]);
        for (i, texel) in texels.iter().enumerate() {
            let a = SHARE[(indices >> (2 * i)) as usize & 3];
            let b = 1.0 - a;
            (aa, ab, bb) = (aa + a * a, ab + a * b, bb + b * b);
            for c in 0..3 {
                ax[c] += a * texel[c];
                bx[c] += b * texel[c];
            }
        }
        let determinant = aa * bb - ab * ab;
        if determinant < 1e-3 {
            return; // all texels have the same index, so the end points are not determined
        }
        let first = [0, 1, 2].map(|c| (ax[c] * bb - bx[c] * ab) / determinant);
        let second = [0, 1, 2].map(|c| (bx[c] * aa - ax[c] * ab) / determinant);
        let mut candidate = [first, second].map(quantise565);
        candidate.sort_unstable_by(|a, b| b.cmp(a)); // the greater end point first: four-colour mode
        if candidate[0] == candidate[1] {
            return;
        }
        let colours = palette(candidate);
        let (mut new_indices, mut new_error) = (0_u32, 0.0);
        for (i, texel) in texels.iter().enumerate() {
            let (mut nearest, mut least) = (0, f32::INFINITY);
            for (k, colour) in (0_u32..).zip(&colours) {
                let d = distance(texel, colour);
                if d < least {
                    (nearest, least) = (k, d);
                }
            }
            new_indices |= nearest << (2 * i);
            new_error += least;
        }
        if new_error >= error {
            return;
        }
        (ends, indices, error) = (candidate, new_indices, new_error);
        block[..2].copy_from_slice(&ends[0].to_le_bytes());
        block[2..4].copy_from_slice(&ends[1].to_le_bytes());
        block[4..].copy_from_slice(&indices.to_le_bytes());
    }
}

/// Expands a 5:6:5 colour to 0..255 per channel. As in a decoder, the high bits are repeated in the low bits.
fn expand565(code: u16) -> [f32; 3] {
    let (r, g, b) = (code >> 11, (code >> 5) & 63, code & 31);
    [(r << 3) | (r >> 2), (g << 2) | (g >> 4), (b << 3) | (b >> 2)].map(f32::from)
}

/// Rounds the channels of a colour, 0..255, to 5, 6 and 5 bits. Values outside this range are clamped.
fn quantise565(colour: [f32; 3]) -> u16 {
    let level = |value: f32, most: f32| (value * most / 255.0 + 0.5).clamp(0.0, most) as u16;
    (level(colour[0], 31.0) << 11) | (level(colour[1], 63.0) << 5) | level(colour[2], 31.0)
}

/// Decodes an image to RGBA8.
///
/// # Panics
/// If `blocks` does not hold [`BlockFormat::image_bytes`] bytes.
pub fn decode(format: BlockFormat, blocks: &[u8], width: usize, height: usize) -> Vec<u8> {
    assert_eq!(blocks.len(), format.image_bytes(width, height), "`blocks` must hold a {format:?} image of {width} x {height} texels");
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

/// Returns a BC3 alpha block. Each of its 16 decoded values is at least the value of the same texel in `needed`. The function tries a block in BC3's
/// eight-value mode and a block in its six-value mode, and returns the block whose values exceed `needed` by less in total.
///
/// Interpolated values are computed as exact fractions and rounded down. A decoder that rounds the exact fractions, up or down, therefore decodes no
/// value below `needed`.
pub fn alpha_block_at_least(needed: [u8; 16]) -> [u8; 8] {
    let highest = needed.iter().copied().max().unwrap_or(0);
    let lowest = needed.iter().copied().min().unwrap_or(0);
    // The six-value mode includes the value 255, so its two end points need to enclose only the needed values below 255.
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
    best.expect("the eight-value block is always possible, because its highest value is the highest value needed").1
}

/// The 8 values of a BC3 alpha block. Interpolated values are rounded down.
fn alpha_palette(first: u8, second: u8) -> [u8; 8] {
    let (a, b) = (u32::from(first), u32::from(second));
    let mix = |k: u32, n: u32| u8::try_from(((n - k) * a + k * b) / n).expect("the mean of two bytes is a byte");
    if first > second {
        [first, second, mix(1, 7), mix(2, 7), mix(3, 7), mix(4, 7), mix(5, 7), mix(6, 7)]
    } else {
        [first, second, mix(1, 5), mix(2, 5), mix(3, 5), mix(4, 5), 0, 255]
    }
}
