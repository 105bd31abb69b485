//! The studies of the project.

use std::process::ExitCode;

use clap::{Args, Parser, Subcommand};
use pid_studies::{
    Failure, build_budget, constrained, coverage, dynamics_speed, faults, fleet, hock_schittkowski,
    net, paper, robot_files, scaling, seed_study, servo, shooting_study, untidy, withheld,
};

/// Studies of the project; none is needed to use it.
#[derive(Debug, Parser)]
#[command(name = "pid-studies", version)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
#[allow(clippy::large_enum_variant, reason = "one value, parsed once")]
enum Command {
    /// Measure the diagnosis on drawn cases whose effect is withheld.
    Withheld(withheld::WithheldArgs),
    /// Measure the diagnosis on drawn cases with several effects and untidy records.
    Untidy(untidy::UntidyArgs),
    /// Measure the diagnosis on drawn cases behind position loops, with targets and positions alone.
    Servo(servo::ServoArgs),
    /// Measure what each number of the criteria decides.
    Criteria(withheld::criteria::CriteriaArgs),
    /// Measure what the statistics of the diagnosis are where nothing is missing.
    Null(Words),
    /// Reproduce the study of the paper on the idealised two-link robot: tables, figures, and its
    /// open questions.
    Paper(paper::PaperArgs),
    /// Measure by simulation how often the 95 % intervals of identifications hold the truth.
    Coverage(coverage::CoverageArgs),
    /// Plant faults into drawn records and count what the preflight finds.
    Faults(faults::FaultsArgs),
    /// Draw logs of a fleet in which a few units differ or change.
    FleetLogs(fleet::FleetLogsArgs),
    /// Score what `simtrue fleet` found of such logs.
    FleetScore(fleet::FleetScoreArgs),
    /// Solve the Hock-Schittkowski collection.
    HockSchittkowski(Words),
    /// Read every URDF and MJCF below a folder, and tell what is refused and why.
    RobotFiles(robot_files::RobotFilesArgs),
    /// Measure how time and memory of an identification grow with the record.
    Scaling(Words),
    /// Identify the two-link robot from every start of a table.
    SeedStudy(Words),
    /// Compare numbers of shooting nodes over the starts of a table.
    ShootingStudy(Words),
    /// Measure what constraints of the user cost.
    Constrained(Words),
    /// Measure the time of one evaluation of the six-axis arm.
    DynamicsSpeed(Words),
    /// Record results bit for bit, and compare those of a later build with them.
    Net(Words),
    /// Measure what a robot costs to build.
    BuildBudget(Words),
}

/// Words that the study reads itself; the head of its file describes them.
#[derive(Debug, Clone, Args)]
struct Words {
    #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
    words: Vec<String>,
}

fn main() -> ExitCode {
    // The net runs the front command in a child process.
    if let Some(code) = net::as_command() {
        return code;
    }
    let done = |outcome: Result<(), Failure>| outcome.map(|()| 0);
    let outcome = match Cli::parse().command {
        Command::Withheld(args) => withheld::run(&args),
        Command::Untidy(args) => untidy::run(&args),
        Command::Servo(args) => servo::run(&args),
        Command::Criteria(args) => withheld::criteria::run(&args),
        Command::Null(args) => done(withheld::null::run(&args.words)),
        Command::Paper(args) => paper::run(&args),
        Command::Coverage(args) => coverage::run(&args),
        Command::Faults(args) => done(faults::run(&args)),
        Command::FleetLogs(args) => done(fleet::make(&args)),
        Command::FleetScore(args) => done(fleet::judge(&args)),
        Command::HockSchittkowski(args) => done(hock_schittkowski::command::run(&args.words)),
        Command::RobotFiles(args) => done(robot_files::run(&args)),
        Command::Scaling(args) => done(scaling::run(&args.words)),
        Command::SeedStudy(args) => done(seed_study::run(&args.words)),
        Command::ShootingStudy(args) => done(shooting_study::run(&args.words)),
        Command::Constrained(args) => done(constrained::run(&args.words)),
        Command::DynamicsSpeed(args) => {
            dynamics_speed::run(&args.words);
            Ok(0)
        }
        Command::Net(args) => net::command::run(&args.words),
        Command::BuildBudget(args) => done(build_budget::run(&args.words)),
    };
    match outcome {
        Ok(code) => ExitCode::from(code),
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}
