//! Compresses maps to block-compressed mip chains, and stores the chains in three texture arrays.
//!
//! | array | format | red | green | blue | alpha |
//! | --- | --- | --- | --- | --- | --- |
//! | albedo, `size`² | BC1, sRGB | albedo | albedo | albedo | opaque |
//! | normal, `size`² | BC3, linear | smoothness | n.y / 2 + 1/2 | specular occlusion | n.x / 2 + 1/2 |
//! | height, (`size` / 2)² | BC1, linear | height | colour mask | 0 | opaque |
//!
//! n is the normal. Alpha and green are the two most precise channels of BC3, so they hold n.x and n.y. The normal map of a quadtree node is
//! packed in the same way. Mips are 2x2 box averages of linear values. n.x and n.y are averaged without renormalising, so a texel of a coarse
//! level holds x and y of the mean of several normals. This mean is shorter than 1 if the normals differ.

use rayon::prelude::*;

use super::MaterialMaps;
use crate::base::colour::{srgb_code, unorm8};
use crate::blocks::{self, BlockFormat, Effort};

/// Largest number of layers in each array of detail textures.
pub const MAX_LAYERS: usize = 32;

/// The detail textures of a scene: three arrays, each with at most [`MAX_LAYERS`] layers.
#[derive(Clone, Debug, PartialEq)]
pub struct DetailArrays {
    /// Edge of an albedo or normal layer in texels; a height layer has half this edge.
    pub size: u32,
    /// Albedo: BC1 sRGB, `size`² texels.
    pub albedo: Vec<CompressedChain>,
    /// Normal, smoothness and specular occlusion: BC3, `size`² texels.
    pub normal: Vec<CompressedChain>,
    /// Height and colour mask: BC1, (`size` / 2)² texels.
    pub height: Vec<CompressedChain>,
}

impl DetailArrays {
    /// Returns a copy of one layer of each array.
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

    /// Returns the RGBA texels of a level, row-major, as stored (sRGB-encoded if the texture is sRGB).
    ///
    /// # Panics
    /// If the chain has no such level.
    pub fn decode(&self, level: usize) -> Vec<[u8; 4]> {
        let size = self.level_size(level) as usize;
        let blocks = &self.levels[level];
        let format = if blocks.len() == BlockFormat::Bc1.image_bytes(size, size) { BlockFormat::Bc1 } else { BlockFormat::Bc3 };
        let bytes = blocks::decode(format, blocks, size, size);
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

/// Compresses the maps of one material. The size of the maps must be a power of two, at least 8.
pub fn compress(maps: &MaterialMaps) -> CompressedLayers {
    let albedo = chain(maps.albedo.clone(), maps.size, BlockFormat::Bc1, ALBEDO, |t| {
        let [r, g, b] = t.map(srgb_code);
        [r, g, b, 255]
    });
    let normal = (0..maps.normal.len())
        .map(|i| [maps.smoothness[i], maps.normal[i][1] * 0.5 + 0.5, maps.specular_occlusion[i], maps.normal[i][0] * 0.5 + 0.5])
        .collect();
    let normal = chain(normal, maps.size, BlockFormat::Bc3, NORMAL, |t| t.map(unorm8));
    let height: Vec<[f32; 2]> = maps.height.iter().zip(&maps.colour_mask).map(|(&h, &m)| [h, m]).collect();
    let height = chain(halve(&height, maps.size as usize), maps.size / 2, BlockFormat::Bc1, HEIGHT, |t| {
        let [h, m] = t.map(unorm8);
        [h, m, 0, 255]
    });
    CompressedLayers { albedo, normal, height }
}

/// Weights of errors in red, green and blue when the albedo array is compressed.
const ALBEDO: [f32; 3] = [1.0, 1.0, 1.0];
/// The same weights for the normal array: errors of the normal (green) are more visible than errors of smoothness (red), and errors of smoothness are
/// more visible than errors of occlusion (blue).
const NORMAL: [f32; 3] = [0.3, 1.0, 0.15];
/// The same weights for the height array: height (red) affects how materials are blended, the colour mask (green) matters only in tinted materials,
/// and blue is constant.
const HEIGHT: [f32; 3] = [1.0, 0.5, 0.0];

/// Returns all levels of an image, from `size`² to 1x1. Each level is quantised by `to_bytes` and compressed.
fn chain<const N: usize>(
    mut image: Vec<[f32; N]>,
    size: u32,
    format: BlockFormat,
    weights: [f32; 3],
    to_bytes: impl Fn([f32; N]) -> [u8; 4] + Sync,
) -> CompressedChain {
    let mut levels = Vec::new();
    let mut edge = size as usize;
    loop {
        let bytes: Vec<u8> = image.par_iter().flat_map_iter(|&texel| to_bytes(texel)).collect();
        levels.push(blocks::encode(format, &bytes, edge, edge, weights, Effort::Refined));
        if edge == 1 {
            return CompressedChain { size, levels };
        }
        image = halve(&image, edge);
        edge /= 2;
    }
}

/// Returns the next coarser mip level: means of 2x2 texels.
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
