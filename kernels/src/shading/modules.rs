//! The WGSL files of shading, and the files that each of them needs. Each flavour has a file. Each estimator has a file, too, except that
//! estimators that replace random choices by their mean share `mean.wgsl`.

use super::{Estimator, VARIANCE_SCALE, diagnostics, salt};
use crate::base::wgsl::{Constant, Wgsl};
use crate::{classification, shared, terrain, view, virtual_texture};

/// Where the cosine of the slope is below this value, the estimator `snapped` projects textures horizontally. The value is Terrain3D's default.
pub const SNAPPED_COSINE: f64 = 0.8;

const fn estimator(estimator: Estimator) -> Constant {
    Constant::U32(estimator as u32)
}

macro_rules! files {
    ($($name:ident = $path:literal needs [$($need:path),* $(,)?] $(with $constants:expr)?,)*) => {
        $(
            static $name: Wgsl =
                Wgsl::new(concat!("shading/", $path), include_str!($path), &[$(&$need),*])$(.with($constants))?;
        )*
    };
}

files! {
    PIXEL = "pixel.wgsl" needs [terrain::WGSL, view::WGSL, shared::FLAVOUR_WEIGHTS, shared::NOISE] with &[
        ("ESTIMATOR_FC5", estimator(Estimator::Fc5)),
        ("ESTIMATOR_EXACT", estimator(Estimator::Exact)),
        ("ESTIMATOR_VARIANCE", estimator(Estimator::Variance)),
        ("ESTIMATOR_BIPLANAR", estimator(Estimator::Biplanar)),
        ("ESTIMATOR_HEX", estimator(Estimator::Hex)),
        ("ESTIMATOR_STF", estimator(Estimator::Stf)),
        ("ESTIMATOR_LAPLACIAN", estimator(Estimator::Laplacian)),
        ("ESTIMATOR_LUNA8", estimator(Estimator::Luna8)),
        ("ESTIMATOR_SNAPPED", estimator(Estimator::Snapped)),
        ("ESTIMATOR_BIPLANAR_MEAN", estimator(Estimator::BiplanarMean)),
        ("ESTIMATOR_HEX_MEAN", estimator(Estimator::HexMean)),
        ("SALT_NEAR_CLIFF", Constant::U32(salt::NEAR_CLIFF)),
        ("SALT_FAR_CLIFF", Constant::U32(salt::FAR_CLIFF)),
        ("SALT_SPLAT", Constant::U32(salt::SPLAT)),
        ("SALT_TEXEL", Constant::U32(salt::TEXEL)),
        ("SALT_HEIGHT_TEXEL", Constant::U32(salt::HEIGHT_TEXEL)),
    ],
    BIPLANAR = "estimators/biplanar.wgsl" needs [PIXEL, view::WGSL, shared::BIPLANAR],
    SNAPPED = "estimators/snapped.wgsl" needs [PIXEL, shared::SNAPPED_PROJECTION] with
        &[("SHADING_SNAPPED_COSINE", Constant::real(SNAPPED_COSINE))],
    LUNA8 = "estimators/luna8.wgsl" needs [PIXEL, terrain::WGSL],
    LAPLACIAN = "estimators/laplacian.wgsl" needs [PIXEL, terrain::WGSL],
    FC5 = "estimators/fc5.wgsl" needs [PIXEL, terrain::WGSL, view::WGSL, shared::SELECT, shared::SPLAT_BLEND],
    MEAN = "estimators/mean.wgsl" needs [PIXEL, terrain::WGSL, view::WGSL],
    VARIANCE = "estimators/variance.wgsl" needs [PIXEL, terrain::WGSL, view::WGSL],
    HEX = "estimators/hex.wgsl" needs [PIXEL, terrain::WGSL, shared::SELECT, shared::SPLAT_BLEND],
    STF = "estimators/stf.wgsl" needs [PIXEL, terrain::WGSL, shared::SELECT, shared::SPLAT_BLEND],
    PROJECTIONS = "projections.wgsl" needs [PIXEL, BIPLANAR, SNAPPED, LUNA8, LAPLACIAN, terrain::WGSL, view::WGSL, shared::TRIPLANAR],
    FAR_ATLAS = "flavours/far_atlas.wgsl" needs [PIXEL, terrain::WGSL],
    VIRTUAL_TEXTURE = "flavours/virtual_texture.wgsl" needs [PIXEL, FAR_ATLAS, virtual_texture::WGSL, terrain::WGSL, view::WGSL],
    SPLAT = "flavours/splat.wgsl" needs [PIXEL, PROJECTIONS, STF, terrain::WGSL, view::WGSL],
    NEAR_CLIFF = "flavours/near_cliff.wgsl" needs [PIXEL, SPLAT, STF, MEAN, VARIANCE, FC5, terrain::WGSL],
    FAR_CLIFF = "flavours/far_cliff.wgsl" needs [PIXEL, SPLAT, STF, LAPLACIAN, MEAN, VARIANCE, HEX, FC5, terrain::WGSL],
    SURFACE = "surface.wgsl" needs [
        PIXEL,
        VIRTUAL_TEXTURE,
        FAR_ATLAS,
        NEAR_CLIFF,
        FAR_CLIFF,
        SPLAT,
        terrain::WGSL,
        shared::FLAVOUR_WEIGHTS,
        shared::TRIPLANAR,
    ] with
        &[("SHADING_VARIANCE_SCALE", Constant::real(VARIANCE_SCALE))],
    SHADING = "shading.wgsl" needs [
        PIXEL,
        PROJECTIONS,
        SURFACE,
        diagnostics::WGSL,
        classification::TILE_WGSL,
        terrain::WGSL,
        terrain::FOOTPRINT_WGSL,
        view::WGSL,
        shared::FLAVOUR_WEIGHTS,
        shared::OCTAHEDRAL,
        shared::TILING,
        shared::VIEW,
    ],
}

/// The file with the entry points.
pub(super) const ROOTS: &[&Wgsl] = &[&SHADING];
