//! Collects errors and warnings with their places.
//!
//! A stage reports everything it finds and the pipeline stops after the first stage with an error.
//! Messages have the form "what is wrong, with name and number", then a `help:` line with text to
//! paste.

use proc_macro2::{Span, TokenStream};
use quote::{quote, quote_spanned};

/// A stretch of the user's text: from its first token to its last.
#[derive(Debug, Clone, Copy)]
pub struct Loc {
    /// First token.
    pub start: Span,
    /// Last token.
    pub end: Span,
}

impl Loc {
    /// The stretch from `self` to the end of `other`.
    #[must_use]
    pub fn to(self, other: impl Into<Loc>) -> Loc {
        Loc {
            start: self.start,
            end: other.into().end,
        }
    }

    /// An error on this stretch.
    pub fn error(self, message: impl std::fmt::Display) -> syn::Error {
        // `new_spanned` underlines from its first to its last token.
        let first = proc_macro2::Ident::new("first", self.start);
        let last = proc_macro2::Ident::new("last", self.end);
        syn::Error::new_spanned(quote!(#first #last), message)
    }
}

impl From<Span> for Loc {
    fn from(span: Span) -> Loc {
        Loc {
            start: span,
            end: span,
        }
    }
}

impl From<&proc_macro2::Ident> for Loc {
    fn from(ident: &proc_macro2::Ident) -> Loc {
        ident.span().into()
    }
}

/// A warning: shown by rustc at the user's token, silenced by `#[allow(deprecated)]` on the robot.
#[derive(Debug, Clone)]
pub struct Warning {
    /// Where.
    pub at: Span,
    /// What.
    pub message: String,
}

/// Errors and warnings of one expansion.
#[derive(Debug, Default)]
pub struct Diagnostics {
    errors: Vec<syn::Error>,
    warnings: Vec<Warning>,
    /// The variant that messages are about.
    variant: Option<String>,
}

impl Diagnostics {
    /// No errors, no warnings.
    pub fn new() -> Self {
        Self::default()
    }

    /// No errors yet, all to come about a variant.
    pub fn of_variant(name: &proc_macro2::Ident) -> Self {
        Self {
            variant: Some(name.to_string()),
            ..Self::default()
        }
    }

    /// Takes over the errors of `other`.
    pub fn extend_errors(&mut self, other: Diagnostics) {
        self.errors.extend(other.errors);
    }

    /// The message, naming the variant it is about.
    fn said(&self, message: impl std::fmt::Display) -> String {
        match &self.variant {
            Some(variant) => format!("in variant `{variant}`: {message}"),
            None => message.to_string(),
        }
    }

    /// Adds an error.
    pub fn push(&mut self, error: syn::Error) {
        self.errors.push(error);
    }

    /// Adds an error at `at`.
    pub fn error(&mut self, at: impl Into<Loc>, message: impl std::fmt::Display) {
        let message = self.said(message);
        self.errors.push(at.into().error(message));
    }

    /// Adds an error that concerns two places.
    pub fn error2(
        &mut self,
        at: impl Into<Loc>,
        message: impl std::fmt::Display,
        other: impl Into<Loc>,
        note: impl std::fmt::Display,
    ) {
        let mut e = at.into().error(self.said(message));
        e.combine(other.into().error(note));
        self.errors.push(e);
    }

    /// Adds a warning.
    pub fn warn(&mut self, at: Span, message: impl Into<String>) {
        self.warnings.push(Warning {
            at,
            message: message.into(),
        });
    }

    /// Number of errors so far.
    pub fn count(&self) -> usize {
        self.errors.len()
    }

    /// Takes the last error back, to hand it on.
    pub fn pop(&mut self) -> Option<syn::Error> {
        self.errors.pop()
    }

    /// Whether nothing but warnings was reported.
    pub fn is_ok(&self) -> bool {
        self.errors.is_empty()
    }

    /// All messages, errors first, in the order of their discovery.
    pub fn messages(&self) -> Vec<String> {
        self.errors
            .iter()
            .flat_map(|e| e.clone().into_iter().map(|e| e.to_string()))
            .chain(self.warnings.iter().map(|w| w.message.clone()))
            .collect()
    }

    /// All messages with their first lines and columns, for tests: places are known where
    /// `proc_macro2` tracks them.
    #[doc(hidden)]
    pub fn located(&self) -> Vec<String> {
        let show =
            |span: Span, m: &str| format!("{}:{}: {m}", span.start().line, span.start().column + 1);
        self.errors
            .iter()
            .flat_map(|e| {
                e.clone()
                    .into_iter()
                    .map(|e| show(e.span(), &e.to_string()))
            })
            .chain(
                self.warnings
                    .iter()
                    .map(|w| show(w.at, &format!("warning: {}", w.message))),
            )
            .collect()
    }

    /// The errors as `compile_error!` items.
    pub fn errors_to_tokens(&self) -> TokenStream {
        self.errors
            .iter()
            .map(syn::Error::to_compile_error)
            .collect()
    }

    /// The warnings as items: a deprecated constant per warning, used once at the user's token,
    /// since stable Rust has no other way to let a macro warn. `attrs` are the user's attributes on
    /// the robot.
    pub fn warnings_to_tokens(&self, attrs: &[TokenStream]) -> TokenStream {
        self.warnings
            .iter()
            .map(|w| {
                let note = &w.message;
                let at = quote_spanned!(w.at=> robot_warning);
                quote! {
                    #(#attrs)*
                    const _: () = {
                        #[deprecated(note = #note)]
                        #[allow(non_upper_case_globals)]
                        const robot_warning: () = ();
                        #at
                    };
                }
            })
            .collect()
    }
}

/// The candidate nearest to `name`, if any is near enough to be meant (edit distance at most a
/// third of the length, at least 1).
pub fn nearest<'a>(name: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let limit = (name.chars().count() / 3).max(1);
    candidates
        .into_iter()
        .map(|c| {
            (
                strsim::osa_distance(&name.to_lowercase(), &c.to_lowercase()),
                c,
            )
        })
        .filter(|(d, _)| *d <= limit)
        .min_by_key(|(d, _)| *d)
        .map(|(_, c)| c)
}

/// `a, b or c` of the items, each in backticks.
pub fn one_of(items: &[&str]) -> String {
    match items {
        [] => String::new(),
        [one] => format!("`{one}`"),
        [head @ .., last] => {
            let head: Vec<String> = head.iter().map(|s| format!("`{s}`")).collect();
            format!("{} or `{last}`", head.join(", "))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_name_is_near() {
        assert_eq!(nearest("foer", ["upper", "fore"]), Some("fore"));
        assert_eq!(nearest("m3", ["m1", "sz2"]), Some("m1"));
        assert_eq!(nearest("zebra", ["m1", "sz2"]), None);
        assert_eq!(nearest("Gain", ["gain"]), Some("gain"));
    }

    #[test]
    fn lists_read_as_english() {
        assert_eq!(one_of(&["a"]), "`a`");
        assert_eq!(one_of(&["a", "b", "c"]), "`a`, `b` or `c`");
    }
}
