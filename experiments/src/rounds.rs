//! Measures times: decides in which order pictures are drawn and how many rounds are measured, and estimates times and ratios with intervals.
//!
//! Several *candidates* are compared, for example the variants of a definition. A *round* draws every candidate once, in an order that is shuffled
//! anew for each round. The order is a function of a seed and the number of the round. Because of the shuffling, a slow drift of the machine affects
//! all candidates about equally, and no candidate regularly follows the same neighbour. The times of the first round are discarded. This round warms
//! up pipelines, pages and caches.
//!
//! Two times of the same round give a ratio. The estimate of a ratio is the median over the rounds. It changes little if another process slows down
//! single pictures, even if this happens more often to one candidate than to another. The 95 % interval of the median lies between two order
//! statistics of the ratios. It requires that the rounds are independent, and makes no assumption about the distribution of the ratios. (The
//! Hodges-Lehmann estimate needs about half as many rounds, but only if this distribution is symmetric. It is not, because a picture that takes
//! longer to draw is disturbed more often. The Hodges-Lehmann interval then contains the true ratio too seldom.)
//!
//! Rounds are added until the intervals are narrow enough or a budget of time is spent. The number of rounds therefore depends on the clock. This is
//! acceptable, because times do not repeat exactly anyway. The clock is an argument of [`measure`], so that tests can control it.
//!
//! Source of the interval: David & Nagaraja, *Order Statistics*, 3rd edition (2003), section 7.1.

use std::collections::BTreeMap;

use anyhow::Result;
use kernels::shared::hash::pcg4d;

/// Half-width of the 95 % confidence interval of a normally distributed estimate, in standard errors.
pub(crate) const NORMAL_95: f64 = 1.96;
/// Largest half-width of the 95 % interval of a stable time or ratio, relative to its value.
pub(crate) const STABLE: f64 = 0.05;
/// Smallest number of rounds for which a 95 % interval of a median exists. The smallest and the largest of five values enclose the true median with
/// a probability of only 93.75 %.
pub(crate) const LEAST: u32 = 6;
/// Limit of the number of rounds. It has an effect only if the rounds are very short compared with the budget of time, or if the clock does not
/// advance.
const MOST: u32 = 1000;
/// Largest accepted probability that the true median lies below the interval. The same limit applies above the interval.
const TAIL: f64 = 0.025;
/// Salt of the hash that shuffles the candidates. It makes the order independent of other random numbers that have the same seed.
const SALT: u32 = 0x0074_5d0e;
/// Number of steps into which the progress is divided.
const STEPS: u64 = 1000;

/// A time or a ratio of two times, estimated from several rounds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Estimate {
    /// The median over the rounds. If their number is even, it is the geometric mean of the two middle values.
    pub(crate) value: f64,
    /// Half-width of the 95 % interval, relative to the value; infinite = there are fewer than [`LEAST`] rounds. The interval from `low` to `high` is
    /// not symmetric. The half-width is the larger of `high / value` and `value / low`, minus 1.
    pub(crate) half_width: f64,
}

impl Estimate {
    /// Estimates the median of positive values. `None` if there are no values.
    fn of(mut values: Vec<f64>) -> Option<Estimate> {
        values.sort_by(f64::total_cmp);
        let count = values.len();
        let (low, high) = (*values.get(count.checked_sub(1)? / 2)?, *values.get(count / 2)?);
        let value = if count % 2 == 1 { low } else { (low * high).sqrt() };
        let side = |rank: usize| (values[count - rank] / value).max(value / values[rank - 1]) - 1.0;
        Some(Estimate { value, half_width: rank(count).map_or(f64::INFINITY, side) })
    }

    /// Returns the standard error of a normally distributed estimate whose 95 % interval is `value` ± `value` * `half_width`. `None` = there is no
    /// interval.
    pub(crate) fn standard_error(&self) -> Option<f64> {
        self.half_width.is_finite().then_some(self.value * self.half_width / NORMAL_95)
    }

    /// Whether the interval is narrow enough for the value to be used in Pareto fronts, verdicts and sentences of the report.
    pub(crate) fn is_stable(&self) -> bool {
        is_stable(self.value, self.standard_error())
    }
}

/// Whether a time or a ratio of times may be used in Pareto fronts, verdicts and sentences: the half-width of its 95 % interval is at most [`STABLE`]
/// times its value. A value without a standard error may not be used.
pub(crate) fn is_stable(value: f64, standard_error: Option<f64>) -> bool {
    // The factor 1 + 1e-9 allows for rounding: a time must be stable if `measure` stopped because its half-width is exactly `STABLE`. A value of NaN
    // is not stable.
    standard_error.is_some_and(|error| NORMAL_95 * error <= STABLE * value * (1.0 + 1e-9))
}

/// Returns the largest rank r for which the r-th smallest and the r-th largest of `count` values enclose the true median with a probability of at
/// least 95 %. The condition is P(B < r) <= 2.5 %, where B is the number of heads in `count` throws of a coin. `None` if no rank meets it. `count` is
/// at most [`MOST`].
fn rank(count: usize) -> Option<usize> {
    // The probability of no head in 1000 throws is 9e-302. This is a normal f64 number, so the recurrence below starts with full precision.
    let mut probability = (0..count).fold(1.0f64, |p, _| 0.5 * p);
    let mut below = 0.0;
    let mut rank = 0;
    for heads in 0..count {
        below += probability;
        if below > TAIL {
            break;
        }
        rank = heads + 1;
        probability *= (count - heads) as f64 / (heads + 1) as f64;
    }
    (rank > 0).then_some(rank)
}

/// Identifies a time: the index of a candidate, and the name of a pass.
pub(crate) type Key<'a> = (usize, &'a str);

/// The valid times of each candidate and pass, by round, in milliseconds. A time is valid if it is above 0 and finite.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Samples(BTreeMap<(usize, String), BTreeMap<u32, f64>>);

impl Samples {
    /// Adds a time of a round. A time that is not valid is left out.
    fn add(&mut self, round: u32, timed: Timed) {
        if timed.ms > 0.0 && timed.ms.is_finite() {
            self.0.entry((timed.candidate, timed.pass)).or_default().insert(round, timed.ms);
        }
    }

    fn get(&self, (candidate, pass): Key<'_>) -> Option<&BTreeMap<u32, f64>> {
        self.0.get(&(candidate, pass.to_owned()))
    }

    /// Returns all pairs of a candidate and a pass that have times, sorted by candidate, then by pass.
    pub(crate) fn keys(&self) -> impl Iterator<Item = Key<'_>> {
        self.0.keys().map(|(candidate, pass)| (*candidate, pass.as_str()))
    }

    /// Returns the estimated time of a pass, milliseconds; `None` if it was not measured.
    pub(crate) fn time(&self, key: Key<'_>) -> Option<Estimate> {
        Estimate::of(self.get(key)?.values().copied().collect())
    }

    /// Returns the ratio of two times, computed from the rounds in which both were measured. `None` if there is no such round.
    pub(crate) fn ratio(&self, of: Key<'_>, over: Key<'_>) -> Option<Estimate> {
        let (of, over) = (self.get(of)?, self.get(over)?);
        Estimate::of(of.iter().filter_map(|(round, ms)| Some(ms / over.get(round)?)).collect())
    }

    fn half_width(&self, wanted: &Wanted<'_>) -> f64 {
        let estimate = match wanted.over {
            Some(over) => self.ratio(wanted.of, over),
            None => self.time(wanted.of),
        };
        estimate.map_or(f64::INFINITY, |estimate| estimate.half_width)
    }
}

/// A time or a ratio of times whose interval must become narrow before the measurement ends.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Wanted<'a> {
    /// The time, or the numerator of the ratio.
    pub(crate) of: Key<'a>,
    /// The denominator of the ratio; `None` = the time itself is meant.
    pub(crate) over: Option<Key<'a>>,
}

/// What is measured, and for how long.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Plan<'a> {
    /// Number of candidates.
    pub(crate) candidates: usize,
    /// The numbers that decide whether another round is needed.
    pub(crate) wanted: &'a [Wanted<'a>],
    /// Smallest number of timed rounds.
    pub(crate) least: u32,
    /// Seconds after which no further round begins, counted from the end of the first round, whose times are discarded.
    pub(crate) budget_s: f64,
    /// Seed of the order of candidates.
    pub(crate) seed: u32,
}

/// A picture that is to be drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Turn {
    /// Number of the round; 0 = the round whose times are discarded.
    pub(crate) round: u32,
    /// The candidate.
    pub(crate) candidate: usize,
    /// Whether it is the first picture of its round.
    pub(crate) is_first: bool,
}

/// The time of a pass.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Timed {
    /// The candidate to which the time belongs.
    pub(crate) candidate: usize,
    /// Name of the pass.
    pub(crate) pass: String,
    /// Milliseconds.
    pub(crate) ms: f64,
}

/// Draws rounds of pictures and returns the times of their passes. The times of a first round are discarded. At least `plan.least` and at most
/// [`MOST`] timed rounds follow. Between these limits, the function stops when the relative half-width of each number in `plan.wanted` is at most
/// [`STABLE`], or when the budget is spent. `clock` returns seconds since any fixed time. `step(done, total)` is called before each picture. `draw`
/// draws a picture and returns the times of its passes. If the first round gives no times, the device cannot measure any, and there is no second
/// round.
///
/// # Errors
/// `draw` fails.
pub(crate) fn measure(
    plan: &Plan<'_>,
    clock: &dyn Fn() -> f64,
    step: &dyn Fn(u64, u64),
    draw: &mut dyn FnMut(Turn) -> Result<Vec<Timed>>,
) -> Result<Samples> {
    let mut samples = Samples::default();
    let least = f64::from(plan.least.max(LEAST));
    let (mut began, mut expected, mut share) = (0.0, least, 0.0f64);
    for round in 0..=MOST {
        let mut is_timed = false;
        for (place, candidate) in order(plan.seed, round, plan.candidates).into_iter().enumerate() {
            // The share could fall if the forecast `expected` grows. It is never lowered, so that progress does not go back.
            let done = f64::from(round) + place as f64 / plan.candidates as f64;
            share = share.max((done / (1.0 + expected)).min(1.0));
            step((share * STEPS as f64) as u64, STEPS);
            let timed = draw(Turn { round, candidate, is_first: place == 0 })?;
            is_timed |= !timed.is_empty();
            if round > 0 {
                timed.into_iter().for_each(|timed| samples.add(round, timed));
            }
        }
        if round == 0 {
            if !is_timed {
                break;
            }
            began = clock();
            continue;
        }
        let widest = plan.wanted.iter().map(|wanted| samples.half_width(wanted)).fold(0.0, f64::max);
        let spent = clock() - began;
        if round >= plan.least && (widest <= STABLE || spent >= plan.budget_s) {
            break;
        }
        // The width of an interval is roughly inversely proportional to the square root of the number of rounds. If the widest interval is q times
        // too wide, about q² times as many rounds are needed.
        let needed = if widest.is_finite() { f64::from(round) * (widest / STABLE).powi(2) } else { least };
        let affordable = if spent > 0.0 { f64::from(round) * plan.budget_s / spent } else { f64::INFINITY };
        expected = needed.min(affordable).clamp(least, f64::from(MOST));
    }
    Ok(samples)
}

/// Returns the order of the candidates in a round: a permutation of 0..`count`, shuffled by Fisher and Yates' method.
fn order(seed: u32, round: u32, count: usize) -> Vec<usize> {
    let mut order: Vec<usize> = (0..count).collect();
    for last in (1..count).rev() {
        let [word, ..] = pcg4d([last as u32, round, seed, SALT]);
        let other = (u64::from(word) * (last as u64 + 1)) >> 32;
        order.swap(last, other as usize);
    }
    order
}

#[cfg(test)]
mod tests {
    use std::cell::{Cell, RefCell};
    use std::f64::consts::TAU;

    use anyhow::bail;
    use statrs::distribution::{Binomial, DiscreteCDF};

    use super::*;
    use crate::stability::statistics::Random;

    /// The pass that all simulated candidates have.
    const PASS: &str = "shading";
    /// More seconds than any simulation lasts.
    const ENOUGH_S: f64 = 1e9;

    /// The ratios of all candidates to the first one.
    fn ratios(candidates: usize) -> Vec<Wanted<'static>> {
        (1..candidates).map(|i| Wanted { of: (i, PASS), over: Some((0, PASS)) }).collect()
    }

    /// Measures candidates whose times are given by a function. The clock counts pictures.
    fn simulate(candidates: usize, budget_s: f64, seed: u32, ms: &mut dyn FnMut(Turn) -> f64) -> (Samples, Vec<Turn>) {
        let wanted = ratios(candidates);
        let plan = Plan { candidates, wanted: &wanted, least: LEAST, budget_s, seed };
        let turns = RefCell::new(Vec::new());
        let samples = measure(&plan, &|| turns.borrow().len() as f64, &|_, _| {}, &mut |turn| {
            turns.borrow_mut().push(turn);
            Ok(vec![Timed { candidate: turn.candidate, pass: PASS.to_owned(), ms: ms(turn) }])
        });
        (samples.expect("nothing fails"), turns.into_inner())
    }

    fn ratio(samples: &Samples, candidate: usize) -> Estimate {
        samples.ratio((candidate, PASS), (0, PASS)).expect("both were measured")
    }

    /// The true time of a candidate, ms: 10, 20, 30, ...
    fn truth(candidate: usize) -> f64 {
        10.0 * (candidate + 1) as f64
    }

    fn normal(random: &mut Random) -> f64 {
        (-2.0 * (1.0 - random.unit()).ln()).sqrt() * (TAU * random.unit()).cos()
    }

    /// How the times of pictures scatter. A neighbour is another process on the machine. While it is busy, a picture takes three times as long.
    #[derive(Clone, Copy, Debug)]
    enum Scatter {
        /// Log-normal, with a standard deviation of 3 %.
        Normal,
        /// Heavy tails: the logarithm has Student's distribution with 2 degrees of freedom, and a scale of 3 %.
        Heavy,
        /// Log-normal, with a standard deviation of 2 %. The neighbour is busy in 15 % of the pictures, independently for each picture.
        Neighbour,
        /// Log-normal, with a standard deviation of 2 %. The neighbour is busy or idle for several pictures: before each picture, it changes its
        /// state with a probability of 10 %.
        Bursts,
    }

    const SCATTERS: [Scatter; 4] = [Scatter::Normal, Scatter::Heavy, Scatter::Neighbour, Scatter::Bursts];

    impl Scatter {
        /// Returns the factor by which the true time of the next picture is multiplied. `is_busy` is the state of the neighbour.
        fn factor(self, random: &mut Random, is_busy: &mut bool) -> f64 {
            let z = normal(random);
            let spread = match self {
                Scatter::Normal => 0.03 * z,
                Scatter::Heavy => 0.03 * z / ((normal(random).powi(2) + normal(random).powi(2)) / 2.0).sqrt(),
                Scatter::Neighbour | Scatter::Bursts => 0.02 * z,
            };
            *is_busy = match self {
                Scatter::Normal | Scatter::Heavy => false,
                Scatter::Neighbour => random.unit() < 0.15,
                Scatter::Bursts => *is_busy != (random.unit() < 0.1),
            };
            spread.exp() * if *is_busy { 3.0 } else { 1.0 }
        }
    }

    #[test]
    fn a_median_lies_between_its_ranks_with_95_percent() {
        // Published tables of the sign test: at a two-sided level of 5 %, the rank is 1 for 6 values, 2 for 9, 3 for 12, 6 for 20 and 40 for 100.
        let known =
            [(0, None), (1, None), (5, None), (6, Some(1)), (8, Some(1)), (9, Some(2)), (12, Some(3)), (20, Some(6)), (100, Some(40))];
        for (count, expected) in known {
            assert_eq!(rank(count), expected, "{count}");
        }
        assert_eq!(rank(LEAST as usize - 1), None);
        // The ranks are the largest ones that are possible.
        for count in [6, 17, 64, 333, MOST as usize] {
            let coin = Binomial::new(0.5, count as u64).expect("a probability");
            let rank = rank(count).expect("enough values") as u64;
            assert!(coin.cdf(rank - 1) <= TAIL && coin.cdf(rank) > TAIL, "{count}: {rank}");
        }
    }

    #[test]
    fn estimates_are_medians_with_the_longer_side_of_their_interval() {
        assert_eq!(Estimate::of(Vec::new()), None);
        let few = Estimate::of(vec![4.0, 1.0, 2.0]).expect("values");
        assert_eq!((few.value, few.half_width, few.standard_error(), few.is_stable()), (2.0, f64::INFINITY, None, false));
        // The median of an even number of values is a geometric mean, so a ratio and its reciprocal give reciprocal estimates.
        let even = Estimate::of(vec![1.0, 4.0, 1.0, 4.0, 1.0, 4.0]).expect("values");
        assert!((even.value - 2.0).abs() < 1e-15 && (even.half_width - 1.0).abs() < 1e-15);
        // With nine values, the interval extends from the second to the eighth value: here from 0.96 to 1.02.
        let nine = Estimate::of(vec![0.5, 0.96, 0.99, 1.0, 1.0, 1.01, 1.01, 1.02, 9.0]).expect("values");
        assert!(nine.value == 1.0 && (nine.half_width - (1.0 / 0.96 - 1.0)).abs() < 1e-15 && nine.is_stable());
        let error = nine.standard_error().expect("an interval");
        assert!((NORMAL_95 * error / nine.value - nine.half_width).abs() < 1e-15);
        // A half-width exactly at the limit is stable. A slightly larger half-width is not.
        let at = |half_width: f64| Estimate { value: 3.7, half_width }.is_stable();
        assert!(at(STABLE) && !at(STABLE * 1.000_001) && !is_stable(1.0, None) && !is_stable(f64::NAN, Some(0.0)));
    }

    #[test]
    fn each_round_draws_every_candidate_once_in_a_new_order() {
        const CANDIDATES: usize = 5;
        let mut first = [0u32; CANDIDATES];
        let mut after = [[0u32; CANDIDATES]; CANDIDATES];
        let mut seen = std::collections::BTreeSet::new();
        for round in 0..MOST {
            let order = order(7, round, CANDIDATES);
            let mut sorted = order.clone();
            sorted.sort_unstable();
            assert_eq!(sorted, (0..CANDIDATES).collect::<Vec<_>>());
            first[order[0]] += 1;
            order.windows(2).for_each(|pair| after[pair[0]][pair[1]] += 1);
            seen.insert(order);
        }
        // H0: all orders are equally likely. Each of 120 orders occurs 8.3 times on average. One of them is missing with a probability of
        // 120 exp(-8.3) = 3 %, and three with a probability of less than 1e-5.
        assert!(seen.len() >= 118, "{} orders", seen.len());
        // A candidate is first in 200 of 1000 rounds on average, with a standard deviation of 12.6. A candidate also follows directly after another
        // given candidate in 200 rounds on average. There are 25 such numbers; four standard deviations leave a level of 0.2 % for all of them
        // together.
        let pairs = (0..CANDIDATES).flat_map(|a| (0..CANDIDATES).map(move |b| (a, b))).filter(|(a, b)| a != b);
        for count in first.into_iter().chain(pairs.map(|(a, b)| after[a][b])) {
            assert!((150..=250).contains(&count), "{first:?} {after:?}");
        }
        assert_eq!(order(7, 3, CANDIDATES), order(7, 3, CANDIDATES));
        assert!((0..20).any(|round| order(7, round, CANDIDATES) != order(8, round, CANDIDATES)), "the seed does not matter");
        assert_eq!((order(1, 1, 1), order(1, 1, 0)), (vec![0], Vec::new()));
    }

    #[test]
    fn quiet_times_take_the_fewest_rounds_and_the_first_is_not_timed() {
        let (samples, turns) = simulate(3, ENOUGH_S, 1, &mut |turn| if turn.round == 0 { 9999.0 } else { truth(turn.candidate) });
        assert_eq!(turns.len(), 3 * (1 + LEAST as usize));
        assert!(turns.chunks(3).all(|round| round[0].is_first && !round[1].is_first && !round[2].is_first));
        for candidate in 0..3 {
            let time = samples.time((candidate, PASS)).expect("a time");
            assert_eq!((time.value, time.half_width), (truth(candidate), 0.0));
            assert!((ratio(&samples, candidate).value - (candidate + 1) as f64).abs() < 1e-12);
        }
        assert_eq!(ratio(&samples, 0), Estimate { value: 1.0, half_width: 0.0 });
        assert_eq!(samples.keys().collect::<Vec<_>>(), [(0, PASS), (1, PASS), (2, PASS)]);
        assert!(samples.time((3, PASS)).is_none() && samples.ratio((0, PASS), (0, "lighting")).is_none());
    }

    #[test]
    fn restless_times_are_measured_until_the_budget_is_spent() {
        let mut random = Random(5);
        // The clock counts pictures, so a round of 3 candidates takes 3 s. Times that are drawn at random from 10 to 100 ms give no stable ratios
        // within the budget.
        let mut restless = |_: Turn| random.between(10.0, 100.0);
        let (samples, turns) = simulate(3, 60.0, 1, &mut restless);
        assert_eq!(turns.len(), 3 * (1 + 20), "the first round is not part of the budget");
        assert!((1..3).any(|candidate| !ratio(&samples, candidate).is_stable()));
        // A budget that is spent at once leaves the fewest rounds that give an interval.
        let (samples, turns) = simulate(3, 1e-3, 1, &mut restless);
        assert_eq!(turns.len(), 3 * (1 + LEAST as usize));
        assert!(ratio(&samples, 1).half_width.is_finite());
        // If the clock does not advance, the number of rounds is limited.
        let (count, wanted) = (Cell::new(0), [Wanted { of: (0, PASS), over: None }]);
        let plan = Plan { candidates: 1, wanted: &wanted, least: LEAST, budget_s: 60.0, seed: 1 };
        let stopped = measure(&plan, &|| f64::NAN, &|_, _| {}, &mut |turn| {
            count.set(count.get() + 1);
            Ok(vec![Timed { candidate: turn.candidate, pass: PASS.to_owned(), ms: if turn.round.is_multiple_of(2) { 1.0 } else { 2.0 } }])
        });
        assert!(stopped.is_ok() && count.get() == 1 + MOST);
    }

    #[test]
    fn disturbed_times_are_measured_until_they_are_stable() {
        for scatter in SCATTERS {
            let (mut random, mut is_busy) = (Random(11), false);
            let (samples, turns) = simulate(3, ENOUGH_S, 2, &mut |turn| truth(turn.candidate) * scatter.factor(&mut random, &mut is_busy));
            assert!((1..3).all(|candidate| ratio(&samples, candidate).is_stable()), "{scatter:?}");
            assert!(turns.len() > 3 * (1 + LEAST as usize) && turns.len() < 3 * MOST as usize, "{scatter:?}: {}", turns.len());
        }
    }

    #[test]
    fn intervals_contain_the_true_ratio() {
        // H0: for each scatter, the interval of a ratio contains the true ratio with a probability of at least 95 %, if rounds are added until the
        // interval is narrow enough. Family of 4 tests, level 0.001, Sidak. Each of 600 measurements gives one result: the interval of candidate 1.
        // Candidate 2 only delays the end of a measurement.
        const REPEATS: u64 = 600;
        let level = 1.0 - (1.0 - 0.001f64).powf(1.0 / 4.0);
        for scatter in SCATTERS {
            let (mut covered, mut covered_by_half) = (0, 0);
            for seed in 0..REPEATS {
                let (mut random, mut is_busy) = (Random(seed << 32), false);
                let (samples, _) =
                    simulate(3, ENOUGH_S, seed as u32, &mut |turn| truth(turn.candidate) * scatter.factor(&mut random, &mut is_busy));
                let Estimate { value, half_width } = ratio(&samples, 1);
                let distance = (value / 2.0).ln().abs() / half_width.ln_1p();
                covered += u64::from(distance <= 1.0);
                covered_by_half += u64::from(distance <= 0.5);
            }
            let p = |covered: u64| Binomial::new(0.95, REPEATS).expect("a probability").cdf(covered);
            assert!(p(covered) > level, "{scatter:?}: {covered} of {REPEATS}");
            // Negative control: an interval of half the width contains the true ratio too seldom.
            assert!(p(covered_by_half) < level, "{scatter:?}: {covered_by_half} of {REPEATS}");
        }
    }

    #[test]
    fn one_slow_picture_does_not_move_an_estimate() {
        for seed in 0..100u32 {
            let measured = |slow: f64| {
                let mut random = Random(u64::from(seed) << 32);
                let (samples, _) = simulate(3, ENOUGH_S, seed, &mut |turn| {
                    let is_slow = (turn.round, turn.candidate) == (4, 1);
                    truth(turn.candidate) * (0.005 * normal(&mut random)).exp() * if is_slow { slow } else { 1.0 }
                });
                samples
            };
            let mean = |samples: &Samples| {
                let times = samples.get((1, PASS)).expect("a time");
                times.values().sum::<f64>() / times.len() as f64
            };
            let (quiet, disturbed) = (measured(1.0), measured(10.0));
            let [before, after] = [&quiet, &disturbed].map(|samples| ratio(samples, 1));
            assert!((after.value / before.value - 1.0).abs() < 0.02 && after.is_stable(), "seed {seed}: {before:?}, {after:?}");
            // Negative control: the mean increases by more than 30 %.
            assert!(mean(&disturbed) > 1.3 * mean(&quiet), "seed {seed}");
        }
    }

    #[test]
    fn neither_a_drift_nor_a_neighbour_in_the_order_moves_an_estimate() {
        let mut random = Random(17);
        // With each picture, all times grow by 1 % of their initial values.
        let mut pictures = 0.0;
        let (samples, _) = simulate(4, ENOUGH_S, 3, &mut |turn| {
            pictures += 1.0;
            truth(turn.candidate) * (1.0 + 0.01 * pictures) * (0.01 * normal(&mut random)).exp()
        });
        for candidate in 1..4 {
            let found = ratio(&samples, candidate);
            assert!((found.value / (candidate + 1) as f64 - 1.0).abs() < 0.03 && found.is_stable(), "drift: {found:?}");
        }
        // A picture that is drawn directly after candidate 3 takes 30 % longer, because its textures are not in the cache. In a fixed order, this
        // would always be candidate 0.
        let mut before = 0;
        let (samples, _) = simulate(4, ENOUGH_S, 3, &mut |turn| {
            let is_cold = before == 3;
            before = turn.candidate;
            truth(turn.candidate) * (0.005 * normal(&mut random)).exp() * if is_cold { 1.3 } else { 1.0 }
        });
        for candidate in 1..3 {
            let found = ratio(&samples, candidate);
            assert!((found.value / (candidate + 1) as f64 - 1.0).abs() < 0.03 && found.is_stable(), "cache: {found:?}");
        }
    }

    #[test]
    fn nothing_to_measure_ends_at_once() {
        let count = Cell::new(0);
        let wanted = ratios(3);
        let plan = Plan { candidates: 3, wanted: &wanted, least: LEAST, budget_s: ENOUGH_S, seed: 1 };
        // A device without timestamps returns no times.
        let samples = measure(&plan, &|| 0.0, &|_, _| {}, &mut |_| {
            count.set(count.get() + 1);
            Ok(Vec::new())
        });
        assert_eq!((samples.expect("nothing fails"), count.get()), (Samples::default(), 3));
        // An error ends the work before the next picture.
        count.set(0);
        let stopped = measure(&plan, &|| 0.0, &|_, _| {}, &mut |_| {
            count.set(count.get() + 1);
            if count.get() == 5 {
                bail!("stopped");
            }
            Ok(vec![Timed { candidate: 0, pass: PASS.to_owned(), ms: 1.0 }])
        });
        assert!(stopped.is_err_and(|error| error.to_string() == "stopped") && count.get() == 5);
        // Without candidates there is nothing to draw.
        let plan = Plan { candidates: 0, wanted: &[], least: LEAST, budget_s: 1.0, seed: 1 };
        assert_eq!(measure(&plan, &|| 0.0, &|_, _| {}, &mut |_| bail!("drawn")).ok(), Some(Samples::default()));
    }

    #[test]
    fn one_candidate_is_measured_until_its_own_time_is_stable() {
        let mut random = Random(23);
        let wanted = [Wanted { of: (0, PASS), over: None }];
        let plan = Plan { candidates: 1, wanted: &wanted, least: LEAST, budget_s: ENOUGH_S, seed: 1 };
        let samples = measure(&plan, &|| 0.0, &|_, _| {}, &mut |turn| {
            Ok(vec![Timed { candidate: turn.candidate, pass: PASS.to_owned(), ms: 10.0 * (0.1 * normal(&mut random)).exp() }])
        });
        let samples = samples.expect("nothing fails");
        let time = samples.time((0, PASS)).expect("a time");
        assert!(time.is_stable() && (time.value - 10.0).abs() < 1.0, "{time:?}");
        assert_eq!(ratio(&samples, 0), Estimate { value: 1.0, half_width: 0.0 });
    }

    #[test]
    fn times_that_say_nothing_are_left_out() {
        // Candidate 1 has a valid time in every second round only. In the other rounds, its time is 0, negative, infinite or NaN, in turn.
        let nothing = [0.0, -1.0, f64::INFINITY, f64::NAN];
        let is_lost = |turn: Turn| turn.candidate == 1 && turn.round % 2 == 1;
        let (samples, turns) = simulate(2, ENOUGH_S, 1, &mut |turn| match is_lost(turn) {
            true => nothing[turn.round as usize / 2 % 4],
            false => truth(turn.candidate),
        });
        assert_eq!(turns.len(), 2 * (1 + 2 * LEAST as usize), "six rounds in which both have a time");
        assert_eq!(ratio(&samples, 1), Estimate { value: 2.0, half_width: 0.0 });
        // If a candidate has no valid time at all, the measurement ends when the budget is spent, and there is no estimate.
        let (samples, turns) = simulate(2, 40.0, 1, &mut |turn| if turn.candidate == 1 { 0.0 } else { 1.0 });
        assert!(turns.len() == 2 * (1 + 20) && samples.time((1, PASS)).is_none() && samples.ratio((1, PASS), (0, PASS)).is_none());
    }

    #[test]
    fn progress_never_goes_back_and_never_exceeds_the_whole() {
        let wanted = ratios(3);
        let plan = Plan { candidates: 3, wanted: &wanted, least: LEAST, budget_s: 200.0, seed: 1 };
        let (clock, steps, mut random) = (Cell::new(0.0), RefCell::new(Vec::new()), Random(29));
        let step = |done: u64, total: u64| steps.borrow_mut().push((done, total));
        let measured = measure(&plan, &|| clock.get(), &step, &mut |turn| {
            clock.set(clock.get() + 1.0);
            Ok(vec![Timed { candidate: turn.candidate, pass: PASS.to_owned(), ms: random.between(10.0, 100.0) }])
        });
        let steps = steps.into_inner();
        assert!(measured.is_ok() && steps.len() == 3 * (1 + 67), "{}", steps.len());
        assert!(steps.is_sorted() && steps.iter().all(|(done, total)| done <= total && *total == STEPS));
        assert!(steps[0].0 == 0 && steps.last().is_some_and(|(done, _)| *done > 900), "{:?}", steps.last());
    }
}
