//! Known names: which one was meant.

/// The known word that `word` was probably meant to be: at most a third of its letters wrong (at least one letter may be, never
/// all). Case, `-` and `_` are not told apart; ties go to the earlier word.
pub fn nearest<'a>(word: &str, known: &[&'a str]) -> Option<&'a str> {
    let plain = |text: &str| text.to_lowercase().replace('_', "-");
    let wanted = plain(word);
    let length = wanted.chars().count();
    let most = |candidate: &str| (length.max(candidate.chars().count()) / 3).max(1);
    known
        .iter()
        // Words are at least as far apart as their lengths: a word of megabytes is compared with none.
        .filter(|candidate| length.abs_diff(candidate.chars().count()) <= most(candidate))
        .map(|&candidate| (strsim::osa_distance(&wanted, &plain(candidate)), candidate))
        .filter(|&(distance, candidate)| distance <= most(candidate) && distance < length.max(1))
        .min_by_key(|&(distance, _)| distance)
        .map(|(_, candidate)| candidate)
}

/// What to say beside a word that is not among the known ones: the nearest, or else all of them.
pub fn suggestion(word: &str, known: &[&str]) -> String {
    nearest(word, known).map_or_else(|| format!("there are {}", known.join(", ")), |near| format!("did you mean `{near}`?"))
}
