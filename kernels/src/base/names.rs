//! Suggestions for misspelled names.

/// Returns the known word with the smallest edit distance to `word`; the first of them if several have this distance. `None` if no known word is
/// near. A word is near if its distance is at most a third of the length of the longer word. A distance of 1 is always near if `word` has more than
/// one letter. Upper and lower case count as equal, and so do `-` and `_`.
pub fn nearest<'a>(word: &str, known: &[&'a str]) -> Option<&'a str> {
    let plain = |text: &str| text.to_lowercase().replace('_', "-");
    let wanted = plain(word);
    let length = wanted.chars().count();
    let most = |candidate: &str| (length.max(candidate.chars().count()) / 3).max(1);
    known
        .iter()
        // The edit distance between two words is at least the difference of their lengths. So a word of several megabytes is rejected here, before
        // the slow comparison.
        .filter(|candidate| length.abs_diff(candidate.chars().count()) <= most(candidate))
        .map(|&candidate| (strsim::osa_distance(&wanted, &plain(candidate)), candidate))
        .filter(|&(distance, candidate)| distance <= most(candidate) && distance < length.max(1))
        .min_by_key(|&(distance, _)| distance)
        .map(|(_, candidate)| candidate)
}

/// A hint for an unknown word: the nearest known word or, if none is near, all known words.
pub fn suggestion(word: &str, known: &[&str]) -> String {
    nearest(word, known).map_or_else(|| format!("the known names are {}", known.join(", ")), did_you_mean)
}

/// A hint that suggests the known word `near`.
pub fn did_you_mean(near: &str) -> String {
    format!("did you mean `{near}`?")
}
