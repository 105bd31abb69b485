//! Names of the description as names of code and as words of comments.

/// The robot's name as the start of C identifiers and of a crate's name: lower case, `_` between words.
pub(crate) fn prefix(robot: &str) -> String {
    let letter = |c: char| match c.is_ascii_alphanumeric() {
        true => c.to_ascii_lowercase(),
        false => '_',
    };
    let text: String = robot.chars().map(letter).collect();
    match text.trim_matches('_') {
        "" => "robot".to_owned(),
        word if word.starts_with(|c: char| c.is_ascii_digit()) => format!("robot_{word}"),
        word => word.to_owned(),
    }
}

/// A name within a comment: nothing in it ends the comment or means anything to a compiler.
pub(crate) fn comment(name: &str) -> String {
    let letter = |c: char| match c.is_ascii_alphanumeric() || " _-.:".contains(c) {
        true => c,
        false => '_',
    };
    name.chars().map(letter).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_name_becomes_an_identifier() {
        for (robot, own) in [
            ("Arm6", "arm6"),
            ("UR 10e/left", "ur_10e_left"),
            ("7bot", "robot_7bot"),
            ("…", "robot"),
        ] {
            assert_eq!(prefix(robot), own);
        }
        assert_eq!(comment("a*/ b\n\\??/"), "a__ b_____");
    }
}
