//! A procedural alpine world: elevation as a function of position and seed, nothing else.
//!
//! Layers, each fed by the ones above: domain warp; a network of broad valleys (zero lines of noise); ridged multifractal massifs whose
//! octaves fade where the ground is already steep (Musgrave 1994; the damping by accumulated slope is Quilez's "derivative" fBm);
//! gullies that run down the local slope; belts of rock faces, 20 to 120 m tall with talus at their foot, where steep ground crosses the
//! zero lines of further noises; ledges along bent beds; fine relief
//! down to a metre. Everything is made of sums, products, square roots and floors, so that all machines agree on every bit.

/// Edge of the world, metres.
pub const EXTENT_M: f64 = 10_240.0;

/// Closed bound on every elevation, metres.
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

    /// f(self) with f's value and derivative given.
    fn map(self, v: f64, derivative: f64) -> Dual {
        Dual { v, x: self.x * derivative, y: self.y * derivative }
    }

    fn slope_squared(self) -> f64 {
        self.x * self.x + self.y * self.y
    }
}

/// PCG-RXS-M-XS, 32 bits (O'Neill 2014; Jarzynski & Olano 2020): one word in, one out, for lattices.
fn pcg(v: u32) -> u32 {
    let state = v.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
    let word = ((state >> ((state >> 28) + 4)) ^ state).wrapping_mul(277_803_737);
    (word >> 22) ^ word
}

/// Rotations by exact rational angles: cosine and sine of Pythagorean triples, an octave each, so that no two lattices line up.
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

/// Adding it rounds to an integer, whose two's complement is then in the low mantissa bits: 1.5 * 2^52.
const ROUNDER: f64 = 6_755_399_441_055_744.0;

/// Floor (as a wrapped integer) and fraction of |v| < 2^51, without the library call that plain x86-64 makes of `floor`.
fn split(v: f64) -> (u32, f64) {
    let shifted = v + ROUNDER;
    let fraction = v - (shifted - ROUNDER);
    let nearest = shifted.to_bits() as u32;
    if fraction < 0.0 { (nearest.wrapping_sub(1), fraction + 1.0) } else { (nearest, fraction) }
}

/// One octave of gradient noise: a turned, shifted lattice of a certain wavelength.
#[derive(Clone, Copy, Debug)]
struct Octave {
    /// Lattice from world: first row (c, s), second (-s, c), over the wavelength.
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

    fn lattice(&self, x: f64, y: f64) -> (u32, u32, f64, f64) {
        let (iu, fu) = split(self.c * x + self.s * y + self.shift[0]);
        let (iv, fv) = split(self.c * y - self.s * x + self.shift[1]);
        (iu, iv, fu, fv)
    }

    /// The value of [`Octave::noise`] alone.
    fn value(&self, x: f64, y: f64) -> f64 {
        let (iu, iv, fu, fv) = self.lattice(x, y);
        let rows = [pcg(iv.wrapping_add(self.seed)), pcg(iv.wrapping_add(1).wrapping_add(self.seed))];
        let corner = |j: usize, i: u32, u: f64, v: f64| {
            let h = pcg(rows[j].wrapping_add(iu).wrapping_add(i));
            // Both halves of the word are used as they are; the scale to -1..=1 follows once, below.
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
        // Gradients in a square are shorter than unit ones: 1.5 brings the noise back to about -1..=1.
        Dual { v: value * 1.5, x: (du * self.c - dv * self.s) * 1.5, y: (du * self.s + dv * self.c) * 1.5 }
    }
}

/// cos and sin of 2 pi t by polynomials: good to 1e-3, the same bits everywhere.
fn wave(t: f64) -> (f64, f64) {
    let sine = |t: f64| {
        let t = t - ((t + ROUNDER) - ROUNDER);
        // A parabola through the zeros and peaks of the sine, then sharpened once.
        let p = 8.0 * t - 16.0 * t * t.abs();
        p * (0.775 + 0.225 * p.abs())
    };
    (sine(t + 0.25), sine(t))
}

/// Gullies: waves across a given direction, locally coherent, blended from jittered cells (after the "phacelle" noise of
/// Johansen's eroded terrain, 2023, and before it Clay John's), so that they run down a slope and branch where it turns.
#[derive(Clone, Copy, Debug)]
struct Gullies {
    octave: Octave,
    wavelength_m: f64,
}

impl Gullies {
    fn new(seed: u32, index: u32, wavelength_m: f64) -> Gullies {
        Gullies { octave: Octave::new(seed, index, wavelength_m), wavelength_m }
    }

    /// Value in -1..=1 and its derivatives per metre, for the unit down-slope direction (x, y).
    fn at(&self, x: f64, y: f64, down: [f64; 2]) -> Dual {
        let o = &self.octave;
        let (iu, iv, fu, fv) = o.lattice(x, y);
        // The direction across the slope, turned into the lattice.
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

/// A staircase of period 1 and mean slope 1: treads of slope `tread`, risers over the share `riser` of each period, in its middle.
/// Returns the offset from the ramp, staircase(t) - t.
fn stairs(t: f64, riser: f64, tread: f64) -> f64 {
    let s = t - t.floor();
    let edge = 0.5 * (1.0 - riser);
    let rise = 1.0 - tread;
    let step = ((s - edge) / riser).clamp(0.0, 1.0);
    // A sharp brink above, a concave foot below: the ramp of the riser eased at its foot only.
    tread * s + rise * (step * (0.55 + step * (0.9 - 0.45 * step))) - s
}

/// A belt of rock faces: steps along the zero line of a noise, where that line runs across the slope.
#[derive(Clone, Copy, Debug)]
struct Faces {
    octave: Octave,
    /// Height of a face, metres.
    rise_m: f64,
    /// Horizontal depth of a face, metres.
    run_m: f64,
    /// Length over which the ground behind the brink falls back to what it was, metres.
    back_m: f64,
}

impl Faces {
    /// What the faces add to ground of this height and gradient; `crenels` moves the brink to and fro (metres).
    fn on(&self, x: f64, y: f64, ground: Dual, crenels: f64, strength: f64) -> Dual {
        let n = self.octave.noise(x, y);
        let gradient = (n.slope_squared() + 1e-12).sqrt();
        // Distance from the zero line, positive on the high side, to first order; the floor keeps flat spots of the noise from making
        // distances of nothing.
        let steepness = gradient.max(0.6 * (self.octave.c * self.octave.c + self.octave.s * self.octave.s).sqrt());
        let distance = n.v / steepness + crenels;
        if distance < -0.5 * self.run_m || distance > 3.0 * self.back_m {
            return Dual::constant(0.0);
        }
        let slope = (ground.slope_squared() + 1e-12).sqrt();
        let aligned = (n.x * ground.x + n.y * ground.y) / (gradient * slope);
        let height = self.rise_m * strength * smoothstep(0.1, 0.75, aligned);
        let (value, rate) = self.profile(distance);
        let rate = height * rate / steepness;
        Dual { v: height * value, x: rate * n.x, y: rate * n.y }
    }

    /// Height share and its rate per metre at a distance behind the middle of the face.
    fn profile(&self, distance: f64) -> (f64, f64) {
        let t = distance / self.run_m + 0.5;
        let fall = (1.0 - (distance / (3.0 * self.back_m)).max(0.0)).max(0.0);
        let back = fall * fall * fall;
        let back_rate = if distance > 0.0 { -fall * fall / self.back_m } else { 0.0 };
        if t < 1.0 {
            // A concave foot of talus under a straight face and a sharp brink.
            let t = t.max(0.0);
            let value = t * t * (1.6 - 0.6 * t);
            (value * back, (3.2 * t - 1.8 * t * t) / self.run_m * back + value * back_rate)
        } else {
            (back, back_rate)
        }
    }
}

/// Octaves of fine relief that slope and curvature are measured with.
const BROAD_OCTAVES: usize = 2;

/// The generator.
#[derive(Clone, Debug)]
pub struct Generator {
    warp: [Octave; 2],
    uplift: Octave,
    valleys: [Octave; 2],
    massifs: [Octave; 4],
    gullies: [Gullies; 3],
    faces: [Faces; 3],
    crenels: [Octave; 2],
    beds: Octave,
    fine: [Octave; 5],
}

impl Generator {
    /// The generator of a seed.
    pub fn new(seed: u32) -> Generator {
        let octave = |index: u32, wavelength_m: f64| Octave::new(seed, index, wavelength_m);
        let gullies = |index: u32, wavelength_m: f64| Gullies::new(seed, index, wavelength_m);
        let faces = |index: u32, wavelength_m: f64, rise_m: f64, run_m: f64| Faces {
            octave: octave(index, wavelength_m),
            rise_m,
            run_m,
            back_m: 0.16 * wavelength_m,
        };
        Generator {
            warp: [octave(0, 2300.0), octave(1, 2300.0)],
            uplift: octave(3, 9100.0),
            valleys: [octave(4, 6100.0), octave(5, 2700.0)],
            massifs: [octave(6, 2900.0), octave(7, 1350.0), octave(8, 620.0), octave(9, 290.0)],
            gullies: [gullies(11, 330.0), gullies(12, 140.0), gullies(13, 61.0)],
            faces: [faces(14, 760.0, 120.0, 38.0), faces(15, 370.0, 60.0, 20.0), faces(16, 170.0, 26.0, 9.0)],
            crenels: [octave(17, 90.0), octave(18, 33.0)],
            beds: octave(25, 240.0),
            fine: [octave(19, 31.0), octave(20, 14.0), octave(21, 6.3), octave(22, 2.9), octave(23, 1.3)],
        }
    }

    /// Elevation at a place, metres, within [`HEIGHT_RANGE_M`].
    pub fn height_m(&self, x: f64, y: f64) -> f64 {
        self.heights_m(x, y)[0]
    }

    /// Elevation without the relief finer than some 10 m: what slope and curvature are measured on, since differences over a few
    /// metres would take boulders for cliffs.
    pub fn broad_height_m(&self, x: f64, y: f64) -> f64 {
        saturate(self.broad(x, y).0)
    }

    /// [`Generator::height_m`] and [`Generator::broad_height_m`], in the time of the first.
    pub fn heights_m(&self, x: f64, y: f64) -> [f64; 2] {
        let (broad, rock, amplitude) = self.broad(x, y);
        let (height, _) = relieved(&self.fine[BROAD_OCTAVES..], x, y, rock, (broad, amplitude));
        [saturate(height), saturate(broad)]
    }

    /// Elevation without the finest relief, how far the ground is rock, and the amplitude of the octave that follows.
    fn broad(&self, x: f64, y: f64) -> (f64, f64, f64) {
        // Domain warp, with its Jacobian for the derivatives of what follows.
        let (wx, wy) = (self.warp[0].noise(x, y).scale(330.0), self.warp[1].noise(x, y).scale(330.0));
        let (px, py) = (x + wx.v, y + wy.v);
        let warped = |n: Dual| Dual { v: n.v, x: n.x * (1.0 + wx.x) + n.y * wy.x, y: n.x * wx.y + n.y * (1.0 + wy.y) };

        // Valleys: zero lines of a broad noise; flat floors, walls that steepen upwards, then an even rise.
        let region = warped(self.valleys[1].noise(px, py));
        let n = warped(self.valleys[0].noise(px, py)).plus(region.scale(0.55));
        let distance = (n.v * n.v + 0.001).sqrt();
        let distance = n.map(distance, n.v / distance);
        // The floor's width varies along the valley.
        let distance = distance.plus(region.scale(0.05));
        let above = (distance.v - 0.05).max(0.0);
        let denominator = 1.0 / (above + 0.30);
        let lift = distance.map(above * above * denominator, above * (above + 0.60) * denominator * denominator);

        // Massifs: ridged octaves, each weaker where the ground so far is steep, and only where valleys leave room.
        let mut height = lift.scale(760.0).plus(region.scale(30.0)).plus(self.uplift.noise(x, y).scale(430.0));
        height.v += 470.0;
        let room = lift.v / (lift.v + 0.12);
        let mut weight = lift.map(room, 0.12 / ((lift.v + 0.12) * (lift.v + 0.12)));
        let mut amplitude = 1080.0;
        for octave in &self.massifs {
            let n = warped(octave.noise(px, py));
            let fold = (n.v * n.v + 0.0012).sqrt();
            let ridge = 1.0 - fold;
            let ridge = n.map(ridge * ridge, -2.0 * ridge * n.v / fold);
            let damping = 1.0 / (1.0 + 0.8 * height.slope_squared());
            height = height.plus(ridge.times(weight).scale(amplitude * damping));
            weight = weight.times(Dual { v: 0.3 + 0.9 * ridge.v, x: 0.9 * ridge.x, y: 0.9 * ridge.y });
            amplitude *= 0.4;
        }

        // Summits stand out: what rises above the middle ground rises a third higher.
        let above = (height.v - 850.0).max(0.0);
        let denominator = 1.0 / (above + 350.0);
        let stretch = height.map(0.33 * above * above * denominator, 0.33 * above * (above + 700.0) * denominator * denominator);
        height = height.plus(stretch);

        // Gullies down the slope: deeper where it is steep, none on valley floors.
        for (gully, depth) in self.gullies[..2].iter().zip([30.0, 12.0]) {
            height = height.plus(cut(gully, x, y, height, depth));
        }

        // Rock faces where the slope is steep already, and more in some regions than in others.
        let steep = smoothstep(0.45, 0.85, height.slope_squared().sqrt() + 0.3 * region.v);
        let crenels = if steep > 0.0 { 11.0 * self.crenels[0].value(x, y) + 5.0 * self.crenels[1].value(x, y) } else { 0.0 };
        if steep > 0.0 {
            let ground = height;
            for faces in &self.faces {
                height = height.plus(faces.on(x, y, ground, crenels, steep));
            }
        }
        height = height.plus(cut(&self.gullies[2], x, y, height, 4.5));

        // Ledges along bent beds, on faces only; some beds are hard and most are not.
        let mut h = height.v;
        let slope = height.slope_squared().sqrt();
        let face = smoothstep(0.9, 1.8, slope);
        if face > 0.0 {
            let bed = (h + 55.0 * self.beds.value(x, y) + crenels) / 24.0;
            let hardness = f64::from(pcg((bed.floor() as i32 as u32) ^ self.beds.seed) >> 16) / 65535.0;
            h += face * hardness * hardness * 24.0 * 0.8 * stairs(bed, 0.3, 0.3);
        }

        let rock = smoothstep(0.4, 0.9, slope);
        let (h, amplitude) = relieved(&self.fine[..BROAD_OCTAVES], x, y, rock, (h, 0.3 + 1.2 * rock + 2.6 * face));
        (h, rock, amplitude)
    }
}

/// An elevation and the amplitude of its next octave, after some octaves of fine relief: hummocks on turf; on `rock`, creases between blocks.
fn relieved(octaves: &[Octave], x: f64, y: f64, rock: f64, ground: (f64, f64)) -> (f64, f64) {
    octaves.iter().fold(ground, |(height, amplitude), octave| {
        let n = octave.value(x, y);
        let creased = 1.5 * n.abs() - 0.35;
        (height + amplitude * (n + rock * (creased - n)), amplitude * 0.47)
    })
}

/// Gullies of a depth (metres) down the slope of the ground so far.
fn cut(gullies: &Gullies, x: f64, y: f64, ground: Dual, depth_m: f64) -> Dual {
    let slope = ground.slope_squared().sqrt();
    let strength = smoothstep(0.1, 0.8, slope) * depth_m;
    if strength > 0.0 { gullies.at(x, y, [-ground.x / slope, -ground.y / slope]).scale(strength) } else { Dual::constant(0.0) }
}

/// Bends elevations near the bounds back inside, so that no summit is a flat cut.
fn saturate(h: f64) -> f64 {
    const KNEE: f64 = 2200.0;
    let room = HEIGHT_RANGE_M.1 - KNEE;
    let h = if h > KNEE { KNEE + room * (h - KNEE) / (h - KNEE + room) } else { h };
    h.clamp(HEIGHT_RANGE_M.0, HEIGHT_RANGE_M.1)
}

/// Relief below the resolution of an imported heightmap.
#[derive(Clone, Debug)]
pub struct Relief {
    octaves: Vec<Octave>,
    bend: Octave,
}

impl Relief {
    /// Relief from half the data's spacing down to a metre or so.
    pub fn new(seed: u32, data_spacing_m: f64) -> Relief {
        let mut octaves = Vec::new();
        let mut wavelength = data_spacing_m.max(2.0);
        while wavelength > 1.0 && octaves.len() < 8 {
            octaves.push(Octave::new(seed, 40 + octaves.len() as u32, wavelength));
            wavelength *= 0.46;
        }
        Relief { octaves, bend: Octave::new(seed, 60, 4.0 * data_spacing_m.max(2.0)) }
    }

    /// Offset in -`detail_m`..=`detail_m` for ground of elevation `height_m` whose data rise by `slope` (tangent): bumps where it is
    /// gentle, ledges and faces where it is steep.
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
