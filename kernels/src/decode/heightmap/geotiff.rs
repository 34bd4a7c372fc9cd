//! Interprets the GeoTIFF tags of a file: coordinate system, units, and positions of the samples.
//!
//! Source: *OGC GeoTIFF Standard* 1.1 (OGC 19-008r4), the requirements of GeoKeyDirectoryTag, GTModelTypeGeoKey, GTRasterTypeGeoKey, the
//! unit keys, ModelPixelScaleTag, ModelTiepointTag and ModelTransformationTag. A sample is an elevation at a point. If the file says that a
//! pixel is an area, this point is the centre of the pixel. The distance between samples is the same whether a pixel is an area or a point.

use std::collections::BTreeMap;

use super::spacing::Spacing;
use super::systems::{WORLD_MERCATOR, has_metric_heights, is_depth, is_metric, projected_feet, vertical_feet};
use super::units::{METRE, Unit};
use crate::decode::fault::Fault;

// Numbers of the GeoTIFF keys that are read; the tag with their floating-point parameters; two values of keys (user-defined unit, degree).
const MODEL_TYPE: u16 = 1024;
const RASTER_TYPE: u16 = 1025;
const GEODETIC_SYSTEM: u16 = 2048;
const ANGULAR_UNIT: u16 = 2054;
const PROJECTED_SYSTEM: u16 = 3072;
const LINEAR_UNIT: u16 = 3076;
const LINEAR_UNIT_SIZE: u16 = 3077;
const VERTICAL_SYSTEM: u16 = 4096;
const VERTICAL_UNIT: u16 = 4099;
const DOUBLE_PARAMETERS: u64 = 34_736;
const USER_DEFINED: u16 = 32_767;
const DEGREE: u16 = 9102;

/// Length of a degree of latitude on a sphere with the mean radius of the Earth (6371 km), metres.
const DEGREE_M: f64 = 111_195.0;
/// Radius of the sphere of web maps, metres.
const MERCATOR_RADIUS_M: f64 = 6_378_137.0;
/// Largest relative difference, between the spacings from west to east and from north to south, that counts as rounding.
const SAME_SPACING: f64 = 1e-4;
/// Largest size of the rotation terms of a transform, as a share of a pixel, that counts as rounding.
///
/// Two other tolerances follow from this number. If a file states its transform twice (as ModelPixelScale and as ModelTransformation), the terms may
/// differ by this share of a pixel, and the origins by its square root times a pixel. The stated unit of a metric system may differ from the metre by
/// this number of metres.
const SAME_TERM: f64 = 1e-6;
/// Largest scale error of a Mercator map of the world at which distances on the map count as distances on the ground.
const TRUE_SCALE: f64 = 1e-3;

/// The tags of a GeoTIFF, as they are stored.
#[derive(Debug, Default)]
pub(super) struct Tags {
    /// ModelPixelScale: width, height and depth of a pixel.
    pub(super) pixel_scale: Option<Vec<f64>>,
    /// ModelTiepoint: sets of six numbers, a position in the raster and its coordinates.
    pub(super) tie_points: Option<Vec<f64>>,
    /// ModelTransformation: a matrix of 4 x 4 numbers, row by row.
    pub(super) transformation: Option<Vec<f64>>,
    /// GeoKeyDirectory.
    pub(super) keys: Option<Vec<u64>>,
    /// GeoDoubleParams.
    pub(super) doubles: Vec<f64>,
}

impl Tags {
    pub(super) fn is_empty(&self) -> bool {
        self.pixel_scale.is_none() && self.tie_points.is_none() && self.transformation.is_none() && self.keys.is_none()
    }
}

/// The interpretation of the tags.
#[derive(Debug, PartialEq)]
pub(super) struct Georeference {
    pub(super) spacing: Spacing,
    /// Whether row 0 is the southern edge.
    pub(super) is_south_up: bool,
    /// Whether column 0 is the eastern edge.
    pub(super) is_mirrored: bool,
    /// The unit of heights, if a key states it, or if the vertical system is known to have heights in feet.
    pub(super) vertical_unit: Option<Unit>,
    /// The unit of projected coordinates, if a key states it, or if the projected system is known to be in metres.
    pub(super) linear_unit: Option<Unit>,
    /// The code of the vertical system, if no key states the unit of heights, and the system is not known to have heights in metres or feet.
    pub(super) vertical_system_without_unit: Option<u16>,
}

impl Georeference {
    /// Reads the tags of an image of this size.
    ///
    /// # Errors
    /// The tags are damaged or contradict each other; a version or a unit is not known; or a world cannot have such samples, for example because the
    /// coordinates are degrees, the spacings are unequal, the raster is rotated, the numbers are depths, or the map distorts distances.
    pub(super) fn read(tags: &Tags, size: [u32; 2]) -> Result<Georeference, Fault> {
        let keys = Keys::read(tags)?;
        let transform = Transform::read(tags)?;
        let (vertical_system, vertical_unit) = (keys.short(VERTICAL_SYSTEM), keys.vertical_unit()?);
        let centre = transform.map(|transform| transform.at(size.map(|n| f64::from(n) / 2.0)));
        let (spacing, linear_unit) = match keys.model()? {
            Model::Geographic => return Err(keys.degrees(transform, centre)),
            Model::Projected => {
                let unit = keys.linear_unit()?;
                (keys.spacing(transform, centre, unit)?, unit)
            }
            Model::Unknown => (keys.spacing(transform, centre, None)?, None),
        };
        Ok(Georeference {
            spacing,
            is_south_up: transform.is_some_and(|t| t.down > 0.0),
            is_mirrored: transform.is_some_and(|t| t.across < 0.0),
            vertical_unit,
            linear_unit,
            vertical_system_without_unit: vertical_system.filter(|&system| vertical_unit.is_none() && !has_metric_heights(system)),
        })
    }
}

/// The kind of coordinates of the model space.
enum Model {
    Projected,
    Geographic,
    Unknown,
}

/// The keys whose value is one number.
struct Keys {
    shorts: BTreeMap<u16, u16>,
    doubles: BTreeMap<u16, f64>,
}

impl Keys {
    /// Reads the directory of keys: a header of four numbers, of which the last is the number of keys, and four numbers for each key.
    fn read(tags: &Tags) -> Result<Keys, Fault> {
        let mut keys = Keys { shorts: BTreeMap::new(), doubles: BTreeMap::new() };
        let Some(directory) = &tags.keys else { return Ok(keys) };
        let [version, _, _, count, entries @ ..] = directory.as_slice() else {
            return Err(Fault::Damaged("its directory of GeoTIFF keys has no header".to_owned()));
        };
        if *version != 1 {
            return Err(Fault::Unsupported(format!(
                "its GeoTIFF keys have version {version}, which is not known (1 is); write the file anew with gdal_translate IN OUT.tif"
            )));
        }
        let (entries, _) = entries.as_chunks::<4>();
        if *count > entries.len() as u64 {
            return Err(Fault::Damaged(format!("its directory of GeoTIFF keys states {count} keys, but holds {}", entries.len())));
        }
        for &[key, place, _, value] in entries.iter().take(usize::try_from(*count).unwrap_or(usize::MAX)) {
            let Ok(key) = u16::try_from(key) else { continue };
            let is_new = match place {
                0 => u16::try_from(value).ok().is_none_or(|value| keys.shorts.insert(key, value).is_none_or(|other| other == value)),
                DOUBLE_PARAMETERS => {
                    let value = usize::try_from(value).ok().and_then(|index| tags.doubles.get(index)).copied().ok_or_else(|| {
                        Fault::Damaged(format!("its GeoTIFF key {key} names a number that is not in the list of parameters"))
                    })?;
                    keys.doubles.insert(key, value).is_none_or(|other| other == value)
                }
                _ => true,
            };
            if !is_new {
                return Err(Fault::Contradictory(format!("its GeoTIFF key {key} is there twice, with different values")));
            }
        }
        Ok(keys)
    }

    /// The value of a key; `None` if the key is absent, or its value is 0 (undefined).
    fn short(&self, key: u16) -> Option<u16> {
        self.shorts.get(&key).copied().filter(|&value| value != 0)
    }

    fn model(&self) -> Result<Model, Fault> {
        let has_projection = self.short(PROJECTED_SYSTEM).is_some();
        match self.short(MODEL_TYPE) {
            Some(1) => Ok(Model::Projected),
            Some(2) if has_projection => Err(Fault::Contradictory(
                "its GeoTIFF keys say that its coordinates are geographic, but name a projected system".to_owned(),
            )),
            Some(2) => Ok(Model::Geographic),
            Some(3) => Err(Fault::Unsupported(
                "its coordinates are geocentric; convert it to a projected system with gdalwarp -t_srs EPSG:CODE IN OUT.tif".to_owned(),
            )),
            _ if has_projection => Ok(Model::Projected),
            _ if self.short(GEODETIC_SYSTEM).is_some() => Ok(Model::Geographic),
            _ => Ok(Model::Unknown),
        }
    }

    /// The unit of projected coordinates; `None` if no key states it, and the system is not known to be in metres.
    fn linear_unit(&self) -> Result<Option<Unit>, Fault> {
        let system = self.short(PROJECTED_SYSTEM);
        let of_system = system.filter(|&system| is_metric(system)).map(|_| METRE);
        let unit = match self.short(LINEAR_UNIT) {
            None => return Ok(of_system),
            Some(USER_DEFINED) => {
                let metres = self.doubles.get(&LINEAR_UNIT_SIZE).copied().filter(|size| size.is_normal() && *size > 0.0);
                let metres = metres.ok_or_else(|| Fault::Damaged("it defines a unit of length, but does not state the unit's length in metres".to_owned()))?;
                Unit { name: "user-defined unit", metres }
            }
            Some(code) => Unit::of_code(code).ok_or_else(|| {
                Fault::Unsupported(format!(
                    "the unit of its coordinates, EPSG code {code}, is not known; convert it to metres with gdalwarp -t_srs EPSG:CODE IN OUT.tif"
                ))
            })?,
        };
        match (of_system, system) {
            (Some(_), Some(system)) if (unit.metres - METRE.metres).abs() > SAME_TERM => Err(Fault::Contradictory(format!(
                "its coordinates are in EPSG:{system}, whose unit is the metre, but it states the unit {}",
                unit.name
            ))),
            _ => Ok(Some(unit)),
        }
    }

    /// The unit of heights; `None` if no key states it, and the vertical system is not known to have heights in feet.
    fn vertical_unit(&self) -> Result<Option<Unit>, Fault> {
        let system = self.short(VERTICAL_SYSTEM);
        if let Some(system) = system.filter(|&system| is_depth(system)) {
            return Err(Fault::Unsupported(format!(
                "its numbers are depths (EPSG:{system}), which grow downwards; turn them into heights with gdal_calc.py -A IN --calc=-A --outfile=OUT.tif"
            )));
        }
        let of_system = system.and_then(vertical_feet);
        let unit = match self.short(VERTICAL_UNIT) {
            None => return Ok(of_system),
            Some(code) => Unit::of_code(code).ok_or_else(|| {
                Fault::Unsupported(format!(
                    "the unit of its heights, EPSG code {code}, is not known; convert the heights to metres, and state the unit m (gdal_edit.py -units m FILE)"
                ))
            })?,
        };
        match of_system {
            Some(other) if other != unit => Err(Fault::Contradictory(format!(
                "its vertical system EPSG:{} has the unit {}, but it states the unit {}",
                system.unwrap_or_default(),
                other.name,
                unit.name
            ))),
            _ => Ok(Some(unit)),
        }
    }

    /// The distance between samples. It must be equal along rows and columns, and the raster must not be rotated. `centre`: coordinates of the centre
    /// of the raster. `unit`: unit of the coordinates, if it is known.
    fn spacing(&self, transform: Option<Transform>, centre: Option<[f64; 2]>, unit: Option<Unit>) -> Result<Spacing, Fault> {
        let Some(transform) = transform else { return Ok(Spacing::Unknown) };
        let [across, down] = transform.spacing()?;
        if (across - down).abs() > SAME_SPACING * across.max(down) {
            let finest = across.min(down);
            let name = unit.map_or_else(String::new, |unit| format!(" {}", unit.name));
            return Err(Fault::Unsupported(format!(
                "its samples are {across}{name} apart from west to east, but {down}{name} from north to south; \
                 make the spacing equal with gdalwarp -tr {finest} {finest} -r bilinear IN OUT.tif"
            )));
        }
        // Even if the two numbers are equal, the root of their product may differ from them in the last bit.
        let spacing = if across == down { across } else { (across * down).sqrt() };
        let Some(unit) = unit else {
            let system = self.short(PROJECTED_SYSTEM);
            return Ok(Spacing::WithoutUnit { stated: spacing, usual: system.and_then(|system| Some((system, projected_feet(system)?))) });
        };
        let metres = spacing * unit.metres;
        let web_map = self.short(PROJECTED_SYSTEM).filter(|system| WORLD_MERCATOR.contains(system));
        if let (Some([x, y]), Some(system)) = (centre, web_map) {
            let [x, y] = [x, y].map(|v| v * unit.metres / MERCATOR_RADIUS_M);
            let stretch = y.cosh();
            if stretch.is_nan() {
                return Err(Fault::Unsupported(format!(
                    "it is a Mercator map of the world (EPSG:{system}), which stretches distances, but it does not say where it lies; \
                     convert it with gdalwarp -t_srs EPSG:CODE -r bilinear IN OUT.tif"
                )));
            }
            if stretch - 1.0 > TRUE_SCALE {
                let (longitude, latitude) = (x.to_degrees(), y.sinh().atan().to_degrees());
                return Err(Fault::Unsupported(format!(
                    "its samples are {spacing} m apart on a Mercator map of the world (EPSG:{system}), but {} m on the ground at latitude {latitude:.1}; convert it with {}",
                    three_digits(metres / stretch),
                    gdalwarp(longitude, latitude, metres / stretch)
                )));
            }
        }
        let kind = match self.short(RASTER_TYPE) {
            Some(2) => ", a pixel is a point",
            Some(1) => ", a pixel is an area, whose centre is the sample",
            _ => "",
        };
        Ok(Spacing::Stated { metres, how: format!("{spacing} {}{kind}", unit.name) })
    }

    /// The error for geographic coordinates, with the command that converts the file.
    fn degrees(&self, transform: Option<Transform>, centre: Option<[f64; 2]>) -> Fault {
        let has_degrees = self.short(ANGULAR_UNIT).is_none_or(|unit| unit == DEGREE);
        let spacing = transform.and_then(|transform| transform.spacing().ok());
        let (Some([across, down]), Some([longitude, latitude]), true) = (spacing, centre, has_degrees) else {
            return Fault::Unsupported(
                "its coordinates are angles, but a world needs metres; convert it with gdalwarp -t_srs EPSG:CODE -r bilinear IN OUT.tif"
                    .to_owned(),
            );
        };
        Fault::Unsupported(format!(
            "its samples are {across:.3e} x {down:.3e} degrees apart, but a world needs metres; convert it with {}",
            gdalwarp(longitude, latitude, down * DEGREE_M)
        ))
    }
}

/// The affine transform from a position in the raster to coordinates: `x = across * column + shear_x * row + origin_x` and
/// `y = shear_y * column + down * row + origin_y`.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Transform {
    across: f64,
    shear_x: f64,
    origin_x: f64,
    shear_y: f64,
    down: f64,
    origin_y: f64,
}

impl Transform {
    fn read(tags: &Tags) -> Result<Option<Transform>, Fault> {
        let of_scale = tags.pixel_scale.as_deref().map(|scale| Transform::of_scale(scale, tags.tie_points.as_deref())).transpose()?;
        let of_matrix = tags.transformation.as_deref().map(Transform::of_matrix).transpose()?;
        match (of_scale, of_matrix) {
            (Some(one), Some(other)) if !one.is_near(other) => {
                Err(Fault::Contradictory("ModelPixelScale and ModelTransformation contradict each other".to_owned()))
            }
            (None, None) if tags.tie_points.as_ref().is_some_and(|points| points.len() > 6) => Err(Fault::Unsupported(
                "it has ground control points instead of an equal spacing; convert it with gdalwarp -t_srs EPSG:CODE -r bilinear IN OUT.tif".to_owned(),
            )),
            (one, other) => Ok(one.or(other)),
        }
    }

    /// The transform from ModelPixelScale and the first tie point. Without a tie point, the position is unknown, and the origin is NaN.
    fn of_scale(scale: &[f64], tie_points: Option<&[f64]>) -> Result<Transform, Fault> {
        let &[width, height, ..] = scale else { return Err(Fault::Damaged("ModelPixelScale has fewer than two numbers".to_owned())) };
        if !(width.is_normal() && height.is_normal() && width > 0.0 && height > 0.0) {
            return Err(Fault::Unsupported(format!(
                "ModelPixelScale is {width} x {height}, but both numbers must be above 0, because programs disagree about what other numbers mean; \
                 write the file anew with gdalwarp -r near IN OUT.tif, and check which edge is north"
            )));
        }
        let [column, row, x, y] = match tie_points {
            Some(&[column, row, _, x, y, _, ..]) => [column, row, x, y],
            Some(_) => return Err(Fault::Damaged("ModelTiepoint has fewer than six numbers".to_owned())),
            None => [0.0, 0.0, f64::NAN, f64::NAN],
        };
        let origin = [x - column * width, y + row * height];
        Ok(Transform { across: width, shear_x: 0.0, origin_x: origin[0], shear_y: 0.0, down: -height, origin_y: origin[1] })
    }

    fn of_matrix(matrix: &[f64]) -> Result<Transform, Fault> {
        let &[across, shear_x, _, origin_x, shear_y, down, _, origin_y, ..] = matrix else {
            return Err(Fault::Damaged("ModelTransformation has fewer than 16 numbers".to_owned()));
        };
        let transform = Transform { across, shear_x, origin_x, shear_y, down, origin_y };
        if matrix.len() < 16 || ![across, shear_x, origin_x, shear_y, down, origin_y].iter().all(|term| term.is_finite()) {
            return Err(Fault::Damaged("ModelTransformation is not a matrix of 4 x 4 numbers".to_owned()));
        }
        Ok(transform)
    }

    fn at(&self, [column, row]: [f64; 2]) -> [f64; 2] {
        [self.across * column + self.shear_x * row + self.origin_x, self.shear_y * column + self.down * row + self.origin_y]
    }

    /// Whether two transforms agree apart from rounding. Their positions are compared only if both are known.
    fn is_near(&self, other: Transform) -> bool {
        let pixel = self.across.abs().max(self.down.abs());
        let near = |a: f64, b: f64, limit: f64| (a - b).abs() <= limit || a.is_nan() || b.is_nan();
        let terms = [(self.across, other.across), (self.shear_x, other.shear_x), (self.shear_y, other.shear_y), (self.down, other.down)];
        terms.iter().all(|&(a, b)| near(a, b, SAME_TERM * pixel))
            && near(self.origin_x, other.origin_x, SAME_TERM.sqrt() * pixel)
            && near(self.origin_y, other.origin_y, SAME_TERM.sqrt() * pixel)
    }

    /// Distances between samples from west to east and from north to south, in the unit of the coordinates.
    ///
    /// # Errors
    /// The raster is rotated or sheared, or a distance is 0 or not finite.
    fn spacing(&self) -> Result<[f64; 2], Fault> {
        let pixel = self.across.abs().max(self.down.abs());
        if self.shear_x.abs().max(self.shear_y.abs()) > SAME_TERM * pixel {
            return Err(Fault::Unsupported(
                "its rows do not run from west to east (its transform has a rotation); turn it with gdalwarp -r bilinear IN OUT.tif"
                    .to_owned(),
            ));
        }
        let spacing = [self.across.abs(), self.down.abs()];
        if !spacing.iter().all(|distance| distance.is_normal()) {
            return Err(Fault::Damaged(format!("its transform says that samples are {} x {} apart", self.across, self.down)));
        }
        Ok(spacing)
    }
}

/// The command of `gdalwarp` that converts a file with this centre (degrees) to UTM or, near a pole, to UPS, on WGS 84. If the centre is not known,
/// the command has the placeholder CODE. `spacing_m`: distance between samples.
fn gdalwarp(longitude: f64, latitude: f64, spacing_m: f64) -> String {
    let system = match latitude {
        _ if !(longitude.is_finite() && latitude.abs() <= 90.0) => "CODE".to_owned(),
        latitude if latitude > 84.0 => "32661".to_owned(),
        latitude if latitude < -80.0 => "32761".to_owned(),
        latitude => {
            let zone = ((longitude + 180.0).rem_euclid(360.0) / 6.0).floor().clamp(0.0, 59.0) as u32 + 1;
            (if latitude < 0.0 { 32_700 + zone } else { 32_600 + zone }).to_string()
        }
    };
    let spacing = three_digits(spacing_m);
    format!("gdalwarp -t_srs EPSG:{system} -tr {spacing} {spacing} -r bilinear IN OUT.tif")
}

/// A length as text, with about three significant digits. Lengths from 100 on are rounded to integers.
fn three_digits(length: f64) -> String {
    let places = (2.0 - length.abs().log10().floor()).clamp(0.0, 12.0) as usize;
    format!("{length:.places$}")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Tags of a file with samples 10 units apart. `model`: 1 = projected, 2 = geographic, 3 = geocentric. `keys`: further keys and their
    /// values, in addition to the types of model and raster.
    fn tags(model: u64, keys: &[[u64; 2]]) -> Tags {
        let mut directory = vec![1, 1, 0, keys.len() as u64 + 2, 1024, 0, 1, model, 1025, 0, 1, 1];
        directory.extend(keys.iter().flat_map(|&[key, value]| [key, 0, 1, value]));
        Tags {
            pixel_scale: Some(vec![10.0, 10.0, 0.0]),
            tie_points: Some(vec![0.0, 0.0, 0.0, 600_000.0, 5_200_000.0, 0.0]),
            keys: Some(directory),
            ..Tags::default()
        }
    }

    fn read(tags: &Tags) -> Result<Georeference, Fault> {
        Georeference::read(tags, [65, 49])
    }

    fn refused(tags: &Tags, words: &[&str]) {
        let text = read(tags).expect_err("refused").to_string();
        for word in words {
            assert!(text.contains(word), "`{word}` is missing in: {text}");
        }
    }

    fn metres(tags: &Tags) -> f64 {
        match read(tags).expect("usable").spacing {
            Spacing::Stated { metres, .. } => metres,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn the_spacing_is_in_metres_whatever_the_unit() {
        assert!((metres(&tags(1, &[[3072, 32_632], [3076, 9001]])) - 10.0).abs() < 1e-12);
        assert!((metres(&tags(1, &[[3072, 32_632]])) - 10.0).abs() < 1e-12, "the system has the metre");
        assert!((metres(&tags(1, &[[3072, 2903], [3076, 9003]])) - 12_000.0 / 3937.0).abs() < 1e-12);
        assert!((metres(&tags(1, &[[3072, 2903], [3076, 9002]])) - 3.048).abs() < 1e-12);
        let own = Tags { doubles: vec![0.5], ..tags(1, &[[3076, 32_767]]) };
        refused(&own, &["defines a unit of length"]);
        let mut own = own;
        own.keys.as_mut().expect("set above").extend([3077, 34_736, 1, 0]);
        own.keys.as_mut().expect("set above")[3] = 4;
        assert!((metres(&own) - 5.0).abs() < 1e-12);
        // If no unit is stated, none is assumed. If the coordinate system is known to be in feet, `usual` contains its unit.
        let without = |usual: Option<(u16, Unit)>| Spacing::WithoutUnit { stated: 10.0, usual };
        let survey_foot = Unit::of_code(9003).expect("known");
        assert_eq!(read(&tags(1, &[[3072, 2229]])).expect("usable").spacing, without(Some((2229, survey_foot))));
        assert_eq!(read(&tags(1, &[[3072, 31_467]])).expect("usable").spacing, without(None));
        let bare = Tags { keys: None, ..tags(1, &[]) };
        assert_eq!(read(&bare).expect("usable").spacing, without(None));
        assert_eq!(read(&Tags::default()).expect("usable").spacing, Spacing::Unknown);
        refused(&tags(1, &[[3072, 2903], [3076, 9999]]), &["EPSG code 9999"]);
        refused(&tags(1, &[[3072, 32_632], [3076, 9003]]), &["contradicts itself", "EPSG:32632", "US survey foot"]);
    }

    #[test]
    fn degrees_are_refused_with_the_call_that_mends_them() {
        let at = |longitude: f64, latitude: f64| Tags {
            pixel_scale: Some(vec![1.0 / 3600.0, 1.0 / 3600.0, 0.0]),
            tie_points: Some(vec![0.0, 0.0, 0.0, longitude, latitude, 0.0]),
            ..tags(2, &[[2048, 4326], [2054, 9102]])
        };
        refused(&at(11.0, 47.0), &["degrees apart", "gdalwarp -t_srs EPSG:32632 -tr 30.9 30.9"]);
        refused(&at(-70.5, -33.0), &["EPSG:32719 -tr"]);
        refused(&at(179.99, 10.0), &["EPSG:32660 -tr"]);
        refused(&at(181.0, 10.0), &["EPSG:32601 -tr"]);
        refused(&at(20.0, 88.0), &["EPSG:32661 -tr"]);
        refused(&at(20.0, -85.0), &["EPSG:32761 -tr"]);
        refused(&at(f64::NAN, 10.0), &["EPSG:CODE -tr"]);
        refused(&tags(2, &[[2048, 4326], [2054, 9105]]), &["angles", "EPSG:CODE"]);
        refused(&tags(2, &[[3072, 32_632]]), &["contradicts itself", "geographic, but name a projected system"]);
        refused(&tags(3, &[]), &["geocentric"]);
        // If the type of the model is missing, the coordinate systems decide.
        let mut old = at(11.0, 47.0);
        old.keys = Some(vec![1, 1, 0, 1, 2048, 0, 1, 4326]);
        refused(&old, &["degrees apart"]);
    }

    #[test]
    fn web_maps_stretch_distances() {
        let web = |y: f64| Tags { tie_points: Some(vec![0.0, 0.0, 0.0, 1_224_514.0, y, 0.0]), ..tags(1, &[[3072, 3857], [3076, 9001]]) };
        refused(&web(5_942_074.0), &["EPSG:3857", "6.82 m on the ground", "latitude 47.0", "EPSG:32632 -tr 6.82"]);
        assert!((metres(&web(100.0)) - 10.0).abs() < 1e-12, "at the equator, distances are true");
        // The unit of all three systems is the metre, so no key is needed.
        for system in [3857, 3785, 3395] {
            let keys = tags(1, &[[3072, system]]).keys;
            refused(&Tags { keys, ..web(5_942_074.0) }, &[&format!("EPSG:{system}"), "6.82 m on the ground"]);
        }
    }

    #[test]
    fn the_transform_says_where_north_is() {
        let north_up = read(&tags(1, &[[3072, 32_632]])).expect("usable");
        assert!(!north_up.is_south_up && !north_up.is_mirrored);
        let matrix = |a: f64, b: f64, c: f64, d: f64| Tags {
            pixel_scale: None,
            tie_points: None,
            transformation: Some(vec![a, b, 0.0, 600_000.0, c, d, 0.0, 5_199_510.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]),
            ..tags(1, &[[3072, 32_632]])
        };
        let south_up = read(&matrix(10.0, 0.0, 0.0, 10.0)).expect("usable");
        assert!(south_up.is_south_up && !south_up.is_mirrored);
        let mirrored = read(&matrix(-10.0, 0.0, 0.0, -10.0)).expect("usable");
        assert!(!mirrored.is_south_up && mirrored.is_mirrored);
        refused(&matrix(7.07, 7.07, 7.07, -7.07), &["rotation", "gdalwarp"]);
        refused(&matrix(0.0, 10.0, 10.0, 0.0), &["rotation"]);
        refused(&matrix(10.0, 0.0, 0.0, -25.0), &["10 metre apart", "25 metre", "gdalwarp -tr 10 10"]);
        refused(&matrix(0.0, 0.0, 0.0, 0.0), &["0 x 0 apart"]);
        refused(&matrix(f64::NAN, 0.0, 0.0, 10.0), &["4 x 4"]);
        let both = Tags { transformation: matrix(20.0, 0.0, 0.0, -20.0).transformation, ..tags(1, &[[3072, 32_632]]) };
        refused(&both, &["contradicts itself", "contradict each other"]);
        let scale = |x: f64, y: f64| Tags { pixel_scale: Some(vec![x, y, 0.0]), ..tags(1, &[[3072, 32_632]]) };
        refused(&scale(10.0, 25.0), &["25 metre", "gdalwarp -tr 10 10"]);
        for (x, y) in [(10.0, -10.0), (0.0, 10.0), (f64::NAN, 10.0), (f64::INFINITY, 10.0)] {
            refused(&scale(x, y), &["ModelPixelScale", "above 0"]);
        }
        refused(&Tags { pixel_scale: Some(vec![10.0]), ..tags(1, &[]) }, &["fewer than two"]);
        let points = Tags { pixel_scale: None, tie_points: Some(vec![0.0; 12]), ..tags(1, &[]) };
        refused(&points, &["control points"]);
    }

    #[test]
    fn heights_have_the_unit_of_their_system() {
        let unit = |keys: &[[u64; 2]]| read(&tags(1, &[&[[3072, 32_632]][..], keys].concat())).expect("usable").vertical_unit;
        assert_eq!(unit(&[]), None);
        assert_eq!(unit(&[[4096, 5703], [4099, 9001]]), Some(METRE));
        assert_eq!(unit(&[[4096, 6360]]), Unit::of_code(9003));
        assert_eq!(unit(&[[4099, 9002]]), Unit::of_code(9002));
        refused(&tags(1, &[[3072, 32_632], [4096, 6360], [4099, 9001]]), &["contradicts itself", "EPSG:6360", "US survey foot", "metre"]);
        for depth in [5715, 5861, 5866, 5831, 6359, 8051, 8053, 5614, 9287, 10_650] {
            refused(&tags(1, &[[3072, 32_632], [4096, depth]]), &["depths", &format!("EPSG:{depth}")]);
        }
        for (system, of) in [(8050, 9002), (8052, 9003), (6130, 9002), (6131, 9002), (6132, 9002), (10_919, 9003), (5754, 9095)] {
            assert!(unit(&[[4096, system]]).is_some_and(|unit| Some(unit) == Unit::of_code(of)), "{system}");
        }
        let unknown =
            |keys: &[[u64; 2]]| read(&tags(1, &[&[[3072, 32_632]][..], keys].concat())).expect("usable").vertical_system_without_unit;
        assert_eq!((unknown(&[[4096, 5103]]), unknown(&[[4096, 32_767]])), (Some(5103), Some(32_767)));
        for known in [&[[4096, 5103], [4099, 9001]][..], &[[4096, 5703]], &[[4096, 6360]], &[]] {
            assert_eq!(unknown(known), None, "{known:?}");
        }
        refused(&tags(1, &[[3072, 32_632], [4099, 9102]]), &["EPSG code 9102"]);
    }

    #[test]
    fn damaged_directories_of_keys_are_refused() {
        let with = |keys: Vec<u64>| Tags { keys: Some(keys), ..tags(1, &[]) };
        refused(&with(vec![1, 1]), &["no header"]);
        refused(&with(vec![2, 1, 0, 0]), &["version 2"]);
        refused(&with(vec![1, 1, 0, 2, 1024, 0, 1, 1]), &["states 2 keys, but holds 1"]);
        refused(&with(vec![1, 1, 0, 2, 1024, 0, 1, 1, 1024, 0, 1, 2]), &["contradicts itself", "1024 is there twice"]);
        refused(&with(vec![1, 1, 0, 1, 3077, 34_736, 1, 5]), &["3077 names a number that is not"]);
    }
}
