use maud::html;

use crate::{Axis, Bar, Footer, Ink, Legend, Page, Plot, Range, bars, figure, legend, table, tick};

const FOOTER: Footer<'_> = Footer {
    program: "pid 0",
    data: "cart & pole",
    settings: "",
    more: "",
};

fn page(body: maud::Markup) -> String {
    let page = Page {
        title: "A < B",
        lead: html! { "lead" },
        sections: &[("a", "First")],
        body,
        footer: FOOTER,
    };
    page.html()
}

fn plot(x: (f64, f64), y: (f64, f64)) -> Plot {
    Plot::new(
        "Position \"q\" < 1 & more",
        Axis::new("time", "s", x),
        Axis::new("position", "rad", y),
    )
}

#[test]
fn a_page_with_everything_is_in_order() {
    let mut all = plot((0.0, 2.0), (-1.0, 1.0));
    all.line(
        Ink::Measured,
        [(0.0, 0.5), (1.0, f64::NAN), (1.5, 0.2), (2.0, 1e300)],
    );
    all.band(&[(0.0, -0.1, 0.1), (2.0, -0.2, 0.2)]);
    all.cloud(
        Ink::Forward,
        [(1.0, 0.3), (f64::NAN, 0.0), (f64::INFINITY, 0.0)],
    );
    all.marks(Ink::Series(7), [(1.0, 0.3)]);
    all.interval(Ink::Backward, 1.0, (0.1, 0.2));
    all.upright(Ink::Stated, 0.3);
    all.span((0.4, 0.4000001));
    let rows = [
        Bar {
            label: "one".into(),
            value: 2.0,
            text: "2 N m".into(),
        },
        Bar {
            label: "none".into(),
            value: 0.0,
            text: "0 N m".into(),
        },
        Bar {
            label: "odd".into(),
            value: f64::NAN,
            text: "–".into(),
        },
    ];
    let html = page(html! {
        section id="a" {
            (legend(&[Legend::Line(Ink::Measured, "measured"), Legend::Note("n")]))
            (figure(&all.draw(), "q", "over time"))
            (bars("Forces of the joints", &rows))
            (table(&["name", "value"], &[vec!["a".into(), "1.5".into()], vec!["b".into(), "−2".into()]]))
        }
    });
    let counted = pid_page_check::page(&html).expect("in order");
    assert_eq!((counted.plots, counted.bars, counted.tables), (1, 1, 1));
    // A line that is interrupted once is one piece of two points: the single point before draws nothing.
    assert_eq!(html.matches("<polyline").count(), 1);
    assert!(html.contains("&lt; 1 &amp; more; time from 0 to 2 s, position from −1 to 1 rad."));
    assert!(html.contains("<td class=\"num\">1.5</td>") && html.contains("<td>a</td>"));
    assert!(html.contains("cart &amp; pole") && !html.contains("<dt>Settings"));
}

#[test]
fn an_interval_without_width_is_not_drawn() {
    let mut plot = plot((0.0, 1.0), (0.0, 1.0));
    plot.interval(Ink::Force, 0.5, (0.3, 0.3));
    plot.interval(Ink::Force, 0.5, (0.3, f64::NAN));
    plot.span((0.2, 0.2));
    let svg = plot.draw().into_string();
    assert!(!svg.contains("spread") && !svg.contains("<rect"), "{svg}");
}

#[test]
fn bars_leave_room_for_their_words() {
    let row = |label: &str, value, text: &str| Bar {
        label: label.into(),
        value,
        text: text.into(),
    };
    let short = [row("before", 0.2, "0.2"), row("after", 0.1, "0.1")];
    let long = [
        row("coulomb_asymmetry at joint 1", 0.52, "52 % (21 to 62 %)"),
        row("left", 0.01, "1 % (a value with very many words to it)"),
    ];
    let longest = [
        row(&"joint".repeat(8), 1.0, &"value".repeat(8)),
        row("left", 0.0, ""),
    ];
    // Width of a letter on a phone, in the units of the drawing: its font is 14.5 of them.
    let wide = |text: &str| 7.5 * text.chars().count() as f64;
    for rows in [&short[..], &long, &longest] {
        let svg = bars("Shares", rows).into_string();
        let number = |tag: &str, name: &str| -> f64 {
            let from = tag.split_once(&format!("{name}=\"")).expect(name).1;
            from.split_once('"').expect(name).0.parse().expect(name)
        };
        let view = svg.split_once("viewBox=\"0 0 ").expect("a view").1;
        let width: f64 = view
            .split(' ')
            .next()
            .expect("a width")
            .parse()
            .expect("a width");
        let texts: Vec<&str> = svg.split("<text ").skip(1).collect();
        let ends = texts.iter().skip(1).step_by(2).map(|t| number(t, "x"));
        for (row, at) in rows.iter().zip(ends) {
            assert!(at + wide(&row.text) <= width, "{svg}");
        }
        let drawn: Vec<(f64, f64)> = svg
            .split("<rect ")
            .skip(1)
            .map(|r| (number(r, "x"), number(r, "width")))
            .collect();
        assert!(rows.iter().all(|r| wide(&r.label) < drawn[0].0), "{svg}");
        assert!(drawn[0].1 >= 40.0, "{svg}");
        for ((_, length), row) in drawn.iter().zip(rows) {
            assert!((length / drawn[0].1 - row.value / rows[0].value).abs() < 1e-2);
        }
    }
}

#[test]
fn the_check_finds_what_is_not_in_order() {
    let good = page(html! { (plot((0.0, 1.0), (0.0, 1.0)).draw()) });
    assert!(pid_page_check::page(&good).is_ok());
    for (from, to, why) in [
        ("time, s</text>", "time</text>", "axis x"),
        ("role=\"img\"", "role=\"none\"", "without words"),
        ("</section>", "", ""),
        ("<dt>Date", "<dt>Day", "Date"),
        ("x1=\"68\"", "x1=\"NaN\"", "NaN"),
    ] {
        let bad = good.replacen(from, to, 1);
        match pid_page_check::page(&bad) {
            Err(message) => assert!(message.contains(why), "{message}"),
            Ok(_) => assert_eq!(bad, good, "{why}"),
        }
    }
    let bare = page(html! { table { tr { td { "x" } } } });
    assert!(
        pid_page_check::page(&bare)
            .unwrap_err()
            .contains("does not scroll")
    );
}

#[test]
fn ticks_are_round_few_and_short() {
    for (low, high, expected) in [
        (0.0, 10.0, "0 2 4 6 8 10"),
        (-0.031, 0.052, "−0.02 0 0.02 0.04"),
        (1.2e-5, 5.9e-5, "2e−5 3e−5 4e−5 5e−5"),
        (0.9996, 1.0003, "0.9996 0.9998 1 1.0002"),
        (0.0, 1.5e6, "0 2.5e5 5e5 7.5e5 1e6 1.25e6 1.5e6"),
        (0.02, 5.98, "1 2 3 4 5"),
    ] {
        let ticks = Axis::new("x", "s", (low, high)).ticks();
        let labels: Vec<String> = ticks.into_iter().map(|t| t.1).collect();
        assert_eq!(labels.join(" "), expected);
    }
    let labels = |low, high| {
        let ticks = Axis::log("x", "1", (low, high)).ticks();
        ticks.into_iter().map(|t| t.1).collect::<Vec<_>>().join(" ")
    };
    assert_eq!(labels(0.9, 320.0), "1 2 5 10 20 50 100 200");
    assert_eq!(labels(1e-6, 1e4).split(' ').count(), 6);
}

#[test]
fn numbers_are_short_and_true() {
    for (v, expected) in [
        (0.0, "0"),
        (0.25, "0.25"),
        (-1.5, "−1.5"),
        (1200.0, "1200"),
        (0.1 + 0.2, "0.3"),
        (2.5e-6, "2.5e−6"),
        (100.0, "100"),
    ] {
        assert_eq!(tick(v), expected);
    }
}

#[test]
fn ranges_are_never_empty_and_spikes_do_not_fill_them() {
    assert_eq!(Range::default().span(0.1), (0.0, 1.0));
    let (low, high) = Range::of([3.0, 3.0]).span(0.1);
    assert!(low < 3.0 && high > 3.0);
    let spiked = (0..1000).map(|k| if k == 500 { 1e6 } else { f64::from(k % 10) });
    assert_eq!(Range::of_most(spiked).span(0.0), (0.0, 13.5));
    let record = Range::of([0.0, 1.0]);
    assert_eq!(
        Range::of([-50.0, 0.5]).within(&record, 0.5).span(0.0),
        (-0.5, 0.5)
    );
}
