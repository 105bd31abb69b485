use clap::CommandFactory;

use pid_data::Horizon;
use pid_fit::transcribe::Scheme;

use super::identify::{HessianArg, HorizonArg, MethodArg};
use super::*;

#[test]
fn the_definition_is_consistent() {
    Cli::command().debug_assert();
}

#[test]
fn no_arguments_mean_identification_of_the_embedded_data() {
    let cli = Cli::try_parse_from(["simtrue"]).unwrap();
    assert!(cli.command.is_none());
    assert!(cli.identify.source.embedded());
    assert_eq!(cli.identify.horizon, None);
}

/// The factors have one option for logs and for data folders, under both of its names.
#[test]
fn gains_are_those_of_the_inputs() {
    for option in ["--gain", "--input-gain"] {
        let line = format!("simtrue simulate emps data {option} 2,3");
        let cli = Cli::try_parse_from(line.split(' ')).unwrap();
        let Some(Command::Simulate(args)) = cli.command else {
            panic!("{cli:?}")
        };
        assert_eq!(args.source.open.gain, [2.0, 3.0]);
        assert_eq!(args.source.open.stated_of_logs(), None);
    }
}

#[test]
fn options_are_read_and_refused() {
    let read = |a: &str| Cli::try_parse_from(a.split(' '));
    let cli = read("simtrue identify emps data --method equation-error --scheme euler --hessian gauss-newton --horizon 1s --starts 20 --tol 1e-6").unwrap();
    let Some(Command::Identify(a)) = cli.command else {
        panic!("{cli:?}")
    };
    assert_eq!(
        (a.method, a.scheme),
        (MethodArg::EquationError, Scheme::ExplicitEuler)
    );
    assert_eq!(
        (a.hessian, a.horizon),
        (
            HessianArg::GaussNewton,
            Some(HorizonArg::Stated(Horizon::Seconds(1.0)))
        )
    );
    assert_eq!((a.starts, a.tol), (Some(20), 1e-6));
    for bad in [
        "identify emps d --armature",
        "identify emps d --inertias fixed",
        "identify emps d --horizon soon",
        "--starts 0",
        "--tol -1",
        "identify emps d --scheme rk5",
        "identify emps d --substeps 0",
    ] {
        assert!(read(&format!("simtrue {bad}")).is_err(), "{bad}");
    }
}
