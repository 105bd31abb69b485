use std::collections::BTreeMap;

use serde::Deserialize;

use crate::{Mistake, Source, Spanned, nearest, one_of};

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    name: String,
    #[serde(default)]
    joint: Vec<Joint>,
    #[serde(default)]
    prior: BTreeMap<Spanned<String>, Spanned<f64>>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(dead_code, reason = "the fields say which keys there are")]
struct Joint {
    mass: f64,
    axis: Option<[f64; 3]>,
}

fn mistake(text: &str) -> Mistake {
    Source::new("f.toml", text)
        .parse::<File>()
        .expect_err("must be refused")
}

#[test]
fn every_kind_of_mistake_has_place_line_and_mend() {
    for (text, expected) in [
        (
            "name = \"a\"\n[[joint]]\nmas = 1.0\n",
            "f.toml:3:1: unknown field `mas`, expected `mass` or `axis`\n    |\n  3 | mas = 1.0\n    | ^^^\n  help: did you mean `mass`?",
        ),
        (
            "name = \"a\"\n[[joint]]\nmass = \"é\" # heavy\n",
            "f.toml:3:8: invalid type: string \"é\", expected f64\n    |\n  3 | mass = \"é\" # heavy\n    |        ^^^\n  help: write a number, such as 1.5",
        ),
        (
            "name = \"a\"\n[[joint]]\naxis = [1.0, 0.0, 0.0]\n",
            "f.toml:2:1: missing field `mass`\n    |\n  2 | [[joint]]\n    | ^^^^^^^^^\n  help: add `mass = …` to this table",
        ),
        (
            "name = \"a\"\n[[joint]]\nmass = 1.0\naxis = [1.0, 0.0]\n",
            "f.toml:4:8: invalid length 2, expected an array of length 3\n    |\n  4 | axis = [1.0, 0.0]\n    |        ^^^^^^^^^^\n  help: write a list of 3 numbers in brackets",
        ),
    ] {
        assert_eq!(mistake(text).to_string(), expected);
    }
    let syntax = mistake("name = \"a\n");
    assert_eq!((syntax.place.line, syntax.mend.is_empty()), (1, false));
    let empty = mistake("").to_string();
    assert!(
        empty.starts_with("f.toml:1:1: missing field `name`"),
        "{empty}"
    );
}

#[test]
fn keys_and_values_know_their_places() {
    let source = Source::new("f.toml", "name = \"ä\"\n[prior]\nm = 0.5\n");
    let file: File = source.parse().expect("readable");
    assert_eq!((file.name.as_str(), file.joint.len()), ("ä", 0));
    let (key, value) = file.prior.first_key_value().expect("one prior");
    assert_eq!(source.place_of(key).to_string(), "f.toml:3:1");
    assert_eq!(source.place_of(value).to_string(), "f.toml:3:5");
}

#[test]
fn top_level_keys_are_read_one_by_one() {
    let text = "[elbow]\nmass = 1.0\n\n[arm]\nmass = true\n";
    let source = Source::new("f.toml", text);
    let items = source.tables().expect("TOML");
    assert!(items.iter().all(crate::Item::is_table));
    let places: Vec<String> = items
        .iter()
        .map(|i| source.place_of(&i.key).to_string())
        .collect();
    assert_eq!(places, ["f.toml:1:2", "f.toml:4:2"]);
    let read: Vec<Result<Joint, Mistake>> = items.into_iter().map(|i| source.read(i)).collect();
    assert_eq!(read[0].as_ref().expect("a joint").mass, 1.0);
    let place = &read[1].as_ref().expect_err("a truth value").place;
    assert_eq!((place.line, place.column), (5, 8));
}

#[test]
fn near_names_are_proposed_and_far_ones_are_not() {
    let known = ["shoulder", "elbow"];
    assert_eq!(nearest("sholder", known), Some("shoulder"));
    assert_eq!(nearest("wrist", known), None);
    assert_eq!(one_of("wrist", known), "use one of `shoulder`, `elbow`");
}
