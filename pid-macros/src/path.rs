//! The path by which the crate that is compiled reaches `pid_runtime`.

use proc_macro_crate::{FoundCrate, crate_name};
use proc_macro2::{Group, Ident, Literal, Punct, Spacing, Span, TokenStream, TokenTree};

/// The crate that emitted code names.
const RUNTIME: &str = "pid_runtime";

/// Code in which every `::pid_runtime` is the path that the user's `Cargo.toml` provides: a direct
/// dependency, renamed or not, or `::simtrue::pid_runtime`. Where neither is found the code stays
/// as it is, and the compiler names the missing crate.
pub(crate) fn reached(code: TokenStream) -> TokenStream {
    match way() {
        Some(way) => replaced(code, &way),
        None => code,
    }
}

/// Segments of the path; `None` for `::pid_runtime` itself.
fn way() -> Option<Vec<String>> {
    match crate_name("pid-runtime") {
        Ok(FoundCrate::Itself) => None,
        Ok(FoundCrate::Name(name)) => (name != RUNTIME).then(|| vec![name]),
        Err(_) => match crate_name("simtrue").ok()? {
            FoundCrate::Itself => Some(vec!["simtrue".into(), RUNTIME.into()]),
            FoundCrate::Name(name) => Some(vec![name, RUNTIME.into()]),
        },
    }
}

fn replaced(code: TokenStream, way: &[String]) -> TokenStream {
    let mut out = Vec::new();
    for token in code {
        match token {
            TokenTree::Ident(ident) if ident == RUNTIME && after_path(&out) => {
                segments(&mut out, way, ident.span());
            }
            TokenTree::Group(group) => {
                let mut inner = Group::new(group.delimiter(), replaced(group.stream(), way));
                inner.set_span(group.span());
                out.push(inner.into());
            }
            // Links in documentation.
            TokenTree::Literal(literal) if literal.to_string().contains("::pid_runtime::") => {
                out.push(linked(&literal, way).into());
            }
            other => out.push(other),
        }
    }
    out.into_iter().collect()
}

/// Whether the tokens end in a `::` that begins a path.
fn after_path(out: &[TokenTree]) -> bool {
    let colon = |t: &TokenTree| matches!(t, TokenTree::Punct(p) if p.as_char() == ':');
    matches!(out, [.., a, b] if colon(a) && colon(b))
}

fn segments(out: &mut Vec<TokenTree>, way: &[String], span: Span) {
    for (k, name) in way.iter().enumerate() {
        if k > 0 {
            for spacing in [Spacing::Joint, Spacing::Alone] {
                let mut colon = Punct::new(':', spacing);
                colon.set_span(span);
                out.push(colon.into());
            }
        }
        out.push(Ident::new(name, span).into());
    }
}

fn linked(literal: &Literal, way: &[String]) -> Literal {
    let text = literal
        .to_string()
        .replace("::pid_runtime::", &format!("::{}::", way.join("::")));
    let mut linked = text.parse().unwrap_or_else(|_| literal.clone());
    linked.set_span(literal.span());
    linked
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_and_links_go_through_the_facade_and_nothing_else_changes() {
        let code = r#"
            #[doc = "see [`At`](::pid_runtime::dynamics::At)"]
            impl ::pid_runtime::dynamics::Dynamics for X { fn f(pid_runtime: f64) { g(::pid_runtime::h(pid_runtime)) } }
        "#;
        let way = ["front".to_owned(), RUNTIME.to_owned()];
        let found = replaced(code.parse().unwrap(), &way).to_string();
        let expected: TokenStream = code
            .replace("::pid_runtime::", "::front::pid_runtime::")
            .parse()
            .unwrap();
        assert_eq!(found, expected.to_string());
    }
}
