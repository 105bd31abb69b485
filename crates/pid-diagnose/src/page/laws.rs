//! Laws without a name on the page.

use maud::{Markup, html};
use pid_page::figure;
use pid_page::number::short;

use super::{axis_name, effect, unit};
use crate::diagnosis::{Diagnosis, Nameless, OwnLaw};
use crate::free::Form;
use crate::locate::Axis;
use crate::plot;
use crate::report::Report;

/// The law without a name that describes the records better than any effect.
pub(super) fn law(d: &Diagnosis) -> Option<&Nameless> {
    d.remainder.as_ref()?.nameless.as_ref()
}

/// A cause without a name.
pub(super) fn nameless(report: &Report, law: &Nameless) -> Markup {
    let j = law.joint - 1;
    let name = &report.evidence.case.nominal.joints[j].name;
    let (what, shape, names) = match law.form {
        Form::ForceOverPosition => (
            format!("a force that depends on the position of joint {name} alone"),
            "a stop shows as a kink, a hard point as a hill",
            (
                axis_name(report, j, Axis::Position),
                ("force", unit(report, j)),
            ),
        ),
        Form::GainOverTime => (
            format!("a gain of the drive of joint {name} that depends on the time alone"),
            "a supply that sags and magnets that warm up fade",
            (
                ("time since the start of the record", "s"),
                ("relative change of the gain", "1"),
            ),
        ),
    };
    html! {
        h2 { "A cause without a name" }
        p {
            "In place of all effects, " (what) " explains " (format!("{:.0} %", 100.0 * law.explained))
            " of the squared gap beyond the floor on motions that were never fitted, and describes the records better than the "
            "named effects, its number of parameters counted. Its shape is free: " (shape) "."
        }
        div.single {
            (figure(
                &plot::free_law(law, name, names.0, names.1),
                name,
                "straight between the marks, with a band of two standard deviations where the records determine it",
            ))
        }
    }
}

/// The law of its own beside the named effects.
pub(super) fn its_law(d: &Diagnosis) -> Option<&OwnLaw> {
    d.remainder.as_ref()?.law.as_ref()
}

/// A law of its own beside the named effects, term by term.
pub(super) fn own_law(d: &Diagnosis, law: &OwnLaw) -> Markup {
    let hull = |(low, high): (f64, f64)| format!("{} to {}", short(low), short(high));
    html! {
        h2 { "A law of its own for what is left" }
        p {
            "No effect of the library describes what the named ones leave. The terms below do, within the motions of the "
            "train records: they remove " (format!("{:.0} %", 100.0 * law.share)) " of the squared gap beyond the floor on motions that were never fitted (gap "
            (short(law.gap_without)) " without them). They say what the records show, and not what causes it. "
            span class="equation" { "extended.toml" } " states them as effects."
        }
        @for term in &law.terms { (effect(d, term)) }
        div.scroll { table {
            thead { tr { th { "joint" } th.num { "position, rad or m" } th.num { "velocity, rad/s or m/s" } } }
            @for e in &law.earned {
                tr {
                    td { (e.joint) }
                    td class="num" { (hull(e.position)) }
                    td class="num" { (hull(e.velocity)) }
                }
            }
        } }
    }
}
