//! Maps to block-compressed mip chains, and the three texture arrays they fill.
//!
//! | array | format | red | green | blue | alpha |
//! | --- | --- | --- | --- | --- | --- |
//! | albedo, `size`² | BC1, sRGB | albedo | albedo | albedo | opaque |
//! | normal, `size`² | BC3, linear | smoothness | n.y / 2 + 1/2 | specular occlusion | n.x / 2 + 1/2 |
//! | height, (`size` / 2)² | BC1, linear | height | colour mask | 0 | opaque |
//!
//! Alpha and green are BC3's two most precise channels, hence the places of n.x and n.y; the normal map of a quadtree node is packed alike.
//! Mips are 2x2 box averages of linear values. n.x and n.y are averaged without renormalising, so a texel of a coarse level is the mean
//! of its normals: shorter where they disagree, as a mean is.

use rayon::prelude::*;
use texpresso::{Algorithm, Format, Params};

use super::MaterialMaps;

/// Detail textures of one type that can be resident at once.
pub const MAX_LAYERS: usize = 32;

/// The detail textures of a scene: three arrays, layer by layer, each at most [`MAX_LAYERS`] deep.
#[derive(Clone, Debug, PartialEq)]
pub struct DetailArrays {
    /// Edge of an albedo or normal layer in texels; a height layer has half of it.
    pub size: u32,
    /// BC1 sRGB, `size`².
    pub albedo: Vec<CompressedChain>,
    /// BC3, `size`².
    pub normal: Vec<CompressedChain>,
    /// BC1, (`size` / 2)².
    pub height: Vec<CompressedChain>,
}

impl DetailArrays {
    /// A copy of one layer of each array.
    ///
    /// # Panics
    /// If there is no such layer.
    pub fn layer(&self, layer: usize) -> CompressedLayers {
        let [albedo, normal, height] = [&self.albedo, &self.normal, &self.height].map(|array| array[layer].clone());
        CompressedLayers { albedo, normal, height }
    }

    /// Adds a layer to each array.
    pub fn push(&mut self, layer: CompressedLayers) {
        self.albedo.push(layer.albedo);
        self.normal.push(layer.normal);
        self.height.push(layer.height);
    }
}

/// A block-compressed square texture with all its mips, down to 1x1.
#[derive(Clone, Debug, PartialEq)]
pub struct CompressedChain {
    /// Edge of level 0 in texels, a power of two.
    pub size: u32,
    /// Blocks of each level, row-major, finest level first. A level smaller than 4x4 is one padded block.
    pub levels: Vec<Vec<u8>>,
}

impl CompressedChain {
    /// Edge of a level in texels.
    pub fn level_size(&self, level: usize) -> u32 {
        (self.size >> level).max(1)
    }

    /// RGBA texels of a level, row-major, as stored (an sRGB texture's are sRGB codes).
    ///
    /// # Panics
    /// If the chain has no such level.
    pub fn decode(&self, level: usize) -> Vec<[u8; 4]> {
        let size = self.level_size(level) as usize;
        let blocks = &self.levels[level];
        let format = if blocks.len() == Format::Bc1.compressed_size(size, size) { Format::Bc1 } else { Format::Bc3 };
        let mut bytes = vec![0_u8; size * size * 4];
        format.decompress(blocks, size, size, &mut bytes);
        bytes.chunks_exact(4).map(|t| [t[0], t[1], t[2], t[3]]).collect()
    }
}

/// One layer of each array.
#[derive(Clone, Debug, PartialEq)]
pub struct CompressedLayers {
    /// Layer of [`DetailArrays::albedo`].
    pub albedo: CompressedChain,
    /// Layer of [`DetailArrays::normal`].
    pub normal: CompressedChain,
    /// Layer of [`DetailArrays::height`].
    pub height: CompressedChain,
}

/// Compresses one material's maps; their size must be a power of two, at least 8.
pub fn compress(maps: &MaterialMaps) -> CompressedLayers {
    let albedo = chain(maps.albedo.clone(), maps.size, Format::Bc1, ALBEDO, |t| {
        let [r, g, b] = t.map(srgb8);
        [r, g, b, 255]
    });
    let normal = (0..maps.normal.len())
        .map(|i| [maps.smoothness[i], maps.normal[i][1] * 0.5 + 0.5, maps.specular_occlusion[i], maps.normal[i][0] * 0.5 + 0.5])
        .collect();
    let normal = chain(normal, maps.size, Format::Bc3, NORMAL, |t| t.map(unorm8));
    let height: Vec<[f32; 2]> = maps.height.iter().zip(&maps.colour_mask).map(|(&h, &m)| [h, m]).collect();
    let height = chain(halve(&height, maps.size as usize), maps.size / 2, Format::Bc1, HEIGHT, |t| {
        let [h, m] = t.map(unorm8);
        [h, m, 0, 255]
    });
    CompressedLayers { albedo, normal, height }
}

/// The range fit, improved by [`refine`], comes within a decibel of texpresso's cluster fit in a small part of its time.
const fn params(weights: [f32; 3]) -> Params {
    Params { algorithm: Algorithm::RangeFit, weights, weigh_colour_by_alpha: false }
}

const ALBEDO: Params = params([1.0, 1.0, 1.0]);
/// An error of slope shows more than one of smoothness, and that more than one of occlusion.
const NORMAL: Params = params([0.3, 1.0, 0.15]);
/// Blue is constant; height decides blends everywhere, the mask only where there is a tint.
const HEIGHT: Params = params([1.0, 0.5, 0.0]);

/// All levels of an image, from `size`² to 1x1, each quantised by `to_bytes` and compressed.
fn chain<const N: usize>(
    mut image: Vec<[f32; N]>,
    size: u32,
    format: Format,
    params: Params,
    to_bytes: impl Fn([f32; N]) -> [u8; 4] + Sync,
) -> CompressedChain {
    let mut levels = Vec::new();
    let mut edge = size as usize;
    loop {
        let bytes: Vec<u8> = image.par_iter().flat_map_iter(|&texel| to_bytes(texel)).collect();
        let mut blocks = vec![0_u8; format.compressed_size(edge, edge)];
        format.compress(&bytes, edge, edge, params, &mut blocks);
        if edge >= 4 {
            refine_level(&mut blocks, &bytes, edge, format, params.weights);
        }
        levels.push(blocks);
        if edge == 1 {
            return CompressedChain { size, levels };
        }
        image = halve(&image, edge);
        edge /= 2;
    }
}

/// Improves the colour half of every block of a level.
fn refine_level(blocks: &mut [u8], bytes: &[u8], edge: usize, format: Format, weights: [f32; 3]) {
    let block_size = format.block_size();
    let across = edge / 4;
    blocks.par_chunks_mut(block_size).with_min_len(256).enumerate().for_each(|(index, block)| {
        let corner = (index / across * edge + index % across) * 4;
        let texels: [[f32; 3]; 16] = std::array::from_fn(|i| {
            let at = (corner + i / 4 * edge + i % 4) * 4;
            [0, 1, 2].map(|c| f32::from(bytes[at + c]))
        });
        if let Ok(colour) = (&mut block[block_size - 8..]).try_into() {
            refine(colour, &texels, weights);
        }
    });
}

/// Alternates the two halves of the fit while that helps, at most twice: end points by least squares for the given indices, then the
/// nearest palette entry for each texel. Each half can only lower the weighted squared error, quantisation aside, which is checked.
/// Blocks in BC1's three-colour mode (flat ones, mostly) stay as they are.
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
            return; // all texels have one index: nothing to solve for
        }
        let first = [0, 1, 2].map(|c| (ax[c] * bb - bx[c] * ab) / determinant);
        let second = [0, 1, 2].map(|c| (bx[c] * aa - ax[c] * ab) / determinant);
        let mut candidate = [first, second].map(quantise565);
        candidate.sort_unstable_by(|a, b| b.cmp(a)); // the greater first: four-colour mode
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

/// Codes 0..255 of a 5:6:5 colour, low bits filled with the high ones as decoders do.
fn expand565(code: u16) -> [f32; 3] {
    let (r, g, b) = (code >> 11, (code >> 5) & 63, code & 31);
    [(r << 3) | (r >> 2), (g << 2) | (g >> 4), (b << 3) | (b >> 2)].map(f32::from)
}

/// The 5:6:5 colour nearest to codes 0..255, clamped.
fn quantise565(colour: [f32; 3]) -> u16 {
    let level = |value: f32, most: f32| (value * most / 255.0 + 0.5).clamp(0.0, most) as u16;
    (level(colour[0], 31.0) << 11) | (level(colour[1], 63.0) << 5) | level(colour[2], 31.0)
}

/// The next mip: means of 2x2 texels.
fn halve<const N: usize>(image: &[[f32; N]], edge: usize) -> Vec<[f32; N]> {
    let half = edge / 2;
    (0..half * half)
        .into_par_iter()
        .map(|i| {
            let corner = (i / half) * 2 * edge + (i % half) * 2;
            std::array::from_fn(|c| {
                0.25 * (image[corner][c] + image[corner + 1][c] + image[corner + edge][c] + image[corner + edge + 1][c])
            })
        })
        .collect()
}

/// Nearest 8-bit code of a number in 0..1; NaN gives 0.
fn unorm8(value: f32) -> u8 {
    (value * 255.0 + 0.5) as u8
}

/// Nearest 8-bit sRGB code of a linear value (IEC 61966-2-1).
fn srgb8(linear: f32) -> u8 {
    unorm8(if linear <= 0.003_130_8 { linear * 12.92 } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 })
}
