//! Diagnoses folders without the command line: `cargo run --example probe -- FOLDER… OUT`.
#![allow(clippy::print_stdout)]
fn main() -> Result<(), Box<dyn std::error::Error>> {
    use pid_diagnose::{case::Case, diagnose};
    let mut arguments: Vec<String> = std::env::args().skip(1).collect();
    let out = arguments.pop().ok_or("FOLDER… OUT")?;
    for folder in arguments {
        let case = Case::read(folder.as_ref())?;
        let d = diagnose::diagnose(&case, &diagnose::Settings::default());
        println!(
            "{} {}:{:?} conf {:.2} gap {:.4} -> {:.4} floor {:.4} misfit {:.3} -> {:.3} {:.1} s {:?}",
            d.case,
            d.effect,
            d.joint,
            d.confidence,
            d.gap_before,
            d.gap_after,
            d.gap_floor,
            d.misfit.0,
            d.misfit.1,
            d.seconds,
            d.effects
                .iter()
                .map(|e| (
                    &e.effect,
                    e.joint,
                    e.parameters
                        .iter()
                        .map(|p| (p.name.as_str(), p.value, p.std))
                        .collect::<Vec<_>>()
                ))
                .collect::<Vec<_>>()
        );
        println!(
            "   {:?}",
            d.ranking
                .iter()
                .take(5)
                .map(|r| format!("{}:{:?} {:.0}", r.effect, r.joint, r.score))
                .collect::<Vec<_>>()
        );
        std::fs::write(
            std::path::Path::new(&out).join(format!("{}.json", d.case)),
            serde_json::to_string_pretty(&d)?,
        )?;
    }
    Ok(())
}
