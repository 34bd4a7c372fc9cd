//! Tests of whole reports. Reports of all kinds of runs must be consistent, and each displayed number must be in the rows.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use super::columns::{self, Cell, Source};
use super::fake::{self, Folder, NOISES, Rows, base, definition};
use super::summary::{Key, RMSE, Table};
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

/// Returns the attributes and the content of each element with this name.
fn elements<'a>(html: &'a str, name: &str) -> Vec<(&'a str, &'a str)> {
    let (open, close) = (format!("<{name} "), format!("</{name}>"));
    let parts = html.split(&open[..]).skip(1);
    parts.filter_map(|part| Some((part.split_once('>')?.0, part.split_once('>')?.1.split(&close[..]).next()?))).collect()
}

fn attribute<'a>(attributes: &'a str, name: &str) -> Option<&'a str> {
    let rest = attributes.split_once(&format!("{name}=\""))?.1;
    Some(rest.split_once('"')?.0)
}

/// The values of rows over all frames, by key, metric, lag and frequency. Only rows of spectra have a frequency.
type Known = BTreeMap<(Key, String, Option<u32>, Option<u64>), f64>;

fn known(run: &RunData) -> Known {
    // If a number has no row over all frames, the row of a single frame is used. In these runs, such a number has only one row.
    let all = || run.rows.iter().chain(&run.times);
    all()
        .filter(|r| r.frame.is_some())
        .chain(all().filter(|r| r.frame.is_none()))
        .map(|r| ((Key::of(r), r.metric.clone(), r.lag, r.frequency.map(f64::to_bits)), r.value))
        .collect()
}

/// Returns the table cells, and the marks of plots, whose values are not in the rows.
fn untraceable(html: &str, run: &RunData) -> Vec<String> {
    let known = known(run);
    let mut lost = Vec::new();
    let table = html.split("<table class=\"all\">").nth(1).and_then(|t| t.split("</table>").next()).expect("a table");
    let heads: Vec<(Option<String>, Option<u32>)> = elements(table, "th")
        .iter()
        .map(|(attributes, _)| {
            (attribute(attributes, "data-metric").map(str::to_owned), attribute(attributes, "data-lag").and_then(|k| k.parse().ok()))
        })
        .collect();
    let mut keys: BTreeMap<String, Key> = BTreeMap::new();
    let mut first_ms: BTreeMap<String, f64> = BTreeMap::new();
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
        for ((attributes, _), (metric, lag)) in numbers.iter().zip(&heads) {
            let Some(shown) = attribute(attributes, "data-v").map(|v| v.parse::<f64>().expect("a number")) else { continue };
            let found = match metric {
                Some(metric) => known.get(&(key.clone(), metric.clone(), *lag, None)).copied(),
                None => {
                    // A column without a metric shows the promised fetches, or the ratio of two shading times.
                    let ms = known.get(&(key.clone(), "gpu_ms:shading".to_owned(), None, None)).copied();
                    let promise =
                        key.variant.parse::<kernels::variant::Variant>().map(|v| f64::from(Estimator::Fc5.promised_fetches_of(v))).ok();
                    let first = ms.map(|ms| *first_ms.entry(key.view.clone()).or_insert(ms));
                    let ratio = ms.zip(first).map(|(ms, first)| ms / first);
                    if promise == Some(shown) { promise } else { ratio }
                }
            };
            if found != Some(shown) {
                lost.push(format!("{}: {metric:?} {lag:?} = {shown}, rows say {found:?}", key.words()));
            }
        }
    }
    // The y of a mark must be the value of a row of its choice, or the ratio of its shading time. The x must be one of these numbers, or
    // the setting, a lag or a frequency of the choice.
    let mut of_choices: BTreeMap<&Key, Vec<_>> = BTreeMap::new();
    for ((key, _, lag, frequency), &value) in &known {
        of_choices.entry(key).or_default().push((*lag, *frequency, value));
    }
    for (anchor, mark) in html.split("<a href=\"#").skip(1).filter_map(|m| m.split_once("\"><circle ")) {
        let (attributes, _) = mark.split_once('>').expect("a whole mark");
        let value = |name: &str| attribute(attributes, name).and_then(|v| v.parse::<f64>().ok()).expect("a number");
        let key = keys.get(anchor).unwrap_or_else(|| panic!("no row has the anchor {anchor}"));
        let (x, y) = (value("data-x"), value("data-y"));
        let of_choice = of_choices.get(key).map_or(&[][..], Vec::as_slice);
        let ms = of_choice_ms(&known, key, &first_ms);
        let is = |value: f64| of_choice.iter().map(|(.., v)| v).chain(&ms).any(|v| v.to_bits() == value.to_bits());
        let is_set = !of_choice.is_empty() && key.setting.parse() == Ok(x);
        let axis = is_set || of_choice.iter().any(|(lag, frequency, _)| lag.map(f64::from) == Some(x) || *frequency == Some(x.to_bits()));
        if !is(y) || !(is(x) || axis) {
            lost.push(format!("{}: a mark at {x}, {y}", key.words()));
        }
    }
    lost
}

/// Returns the ratio of the choice's shading time to the first shading time of its view; empty if the choice was not timed.
fn of_choice_ms(known: &Known, key: &Key, first_ms: &BTreeMap<String, f64>) -> Vec<f64> {
    let ms = known.get(&(key.clone(), "gpu_ms:shading".to_owned(), None, None));
    ms.zip(first_ms.get(&key.view)).map(|(ms, first)| ms / first).into_iter().collect()
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
        let changed = run.rows.iter_mut().find(|r| r.metric == "rmse" && r.frame.is_none()).expect("a row");
        changed.value *= 1.0 + 1e-9;
        let lost = untraceable(&html, &run);
        assert!(lost.iter().any(|l| l.contains("Some(\"rmse\")")) && lost.iter().any(|l| l.contains("a mark at")), "{lost:?}");
    }
}

#[test]
fn every_shape_makes_a_whole_page_and_a_text() {
    for (folder, run, verdicts) in shapes() {
        fake::pictures(folder.path(), [640, 360], &[("reference", 1), ("frame", 6), ("flicker-map", 6)]);
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
        // Encoded pictures can contain these letters by chance. Each word is therefore searched together with the character before it.
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
    // There are 42 rows that must be in the table: two automatic choices and five flavours, each with six noises. Choices on a front are in the
    // table, too.
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
        for (frame, value) in (0..).zip(values) {
            rows.put(&Row { frame: Some(frame), ..base("cliff") }, "rmse", "linear albedo", *value, None);
        }
        if let Some(value) = whole {
            rows.put(&base("cliff"), "rmse", "linear albedo", value, Some(0.1));
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
    // NaN values are omitted from a mean, and the page gives the number of values that were used.
    let run = frames(&[1.0, f64::NAN, 3.0], None);
    assert_eq!(value(&run), 2.0);
    assert!(
        html(&run, &[]).contains("mean over 2 of 3 frames") && html(&run, &[]).contains("means over the frames, computed by this report")
    );
    let run = frames(&[f64::NAN, f64::NAN], None);
    assert!(value(&run).is_nan());
    // If a number has two rows, the first is used, and a check of the report fails.
    let mut run = frames(&[], Some(7.0));
    run.rows.push(Row { value: 8.0, ..run.rows[0].clone() });
    assert_eq!((value(&run), Table::of(&run).doubles), (7.0, 1));
    assert!(html(&run, &[]).contains("<li class=\"bad\">1 numbers have more than one row"));
    // The same holds for a second row of any frame, which would otherwise shift the mean.
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
    lost.rows.retain(|r| r.metric != "bias" && r.metric != "flicker");
    (lost.definition.seeds, lost.definition.frames) = (0, 1);
    assert_eq!(reason(&lost, 0, Source::WithError(super::summary::BIAS)), "not measured: seeds = 0");
    assert_eq!(reason(&lost, 0, Source::Row(super::summary::FLICKER)), "not measured: one frame");
    let resolved = fake::temporal(folder.path(), &["hashed"]);
    assert_eq!(reason(&resolved, 1, Source::Row(super::summary::REJECTIONS)), "measured only without a resolve");
    lost.definition.times = crate::definition::Times::None;
    lost.times.clear();
    assert_eq!(reason(&lost, 0, Source::ShadingRatio), "not timed: times = \"none\"");
    // A column without any number is not shown, but its heading is named below the table.
    assert!(html(&lost, &[]).contains("Columns without any number: Shading, RMSE, Bias \u{b1} s.e., Flicker."));
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
fn every_mark_can_be_red() {
    let folder = Folder::new("marks");
    let good = fake::variants(folder.path(), &["cliff"], &["hashed"]);
    let marks = |run: &RunData, verdicts: &[Verdict]| {
        let checks = columns::checks(run, &Table::of(run), verdicts);
        let page = html(run, verdicts);
        let text = text(run, verdicts);
        for (good, words) in &checks {
            assert!(
                page.contains(&format!("<li class=\"{}\">{}</li>", if *good { "good" } else { "bad" }, super::html::escape(words))),
                "{words}"
            );
            assert!(text.contains(if *good { "- \u{2705} " } else { "- \u{274c} " }));
        }
        checks.iter().map(|c| c.0).collect::<Vec<_>>()
    };
    // The four checks: accuracy of the references, promised fetches, bias, variance.
    assert_eq!(marks(&good, &[]), [true; 4]);
    let with = |change: &dyn Fn(&mut RunData)| {
        let mut run = good.clone();
        change(&mut run);
        marks(&run, &[])
    };
    let scale = |run: &mut RunData, metric: &str, variant: &str, factor: f64| {
        run.rows.iter_mut().filter(|r| r.metric == metric && r.variant == variant).for_each(|r| r.value *= factor);
    };
    assert_eq!(with(&|run| scale(run, "reference_se", "reference", 10.0)), [false, true, true, true]);
    assert_eq!(with(&|run| scale(run, "fetches_per_px", "near-cliff", 1.1)), [true, false, true, true]);
    assert_eq!(with(&|run| scale(run, "bias", "auto", 200.0)), [true, true, false, true]);
    assert_eq!(with(&|run| scale(run, "variance", "auto", 2.0)), [true, true, true, false]);
    // The check of the references also fails if their accuracy is unknown.
    let lost = with(&|run| run.rows.retain(|r| !r.metric.starts_with("reference_")));
    assert_eq!(lost, [false, true, true, true]);
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
    assert!(marks(&good, &met)[0]);
    assert!(!marks(&good, &fake::verdicts())[0]);
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
    assert_eq!(table.references.iter().map(|r| (r.view.as_str(), r.suffices())).collect::<Vec<_>>(), [("cliff", true), ("ground", false)]);
    let fronts = columns::fronts(&table);
    assert!(table.views.iter().all(|view| table.of_view(view).iter().any(|&i| fronts[i].error)));
    assert!(html(&run, &[]).matches("<details class=\"view\" open>").count() > 2);
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
