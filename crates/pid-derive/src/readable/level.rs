//! Shared by all notations: how tightly parts bind, and how terms join to a sum.

use super::Formula;

/// Binding strength.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Level {
    Sum,
    Product,
    Atom,
}

/// Terms with their signs; `at` writes a part, in brackets if it binds less tightly than asked.
pub(super) fn sum(terms: &[Formula], at: impl Fn(&Formula, Level) -> String) -> String {
    let mut text = String::new();
    for (k, term) in terms.iter().enumerate() {
        match (k, term) {
            (0, term) => text += &at(term, Level::Sum),
            (_, Formula::Negative(x)) => {
                text += " - ";
                text += &at(x, Level::Product);
            }
            (_, term) => {
                text += " + ";
                text += &at(term, Level::Product);
            }
        }
    }
    text
}
