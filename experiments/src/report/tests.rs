//! Tests of whole reports. Reports of several kinds of runs must be consistent, and the numbers in their tables and plots must be in the rows.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use super::checks::Mark::{Fails, Passes, Unclear};
use super::columns::{self, Cell, Source, Standing};
use super::fake::{self, FREEDOM, Folder, LIT, NOISES, Rows, base, definition};
use super::summary::{ADDED, BIAS, CLUMPING, Key, PERCEIVED, REJECTIONS, RMSE, SHADING, Table};
use super::{RunData, Verdict, markdown, read_run, run, verdict, write_run};
use crate::row::Row;
use kernels::shading::Estimator;

/// Returns a run for each form of report, with its folder and its verdicts.
fn shapes() -> Vec<(Folder, RunData, Vec<Verdict>)> {
    type Make = fn(&Path) -> RunData;
    let all: [(&str, Make, Vec<Verdict>); 8] = [
        ("one", fake::one, Vec::new()),
        ("variants", |folder| fake::variants(folder, &["cliff"], &NOISES), Vec::new()),
        ("views", |folder| fake::variants(folder, &["cliff", "ground", "vista"], &NOISES), Vec::new()),
        ("plain", |folder| fake::variants(folder, &["cliff"], &["hashed"]), Vec::new()),
        ("hash-scale", fake::hash_scale, fake::verdicts()),
        ("temporal", |folder| fake::temporal(folder, &NOISES), Vec::new()),
        ("resolve", |folder| fake::temporal(folder, &["hashed"]), Vec::new()),
        ("estimators", fake::estimators, Vec::new()),
    ];
    all.into_iter()
        .map(|(name, make, verdicts)| {
            let folder = Folder::new(name);
            let run = make(folder.path());
            (folder, run, verdicts)
        })
        .collect()
}

fn html(run: &RunData, verdicts: &[Verdict]) -> String {
    let table = Table::of(run);
    run::page(run, &table, verdicts, &verdict::verdict(&table)).expect("drawn")
}

fn text(run: &RunData, verdicts: &[Verdict]) -> String {
    let table = Table::of(run);
    markdown::text(run, &table, verdicts, &verdict::verdict(&table))
}

/// Returns the attributes and the content of each element with this name. Elements without attributes are left out.
fn elements<'a>(html: &'a str, name: &str) -> Vec<(&'a str, &'a str)> {
    let (open, close) = (format!("<{name} "), format!("</{name}>"));
    let parts = html.split(&open[..]).skip(1);
    parts.filter_map(|part| Some((part.split_once('>')?.0, part.split_once('>')?.1.split(&close[..]).next()?))).collect()
}

fn attribute<'a>(attributes: &'a str, name: &str) -> Option<&'a str> {
    let rest = attributes.split_once(&format!("{name}=\""))?.1;
    Some(rest.split_once('"')?.0)
}

/// The columns that identify a number of a choice: metric, signal, lag and frequency. Only rows of spectra have a frequency.
type Name = (String, String, Option<u32>, Option<u64>);

/// The values of rows over all frames, by key and name.
type Known = BTreeMap<(Key, Name), f64>;

fn known(run: &RunData) -> Known {
    // If a number has no row over all frames, the row of a single frame is used. In these runs, such a number has only one row.
    let all = || run.rows.iter().chain(&run.times);
    all()
        .filter(|r| r.frame.is_some())
        .chain(all().filter(|r| r.frame.is_none()))
        .map(|r| ((Key::of(r), (r.metric.clone(), r.signal.clone(), r.lag, r.frequency.map(f64::to_bits))), r.value))
        .collect()
}

/// Returns the table cells, and the marks of plots, whose values are not in the rows.
fn untraceable(html: &str, run: &RunData) -> Vec<String> {
    let known = known(run);
    let mut lost = Vec::new();
    let table = html.split("<table class=\"all\">").nth(1).and_then(|t| t.split("</table>").next()).expect("a table");
    let heads: Vec<Option<Name>> = elements(table, "th")
        .iter()
        .map(|(attributes, _)| {
            let signal = attribute(attributes, "data-signal").unwrap_or_default().to_owned();
            let lag = attribute(attributes, "data-lag").and_then(|k| k.parse().ok());
            Some((attribute(attributes, "data-metric")?.to_owned(), signal, lag, None))
        })
        .collect();
    let mut keys: BTreeMap<String, Key> = BTreeMap::new();
    for (attributes, cells) in elements(table, "tr") {
        let column = |name: &str| attribute(attributes, &format!("data-{name}")).unwrap_or_default().to_owned();
        let key = Key {
            experiment: column("experiment"),
            scene: column("scene"),
            view: column("view"),
            variant: column("variant"),
            estimator: column("estimator"),
            noise: column("noise"),
            temporal: column("temporal"),
            parameter: column("parameter"),
            setting: column("setting"),
        };
        keys.insert(attribute(attributes, "id").expect("an anchor").to_owned(), key.clone());
        // Only cells and headings of numeric columns have attributes, so `elements` finds no others. The cells of a row have the same order as the
        // headings.
        let numbers = elements(cells, "td");
        assert_eq!(numbers.len(), heads.len(), "{attributes}");
        for ((attributes, _), name) in numbers.iter().zip(&heads) {
            let Some(shown) = attribute(attributes, "data-v").map(|v| v.parse::<f64>().expect("a number")) else { continue };
            let found = match name {
                Some(name) => known.get(&(key.clone(), name.clone())).copied(),
                // A column without a metric shows the promised fetches.
                None => key.variant.parse::<kernels::variant::Variant>().map(|v| f64::from(Estimator::Fc5.promised_fetches_of(v))).ok(),
            };
            if found != Some(shown) {
                lost.push(format!("{}: {name:?} = {shown}, rows say {found:?}", key.words()));
            }
        }
    }
    // The y of a mark must be the value of a row of its choice. The x must also be such a value, or the setting, a lag or a frequency of the choice.
    let mut of_choices: BTreeMap<&Key, Vec<_>> = BTreeMap::new();
    for ((key, (_, _, lag, frequency)), &value) in &known {
        of_choices.entry(key).or_default().push((*lag, *frequency, value));
    }
    for (anchor, mark) in html.split("<a href=\"#").skip(1).filter_map(|m| m.split_once("\"><circle ")) {
        let (attributes, _) = mark.split_once('>').expect("a whole mark");
        let value = |name: &str| attribute(attributes, name).and_then(|v| v.parse::<f64>().ok()).expect("a number");
        let key = keys.get(anchor).unwrap_or_else(|| panic!("no row has the anchor {anchor}"));
        let (x, y) = (value("data-x"), value("data-y"));
        let of_choice = of_choices.get(key).map_or(&[][..], Vec::as_slice);
        let is = |value: f64| of_choice.iter().any(|(.., v)| v.to_bits() == value.to_bits());
        let is_set = !of_choice.is_empty() && key.setting.parse() == Ok(x);
        let axis = is_set || of_choice.iter().any(|(lag, frequency, _)| lag.map(f64::from) == Some(x) || *frequency == Some(x.to_bits()));
        if !is(y) || !(is(x) || axis) {
            lost.push(format!("{}: a mark at {x}, {y}", key.words()));
        }
    }
    lost
}

#[test]
fn every_number_shown_is_in_the_rows() {
    for (folder, mut run, verdicts) in shapes() {
        let html = html(&run, &verdicts);
        let marks = html.matches("class=\"hit\"").count();
        assert!(html.matches("data-v=").count() > 1 && marks > 0, "{}: {marks}", folder.path().display());
        assert_eq!(untraceable(&html, &run), [""; 0], "{}", folder.path().display());
        // Negative control: the value of one row is changed after the page was made. Both the table and the plots must then contain values without a
        // row.
        let shown = Table::of(&run).shown.name();
        let is_shown = |r: &&mut Row| r.metric == "rmse" && r.frame.is_none() && r.signal == shown;
        let changed = run.rows.iter_mut().find(is_shown).expect("a row");
        changed.value *= 1.0 + 1e-9;
        let lost = untraceable(&html, &run);
        assert!(lost.iter().any(|l| l.contains("(\"rmse\"")) && lost.iter().any(|l| l.contains("a mark at")), "{lost:?}");
    }
}

#[test]
fn every_shape_makes_a_whole_page_and_a_text() {
    for (folder, run, verdicts) in shapes() {
        fake::pictures(folder.path(), [640, 360], &[("reference", 1), ("frame", 6), ("residual-map", 6)]);
        let written = write_run(&run, &verdicts).expect("written");
        let html = fs::read_to_string(&written.page).expect("a page");
        let name = folder.path().display();
        assert!(html.len() < 8 << 20, "{name}: {} bytes", html.len());
        assert!(
            html.contains("Which &lt;blend&gt; is cheapest &amp; good?") && !html.contains("<blend>") && !html.contains("a<b"),
            "{name}"
        );
        // The page loads no other file: all references are links within the page or data URLs.
        let outside = |mark: &str| html.split(mark).skip(1).filter(|rest| !rest.starts_with('#') && !rest.starts_with("data:")).count();
        assert_eq!([outside("href=\""), outside("src=\"")], [0, 0], "{name}");
        for tag in ["section", "table", "figure", "details", "svg", "tr", "td"] {
            let opened = html.matches(&format!("<{tag} ")).count() + html.matches(&format!("<{tag}>")).count();
            assert_eq!(opened, html.matches(&format!("</{tag}>")).count(), "{name}: {tag}");
        }
        let order = [
            "class=\"verdict\"",
            "id=\"analysis\"",
            "id=\"expectations\"",
            "id=\"facts\"",
            "id=\"choices\"",
            "id=\"pictures\"",
            "id=\"numbers\"",
        ];
        let places: Vec<usize> = order.iter().map(|mark| html.find(mark).unwrap_or_else(|| panic!("{name} has no {mark}"))).collect();
        assert!(places.is_sorted(), "{name}: {places:?}");
        // Encoded pictures can contain "NaN" or "inf" by chance. The page is therefore searched for each word together with a character before it.
        assert!([">NaN", " NaN", "\"NaN", ">inf", " inf "].iter().all(|word| !html.contains(word)), "{name}");
        let text = fs::read_to_string(folder.path().join("report.md")).expect("a text");
        assert!(text.contains("\\<blend\\>") && text.contains("## Set-up") && !text.contains("NaN"), "{text}");
        // In each table of the Markdown text, all lines have the same number of cells.
        let mut widths: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        let mut block = 0;
        for line in text.lines() {
            if line.starts_with('|') {
                widths.entry(block).or_default().push(line.replace("\\|", "").matches('|').count());
            } else {
                block += 1;
            }
        }
        assert!(widths.values().all(|w| w.iter().all(|n| *n == w[0])), "{name}: {widths:?}");
    }
}

#[test]
fn the_text_is_cut_to_fronts_and_single_variants() {
    let (variants, plain) = (Folder::new("cut"), Folder::new("cut-plain"));
    let all = text(&fake::variants(variants.path(), &["cliff"], &NOISES), &[]);
    let choices = all.split("## Choices").nth(1).expect("a table").lines().filter(|l| l.starts_with('|')).count() - 2;
    // There are 42 rows that must be in the table: `auto`, `generic` and the five single flavours, each with six noises. Choices on a front are in
    // the table, too.
    assert!((42..90).contains(&choices), "{choices}");
    assert!(all.contains(&format!("The table shows {choices} of 198 choices")), "{all}");
    assert!(!all.contains("| vt+near-cliff+far-cliff+splat |"));
    // A small table is not shortened.
    let few = text(&fake::estimators(plain.path()), &[]);
    assert_eq!(few.split("## Choices").nth(1).expect("a table").lines().filter(|l| l.starts_with('|')).count(), 8 + 2);
    assert!(!few.contains("The table shows"));
}

#[test]
fn splat_promises_twice_as_much_where_it_has_two_tilings() {
    let folder = Folder::new("tilings");
    let mut run = fake::variants(folder.path(), &["cliff"], &NOISES[..1]);
    for row in run.rows.iter_mut().filter(|row| row.metric == "fetches_per_px" && row.variant == "splat") {
        row.value = 96.0;
    }
    let splat = |run: &RunData| columns::golden(run, &Table::of(run)).into_iter().find(|row| row.flavour == "splat").expect("it is there");
    assert!(!splat(&run).agrees);
    run.definition.settings.insert("frame.two_tilings".to_owned(), toml::Value::Boolean(true));
    let row = splat(&run);
    assert!(row.agrees && row.promised == "96", "{row:?}");
    let others = columns::golden(&run, &Table::of(&run));
    assert!(others.len() == 5 && others.iter().all(|row| row.agrees), "{others:?}");
}

#[test]
fn whole_rows_win_over_frames_and_frames_are_averaged_without_them() {
    let frames = |values: &[f64], whole: Option<f64>| {
        let mut rows = Rows::new();
        let base = Row { signal: "albedo".to_owned(), ..base("cliff") };
        for (frame, value) in (0..).zip(values) {
            rows.put(&Row { frame: Some(frame), ..base.clone() }, "rmse", "linear albedo", *value, None);
        }
        if let Some(value) = whole {
            rows.put(&base, "rmse", "linear albedo", value, Some(0.1));
        }
        fake::run(definition("frames = 2\nvariants = [\"auto\"]"), rows, Path::new("."))
    };
    let value = |run: &RunData| Table::of(run).summaries[0].value(RMSE);
    assert_eq!(value(&frames(&[1.0, 3.0], None)), 2.0);
    assert_eq!(value(&frames(&[1.0, 3.0], Some(7.0))), 7.0);
    // If only one frame has a row, the value is not a mean, so the standard error is kept.
    let mut last = frames(&[4.0], None);
    last.rows[0].standard_error = Some(0.5);
    assert_eq!((value(&last), Table::of(&last).summaries[0].error(RMSE), Table::of(&last).averaged), (4.0, Some(0.5), 0));
    assert!(html(&last, &[]).contains("standard error 0.5, frame 0"));
    // NaN values are omitted from a mean. The page gives the number of values that were used, and a check names the rows that were left out.
    let run = frames(&[1.0, f64::NAN, 3.0], None);
    assert_eq!(value(&run), 2.0);
    assert!(
        html(&run, &[]).contains("mean over 2 of 3 frames") && html(&run, &[]).contains("means over the frames, computed by this report")
    );
    assert!(html(&run, &[]).contains("<li class=\"bad\">1 row holds no number (NaN) and is left out: rmse (albedo) of auto, frame 1</li>"));
    let run = frames(&[f64::NAN; 5], None);
    assert!(value(&run).is_nan());
    assert!(
        text(&run, &[])
            .contains("5 rows hold no number (NaN) and are left out: rmse (albedo) of auto, frame 0; rmse (albedo) of auto, frame 1; ")
    );
    assert!(text(&run, &[]).contains("frame 2; and 2 more"));
    // If a number has two rows, the first is used, and a check of the report fails.
    let mut run = frames(&[], Some(7.0));
    run.rows.push(Row { value: 8.0, ..run.rows[0].clone() });
    assert_eq!((value(&run), Table::of(&run).doubles), (7.0, 1));
    assert!(html(&run, &[]).contains("<li class=\"bad\">rows that repeat a number of an earlier row, and are ignored: 1"));
    // A second row of a frame is ignored and counted, too. It would otherwise shift the mean.
    for again in 0..2 {
        let mut run = frames(&[1.0, 3.0], None);
        run.rows.push(Row { value: 8.0, ..run.rows[again].clone() });
        assert_eq!((value(&run), Table::of(&run).doubles), (2.0, 1));
    }
}

#[test]
fn missing_numbers_are_dashes_with_their_reason() {
    let folder = Folder::new("missing");
    let run = fake::variants(folder.path(), &["cliff"], &NOISES);
    let page = html(&run, &[]);
    assert!(page.contains("title=\"timed with the first noise only\">\u{2013}</td>"));
    assert!(page.contains("title=\"tiles have different variants, so nothing is promised\">\u{2013}</td>"));
    assert!(page.contains("A dash means that there is no number.") && page.contains("Shading: timed with the first noise only"));
    assert!(text(&run, &[]).contains("Shading: timed with the first noise only"));
    let reason = |run: &RunData, index: usize, source: Source| match columns::cell(run, &Table::of(run), index, source) {
        Cell::Missing(reason) => reason,
        Cell::Value { shown, .. } => panic!("{shown}"),
    };
    // A value of NaN gets a reason that differs from the reason for a missing row.
    let mut lost = run.clone();
    lost.rows.iter_mut().filter(|r| r.metric == "rmse" && r.frame.is_none()).for_each(|r| r.value = f64::NAN);
    assert_eq!(reason(&lost, 0, Source::Row(RMSE)), "the value in its row is NaN");
    lost.rows.retain(|r| r.metric != "rmse");
    assert_eq!(reason(&lost, 0, Source::Row(RMSE)), "no row of this metric");
    lost.definition.metrics = vec!["flip".to_owned()];
    assert_eq!(reason(&lost, 0, Source::Row(RMSE)), "not among the definition's metrics");
    lost.rows.retain(|r| !["bias", "added", "perceived_noise"].contains(&r.metric.as_str()));
    (lost.definition.seeds, lost.definition.frames) = (0, 1);
    assert_eq!(reason(&lost, 0, Source::WithError(BIAS)), "not measured: seeds = 0");
    assert_eq!([ADDED, PERCEIVED].map(|metric| reason(&lost, 0, Source::Row(metric))), ["not measured: one frame"; 2]);
    let resolved = fake::temporal(folder.path(), &["hashed"]);
    assert_eq!(reason(&resolved, 1, Source::Row(REJECTIONS)), "measured only without a resolve");
    lost.definition.times = crate::definition::Times::None;
    lost.times.clear();
    assert_eq!(reason(&lost, 0, Source::ShadingRatio), "not timed: times = \"none\"");
    // A column without any number is not shown, but its heading is named below the table.
    assert!(html(&lost, &[]).contains("Columns without any number: Shading, RMSE, Bias \u{b1} s.e., Added, Perceived noise."));
    // A picture that equals the reference has an infinite PSNR, which must be shown as a number.
    let mut same = run.clone();
    same.rows.iter_mut().filter(|r| r.metric == "psnr").for_each(|r| r.value = f64::INFINITY);
    assert!(html(&same, &[]).contains("data-v=\"Infinity\""));
    // Entries that the manifest lacks are reported as not recorded.
    let mut bare = run.clone();
    bare.manifest = serde_json::json!({});
    assert!(html(&bare, &[]).contains("not recorded in manifest.json") && !html(&bare, &[]).contains("software adapter"));
}

#[test]
fn unstable_times_are_marked_and_lie_on_no_front() {
    let folder = Folder::new("unstable");
    let mut run = fake::variants(folder.path(), &["cliff"], &["hashed"]);
    let shown = |run: &RunData, index: usize| match columns::cell(run, &Table::of(run), index, Source::ShadingRatio) {
        Cell::Value { shown, .. } => shown,
        Cell::Missing(reason) => panic!("{reason}"),
    };
    let stable = Table::of(&run);
    let rows = stable.of_view("cliff");
    let fronts = |table: &Table| [SHADING, table.cost].map(|cost| table.front(&rows, cost, RMSE));
    let [by_time, by_fetches] = fronts(&stable);
    let base = stable.shading_base("cliff").expect("the first timed choice");
    assert_eq!((base, shown(&run, base).as_str()), (0, "1.00"));
    let index = by_time.points.iter().copied().find(|&i| i != base).expect("the front has several choices");
    assert!(shown(&run, index).contains(" \u{b1} ") && !shown(&run, index).contains("unstable"), "{}", shown(&run, index));
    assert!(!html(&run, &[]).contains("are unstable"));
    let variant = stable.summaries[index].key.variant.clone();
    let mut spread = |error: Option<f64>| {
        let row = run.times.iter_mut().find(|row| row.metric == SHADING.name && row.variant == variant).expect("a row");
        row.standard_error = error.map(|share| share * row.value);
        run.clone()
    };
    // 1.96 standard errors of 2.6 % are 5.1 %, so the time is unstable. Its choice leaves the front whose cost is the time, but not the front whose
    // cost is the number of fetches.
    for (error, words) in [(Some(0.026), "unstable (\u{b1} 5.1 %)"), (None, "unstable (no interval)")] {
        let run = spread(error);
        let table = Table::of(&run);
        assert!(shown(&run, index).ends_with(words), "{}", shown(&run, index));
        let [without, as_before] = fronts(&table);
        assert!(!without.contains(index) && !without.is_alike(index) && as_before == by_fetches, "{without:?}");
        assert_eq!(table.unstable(&rows), (1, 33));
        assert!(
            html(&run, &[]).contains("1 of 33 times are unstable (95 % interval wider than \u{b1} 5 %) and take no part in the front.")
        );
        assert!(text(&run, &[]).contains("1 of 33 shading times are unstable"));
    }
    assert_eq!(fronts(&Table::of(&spread(Some(0.025))))[0], by_time);
}

#[test]
fn times_of_other_settings_are_divided_without_an_interval() {
    let mut rows = Rows::new();
    for (setting, auto, splat) in [("4", 10.0, 40.0), ("8", 15.0, 45.0)] {
        for (variant, ms, rmse) in [("auto", auto, 0.02), ("splat", splat, 0.01)] {
            let row = Row { variant: variant.to_owned(), parameter: "frame.tile".to_owned(), setting: setting.to_owned(), ..base("cliff") };
            rows.put(&row, "rmse", "linear albedo", rmse, None);
            rows.times(&row, ms, auto);
        }
    }
    let varied = "frames = 1\nvariants = [\"auto\", \"splat\"]\nviews = [\"cliff\"]\n[vary]\nparameter = \"frame.tile\"\nvalues = [4, 8]";
    let run = fake::run(definition(varied), rows, Path::new("."));
    let table = Table::of(&run);
    let order: Vec<(&str, &str)> = table.summaries.iter().map(|s| (s.key.variant.as_str(), s.key.setting.as_str())).collect();
    assert_eq!(order, [("auto", "4"), ("auto", "8"), ("splat", "4"), ("splat", "8")]);
    // The rows of setting 8 contain the ratios to `auto` with setting 8: 1 and 3. The table divides by the 10 ms of `auto` with setting 4.
    let ratios: Vec<(f64, bool)> = (0..4).filter_map(|i| table.shading(i)).map(|shading| (shading.ratio, shading.is_stable())).collect();
    assert_eq!(ratios, [(1.0, true), (1.5, false), (4.0, true), (4.5, false)]);
    assert_eq!(table.front(&[0, 1, 2, 3], SHADING, RMSE).points, [0, 2]);
    assert_eq!(table.unstable(&[0, 1, 2, 3]), (0, 2), "such a ratio is not interleaved, which differs from unstable");
    let page = html(&run, &[]);
    assert!(
        page.contains("1.50, not interleaved") && page.contains("2 times of other values of frame.tile were not interleaved"),
        "{page}"
    );
}

#[test]
fn every_mark_can_be_red() {
    let folder = Folder::new("marks");
    let good = fake::variants(folder.path(), &["cliff"], &["hashed"]);
    let marks = |run: &RunData, verdicts: &[Verdict]| {
        let checks = columns::checks(run, &Table::of(run), verdicts);
        let page = html(run, verdicts);
        let text = text(run, verdicts);
        for (result, words) in &checks {
            let (class, sign) = match result {
                Passes => ("good", '\u{2705}'),
                Fails => ("bad", '\u{274c}'),
                Unclear => ("unclear", '\u{2754}'),
            };
            assert!(page.contains(&format!("<li class=\"{class}\">{}</li>", super::html::escape(words))), "{words}");
            assert!(text.contains(&format!("- {sign} ")), "{words}");
        }
        checks.iter().map(|c| c.0).collect::<Vec<_>>()
    };
    // The six checks: accuracy of the references, promised fetches, bias, variance, invalid pixels, share of pixels that can be followed from frame
    // to frame.
    assert_eq!(marks(&good, &[]), [Passes; 6]);
    let with = |change: &dyn Fn(&mut RunData)| {
        let mut run = good.clone();
        change(&mut run);
        marks(&run, &[])
    };
    let scale = |run: &mut RunData, metric: &str, variant: &str, factor: f64| {
        run.rows.iter_mut().filter(|r| r.metric == metric && r.variant == variant).for_each(|r| r.value *= factor);
    };
    let put = |run: &mut RunData, metric: &str, variant: &str, value: f64, error: f64| {
        let rows = run.rows.iter_mut().filter(|r| r.metric == metric && r.variant == variant);
        rows.for_each(|r| (r.value, r.standard_error) = (value, Some(error)));
    };
    assert_eq!(with(&|run| scale(run, "reference_se", "reference", 10.0)), [Fails, Passes, Passes, Passes, Passes, Passes]);
    assert_eq!(with(&|run| scale(run, "fetches_per_px", "near-cliff", 1.1)), [Passes, Fails, Passes, Passes, Passes, Passes]);
    assert_eq!(with(&|run| put(run, "bias", "near-cliff", 1e-3, 1.5e-5)), [Passes, Passes, Fails, Passes, Passes, Passes]);
    assert_eq!(with(&|run| scale(run, "exact_mse", "near-cliff", 2.0)), [Passes, Passes, Passes, Fails, Passes, Passes]);
    // Biases of compositions are not tested, because they follow from those of the flavours.
    assert_eq!(with(&|run| put(run, "bias", "auto", 1e-3, 1.5e-5)), [Passes; 6]);
    // A check without enough data is `Unclear`.
    assert_eq!(with(&|run| put(run, "bias", "far-cliff", 0.0, 0.1)), [Passes, Passes, Unclear, Passes, Passes, Passes]);
    // A seventh check names rows whose value is NaN.
    assert_eq!(with(&|run| scale(run, "exact_mse", "far-cliff", f64::NAN)), [Passes, Passes, Passes, Unclear, Passes, Passes, Fails]);
    let invalid = |run: &mut RunData| {
        let is_count = |r: &&mut Row| r.metric == "invalid_px" && r.variant == "vt+splat" && r.signal == "lit";
        run.rows.iter_mut().find(is_count).expect("a count").value = 17.0;
    };
    assert_eq!(with(&invalid), [Passes, Passes, Passes, Passes, Fails, Passes]);
    let mut with_invalid = good.clone();
    invalid(&mut with_invalid);
    let words = "1 sequence has terrain pixels whose colour is not finite, which are left out of all metrics of colours: vt+splat, lit: 17";
    assert!(html(&with_invalid, &[]).contains(&format!("<li class=\"bad\">{words}</li>")));
    // The check of the references also fails if their accuracy is unknown.
    let lost = with(&|run| run.rows.retain(|r| !r.metric.starts_with("reference_")));
    assert_eq!(lost, [Fails, Passes, Passes, Passes, Passes, Passes]);
    let mut without = good.clone();
    without.rows.retain(|r| !r.metric.starts_with("reference_"));
    assert!(html(&without, &[]).contains("<td class=\"bad\">its standard error is not known</td>"));
    let mut poor = good.clone();
    scale(&mut poor, "reference_se", "reference", 10.0);
    assert!(
        html(&poor, &[]).contains("<td class=\"bad\">not accurate enough</td>")
            && html(&good, &[]).contains("<td class=\"good\">suffices</td>")
    );
    let mut broken = good.clone();
    scale(&mut broken, "fetches_per_px", "near-cliff", 1.1);
    assert!(html(&broken, &[]).contains("<td class=\"bad\">differs</td>") && !html(&good, &[]).contains("<td class=\"bad\">"));
    // The check of expectations has three cases: all are met, one is not met, one has no verdict.
    let met: Vec<Verdict> = fake::verdicts().into_iter().take(1).collect();
    assert_eq!([marks(&good, &met)[0], marks(&good, &fake::verdicts())[0]], [Passes, Fails]);
    let open = fake::hash_scale(folder.path());
    let page = html(&open, &met);
    assert!(page.contains("1 of 2 expectations are met"));
    assert!(
        page.contains("<td class=\"bad nowrap\">not met</td><td>Nobody judged &lt;this&gt;</td>")
            && page.contains("<td class=\"good nowrap\">met</td>")
    );
    assert!(text(&open, &met).contains("| \u{274c} | Nobody judged \\<this\\> | clumping | \u{2013} | 2 to 9 | not judged |"));
}

#[test]
fn several_views_are_kept_apart() {
    let folder = Folder::new("apart");
    let run = fake::variants(folder.path(), &["cliff", "ground"], &["hashed"]);
    let table = Table::of(&run);
    // The reference of the second view is not accurate enough, but that of the first is. Each view has its own Pareto front.
    assert_eq!(
        table.references.iter().map(|r| (r.view.as_str(), r.signal.name(), r.suffices())).collect::<Vec<_>>(),
        [("cliff", "albedo", true), ("cliff", "lit", true), ("ground", "albedo", false), ("ground", "lit", false)]
    );
    let fronts = columns::fronts(&table);
    assert!(table.views.iter().all(|view| table.of_view(view).iter().any(|&i| fronts[i].error == Standing::On)));
    assert!(html(&run, &[]).matches("<details class=\"view\" open>").count() > 2);
}

#[test]
fn the_lit_picture_is_ranked_and_shown_where_it_is_measured() {
    let folder = Folder::new("lit");
    let run = fake::variants(folder.path(), &["cliff"], &["hashed"]);
    let albedo = |metric: &str| {
        let is_it = |r: &&Row| r.metric == metric && r.variant == "auto" && r.frame.is_none() && r.signal == "albedo";
        run.rows.iter().find(is_it).expect("a row").value
    };
    let auto = |run: &RunData| {
        let table = Table::of(run);
        let summary = table.summaries.iter().find(|s| s.key.variant == "auto").expect("it is there").clone();
        (summary.value(RMSE), summary.value(BIAS), table.shown.name())
    };
    assert_eq!(auto(&run), (albedo("rmse") * LIT, albedo("bias"), "lit"));
    assert!(html(&run, &[]).contains("title=\"rmse, lit\">RMSE<small>lit</small>") && text(&run, &[]).contains("| RMSE (lit) |"));
    assert!(html(&run, &[]).contains("title=\"added, lit, lag 1\">Added<small>lit, k = 1</small>"));
    assert!(html(&run, &[]).contains("title=\"bias, albedo\">Bias"), "theory exists for albedo only");
    assert!(
        text(&run, &[]).contains("- Signals: albedo, lit; shown: lit; lit with exposure 0 stops and tone curve reinhard; perceived noise at 60 frames per second and 67 pixels")
    );
    // A run that measures only albedo.
    let mut plain = run.clone();
    plain.rows.retain(|r| r.signal != "lit");
    assert_eq!(auto(&plain), (albedo("rmse"), albedo("bias"), "albedo"));
    assert!(html(&plain, &[]).contains("title=\"rmse, albedo\">RMSE<small>albedo</small>"));
}

#[test]
fn a_varied_exposure_is_not_said_to_be_fixed() {
    let varied = |parameter: &str, values: [&str; 2], list: &str| {
        let mut rows = Rows::new();
        for setting in values {
            let row = Row { parameter: parameter.to_owned(), setting: setting.to_owned(), ..base("cliff") };
            rows.put(&row, "rmse", "", 0.02, None);
        }
        let vary = format!("frames = 1\nvariants = [\"auto\"]\nviews = [\"cliff\"]\n[vary]\nparameter = \"{parameter}\"\nvalues = {list}");
        text(&fake::run(definition(&vary), rows, Path::new(".")), &[])
    };
    let exposure = varied("frame.exposure", ["0.0", "2.0"], "[0.0, 2.0]");
    assert!(exposure.contains("; lit with tone curve reinhard") && !exposure.contains("lit with exposure"), "{exposure}");
    assert!(exposure.contains("frame.exposure: 0.0, 2.0"), "{exposure}");
    let curve = varied("frame.tone_curve", ["reinhard", "clip"], "[\"reinhard\", \"clip\"]");
    assert!(curve.contains("; lit with exposure 0 stops") && !curve.contains("and tone curve"), "{curve}");
}

#[test]
fn perceived_noise_of_a_short_sequence_is_marked() {
    let hint = |frames: u32| {
        let mut rows = Rows::new();
        rows.put(&base("cliff"), "perceived_noise", "", 0.002, None);
        let run = fake::run(definition(&format!("frames = {frames}\nvariants = [\"auto\"]")), rows, Path::new("."));
        let table = Table::of(&run);
        match columns::cell(&run, &table, 0, Source::Row(PERCEIVED)) {
            Cell::Value { hint, .. } => hint,
            Cell::Missing(why) => panic!("{why}"),
        }
    };
    assert!(hint(5).ends_with("too high for noise that changes in every frame, because the sequence is too short"), "{}", hint(5));
    assert!(!hint(16).contains("too short"), "{}", hint(16));
}

#[test]
fn reference_sequences_of_resolves_are_told_apart() {
    let folder = Folder::new("resolved");
    let run = fake::temporal(folder.path(), &["hashed"]);
    let table = Table::of(&run);
    // The rows of these sequences differ only in the resolve, so none of them counts as a repetition of another.
    assert_eq!((table.doubles, table.references.len()), (0, 2));
    let differences: Vec<(&str, f64)> = table.references[0].differences.iter().map(|(resolve, d)| (resolve.as_str(), *d)).collect();
    assert_eq!(differences, [("", 0.0011), ("exponential", 0.0007), ("flipquad", 0.0007)]);
    let page = html(&run, &[]);
    assert!(page.contains("Difference, k = 1</th>") && page.contains("Difference, k = 1, exponential</th>"));
    assert!(page.contains("<td>lit</td>") && page.contains("<td>albedo</td>"));
}

#[test]
fn choices_within_chance_of_a_front_are_marked() {
    let mut rows = Rows::new();
    for (variant, fetches, added) in [("far-atlas", 2.0, 0.004), ("near-cliff", 12.0, 0.0035), ("splat", 48.0, 0.003), ("vt", 49.0, 0.0036)]
    {
        let row = Row { variant: variant.to_owned(), signal: "albedo".to_owned(), ..base("cliff") };
        rows.put(&row, "fetches_per_px", "samples", fetches, None);
        rows.put(&row, "rmse", "linear albedo", added, None);
        rows.put(&Row { lag: Some(1), ..row }, "added", "luminance", added, Some(0.0002));
    }
    let run = fake::run(definition("frames = 16\nvariants = [\"all\"]"), rows, Path::new("."));
    let table = Table::of(&run);
    let names = |table: &Table| -> BTreeMap<String, String> {
        table.summaries.iter().zip(columns::fronts(table)).map(|(s, front)| (s.key.variant.clone(), front.name())).collect()
    };
    // RMSE has no standard errors, so each of the first three choices is on the front of cost against error. Chance explains why near cliff adds less
    // change than the far atlas, and why it adds more than splat.
    let expected = [("far-atlas", "error, added"), ("near-cliff", "error, (added)"), ("splat", "error, added"), ("vt", "")];
    assert_eq!(names(&table), BTreeMap::from(expected.map(|(variant, front)| (variant.to_owned(), front.to_owned()))));
    let page = html(&run, &[]);
    assert!(
        page.contains("<td>error, (added)</td>") && page.contains("The standard errors of RMSE are not known, so the values are compared")
    );
    assert!(page.contains(
        "A choice is on the line if its added change is smaller than that of every cheaper choice on the line by more than chance"
    ));
    assert!(text(&run, &[]).contains("A front in brackets: the choice is not on that front"));
}

#[test]
fn intervals_follow_from_the_degrees_of_freedom() {
    let half = |frames: u32, metric: &str, lag: Option<u32>| {
        let mut rows = Rows::new();
        let row = Row { signal: "albedo".to_owned(), lag, ..base("cliff") };
        rows.put(&row, metric, "", 1.0, Some(1.0));
        let run = fake::run(definition(&format!("frames = {frames}\nseeds = 8\nvariants = [\"auto\"]")), rows, Path::new("."));
        let table = Table::of(&run);
        let found = [ADDED, PERCEIVED, CLUMPING, BIAS, SHADING].into_iter().find_map(|m| table.summaries[0].half(m));
        (found.expect("an interval") * 1000.0).round() / 1000.0
    };
    // Published tables of Student's t distribution, two-sided level 5 %: 12.706, 4.303, 3.182, 2.365, 2.145 and 2.093 with 1, 2, 3, 7, 14 and 19
    // degrees of freedom. The degrees of freedom are one less than the number of values. Added change of n frames has n - 1 groups as values, at most
    // 20. Perceived noise is measured in 4 of 16 frames, and clumping in 8 seeds.
    assert_eq!([3, 4, 16, 200].map(|frames| half(frames, "added", Some(1))), [12.706, 4.303, 2.145, 2.093]);
    assert_eq!(half(16, "perceived_noise", None), 3.182);
    assert_eq!(half(16, "clumping", None), 2.365);
    // The row of a bias gives 90 degrees of freedom. The standard error of a time is the half-width of its interval divided by 1.96, and it is
    // treated as known exactly.
    assert_eq!((FREEDOM, half(16, "bias", None)), (90.0, 1.987));
    assert!((half(16, "gpu_ratio:shading", None) - 1.96).abs() < 1.5e-3, "{}", half(16, "gpu_ratio:shading", None));
}

#[test]
fn rows_are_in_the_order_of_the_definition() {
    let folder = Folder::new("order");
    let table = Table::of(&fake::hash_scale(folder.path()));
    assert_eq!(table.settings, fake::SCALES);
    assert_eq!(table.variants, ["auto", "near-cliff"]);
    let table = Table::of(&fake::variants(folder.path(), &["ground", "cliff"], &NOISES));
    assert_eq!((table.views, table.noises), (vec!["ground".to_owned(), "cliff".to_owned()], NOISES.map(str::to_owned).to_vec()));
    assert_eq!(table.variants[..4], ["auto", "generic", "vt", "far-atlas"].map(str::to_owned));
}

#[test]
fn a_run_without_rows_is_refused() {
    let folder = Folder::new("empty");
    let run = fake::hash_scale(folder.path());
    assert!(read_run(&folder.path().join("none")).is_err());
    // A report without rows is refused, and no file is written.
    let empty = RunData { rows: Vec::new(), ..run };
    assert!(write_run(&empty, &[]).is_err_and(|e| e.to_string().contains("no metrics yet")));
    assert!(!folder.path().join("report.html").exists() || std::env::var_os("SCREE_REPORTS").is_some());
}

#[test]
fn biases_by_design_are_remarks_and_not_checks() {
    let folder = Folder::new("remarks");
    let mut run = fake::estimators(folder.path());
    let hex = run.rows.iter().find(|row| row.estimator == "hex").expect("an estimator").clone();
    assert!(!html(&run, &[]).contains("class=\"remark\""));
    let before = columns::checks(&run, &Table::of(&run), &[]).len();
    let bias = Row { metric: "bias".to_owned(), signal: "albedo".to_owned(), lag: None, value: -0.0123, ..hex };
    run.rows.push(Row { standard_error: Some(1e-4), freedom: Some(60.0), ..bias });
    assert_eq!(columns::checks(&run, &Table::of(&run), &[]).len(), before);
    let (page, text) = (html(&run, &[]), text(&run, &[]));
    let words = "biased by design against the exact blend (95 % intervals): hex by at most -0.0123 \u{b1} 0.0002 (hex; hex tiling reduces";
    assert!(page.contains(&format!("<li class=\"remark\">{words}")) && text.contains(&format!("- {words}")), "{text}");
}

#[test]
fn histories_that_are_not_filled_and_sequences_that_are_too_short_are_remarks() {
    let folder = Folder::new("warm-up");
    let mut run = fake::one(folder.path());
    let seen = Row { metric: "perceived_noise".to_owned(), signal: "albedo".to_owned(), value: 0.01, ..run.rows[0].clone() };
    run.rows.push(seen);
    let mut of = |frames: u32, warm_up: u32, temporal: &[&str]| {
        run.definition.frames = frames;
        run.definition.warm_up = warm_up;
        run.definition.temporal = temporal.iter().map(|&name| name.to_owned()).collect();
        columns::remarks(&run, &Table::of(&run)).join("; ")
    };
    let begins = "the history of exponential and flipquad+exponential begins empty: in frame 1, the first whose changes are measured, 90 % of it \
                  comes from frame 0, so this start is part of all numbers over frames; to leave it out, set `warm_up = 22` and `frames = 38`";
    assert_eq!(of(16, 0, &["off", "exponential", "flipquad", "flipquad+exponential"]), begins);
    assert!(of(40, 21, &["exponential"]).contains("in frame 21, the first whose changes are measured, 11 % of it"));
    for (frames, warm_up, temporal) in [(40, 22, "exponential"), (16, 0, "flipquad"), (16, 0, "off")] {
        assert_eq!(of(frames, warm_up, &[temporal]), "", "{frames} frames, {warm_up} to warm up, {temporal}");
    }
    let short = "perceived noise is too high for noise that changes in every frame, and no sentence uses it: it needs 16 frames at 60 per second, and \
                 this run has 5";
    assert_eq!(of(5, 0, &["off"]), short);
}
