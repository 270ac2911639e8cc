//! What was probably meant.

/// The known name that is most like a misspelt one, if one is.
pub(crate) fn nearest<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let distance = |other: &&str| strsim::damerau_levenshtein(name, other);
    let nearest = known.into_iter().min_by_key(distance)?;
    (distance(&nearest) <= 1 + name.chars().count() / 3).then_some(nearest)
}

/// What was probably meant by the word that a message of the parser calls unknown before it lists the known ones.
pub(crate) fn meant(message: &str) -> Option<&str> {
    let mut words = message.strip_prefix("unknown ")?.split('`').skip(1).step_by(2);
    nearest(words.next()?, words)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn near_names_are_suggested_and_far_ones_are_not() {
        for (name, expected) in [("whiet", Some("white")), ("Red", Some("red")), ("blue", None), ("", None)] {
            assert_eq!(nearest(name, ["white", "red", "green"]), expected, "{name}");
        }
        assert_eq!(nearest("red", []), None);
    }

    #[test]
    fn messages_of_the_parser_are_understood() {
        assert_eq!(meant("unknown field `filee`, expected one of `unit`, `file`, `scale`"), Some("file"));
        assert_eq!(meant("unknown variant `lihgt`, expected `light` or `heat`"), Some("light"));
        assert_eq!(meant("unknown field `color`, expected one of `unit`, `file`"), None);
        assert_eq!(meant("missing field `file`"), None);
    }
}
