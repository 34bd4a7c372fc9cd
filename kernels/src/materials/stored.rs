//! The bytes of a texture in the cache on disk: its means, then the blocks of all levels of the three arrays.

use super::TextureMeans;
use super::arrays::{CompressedChain, CompressedLayers};
use crate::blocks::BlockFormat;

/// Bytes of the means.
const MEANS: usize = 6 * 8 + 2 * 4;

/// The bytes of a texture.
pub(super) fn to_bytes(layers: &CompressedLayers, means: &TextureMeans) -> Vec<u8> {
    let TextureMeans { albedo, masked, smoothness, specular_occlusion } = means;
    let CompressedLayers { albedo: colour, normal, height } = layers;
    let mut bytes = bytemuck::cast_slice::<f64, u8>([*albedo, *masked].as_flattened()).to_vec();
    bytes.extend_from_slice(bytemuck::cast_slice(&[*smoothness, *specular_occlusion]));
    [colour, normal, height].into_iter().flat_map(|chain| &chain.levels).for_each(|level| bytes.extend_from_slice(level));
    bytes
}

/// The texture of which these are the bytes; `None` if their number is wrong. `size`: edge of the albedo, texels.
pub(super) fn from_bytes(size: u32, bytes: &[u8]) -> Option<(CompressedLayers, TextureMeans)> {
    let (means, mut rest) = bytes.split_at_checked(MEANS)?;
    let (colours, shares) = means.split_at(6 * 8);
    let (colours, shares): (Vec<f64>, Vec<f32>) = (bytemuck::pod_collect_to_vec(colours), bytemuck::pod_collect_to_vec(shares));
    let three = |from: usize| [0, 1, 2].map(|k| colours[from + k]);
    let means = TextureMeans { albedo: three(0), masked: three(3), smoothness: shares[0], specular_occlusion: shares[1] };
    let mut chain = |size: u32, format: BlockFormat| -> Option<CompressedChain> {
        let mut levels = Vec::new();
        for level in 0..=size.ilog2() {
            let edge = (size >> level) as usize;
            let (blocks, after) = rest.split_at_checked(format.image_bytes(edge, edge))?;
            levels.push(blocks.to_vec());
            rest = after;
        }
        Some(CompressedChain { size, levels })
    };
    let albedo = chain(size, BlockFormat::Bc1)?;
    let normal = chain(size, BlockFormat::Bc3)?;
    let height = chain(size / 2, BlockFormat::Bc1)?;
    rest.is_empty().then_some((CompressedLayers { albedo, normal, height }, means))
}
