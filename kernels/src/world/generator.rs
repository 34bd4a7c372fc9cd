//! A procedural alpine world: elevation as a function of position and seed only.
//!
//! The elevation is built from these layers:
//!
//! 1. Domain warp.
//! 2. A network of broad valleys along the zero lines of noise, on an uplift that varies over about 9 km.
//! 3. Massifs: ridged multifractal noise (Musgrave 1994). Its octaves are weaker where the ground is already steep, as in Quilez's "derivative" fBm.
//!    Then summits are raised.
//! 4. Gullies that run down the local slope.
//! 5. Buttresses.
//! 6. Strata of three thicknesses. Their hard beds form rock faces, from a few metres to more than 100 m tall; their soft beds form ledges.
//! 7. Fine relief, down to a wavelength of about a metre.
//!
//! Apart from integer hashes, the computations are sums, products, quotients, square roots, floors, comparisons and conversions. IEEE 754 defines
//! their results exactly, so machines that follow it agree on every bit.

use crate::shared::hash::pcg;

/// Edge of the world, metres.
pub const EXTENT_M: f64 = 10_240.0;

/// The lowest and the highest possible elevation, metres.
pub const HEIGHT_RANGE_M: (f64, f64) = (150.0, 2550.0);

/// A value and its derivatives along x and y.
#[derive(Clone, Copy, Debug)]
struct Dual {
    v: f64,
    x: f64,
    y: f64,
}

impl Dual {
    const fn constant(v: f64) -> Dual {
        Dual { v, x: 0.0, y: 0.0 }
    }

    fn scale(self, s: f64) -> Dual {
        Dual { v: self.v * s, x: self.x * s, y: self.y * s }
    }

    fn plus(self, o: Dual) -> Dual {
        Dual { v: self.v + o.v, x: self.x + o.x, y: self.y + o.y }
    }

    fn times(self, o: Dual) -> Dual {
        Dual { v: self.v * o.v, x: self.x * o.v + self.v * o.x, y: self.y * o.v + self.v * o.y }
    }

    /// Applies a function to `self`. `v` and `derivative` are the value and the derivative of the function at `self.v`.
    fn map(self, v: f64, derivative: f64) -> Dual {
        Dual { v, x: self.x * derivative, y: self.y * derivative }
    }

    fn slope_squared(self) -> f64 {
        self.x * self.x + self.y * self.y
    }
}

/// Rotations whose cosine and sine are rational numbers, from Pythagorean triples. Octaves with consecutive indices are rotated differently, so
/// that their lattices do not line up.
const TURNS: [[f64; 2]; 8] = [
    [0.8, 0.6],
    [5.0 / 13.0, -12.0 / 13.0],
    [15.0 / 17.0, 8.0 / 17.0],
    [20.0 / 29.0, -21.0 / 29.0],
    [12.0 / 37.0, 35.0 / 37.0],
    [40.0 / 41.0, -9.0 / 41.0],
    [28.0 / 53.0, 45.0 / 53.0],
    [60.0 / 61.0, 11.0 / 61.0],
];

/// 1.5 * 2^52. Adding it to a number rounds the number to an integer; the low mantissa bits of the sum are the integer in two's complement.
const ROUNDER: f64 = 6_755_399_441_055_744.0;

/// Returns the floor of v, wrapped to 32 bits, and the fraction v - floor(v), for |v| < 2^51. `f64::floor` is not used, because it is a slower
/// library call on plain x86-64.
fn split(v: f64) -> (u32, f64) {
    let shifted = v + ROUNDER;
    let fraction = v - (shifted - ROUNDER);
    let nearest = shifted.to_bits() as u32;
    if fraction < 0.0 { (nearest.wrapping_sub(1), fraction + 1.0) } else { (nearest, fraction) }
}

/// One octave of gradient noise: a rotated, shifted lattice with its own wavelength.
#[derive(Clone, Copy, Debug)]
struct Octave {
    /// The matrix from world to lattice has the rows (c, s) and (-s, c). `c` and `s` include the division by the wavelength.
    c: f64,
    s: f64,
    shift: [f64; 2],
    seed: u32,
}

impl Octave {
    fn new(seed: u32, index: u32, wavelength_m: f64) -> Octave {
        let seed = pcg(seed ^ pcg(index.wrapping_mul(0x9e37_79b9)));
        let [cosine, sine] = TURNS[(index % 8) as usize];
        let shift = [seed & 0xffff, seed >> 16].map(|bits| f64::from(bits) / 64.0);
        Octave { c: cosine / wavelength_m, s: sine / wavelength_m, shift, seed }
    }

    /// Square of the number of lattice points per metre.
    fn frequency_squared(&self) -> f64 {
        self.c * self.c + self.s * self.s
    }

    fn lattice(&self, x: f64, y: f64) -> (u32, u32, f64, f64) {
        let (iu, fu) = split(self.c * x + self.s * y + self.shift[0]);
        let (iv, fv) = split(self.c * y - self.s * x + self.shift[1]);
        (iu, iv, fu, fv)
    }

    /// The value of [`Octave::noise`], without the derivatives.
    fn value(&self, x: f64, y: f64) -> f64 {
        let (iu, iv, fu, fv) = self.lattice(x, y);
        let rows = [pcg(iv.wrapping_add(self.seed)), pcg(iv.wrapping_add(1).wrapping_add(self.seed))];
        let corner = |j: usize, i: u32, u: f64, v: f64| {
            let h = pcg(rows[j].wrapping_add(iu).wrapping_add(i));
            // The two 16-bit halves of the hash are the components of a gradient. They are not scaled here: the last line of the function scales the
            // result to about -1..=1.
            (f64::from(h & 0xffff) - 32767.5) * u + (f64::from(h >> 16) - 32767.5) * v
        };
        let fade = |t: f64| t * t * t * (t * (t * 6.0 - 15.0) + 10.0);
        let (a, b) = (fade(fu), fade(fv));
        let (d00, d10) = (corner(0, 0, fu, fv), corner(0, 1, fu - 1.0, fv));
        let (d01, d11) = (corner(1, 0, fu, fv - 1.0), corner(1, 1, fu - 1.0, fv - 1.0));
        let (south, north) = (d00 + a * (d10 - d00), d01 + a * (d11 - d01));
        (south + b * (north - south)) * (1.5 / 32767.5)
    }

    /// Gradient noise (Perlin 2002: quintic fade), roughly -1..=1, with its derivatives per metre.
    fn noise(&self, x: f64, y: f64) -> Dual {
        let (iu, iv, fu, fv) = self.lattice(x, y);
        let rows = [pcg(iv.wrapping_add(self.seed)), pcg(iv.wrapping_add(1).wrapping_add(self.seed))];
        let gradient = |row: u32, i: u32| {
            let h = pcg(row.wrapping_add(iu).wrapping_add(i));
            let part = |bits: u32| f64::from(bits) * (2.0 / 65535.0) - 1.0;
            (part(h & 0xffff), part(h >> 16))
        };
        let (g00, g10) = (gradient(rows[0], 0), gradient(rows[0], 1));
        let (g01, g11) = (gradient(rows[1], 0), gradient(rows[1], 1));
        let d00 = g00.0 * fu + g00.1 * fv;
        let d10 = g10.0 * (fu - 1.0) + g10.1 * fv;
        let d01 = g01.0 * fu + g01.1 * (fv - 1.0);
        let d11 = g11.0 * (fu - 1.0) + g11.1 * (fv - 1.0);
        let fade = |t: f64| (t * t * t * (t * (t * 6.0 - 15.0) + 10.0), 30.0 * t * t * (t - 1.0) * (t - 1.0));
        let ((a, da), (b, db)) = (fade(fu), fade(fv));
        let k = d00 - d10 - d01 + d11;
        let value = d00 + a * (d10 - d00) + b * (d01 - d00) + a * b * k;
        let mix = |g00: f64, g10: f64, g01: f64, g11: f64| g00 + a * (g10 - g00) + b * (g01 - g00) + a * b * (g00 - g10 - g01 + g11);
        let du = mix(g00.0, g10.0, g01.0, g11.0) + da * (d10 - d00 + b * k);
        let dv = mix(g00.1, g10.1, g01.1, g11.1) + db * (d01 - d00 + a * k);
        // The gradients are distributed uniformly over the square -1..=1 x -1..=1, so on average they are shorter than unit vectors. The factor 1.5
        // compensates for this, so that the noise is about -1..=1.
        Dual { v: value * 1.5, x: (du * self.c - dv * self.s) * 1.5, y: (du * self.s + dv * self.c) * 1.5 }
    }
}

/// Returns cos and sin of 2 pi t, with an error of about 1e-3. They are computed by polynomials, so that machines agree on every bit.
fn wave(t: f64) -> (f64, f64) {
    let sine = |t: f64| {
        let t = t - ((t + ROUNDER) - ROUNDER);
        // A parabola through the zeros and peaks of the sine, then one step of refinement.
        let p = 8.0 * t - 16.0 * t * t.abs();
        p * (0.775 + 0.225 * p.abs())
    };
    (sine(t + 0.25), sine(t))
}

/// Gullies: parallel grooves that run down a given slope and branch where the direction of the slope changes. Each jittered cell has a wave whose
/// crests run down the slope, and the waves of neighbouring cells are blended. The method follows the "phacelle" noise of Johansen's eroded terrain
/// (2023) and an earlier noise by Clay John.
#[derive(Clone, Copy, Debug)]
struct Gullies {
    octave: Octave,
    wavelength_m: f64,
}

impl Gullies {
    fn new(seed: u32, index: u32, wavelength_m: f64) -> Gullies {
        Gullies { octave: Octave::new(seed, index, wavelength_m), wavelength_m }
    }

    /// Returns the value, in -1..=1, and its approximate derivatives per metre. The derivatives are computed as if the weights of the cells and
    /// `down` did not depend on the position. `down` is the unit vector down the slope.
    fn at(&self, x: f64, y: f64, down: [f64; 2]) -> Dual {
        let o = &self.octave;
        let (iu, iv, fu, fv) = o.lattice(x, y);
        // The direction across the slope, in lattice coordinates.
        let (cosine, sine) = (o.c * self.wavelength_m, o.s * self.wavelength_m);
        let across = [-down[1], down[0]];
        let (au, av) = (cosine * across[0] + sine * across[1], cosine * across[1] - sine * across[0]);
        let (mut cos_sum, mut sin_sum, mut weights) = (0.0, 0.0, 0.0);
        for j in 0..3u32 {
            let row = pcg(iv.wrapping_add(j).wrapping_sub(1).wrapping_add(o.seed));
            for i in 0..3u32 {
                let h = pcg(row.wrapping_add(iu).wrapping_add(i).wrapping_sub(1));
                let jitter = |bits: u32| f64::from(bits) * (0.5 / 65535.0) - 0.25;
                let u = fu - (f64::from(i) - 0.5 + jitter(h & 0xffff));
                let v = fv - (f64::from(j) - 0.5 + jitter(h >> 16));
                let near = (1.0 - (u * u + v * v) * (1.0 / 1.5625)).max(0.0);
                let weight = near * near * near;
                let (cosine, sine) = wave(au * u + av * v);
                cos_sum += weight * cosine;
                sin_sum += weight * sine;
                weights += weight;
            }
        }
        let (cosine, sine) = (cos_sum / weights, sin_sum / weights);
        let rate = -sine * std::f64::consts::TAU / self.wavelength_m;
        Dual { v: cosine, x: across[0] * rate, y: across[1] * rate }
    }
}

/// Rises from 0 at `from` to 1 at `to`, smoothly.
fn smoothstep(from: f64, to: f64, v: f64) -> f64 {
    let t = ((v - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// A staircase of period 1 and mean slope 1. Its treads have the slope `tread`. In the middle of each period, there is a riser, whose width is the
/// share `riser` of the period. Returns the difference between the staircase and a plain ramp, staircase(t) - t.
fn stairs(t: f64, riser: f64, tread: f64) -> f64 {
    let s = t - t.floor();
    let edge = 0.5 * (1.0 - riser);
    let rise = 1.0 - tread;
    let step = ((s - edge) / riser).clamp(0.0, 1.0);
    // The riser is less steep at its foot than at its upper edge, where it ends abruptly.
    tread * s + rise * (step * (0.55 + step * (0.9 - 0.45 * step))) - s
}

/// A sequence of hard and soft beds. The height of the ground is remapped so that hard beds become walls and soft beds become ledges.
///
/// On ground of constant slope, the remapping is monotonic. So ridges stay ridges, and a wall roughly follows a contour line of the ground before the
/// remapping. Crests should not become thinner, because a coarse grid of vertices would draw a thin crest as a row of needles.
#[derive(Clone, Copy, Debug)]
struct Strata {
    seed: u32,
    /// Height from one hard bed to the next, metres.
    period_m: f64,
    /// Slope (tangent) that a wall has on average, if the ground is steep enough for walls. Ground that is already this steep stays as it is.
    wall: f64,
    /// Share of a period's height that its wall takes: first for the softest bed, then for the hardest bed.
    rise: [f64; 2],
}

impl Strata {
    /// Returns the ground after erosion has exposed its beds. `bend`: distance of the beds below their usual level at this point, metres. `strength`:
    /// degree to which erosion has exposed the beds, 0..=1.
    fn on(&self, ground: Dual, bend: f64, strength: f64) -> Dual {
        let t = (ground.v + bend) / self.period_m;
        let bed = t.floor();
        let s = t - bed;
        let h = pcg((bed as i32 as u32) ^ self.seed);
        let part = |bits: u32| f64::from(bits & 0xffff) * (1.0 / 65535.0);
        let rise = self.rise[0] + (self.rise[1] - self.rise[0]) * part(h);
        // `rise` and `width` are the shares of the period's height that the wall takes: `rise` after the remapping, `width` before it. The smaller
        // `width` is, the steeper the wall becomes. It is as small as the slope of the wall requires, but at least 0.3 of `rise`, so that gentle
        // ground has steps instead of walls.
        let slope = ground.slope_squared().sqrt();
        let width = rise * (slope / self.wall).clamp(0.3, 1.0);
        let start = 0.5 + 0.2 * (part(h >> 16) - 0.5) - 0.5 * width;
        let q = ((s - start) / width).clamp(0.0, 1.0);
        let tread = (1.0 - rise) / (1.0 - width);
        // The wall has a long foot and a short rounded top. Where the wall meets a ledge, both have the same slope, because a sharp edge would
        // look jagged on a grid of vertices.
        let extra = rise - tread * width;
        let stepped = tread * s + extra * (q * q * (2.0 - q * q));
        let rate = tread + extra / width * (4.0 * q * (1.0 - q * q));
        let rate = 1.0 + strength * (rate - 1.0);
        Dual { v: ground.v + strength * self.period_m * (stepped - s), x: ground.x * rate, y: ground.y * rate }
    }
}

/// Number of octaves of fine relief in the elevation from which slope and curvature are measured.
const BROAD_OCTAVES: usize = 1;

/// The generator of the procedural world.
#[derive(Clone, Debug)]
pub struct Generator {
    warp: [Octave; 2],
    uplift: Octave,
    valleys: [Octave; 2],
    massifs: [Octave; 4],
    gullies: [Gullies; 3],
    buttresses: [Octave; 3],
    bend: Octave,
    hardness: [Octave; 2],
    strata: [Strata; 3],
    fine: [Octave; 5],
}

impl Generator {
    /// Makes the generator for a seed.
    pub fn new(seed: u32) -> Generator {
        let octave = |index: u32, wavelength_m: f64| Octave::new(seed, index, wavelength_m);
        let gullies = |index: u32, wavelength_m: f64| Gullies::new(seed, index, wavelength_m);
        let strata = |index: u32, period_m: f64, wall: f64, rise: [f64; 2]| Strata { seed: pcg(seed ^ pcg(index)), period_m, wall, rise };
        Generator {
            warp: [octave(0, 2300.0), octave(1, 2300.0)],
            uplift: octave(3, 9100.0),
            valleys: [octave(4, 6100.0), octave(5, 2700.0)],
            massifs: [octave(6, 2900.0), octave(7, 1350.0), octave(8, 620.0), octave(9, 290.0)],
            gullies: [gullies(11, 430.0), gullies(12, 150.0), gullies(13, 62.0)],
            buttresses: [octave(14, 210.0), octave(17, 97.0), octave(18, 43.0)],
            bend: octave(25, 1300.0),
            hardness: [octave(15, 1500.0), octave(16, 420.0)],
            strata: [strata(26, 290.0, 2.1, [0.15, 0.6]), strata(27, 66.0, 2.5, [0.1, 0.65]), strata(28, 15.0, 2.8, [0.3, 0.6])],
            fine: [octave(19, 31.0), octave(20, 14.0), octave(21, 6.3), octave(22, 2.9), octave(23, 1.3)],
        }
    }

    /// Elevation at a position, metres, within [`HEIGHT_RANGE_M`].
    pub fn height_m(&self, x: f64, y: f64) -> f64 {
        self.heights_m(x, y)[0]
    }

    /// Elevation without thin beds, and without fine relief of wavelengths of 14 m or less. Slope and curvature are measured from this elevation,
    /// because differences over a few metres would treat boulders as cliffs.
    pub fn broad_height_m(&self, x: f64, y: f64) -> f64 {
        saturate(self.broad(x, y).height)
    }

    /// Returns [`Generator::height_m`] and [`Generator::broad_height_m`]. This takes no longer than a call of [`Generator::height_m`] alone.
    pub fn heights_m(&self, x: f64, y: f64) -> [f64; 2] {
        let broad = self.broad(x, y);
        let mut height = broad.height;
        // Thin beds exist on rock only. They are weaker on steep ground, where a bed would be less than a few vertices wide.
        if broad.rock > 0.0 {
            let squeezed = smoothstep(1.1, 2.3, broad.beds.slope_squared().sqrt());
            let strength = broad.rock * (0.55 - 0.4 * squeezed);
            height += self.strata[2].on(broad.beds, broad.bend + 0.6 * (height - broad.beds.v), strength).v - broad.beds.v;
        }
        let (height, _) = relieved(&self.fine[BROAD_OCTAVES..], x, y, broad.rock, (height, broad.amplitude));
        [saturate(height), saturate(broad.height)]
    }

    fn broad(&self, x: f64, y: f64) -> Broad {
        // Domain warp. Its Jacobian is needed for the derivatives of the layers that follow.
        let (wx, wy) = (self.warp[0].noise(x, y).scale(330.0), self.warp[1].noise(x, y).scale(330.0));
        let (px, py) = (x + wx.v, y + wy.v);
        let warped = |n: Dual| Dual { v: n.v, x: n.x * (1.0 + wx.x) + n.y * wy.x, y: n.x * wx.y + n.y * (1.0 + wy.y) };

        // Valleys follow the zero lines of a broad noise. They have flat floors, and walls that become steeper upwards until the slope is constant.
        let region = warped(self.valleys[1].noise(px, py));
        let n = warped(self.valleys[0].noise(px, py)).plus(region.scale(0.55));
        let distance = (n.v * n.v + 0.001).sqrt();
        let distance = n.map(distance, n.v / distance);
        // The floor's width varies along the valley.
        let distance = distance.plus(region.scale(0.05));
        let above = (distance.v - 0.05).max(0.0);
        let denominator = 1.0 / (above + 0.30);
        let lift = distance.map(above * above * denominator, above * (above + 0.60) * denominator * denominator);

        // Massifs are ridged octaves between the valleys. Each octave is weaker where the sum of the previous layers is steep.
        let mut height = lift.scale(760.0).plus(region.scale(30.0)).plus(self.uplift.noise(x, y).scale(430.0));
        height.v += 470.0;
        let room = lift.v / (lift.v + 0.12);
        let mut weight = lift.map(room, 0.12 / ((lift.v + 0.12) * (lift.v + 0.12)));
        let mut amplitude = 860.0;
        // Gullies run down both sides of a crest. They are less deep near the crest, so that they do not cut deep notches into it.
        let mut below_crest = 1.0;
        for (octave, k) in self.massifs.iter().zip(0..) {
            let n = warped(octave.noise(px, py));
            // A crest is rounded over about 30 m on either side, in every octave.
            let fold = (n.v * n.v + 1100.0 * octave.frequency_squared()).sqrt();
            let ridge = 1.0 - fold;
            let ridge = n.map(ridge * ridge, -2.0 * ridge * n.v / fold);
            let damping = 1.0 / (1.0 + 0.7 * height.slope_squared());
            height = height.plus(ridge.times(weight).scale(amplitude * damping));
            weight = weight.times(Dual { v: 0.3 + 0.9 * ridge.v, x: 0.9 * ridge.x, y: 0.9 * ridge.y });
            amplitude *= 0.5;
            if k < 2 {
                below_crest *= smoothstep(0.0, 40.0 * 40.0 * 4.0, n.v * n.v / octave.frequency_squared());
            }
        }

        // Raises summits: the part of the height above 850 m is increased by up to a third.
        let above = (height.v - 850.0).max(0.0);
        let denominator = 1.0 / (above + 350.0);
        let stretch = height.map(0.33 * above * above * denominator, 0.33 * above * (above + 700.0) * denominator * denominator);
        height = height.plus(stretch);

        // Gullies down the slope: deeper on steeper ground, none on valley floors.
        for (gully, depth) in self.gullies.iter().zip([48.0, 16.0, 3.5]) {
            height = height.plus(cut(gully, x, y, height, depth * (0.3 + 0.7 * below_crest)));
        }

        // Buttresses, and the bays between them. They are added before the strata, so that the walls of the strata follow them.
        let slope = height.slope_squared().sqrt();
        let steep = smoothstep(0.35, 0.75, slope + 0.15 * region.v);
        let mut bend = 0.0;
        if steep > 0.0 {
            for (octave, depth) in self.buttresses.iter().zip([22.0, 11.0, 4.5]) {
                // Spurs are sharper than the bays between them, but not as sharp as a crease.
                let n = octave.noise(x, y);
                let fold = (n.v * n.v + 0.012).sqrt();
                height = height.plus(n.map(0.35 - fold, -n.v / fold).scale(depth * steep));
            }
            let [walls, benches] = [0, 1].map(|k| self.hardness[k].value(x, y));
            bend = 18.0 * self.bend.value(x, y);
            height = self.strata[0].on(height, bend, steep * (0.2 + 0.8 * below_crest) * smoothstep(-0.3, 0.25, walls));
            height = self.strata[1].on(height, bend, 0.75 * steep * smoothstep(-0.25, 0.3, benches + 0.3 * walls));
        }

        let slope = height.slope_squared().sqrt();
        let (rock, face) = (smoothstep(0.6, 1.1, slope), smoothstep(1.0, 2.0, slope));
        let (h, amplitude) = relieved(&self.fine[..BROAD_OCTAVES], x, y, rock, (height.v, 0.3 + 1.7 * rock + 1.6 * face));
        Broad { height: h, beds: height, bend, rock, amplitude }
    }
}

/// Ground without its finest relief, and the values on which the finest relief depends.
#[derive(Clone, Copy, Debug)]
struct Broad {
    /// Elevation, metres, before it is compressed into [`HEIGHT_RANGE_M`].
    height: f64,
    /// Elevation before any octave of fine relief is added, with its derivatives. Thin beds follow it.
    beds: Dual,
    /// Distance of the beds below their usual level, metres.
    bend: f64,
    /// Degree to which the ground is rock, 0..=1.
    rock: f64,
    /// Amplitude of the next octave of fine relief, metres.
    amplitude: f64,
}

/// Adds octaves of fine relief: hummocks on turf, and creases between blocks on rock. `rock`: degree to which the ground is rock, 0..=1. `ground` and
/// the result are pairs: an elevation, and the amplitude of the next octave.
fn relieved(octaves: &[Octave], x: f64, y: f64, rock: f64, ground: (f64, f64)) -> (f64, f64) {
    octaves.iter().fold(ground, |(height, amplitude), octave| {
        let n = octave.value(x, y);
        let creased = 1.5 * n.abs() - 0.35;
        (height + amplitude * (n + rock * (creased - n)), amplitude * 0.5)
    })
}

/// Returns the change in elevation by gullies that run down the slope of `ground`. `depth_m`: their depth on steep ground. Gentle ground has no
/// gullies.
fn cut(gullies: &Gullies, x: f64, y: f64, ground: Dual, depth_m: f64) -> Dual {
    let slope = ground.slope_squared().sqrt();
    let strength = smoothstep(0.1, 0.8, slope) * depth_m;
    if strength > 0.0 { gullies.at(x, y, [-ground.x / slope, -ground.y / slope]).scale(strength) } else { Dual::constant(0.0) }
}

/// Compresses elevations near the upper bound, so that summits are not clipped to a plateau.
fn saturate(h: f64) -> f64 {
    const KNEE: f64 = 2200.0;
    let room = HEIGHT_RANGE_M.1 - KNEE;
    let h = if h > KNEE { KNEE + room * (h - KNEE) / (h - KNEE + room) } else { h };
    h.clamp(HEIGHT_RANGE_M.0, HEIGHT_RANGE_M.1)
}

/// Relief finer than the resolution of an imported heightmap.
#[derive(Clone, Debug)]
pub struct Relief {
    octaves: Vec<Octave>,
    bend: Octave,
}

impl Relief {
    /// Makes relief for data with this spacing. The longest wavelength is the spacing, but at least 2 m. Further octaves are finer and finer, until
    /// the next wavelength would be 1 m or less, or there are 8 octaves.
    pub fn new(seed: u32, data_spacing_m: f64) -> Relief {
        let mut octaves = Vec::new();
        let mut wavelength = data_spacing_m.max(2.0);
        while wavelength > 1.0 && octaves.len() < 8 {
            octaves.push(Octave::new(seed, 40 + octaves.len() as u32, wavelength));
            wavelength *= 0.46;
        }
        Relief { octaves, bend: Octave::new(seed, 60, 4.0 * data_spacing_m.max(2.0)) }
    }

    /// Returns an offset in elevation, from -`detail_m` to `detail_m`. `height_m` and `slope` (tangent) are elevation and slope of the data at the
    /// position. Gentle ground gets bumps, steep ground gets ledges and faces.
    pub fn offset_m(&self, x: f64, y: f64, height_m: f64, slope: f64, detail_m: f64) -> f64 {
        let steep = smoothstep(0.5, 1.2, slope);
        let mut bumps = 0.0;
        let mut amplitude = 0.5;
        for octave in &self.octaves {
            bumps += amplitude * octave.noise(x, y).v;
            amplitude *= 0.5;
        }
        let period = 2.2 * detail_m;
        let bed = (height_m + 1.5 * detail_m * self.bend.noise(x, y).v + 0.5 * detail_m * bumps) / period;
        let offset = detail_m * bumps * (0.5 - 0.2 * steep) + steep * 0.9 * period * stairs(bed, 0.22, 0.3);
        offset.clamp(-detail_m, detail_m)
    }
}
