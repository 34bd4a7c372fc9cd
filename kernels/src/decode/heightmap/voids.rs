//! Finds samples without data. Values are compared as they are stored, before they are converted to metres.

use super::depth::Depth;
use super::options::{NoData, Voids};
use super::raster::{Absent, Raster};
use crate::decode::fault::Fault;

/// Values that often mark missing data in files that do not name a no-data value. They are used by ESRI, SRTM, Mapbox and others, or are the
/// ends of the range of signed 16-bit integers. They do not apply to unsigned 16-bit integers.
const MARKERS: [f64; 8] = [-9999.0, -32_768.0, -32_767.0, -10_000.0, -99_999.0, 9999.0, 99_999.0, 32_767.0];
/// The value that often marks missing data in unsigned 16-bit integers.
const UNSIGNED_MARKER: f64 = 65_535.0;
/// A value that often marks missing data counts as a marker only if it is below or above all other samples by more than this share of their
/// range. For example, real ground at -9999 dm is kept if the other samples reach from -9998 to 0 dm.
const MARKER_GAP: f64 = 1.0 / 64.0;

/// A sample whose absolute value is at least this is no elevation in any unit.
const HUGE: f64 = 1e10;

/// Largest number of samples from which quartiles are estimated.
const SURVEYED: usize = 1 << 16;
/// Samples that lie more than this many interquartile ranges outside the quartiles are far outside (the outer fences of Tukey, *Exploratory Data
/// Analysis*, 1977).
const FENCE: f64 = 3.0;

/// Zeros count as far from the other samples if the distance of every other sample from 0 is more than this share of the range of the other samples.
const ZERO_GAP: f64 = 1.0 / 16.0;

/// The samples without data, and the reasons.
#[derive(Default)]
pub(super) struct Found {
    /// For each sample, whether it has no data; empty if all samples have data.
    pub(super) mask: Vec<bool>,
    pub(super) count: usize,
    /// The reasons with their counts, and the place of the first sample without data, in words; empty if all samples have data.
    pub(super) words: String,
    /// Notes for the user, one line each.
    pub(super) notes: Vec<String>,
}

impl Found {
    /// Whether a sample has data.
    pub(super) fn has_data(&self, index: usize) -> bool {
        self.mask.get(index).is_none_or(|&is_void| !is_void)
    }
}

/// A reason why samples have no data, or may have none.
struct Cause {
    what: String,
    count: usize,
    first: usize,
}

/// Finds the samples without data.
///
/// # Errors
/// A value probably marks missing data (see [`refuse_marks`]), but neither the file nor the user says so; no sample has data; or there are
/// samples without data, and `voids` is `Refuse`.
pub(super) fn find(raster: &Raster, no_data: &NoData, voids: Voids) -> Result<Found, Fault> {
    let stored = &raster.stored;
    let mut named: Vec<(f64, &str)> = Vec::new();
    let mut looks_for_marks = !raster.holds_codes;
    match no_data {
        NoData::Stated => named.extend(raster.no_data.map(|value| (value, "its no-data value"))),
        NoData::Named(values) => {
            named.extend(raster.no_data.map(|value| (value, "its no-data value")));
            named.extend(values.iter().map(|&value| (value, "the value of --no-data")));
        }
        NoData::Nothing => looks_for_marks = false,
    }
    let fixed = [
        "in strips or tiles that are not in the file",
        "that its mask hides",
        "that are transparent",
        "that are NaN",
        "that are infinite",
        "",
    ];
    let mut causes: Vec<Cause> = fixed.iter().map(|what| Cause { what: (*what).to_owned(), count: 0, first: 0 }).collect();
    causes.extend(named.iter().map(|(value, whose)| Cause { what: format!("with {whose} {}", stored.shown(*value)), count: 0, first: 0 }));
    let mut found = Found::default();
    for index in 0..stored.len() {
        let value = stored.at(index);
        let cause = match raster.absent.get(index).copied().flatten() {
            Some(Absent::Missing) => Some(0),
            Some(Absent::Masked) => Some(1),
            Some(Absent::Transparent) if matches!(no_data, NoData::Nothing) => None,
            Some(Absent::Transparent) => Some(2),
            None if value.is_nan() => Some(3),
            None if value.is_infinite() => Some(4),
            None => match named.iter().position(|&(no_data, _)| stored.is(value, no_data)) {
                Some(position) => Some(fixed.len() + position),
                None if value.abs() >= HUGE => Some(5),
                None => None,
            },
        };
        if let Some(cause) = cause.and_then(|cause| causes.get_mut(cause)) {
            if found.mask.is_empty() {
                found.mask = vec![false; stored.len()];
            }
            found.mask[index] = true;
            found.count += 1;
            if cause.count == 0 {
                cause.first = index;
                if cause.what.is_empty() {
                    cause.what = format!("with values such as {}, which is no elevation", stored.shown(value));
                }
            }
            cause.count += 1;
        }
    }
    if looks_for_marks {
        refuse_marks(raster, &found)?;
    }
    if let NoData::Named(values) = no_data {
        // A sample is counted only for the first entry of `named` that has its value.
        let occurs = |value: f64| named.iter().zip(&causes[fixed.len()..]).any(|(&(other, _), cause)| other == value && cause.count > 0);
        let unused = values.iter().filter(|&&value| !occurs(value));
        found.notes = unused.map(|value| format!("no sample has the value {} of --no-data", stored.shown(*value))).collect();
    }
    causes.retain(|cause| cause.count > 0);
    let reasons: Vec<String> = causes.iter().map(|cause| format!("{} {}", cause.count, cause.what)).collect();
    let Some(first) = causes.iter().map(|cause| cause.first).min() else { return Ok(found) };
    found.words = format!("{}; the first at {}", reasons.join(", "), raster.place(first));
    if found.count == stored.len() {
        let of_transparency =
            if raster.absent.contains(&Some(Absent::Transparent)) { ", or give --no-data none if alpha says nothing" } else { "" };
        return Err(Fault::Unsupported(format!(
            "no sample has data ({}); use another file, or choose another part of it with --window{of_transparency}",
            found.words
        )));
    }
    match voids {
        Voids::Refuse => Err(Fault::Unsupported(format!(
            "{} of {} samples {} no data: {}; fill them with --fill-voids, open them with --holes, or give a --window without them",
            found.count,
            stored.len(),
            if found.count == 1 { "has" } else { "have" },
            found.words
        ))),
        Voids::Fill | Voids::Holes => Ok(found),
    }
}

/// The values that usually mark missing data in samples of this depth.
fn markers(depth: Depth) -> impl Iterator<Item = f64> {
    let unsigned = (depth == Depth::Unsigned16).then_some(UNSIGNED_MARKER);
    let usual = MARKERS.into_iter().filter(move |_| depth != Depth::Unsigned16);
    let ends = depth.limits().filter(|_| depth == Depth::Signed32).into_iter().flatten();
    usual.chain(unsigned).chain(ends)
}

/// Refuses values that usually mark missing data, if they are below or above all other samples by more than [`MARKER_GAP`] times the range of the
/// other samples.
fn refuse_marks(raster: &Raster, found: &Found) -> Result<(), Fault> {
    let stored = &raster.stored;
    let mut marks: Vec<(f64, Cause)> =
        markers(raster.depth).map(|marker| (marker, Cause { what: stored.shown(marker), count: 0, first: 0 })).collect();
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for index in (0..stored.len()).filter(|&index| found.has_data(index)) {
        let value = stored.at(index);
        match marks.iter_mut().find(|(marker, _)| *marker == value) {
            Some((_, cause)) => {
                if cause.count == 0 {
                    cause.first = index;
                }
                cause.count += 1;
            }
            None => (low, high) = (low.min(value), high.max(value)),
        }
    }
    let gap = MARKER_GAP * (high - low).max(0.0);
    marks.retain(|(marker, cause)| cause.count > 0 && (*marker < low - gap || *marker > high + gap));
    let Some(first) = marks.iter().map(|(_, cause)| cause.first).min() else { return Ok(()) };
    let counts = marks.iter().map(|(_, cause)| match cause.count {
        1 => format!("1 sample has the value {}", cause.what),
        count => format!("{count} samples have the value {}", cause.what),
    });
    let counts: Vec<String> = counts.collect();
    let options: Vec<String> = marks.iter().map(|(_, cause)| format!("--no-data {}", cause.what)).collect();
    Err(Fault::Unsupported(format!(
        "{} (the first at {}); such values usually mark missing data, but the file does not say so; if they do, give {} (with --fill-voids or \
         --holes); if they are ground, give --no-data none",
        counts.join(", "),
        raster.place(first),
        options.join(" ")
    )))
}

/// Returns a remark about samples that are far below or far above all others; `None` if there are none.
///
/// The outer fences are three interquartile ranges beyond the quartiles. Samples count as far from the others in this case: they lie outside the
/// fences, and a gap of at least three interquartile ranges separates them from the samples inside. Steep ground usually has no such gap. In a map
/// such as one that is mostly sea, so many samples equal the median that the quartiles are equal. The quartiles are then estimated without these
/// samples.
pub(super) fn remark(raster: &Raster, found: &Found) -> Option<String> {
    let stored = &raster.stored;
    let values = move || (0..stored.len()).filter(move |&index| found.has_data(index)).map(move |index| (index, stored.at(index)));
    let step = stored.len().div_ceil(SURVEYED);
    let mut surveyed: Vec<f64> = values().map(|(_, value)| value).step_by(step).collect();
    surveyed.sort_by(f64::total_cmp);
    let quarter = |sorted: &[f64], quarters: usize| sorted.get(sorted.len() * quarters / 4).copied();
    if quarter(&surveyed, 1) == quarter(&surveyed, 3) {
        let common = quarter(&surveyed, 2);
        surveyed.retain(|&value| Some(value) != common);
    }
    let (lower, upper) = (quarter(&surveyed, 1)?, quarter(&surveyed, 3)?);
    let reach = FENCE * (upper - lower);
    if reach <= 0.0 {
        return None;
    }
    let fences = (lower - reach, upper + reach);
    // `low` and `high` are the lowest and highest sample inside the fences. `below` and `above` are the samples outside, on each side.
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    let (mut below, mut above) = (Group::default(), Group::default());
    for (index, value) in values() {
        if value < fences.0 {
            below.add(index, value);
        } else if value > fences.1 {
            above.add(index, value);
        } else {
            (low, high) = (low.min(value), high.max(value));
        }
    }
    let far = [(&below, low - below.high), (&above, above.low - high)];
    let groups: Vec<String> =
        far.iter().filter(|(group, gap)| group.count > 0 && *gap >= reach).map(|(group, _)| group.words(raster)).collect();
    if groups.is_empty() {
        return None;
    }
    Some(format!(
        "{}, far from all others ({} to {}); if a value marks missing data, name it with --no-data VALUE",
        groups.join(", and "),
        stored.shown(low),
        stored.shown(high)
    ))
}

/// Returns a note about floats that are exactly 0, if at least 2 x 2 of them form a square, and all other samples are far from 0 ([`ZERO_GAP`]).
/// Programs may fill gaps with 0, but 0 may also be the level of a sea.
pub(super) fn note_of_zeros(raster: &Raster, found: &Found) -> Option<String> {
    if !raster.depth.is_float() {
        return None;
    }
    let stored = &raster.stored;
    let mut zeros = Group::default();
    let (mut low, mut high, mut nearest) = (f64::INFINITY, f64::NEG_INFINITY, f64::INFINITY);
    for index in (0..stored.len()).filter(|&index| found.has_data(index)) {
        let value = stored.at(index);
        if value == 0.0 {
            zeros.add(index, value);
        } else {
            (low, high, nearest) = (low.min(value), high.max(value), nearest.min(value.abs()));
        }
    }
    let width = raster.window[2] as usize;
    let is_zero = |index: usize| index < stored.len() && found.has_data(index) && stored.at(index) == 0.0;
    let is_corner = |index: usize| index % width + 1 < width && [0, 1, width, width + 1].into_iter().all(|step| is_zero(index + step));
    let is_far = zeros.count > 0 && low <= high && nearest > ZERO_GAP * (high - low);
    (is_far && (zeros.first..stored.len()).any(is_corner)).then(|| {
        format!(
            "{} samples are exactly 0 (the first at {}), but all others are {} to {}; if 0 marks missing data, name it with --no-data 0",
            zeros.count,
            raster.place(zeros.first),
            stored.shown(low),
            stored.shown(high)
        )
    })
}

/// Samples that a remark or a note is about: their number, the index of the first one, and their lowest and highest value.
struct Group {
    count: usize,
    first: usize,
    low: f64,
    high: f64,
}

impl Default for Group {
    fn default() -> Self {
        Group { count: 0, first: 0, low: f64::INFINITY, high: f64::NEG_INFINITY }
    }
}

impl Group {
    fn add(&mut self, index: usize, value: f64) {
        if self.count == 0 {
            self.first = index;
        }
        self.count += 1;
        (self.low, self.high) = (self.low.min(value), self.high.max(value));
    }

    fn words(&self, raster: &Raster) -> String {
        let shown = |value: f64| raster.stored.shown(value);
        let values = if self.low < self.high { format!("{} to {}", shown(self.low), shown(self.high)) } else { shown(self.low) };
        match self.count {
            1 => format!("1 sample is {values} (at {})", raster.place(self.first)),
            count => format!("{count} samples are {values} (the first at {})", raster.place(self.first)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::raster::Stored;
    use super::super::scaling::Statement;
    use super::super::spacing::Spacing;
    use super::*;

    /// A map of 40 x 25 samples of smooth ground from `low` to `high`. `replaced`: indices of samples, and the values that replace them.
    fn ground(depth: Depth, [low, high]: [f64; 2], replaced: &[(usize, f64)]) -> Raster {
        let mut samples: Vec<f64> = (0..1000).map(|i| low + (high - low) * (0.5 - 0.5 * (f64::from(i) * 0.0217).cos())).collect();
        if !depth.is_float() {
            samples.iter_mut().for_each(|sample| *sample = sample.round());
        }
        for &(index, value) in replaced {
            samples[index] = value;
        }
        let stored = match depth {
            Depth::Unsigned32 | Depth::Signed32 | Depth::Double => Stored::Double(samples),
            _ => Stored::Single(samples.into_iter().map(|sample| sample as f32).collect()),
        };
        Raster {
            format: String::new(),
            file_size: [40, 25],
            window: [0, 0, 40, 25],
            depth,
            holds_codes: false,
            stored,
            absent: Vec::new(),
            no_data: None,
            statement: Statement::default(),
            spacing: Spacing::Unknown,
            orientation: "",
            notes: Vec::new(),
        }
    }

    fn refused(raster: &Raster, no_data: &NoData, words: &[&str]) {
        let Err(fault) = find(raster, no_data, Voids::Refuse) else { panic!("accepted, but should say {words:?}") };
        let text = fault.to_string();
        for word in words {
            assert!(text.contains(word), "`{word}` is missing in: {text}");
        }
    }

    fn accepted(raster: &Raster, no_data: &NoData) {
        assert_eq!(find(raster, no_data, Voids::Refuse).unwrap_or_else(|fault| panic!("{fault}")).count, 0);
    }

    const METRES: [f64; 2] = [300.0, 900.0];

    #[test]
    fn usual_marks_are_refused_until_they_are_named_or_kept() {
        for marker in [-9999.0, -32_768.0, -32_767.0, -10_000.0, 9999.0, 32_767.0] {
            for (depth, range) in
                [(Depth::Signed16, METRES), (Depth::Signed16, [3000.0, 9000.0]), (Depth::Single, METRES), (Depth::Double, METRES)]
            {
                let raster = ground(depth, range, &[(83, marker), (84, marker), (900, marker)]);
                refused(&raster, &NoData::Stated, &[&format!("3 samples have the value {marker}"), "column 3, row 2", "--no-data none"]);
                refused(
                    &raster,
                    &NoData::Named(vec![marker]),
                    &["3 of 1000 samples have no data", "the value of --no-data", "--fill-voids"],
                );
                accepted(&raster, &NoData::Nothing);
                let found = find(&raster, &NoData::Named(vec![marker]), Voids::Fill).unwrap_or_else(|fault| panic!("{fault}"));
                assert_eq!((found.count, found.has_data(83), found.has_data(85)), (3, false, true));
                assert_eq!(found.notes, [""; 0]);
            }
        }
        let other = NoData::Named(vec![-1.0, 300.0]);
        let found = find(&ground(Depth::Single, METRES, &[]), &other, Voids::Fill).unwrap_or_else(|fault| panic!("{fault}"));
        assert_eq!((found.count, found.notes.as_slice()), (1, ["no sample has the value -1 of --no-data".to_owned()].as_slice()));
        refused(&ground(Depth::Single, METRES, &[(5, -99_999.0)]), &NoData::Stated, &["1 sample has the value -99999"]);
        refused(&ground(Depth::Unsigned16, METRES, &[(5, 65_535.0)]), &NoData::Stated, &["the value 65535"]);
        refused(&ground(Depth::Unsigned16, [0.0, 40_000.0], &[(5, 65_535.0)]), &NoData::Stated, &["1 sample has the value 65535"]);
        refused(&ground(Depth::Signed32, [3e5, 9e5], &[(5, -2_147_483_648.0)]), &NoData::Stated, &["the value -2147483648"]);
        refused(&ground(Depth::Single, METRES, &[(5, -9999.0), (6, 9999.0)]), &NoData::Stated, &["--no-data -9999 --no-data 9999"]);
    }

    #[test]
    fn real_ground_is_kept_though_it_has_the_value_of_a_mark() {
        accepted(&ground(Depth::Signed16, [-12_000.0, 0.0], &[(5, -9999.0)]), &NoData::Stated);
        accepted(&ground(Depth::Signed16, [-9990.0, 4000.0], &[(5, -9999.0)]), &NoData::Stated);
        accepted(&ground(Depth::Signed16, [-32_768.0, 32_767.0], &[]), &NoData::Stated);
        accepted(&ground(Depth::Unsigned16, [20_000.0, 65_535.0], &[]), &NoData::Stated);
        accepted(&ground(Depth::Unsigned16, [0.0, 65_000.0], &[(5, 65_535.0)]), &NoData::Stated);
        accepted(&ground(Depth::Single, [0.0, 10_040.0], &[(5, 9999.0)]), &NoData::Stated);
        // In a PNG or RAW file, the largest code is the highest ground and not a marker.
        accepted(&Raster { holds_codes: true, ..ground(Depth::Unsigned16, METRES, &[(5, 65_535.0)]) }, &NoData::Stated);
    }

    #[test]
    fn an_infinite_no_data_value_is_only_that_of_infinite_samples() {
        for value in [f64::INFINITY, f64::NEG_INFINITY] {
            accepted(&Raster { no_data: Some(value), ..ground(Depth::Single, METRES, &[]) }, &NoData::Stated);
        }
    }

    #[test]
    fn stated_values_are_compared_as_they_are_stored() {
        let with = |depth, value: f64| Raster { no_data: Some(value), ..ground(depth, METRES, &[(41, value), (42, value)]) };
        for (depth, value, shown) in [
            (Depth::Signed16, -32_768.0, "-32768"),
            (Depth::Unsigned16, 0.0, "0"),
            (Depth::Unsigned16, 65_535.0, "65535"),
            (Depth::Double, 1e20, "1e20"),
            (Depth::Single, f64::from(f32::MIN), "-3.4028235e38"),
        ] {
            let says = format!("2 of 1000 samples have no data: 2 with its no-data value {shown}; the first at column 1, row 1");
            refused(&with(depth, value), &NoData::Stated, &[&says]);
        }
        refused(&with(Depth::Single, f64::NAN), &NoData::Stated, &["2 that are NaN"]);
        accepted(&with(Depth::Unsigned16, 0.0), &NoData::Nothing);
        refused(
            &ground(Depth::Single, METRES, &[(0, f64::NEG_INFINITY)]),
            &NoData::Nothing,
            &["1 of 1000 samples has no data", "1 that are infinite"],
        );
        refused(&ground(Depth::Single, METRES, &[(0, -3.4e38)]), &NoData::Nothing, &["1 with values such as -3.4e38"]);
        let absent = (0..1000).map(|i| [Some(Absent::Masked), Some(Absent::Missing), None][usize::min(i, 2)]).collect();
        refused(
            &Raster { absent, ..ground(Depth::Single, METRES, &[]) },
            &NoData::Stated,
            &["2 of 1000", "1 in strips or tiles", "1 that its mask"],
        );
        let nothing: Vec<(usize, f64)> = (0..1000).map(|index| (index, f64::NAN)).collect();
        refused(&ground(Depth::Single, METRES, &nothing), &NoData::Stated, &["no sample has data"]);
    }

    #[test]
    fn values_far_from_all_others_are_remarked() {
        let remark = |raster: &Raster| remark(raster, &Found::default());
        let said = remark(&ground(Depth::Single, METRES, &[(3, 5000.0), (4, 5001.0), (5, -4000.0)])).expect("far outside");
        assert!(said.contains("1 sample is -4000 (at column 5, row 0), and 2 samples are 5000 to 5001"), "{said}");
        assert!(said.contains("(300 to 899.99"), "{said}");
        assert_eq!(remark(&ground(Depth::Single, METRES, &[])), None);
        assert_eq!(remark(&ground(Depth::Single, METRES, &[(3, 1000.0)])), None, "a peak");
        // A plain with a volcano. Its summit is far above the quartiles of the heights, but there is no large gap between the heights of plain and
        // summit, so it is no outlier.
        let volcano: Vec<(usize, f64)> = (0..300).map(|i| (i, 3.0 + f64::from(i as u32) * 10.0)).collect();
        assert_eq!(remark(&ground(Depth::Single, [0.0, 3.0], &volcano)), None);
        // Most of the map is sea.
        let mut sea: Vec<(usize, f64)> = (0..800).map(|i| (i, 0.0)).collect();
        assert_eq!(remark(&ground(Depth::Single, METRES, &sea)), None);
        sea.push((900, 30_000.0));
        assert!(remark(&ground(Depth::Single, METRES, &sea)).is_some_and(|said| said.contains("1 sample is 30000")));
        assert_eq!(remark(&ground(Depth::Single, [5.0, 5.0], &[])), None, "all samples are equal");
    }

    #[test]
    fn a_block_of_zeros_far_from_all_other_floats_is_remarked() {
        let note = |raster: &Raster| note_of_zeros(raster, &Found::default());
        // Columns 5 and 6 of rows 2 and 3; a map is 40 samples wide.
        let block = [(85, 0.0), (86, 0.0), (125, 0.0), (126, -0.0)];
        let said = note(&ground(Depth::Single, METRES, &block)).expect("far from 0");
        assert!(said.starts_with("4 samples are exactly 0 (the first at column 5, row 2), but all others are 300 to"), "{said}");
        assert!(note(&ground(Depth::Double, [-900.0, -300.0], &block)).is_some_and(|said| said.contains("--no-data 0")));
        assert_eq!(note(&ground(Depth::Single, METRES, &[])), None);
        assert_eq!(note(&ground(Depth::Single, METRES, &block[..3])), None, "no block");
        assert_eq!(note(&ground(Depth::Single, METRES, &[(39, 0.0), (40, 0.0), (79, 0.0), (80, 0.0)])), None, "not beside each other");
        assert_eq!(note(&ground(Depth::Single, [20.0, 900.0], &block)), None, "a coast");
        assert_eq!(note(&ground(Depth::Signed16, METRES, &block)), None, "integers");
        let hidden = Found { mask: (0..1000).map(|index| index == 85).collect(), count: 1, ..Found::default() };
        assert_eq!(note_of_zeros(&ground(Depth::Single, METRES, &block), &hidden), None, "one of them has no data");
    }
}
