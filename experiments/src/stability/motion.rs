//! Measures flips, clumping and low frequencies of noise while a camera moves over a plane. At each pixel, the noise chooses among four texels of
//! equal weight.
//!
//! The statistics are those of METHODOLOGY (Flips, Clumping and spectrum), as for sequences of the renderer. Only the geometry is simpler: rays are
//! intersected with a plane, derivatives are computed on this plane, and points are followed by reprojection.

use std::fmt;

use glam::{DVec3, dvec3};
use kernels::metrics::{BLOCK, SeedSums, reference};
use kernels::motion::NO_LINK;
use kernels::shared::motion::{Past, reproject};
use kernels::shared::noise::{HashedPoint, NoiseKind};
use kernels::shared::{derivatives, select, signal};
use kernels::view::camera::{Pose, View};
use rayon::prelude::*;

use super::Row;
use super::noise::{Ask, Noise, ORIGINS, SECTOR_M, of_kind};
use crate::judge::spectrum::radial_power;
use crate::metrics;

/// Size of the picture, pixels.
pub const SIZE: [u32; 2] = [384, 216];
/// Number of frames of a sequence.
pub const FRAMES: u32 = 8;
/// Side of the square from which the spectrum is computed, pixels. The square lies at the middle of the lower edge of the picture.
const SIDE: u32 = 128;
/// Number of bands of the spectrum. The bands together extend to half a cycle per pixel.
const BANDS: usize = 8;
/// Index of the band that is measured: 0.0625 to 0.125 cycles per pixel.
const BAND: usize = 1;
/// Vertical field of view.
const FOV_DEG: f64 = 55.0;
/// Angle of the view direction above the horizontal plane; negative = downwards. With this angle, the horizon of level ground is in the upper half of
/// the picture.
const PITCH_DEG: f64 = -15.0;
/// Compass bearing of the direction in which walls rise, and of the view direction in the first frame. It is not parallel to the axes of the noise's
/// cells.
const YAW_DEG: f64 = 30.0;
/// Height of the eye above level ground, or above the foot of a wall, metres.
const EYE_M: f64 = 2.0;
/// Horizontal distance from the eye to the foot of a wall, metres. The camera must not reach the wall, so this is larger than the distance that it
/// moves forwards in a sequence.
const FOOT_M: f64 = 3.0;
/// Elevation of the level ground, metres.
const GROUND_M: f64 = 1234.5;
/// Limit of the distance along the view direction up to which ground is visible, metres.
const FAR_M: f64 = 4096.0;
/// The accepted range of a recorded value extends by this share of the value to either side. Results are deterministic, but they can differ slightly
/// between machines, because the last digit of a sine can differ.
const SLACK: f64 = 0.1;
const SEED: u32 = 8;
const SALT: u32 = 3;

/// The ground that the camera looks at: level ground, or a wall that rises in the view direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ground {
    /// Name in tables.
    pub name: &'static str,
    /// Slope, degrees.
    pub slope_deg: f64,
}

/// The kinds of ground for which results are recorded.
pub const GROUNDS: [Ground; 3] =
    [Ground { name: "flat", slope_deg: 0.0 }, Ground { name: "30 deg", slope_deg: 30.0 }, Ground { name: "60 deg", slope_deg: 60.0 }];

/// The motion of the camera from frame to frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Motion {
    /// The camera does not move.
    Rest,
    /// The camera moves 3 cm to the right.
    Sideways,
    /// The camera moves 10 cm forwards.
    Forwards,
    /// The camera turns 0.3 degrees to the right.
    Turning,
    /// The field of view shrinks, so that the picture is magnified by 1 %.
    Zoom,
}

impl Motion {
    /// All motions.
    pub const ALL: [Motion; 5] = [Motion::Rest, Motion::Sideways, Motion::Forwards, Motion::Turning, Motion::Zoom];

    /// Name in tables.
    pub const fn name(self) -> &'static str {
        match self {
            Motion::Rest => "at rest",
            Motion::Sideways => "sideways",
            Motion::Forwards => "forwards",
            Motion::Turning => "turning",
            Motion::Zoom => "zoom",
        }
    }

    fn view(self, frame: u32, sector: i32) -> View {
        let step = |motion: Motion, a_frame: f64| if self == motion { f64::from(frame) * a_frame } else { 0.0 };
        let (sin, cos) = YAW_DEG.to_radians().sin_cos();
        let (right, ahead) = (dvec3(cos, -sin, 0.0), dvec3(sin, cos, 0.0));
        let corner = f64::from(sector) * SECTOR_M;
        let start = dvec3(20.3 + corner, 20.7 - corner, GROUND_M + EYE_M);
        let pose = Pose {
            position: start + right * step(Motion::Sideways, 0.03) + ahead * step(Motion::Forwards, 0.1),
            yaw: (YAW_DEG + step(Motion::Turning, 0.3)).to_radians(),
            pitch: PITCH_DEG.to_radians(),
            fov: 2.0 * ((FOV_DEG / 2.0).to_radians().tan() * 1.01_f64.powf(-step(Motion::Zoom, 1.0))).atan(),
        };
        // The world has an extent of 0, so its corner lies at the origin.
        View::new(pose, SIZE, [0.0; 2], SECTOR_M, 0.0)
    }
}

impl fmt::Display for Motion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

/// What the pixels of a frame show, row by row.
struct Seen {
    /// For each pixel, the input of the noise at the visible point; `None` = the pixel shows no ground.
    asks: Vec<Option<Ask>>,
    /// For each pixel, the index of the pixel that showed the same point in the previous frame, or `NO_LINK`.
    links: Vec<u32>,
}

fn see(ground: Ground, now: &View, past: &View, frame: u32, foot: DVec3) -> Seen {
    let (sin, cos) = ground.slope_deg.to_radians().sin_cos();
    let (east, north) = YAW_DEG.to_radians().sin_cos();
    let normal = dvec3(-sin * east, -sin * north, cos);
    let height = |view: &View| normal.dot(foot - view.pose.position);
    let hit = |view: &View, ray: DVec3| {
        let t = height(view) / normal.dot(ray);
        (t > 0.0 && t < FAR_M).then_some(t)
    };
    let between = Past::between(now, past);
    let at = |i: u32| {
        let [x, y] = [i % SIZE[0], i / SIZE[0]];
        let ray = now.ray(f64::from(x), f64::from(y));
        let Some(t) = hit(now, ray) else { return (None, NO_LINK) };
        let step = |to: DVec3| derivatives::on_plane(ray.to_array(), to.to_array(), t, normal.to_array());
        let point = HashedPoint {
            sector: now.sector.to_array(),
            position: (now.camera + ray * t).to_array(),
            sector_m: SECTOR_M,
            ddx: step(now.ray_dx),
            ddy: step(now.ray_dy),
            hash_scale: 1.0,
        };
        let [px, py, _] = reproject((ray * t).to_array(), &between).map(f64::round);
        let inside = |p: f64, n: u32| (0.0..f64::from(n)).contains(&p);
        let seen = inside(px, SIZE[0]) && inside(py, SIZE[1]) && hit(past, past.ray(px, py)).is_some();
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "inside the picture")]
        let link = if seen { py as u32 * SIZE[0] + px as u32 } else { NO_LINK };
        (Some(Ask { point, pixel: [x, y], frame, seed: SEED, salt: SALT }), link)
    };
    let (asks, links) = (0..SIZE[0] * SIZE[1]).map(at).unzip();
    Seen { asks, links }
}

/// Returns a picture of random choices. At each pixel, the first threshold chooses among four texels of equal weight, whose values are 0, 1/3, 2/3
/// and 1.
fn picture(seen: &Seen, noise: Noise<'_>) -> Vec<[u32; 2]> {
    let pixel = |ask: &Option<Ask>| {
        ask.as_ref().map_or([0, 0], |ask| {
            let chosen = u8::try_from(select::of_4([0.25; 4], noise(ask)[0])).unwrap_or(u8::MAX);
            signal::pack([f32::from(chosen) / 3.0; 3], 1, u32::from(chosen) + 1)
        })
    };
    seen.asks.iter().map(pixel).collect()
}

/// The measured properties of a sequence.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Measured {
    /// Share of the points visible in two successive frames whose choices in these frames differ.
    pub flip_rate: f64,
    /// Clumping of the error, measured in blocks of 5 x 5 pixels. White noise has a clumping of 1.
    pub clumping: f64,
    /// Power of the error between 0.0625 and 0.125 cycles per pixel, averaged over frames. White noise has a power of 1.
    pub power: f64,
}

impl Measured {
    /// Returns the names and values of the statistics.
    pub fn statistics(&self) -> [(&'static str, f64); 3] {
        [(metrics::FLIP_RATE, self.flip_rate), (metrics::CLUMPING, self.clumping), ("power 0.0625-0.125 cycles/px", self.power)]
    }
}

/// Measures a sequence of [`FRAMES`] frames with each of `noises`. The camera starts in sector (`sector`, -`sector`).
pub fn measure(ground: Ground, motion: Motion, sector: i32, noises: &[Noise<'_>]) -> Vec<Measured> {
    let (east, north) = YAW_DEG.to_radians().sin_cos();
    let foot = motion.view(0, sector).pose.position + dvec3(FOOT_M * east, FOOT_M * north, -EYE_M);
    let area = (SIZE[0] * SIZE[1]) as usize;
    let exact = vec![signal::pack([0.5; 3], 1, 0); area];
    let mut pasts: Vec<Option<Vec<[u32; 2]>>> = vec![None; noises.len()];
    let mut sums = vec![([0_u64; 2], [0.0; 2], 0.0); noises.len()];
    for frame in 0..FRAMES {
        let [now, past] = [frame, frame.saturating_sub(1)].map(|frame| motion.view(frame, sector));
        let seen = see(ground, &now, &past, frame, foot);
        noises.par_iter().zip(&mut pasts).zip(&mut sums).for_each(|((noise, past), (flips, blocks, power))| {
            let picture = picture(&seen, *noise);
            if let Some(past) = past {
                let lag = reference::measure(
                    SIZE,
                    &picture,
                    None,
                    &[reference::Earlier { picture: past, reference: None, links: &seen.links }],
                    frame % 4,
                )
                .lags[0];
                *flips = [flips[0] + lag.flipped, flips[1] + lag.chosen];
            }
            let found = reference::seed(SIZE, BLOCK, &picture, &exact);
            *blocks = [blocks[0] + found.block_squares, blocks[1] + found.pixel_squares];
            *power += low_power(&picture);
            *past = Some(picture);
        });
    }
    let mean = |([flipped, chosen], [block_squares, pixel_squares], power): ([u64; 2], [f64; 2], f64)| Measured {
        flip_rate: flipped as f64 / chosen.max(1) as f64,
        clumping: SeedSums { block_squares, pixel_squares, ..Default::default() }.clumping().unwrap_or(0.0),
        power: power / f64::from(FRAMES),
    };
    sums.into_iter().map(mean).collect()
}

/// Returns the power of the error in the band [`BAND`], computed from the square at the middle of the lower edge of the picture.
fn low_power(picture: &[[u32; 2]]) -> f64 {
    let (left, top) = ((SIZE[0] - SIDE) / 2, SIZE[1] - SIDE);
    #[allow(clippy::cast_possible_truncation, reason = "the transform is in f32")]
    let error = |i: u32| signal::luminance(signal::colour(picture[((top + i / SIDE) * SIZE[0] + left + i % SIDE) as usize])) as f32 - 0.5;
    let field: Vec<f32> = (0..SIDE * SIDE).map(error).collect();
    radial_power(&field, [SIDE; 2], BANDS).expect("a square of finite numbers, with 16 pixels per band along each side")[BAND].power
}

/// Returns the accepted range of a statistic whose recorded value is `value`: 10 % to either side. White noise of the screen is an exception, because
/// theory gives two of its statistics. Its flip rate is near 3/4, because each frame draws a new choice among four texels. Its clumping is near 1,
/// because pixels are independent.
pub fn budget(kind: NoiseKind, statistic: &str, value: f64) -> [f64; 2] {
    match (kind, statistic) {
        (NoiseKind::WhiteScreen, metrics::FLIP_RATE) => [0.747, 0.753],
        (NoiseKind::WhiteScreen, metrics::CLUMPING) => [0.97, 1.03],
        _ => [value * (1.0 - SLACK), value * (1.0 + SLACK)],
    }
}

/// The recorded values for the grounds and motions, with their accepted ranges.
const RECORDED: &str = include_str!("../../../notebooks-data/stability/noise.csv");

/// Sets the accepted ranges of measured rows to the recorded ranges. If a row has no recorded counterpart, it keeps the range that was computed from
/// its own value.
fn hold_to_recorded(rows: &mut [Row]) {
    let budgets: Result<Vec<Row>, csv::Error> = csv::Reader::from_reader(RECORDED.as_bytes()).deserialize().collect();
    let budgets = budgets.expect("the recorded table's columns are a row's fields");
    for row in rows {
        let same = |of: &&Row| [&of.kind, &of.view, &of.motion, &of.statistic] == [&row.kind, &row.view, &row.motion, &row.statistic];
        if let Some(budget) = budgets.iter().find(same) {
            (row.low, row.high) = (budget.low, budget.high);
        }
    }
}

/// Measures every kind of noise for every combination of ground and motion, 10 km from the origin along each axis. The accepted ranges are the
/// recorded ones.
pub fn rows() -> Vec<Row> {
    let noises = NoiseKind::ALL.map(of_kind);
    let stages: Vec<(Ground, Motion)> = GROUNDS.into_iter().flat_map(|ground| Motion::ALL.map(|motion| (ground, motion))).collect();
    let of_stage = |(ground, motion): (Ground, Motion)| {
        let measured = measure(ground, motion, ORIGINS[1].1, &noises.each_ref().map(|noise| noise as Noise<'_>));
        let of_kind = |(kind, measured): (NoiseKind, Measured)| {
            measured.statistics().map(|(statistic, value)| {
                let [low, high] = budget(kind, statistic, value);
                let [kind, view, motion, statistic] = [kind.name(), ground.name, motion.name(), statistic].map(str::to_owned);
                Row { kind, view, motion, statistic, value, low, high }
            })
        };
        NoiseKind::ALL.into_iter().zip(measured).flat_map(of_kind).collect::<Vec<Row>>()
    };
    let mut rows: Vec<Row> = stages.into_par_iter().flat_map_iter(of_stage).collect();
    hold_to_recorded(&mut rows);
    rows
}

/// Returns a row in the form in which it is recorded: the value is rounded, and the accepted range is that of the rounded value.
pub fn recorded(row: &Row) -> Row {
    let value = row.shortened().value;
    let kind = row.kind.parse().unwrap_or(NoiseKind::HashedIsotropic);
    let [low, high] = budget(kind, &row.statistic, value);
    Row { value, low, high, ..row.clone() }.shortened()
}
