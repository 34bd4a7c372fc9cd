//! Interprets two tags of GDAL in a TIFF: metadata as XML (42112) and the no-data value as text (42113).
//!
//! Source: GDAL, *GTiff -- GeoTIFF File Format*, "Internal nodata masks", "Metadata" and "Nodata value". The XML is a flat list of
//! `<Item name="SCALE" sample="0" role="scale">0.1</Item>`, so it is read without an XML library.

use super::scaling::Statement;
use super::units::Unit;
use crate::decode::fault::Fault;

/// Returns scale, offset and unit of the first band.
///
/// # Errors
/// The metadata are truncated or not well formed, the scale or the offset is not a finite number, the scale is 0 or subnormal, the unit is
/// unknown, or two items contradict each other.
pub(super) fn statement(xml: &str) -> Result<Statement, Fault> {
    let items = items(xml)?;
    let scale = number(&items, "scale")?;
    // Subnormal numbers are refused like 0, because they would make all elevations equal.
    if let Some(scale) = scale.filter(|scale| !scale.is_normal()) {
        return Err(Fault::Unsupported(format!(
            "the scale of its heights is {scale}; state the right value with gdal_translate -a_scale SCALE IN OUT.tif"
        )));
    }
    let offset = number(&items, "offset")?;
    let unit = match one(&items, "unittype")? {
        None => None,
        Some(name) if name.trim().is_empty() => None,
        Some(name) => Some(Unit::of_name(&name).ok_or_else(|| {
            Fault::Unsupported(format!(
                "the unit of its heights, `{}`, is not known; convert the heights to metres, and state the unit m (gdal_edit.py -units m FILE)",
                name.trim()
            ))
        })?),
    };
    Ok(Statement { scale, offset, unit })
}

/// The text that [`one`] finds, as a number; `None` if there is no such item.
fn number(items: &[Item], role: &str) -> Result<Option<f64>, Fault> {
    let Some(text) = one(items, role)? else { return Ok(None) };
    match text.trim().parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(Some(value)),
        _ => Err(Fault::Unsupported(format!(
            "the {role} of its heights is `{}`, which is not a number; state the right value with gdal_translate -a_{role} VALUE IN OUT.tif",
            text.trim()
        ))),
    }
}

/// The text of the item with this role that describes the first band or the whole file; `None` if there is no such item. Several items with the
/// same text count as one.
fn one(items: &[Item], role: &str) -> Result<Option<String>, Fault> {
    let mut found: Option<&str> = None;
    for item in items.iter().filter(|item| item.role == role && (item.sample.is_empty() || item.sample == "0")) {
        match found {
            Some(other) if other != item.text => {
                return Err(Fault::Contradictory(format!("its metadata state two values of {role}: {other} and {}", item.text)));
            }
            _ => found = Some(item.text.as_str()),
        }
    }
    Ok(found.map(str::to_owned))
}

struct Item {
    /// The role, in lower case.
    role: String,
    /// The band, counted from 0; empty if the item describes the file.
    sample: String,
    text: String,
}

/// The items of GDAL's metadata that have a role.
///
/// # Errors
/// An item is not well formed, or the end of a comment or of the metadata is missing.
fn items(xml: &str) -> Result<Vec<Item>, Fault> {
    let damaged = |what: &str| Fault::Damaged(format!("its metadata (tag 42112) {what}"));
    let xml = without_comments(xml).ok_or_else(|| damaged("hold a comment that has no end"))?;
    let mut items = Vec::new();
    let mut rest = xml.as_str();
    while let Some((_, from)) = rest.split_once("<Item") {
        let (item, after) = item(from).ok_or_else(|| damaged("hold an item that is not well formed"))?;
        items.extend((!item.role.is_empty()).then_some(item));
        rest = after;
    }
    if xml.contains("<GDALMetadata>") && !rest.contains("</GDALMetadata>") {
        return Err(damaged("have no end"));
    }
    Ok(items)
}

/// Returns the text without its XML comments (XML 1.0, section 2.5); `None` if a comment has no end.
pub(super) fn without_comments(xml: &str) -> Option<String> {
    let mut text = String::new();
    let mut rest = xml;
    while let Some((before, comment)) = rest.split_once("<!--") {
        text.push_str(before);
        (_, rest) = comment.split_once("-->")?;
    }
    text.push_str(rest);
    Some(text)
}

/// Reads an item from the text after `<Item`. Returns the item and the text after it; `None` if the item is not well formed.
fn item(from: &str) -> Option<(Item, &str)> {
    let mut item = Item { role: String::new(), sample: String::new(), text: String::new() };
    let is_name = |text: &str| !text.is_empty() && !text.contains(|c: char| c.is_whitespace() || "<>\"'".contains(c));
    let mut rest = from;
    loop {
        rest = rest.trim_start();
        // An element without content ends in `/>`.
        if let Some(after) = rest.strip_prefix("/>") {
            return Some((item, after));
        }
        if let Some(body) = rest.strip_prefix('>') {
            let (text, after) = body.split_once("</Item>")?;
            item.text = plain(text);
            return (!text.contains('<')).then_some((item, after));
        }
        let (key, after) = rest.split_once('=')?;
        let after = after.trim_start();
        let quote = after.chars().next().filter(|c| ['"', '\''].contains(c))?;
        let (value, next) = after.get(1..)?.split_once(quote)?;
        match key.trim() {
            "role" => item.role = plain(value).to_lowercase(),
            "sample" => item.sample = plain(value),
            other if is_name(other) => {}
            _ => return None,
        }
        rest = next;
    }
}

/// Replaces the predefined entities (XML 1.0, section 4.6).
fn plain(text: &str) -> String {
    let entities = [("&lt;", "<"), ("&gt;", ">"), ("&quot;", "\""), ("&apos;", "'"), ("&amp;", "&")];
    entities.iter().fold(text.to_owned(), |text, (entity, character)| text.replace(entity, character))
}

/// The no-data value of tag 42113; `None` if the text is empty.
///
/// # Errors
/// The text is not a number.
pub(super) fn no_data(text: &str) -> Result<Option<f64>, Fault> {
    let text = text.trim_matches(|c: char| c == '\0' || c.is_whitespace());
    if text.is_empty() {
        return Ok(None);
    }
    text.parse().map(Some).map_err(|_| {
        Fault::Unsupported(format!(
            "its no-data value is `{text}`, which is not a number; state the right value with gdal_edit.py -a_nodata VALUE FILE"
        ))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn told(items: &str) -> Result<Statement, Fault> {
        statement(&format!("<GDALMetadata>\n  {items}\n</GDALMetadata>"))
    }

    #[test]
    fn scale_offset_and_unit_are_found_by_role() {
        let all = "<Item name=\"OFFSET\" sample=\"0\" role=\"offset\">500</Item>\n<Item name='SCALE' sample='0' role='scale'>0.1</Item>\
                   <Item name=\"UNITTYPE\" sample=\"0\" role=\"unittype\">US survey foot</Item><Item name=\"SCALE\">7</Item>\
                   <Item name=\"SCALE\" sample=\"1\" role=\"scale\">9</Item>";
        let statement = told(all).expect("well formed");
        assert_eq!((statement.scale, statement.offset, statement.unit), (Some(0.1), Some(500.0), Unit::of_name("us-ft")));
        let none = told("<Item name=\"AREA_OR_POINT\">Area</Item>").expect("well formed");
        assert_eq!((none.scale, none.offset, none.unit), (None, None, None));
        let twice = told("<Item role=\"scale\">2</Item><Item role=\"scale\" sample=\"0\">2</Item>").expect("the same twice");
        assert_eq!(twice.scale, Some(2.0));
        let negative = told("<Item role=\"scale\" sample=\"0\">-1</Item>").expect("GDAL applies it");
        assert_eq!(negative.scale, Some(-1.0));
    }

    #[test]
    fn items_in_comments_are_not_applied() {
        let scale = |items: &str| told(items).map(|statement| statement.scale);
        let inside = scale("<!-- <Item role=\"scale\">7</Item> -->");
        assert_eq!(inside.expect("well formed"), None);
        let beside = scale("<!--<Item role=\"scale\">7</Item>--><Item role=\"scale\">2</Item><!-- > <Item -->");
        assert_eq!(beside.expect("well formed"), Some(2.0));
        let within = scale("<Item role=\"scale\"><!-- metres -->2</Item>");
        assert_eq!(within.expect("well formed"), Some(2.0));
        assert!(matches!(scale("<Item role=\"scale\">2</Item><!-- <Item role=\"scale\">7</Item>"), Err(Fault::Damaged(_))));
    }

    #[test]
    fn values_that_mean_nothing_are_refused() {
        for (items, words) in [
            ("<Item role=\"scale\">0</Item>", "scale of its heights is 0"),
            ("<Item role=\"scale\">nan</Item>", "not a number"),
            ("<Item role=\"scale\">inf</Item>", "not a number"),
            ("<Item role=\"scale\">1e-320</Item>", "scale of its heights"),
            ("<Item role=\"offset\">x</Item>", "offset of its heights is `x`"),
            ("<Item role=\"unittype\">fathom &amp; more</Item>", "`fathom & more`"),
            ("<Item role=\"scale\">1</Item><Item role=\"scale\">2</Item>", "two values of scale: 1 and 2"),
        ] {
            let text = told(items).expect_err(items).to_string();
            assert!(text.contains(words), "{items}: {text}");
        }
        assert!(matches!(told("<Item role=\"scale\"/>"), Err(Fault::Unsupported(_))), "an item without content has no number");
    }

    #[test]
    fn metadata_that_are_cut_or_not_well_formed_are_damaged() {
        let whole =
            "<GDALMetadata>\n<Item name=\"a>b\">x</Item><Item name=\"SCALE\" sample=\"0\" role=\"scale\">0.1</Item>\n</GDALMetadata>";
        assert_eq!(statement(whole).expect("well formed").scale, Some(0.1));
        for length in "<GDALMetadata>".len()..whole.len() {
            assert!(matches!(statement(&whole[..length]), Err(Fault::Damaged(_))), "{}", &whole[..length]);
        }
        for broken in [
            "<Item role=\"scale\">1",
            "<Item role=scale>1</Item>",
            "<Item",
            "<Item name \"a\" role=\"scale\">1</Item>",
            "<Item role>1</Item><Item role=\"scale\">1</Item>",
            "<Item name=\"a\">x<Item role=\"scale\">1</Item>",
        ] {
            assert!(matches!(told(broken), Err(Fault::Damaged(_))), "{broken}");
        }
    }

    #[test]
    fn no_data_values_are_numbers() {
        assert_eq!(no_data("-9999\0").expect("a number"), Some(-9999.0));
        assert_eq!(no_data(" 1e+20 ").expect("a number"), Some(1e20));
        assert!(no_data("nan\0").expect("a number").is_some_and(f64::is_nan));
        assert_eq!(no_data("\0").expect("nothing"), None);
        assert!(no_data("none").is_err());
    }
}
