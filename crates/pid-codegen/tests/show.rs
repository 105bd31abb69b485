//! Declarations in, equations, code and counts out.

use pid_codegen::show::Error;

const PENDULUM: &str = r#"
//! A file with other things in it.
use pid_runtime::robot;

robot! {
    /// A pendulum with a motor.
    pub robot Pendulum {
        gravity: [0, 0, -9.81] m/s^2;
        params {
            /// Mass of the bob.
            m: kg = 1.0 in 0.1..=5.0;
            l: m = 0.5 in 0.1..=1.0;
        }
        link rod { mass: m; com: [0, 0, -l]; }
        joint pivot: revolute about y { base -> rod; }
        per joint {
            input torque: N*m;
            viscous: N*m*s/rad = 0.1 in 0.0..=1.0;
            force = torque - viscous*v;
        }
    }
}

mod inner {
    pid_runtime::robot! {
        robot Cart {
            gravity: [0, 0, -9.81] m/s^2;
            params { mass: kg = 2.0 in 0.1..=9.0; }
            link body { mass: mass; }
            joint rail: prismatic along x { base -> body; }
            per joint { input push: N; force = push; }
            emit { dynamics, first_derivatives, regressor, base_parameters }
        }
    }
}
"#;

#[test]
fn every_robot_of_a_file() {
    let robots = pid_codegen::show::robots(PENDULUM).unwrap();
    let names: Vec<&str> = robots.iter().map(|robot| robot.name()).collect();
    assert_eq!(names, ["Pendulum", "Cart"]);
    assert_eq!(
        robots[0].text().unwrap(),
        "Pendulum: M(q, p) a + b(q, v, p) = f_L(q, v, p, u)\n\
         M[pivot, pivot] = m*l^2\n\
         b[pivot] = 9.81*m*l*sin(q.pivot)\n\
         f_L[pivot] = torque_pivot - viscous_pivot*v.pivot\n"
    );
    assert!(
        robots[0]
            .latex()
            .unwrap()
            .contains("9.81 \\, m \\, l \\, \\sin q_{\\mathrm{pivot}}")
    );
}

#[test]
fn code_is_formatted_and_counted() {
    let robots = pid_codegen::show::robots(PENDULUM).unwrap();
    let code = robots[1].code().unwrap();
    for line in [
        "struct Cart;",
        "    pub const BASE: [&'static str; 1usize] = [\"mass\"];",
        "        pub fn mass_matrix(",
    ] {
        assert!(code.contains(line), "{line} in\n{code}");
    }
    let counts = robots[0].counts().unwrap();
    assert!(
        counts.starts_with("Pendulum            values  operations\nr                        1  "),
        "{counts}"
    );
    assert_eq!(counts.lines().count(), 10);
}

#[test]
fn what_is_wrong_has_a_place() {
    let wrong = PENDULUM.replace("com: [0, 0, -l]", "com: [0, 0, -k]");
    let Err(Error::Refused { messages }) = pid_codegen::show::robots(&wrong) else {
        panic!("`k` is not declared");
    };
    assert!(
        messages[0].starts_with("14:42: ") && messages[0].contains("`k`"),
        "{messages:?}"
    );
    assert_eq!(
        pid_codegen::show::robots("fn main() {}").unwrap_err(),
        Error::NoRobot
    );
    assert!(matches!(
        pid_codegen::show::robots("fn main( {}"),
        Err(Error::Syntax { line: 1, .. })
    ));
}

#[test]
fn every_model_of_the_workspace() {
    let mut found = 0;
    for entry in std::fs::read_dir("../../models/src").expect("the models are beside this crate") {
        let source = std::fs::read_to_string(entry.unwrap().path()).unwrap();
        if !source.contains("robot! {\n") {
            continue;
        }
        for robot in pid_codegen::show::robots(&source).unwrap() {
            let lines = robot.counts().unwrap().lines().count();
            assert!(lines >= 10, "{}", robot.name());
            let text = robot.text().unwrap();
            assert!(text.starts_with(robot.name()) && text.contains("\nb["));
            let latex = robot.latex().unwrap();
            assert_eq!(
                latex.matches("\\begin{").count(),
                latex.matches("\\end{").count()
            );
            assert_eq!(latex.matches('{').count(), latex.matches('}').count());
            found += 1;
        }
    }
    assert!(found >= 7, "{found}");
}
