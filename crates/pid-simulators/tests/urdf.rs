//! `robot.urdf`, read back; what it cannot express.

mod common;

use common::{described, effect, equations, in_order_of, same, state, tree};
use pid_interpret::nominal::{Nominal, Provenance};
use pid_simulators::{Options, Target, export};
use pid_symbolic::random::Random;
use pid_urdf::Description;

fn file(nominal: &Nominal, name: &str) -> String {
    let files =
        export(nominal, Target::Urdf, &Options::default()).unwrap_or_else(|e| panic!("{e}"));
    let found = files.into_iter().find(|f| f.name == name);
    found.unwrap_or_else(|| panic!("no {name}")).text
}

/// Mass matrix and bias survive the file, without rotors, which URDF has none of: trees of turning and
/// sliding joints with a joint that follows another, gravity of any direction in a level world.
#[test]
fn the_equations_survive_the_file() {
    let mut random = Random::new(7);
    for seed in 0..24 {
        let bodies = 1 + seed as usize % 6;
        let mechanism = tree(seed, bodies, bodies > 1 && seed % 3 == 0);
        let described = Nominal::of_mechanism(&mechanism, Provenance::Cad);
        let nominal = described.unwrap_or_else(|e| panic!("{e}")).nominal;
        let text = file(&nominal, "robot.urdf");
        let again =
            Description::parse("robot.urdf", &text).unwrap_or_else(|e| panic!("{e}\n{text}"));
        let size = mechanism.gravity.iter().map(|x| x * x).sum::<f64>().sqrt();
        let again = in_order_of(&again.mechanism([0.0, 0.0, -size]), &mechanism);
        assert_eq!(again.bodies.len(), bodies);
        for (body, own) in again.bodies.iter().zip(&mechanism.bodies) {
            assert_eq!((body.coulomb, body.viscous), (own.coulomb, own.viscous));
        }
        for _ in 0..5 {
            let [q, v] = state(&mut random, nominal.robot().nq());
            let expected = equations(nominal.robot(), false, &q, &v);
            same(
                &equations(&again.robot(), true, &q, &v),
                &expected,
                &format!("seed {seed}"),
            );
        }
    }
}

#[test]
fn what_urdf_cannot_say_is_listed() {
    let effects = [
        effect("torque_saturation", Some("j1"), &[("limit_input", 4.0)]),
        effect(
            "stribeck",
            Some("j2"),
            &[("excess", 0.5), ("stribeck_velocity", 0.03)],
        ),
    ];
    let nominal = described(&effects.concat());
    let (text, list) = (
        file(&nominal, "robot.urdf"),
        file(&nominal, "not_expressed.md"),
    );
    assert!(
        text.contains(r#"<limit effort="12" velocity="1000"/>"#),
        "{text}"
    );
    for line in [
        "| torque_saturation | j1 | effort of the joint's limit |",
        "| stribeck | j2 | nothing: URDF has no element for it |",
        "| rotor inertia | j3 | nothing: 1.000000e-1 kg m^2 or kg",
        "| gain of the drive | j1 | nothing: 3 N m or N per A",
    ] {
        assert!(list.contains(line), "{line}\n{list}");
    }
}

/// A URDF and BAM have no element for a position loop; gains that nobody knows are in no file.
#[test]
fn position_loops_are_told_to_be_left_out() {
    let list = |drive: &str, target: Target| {
        let nominal = described(drive);
        let files = export(&nominal, target, &Options::default()).unwrap_or_else(|e| panic!("{e}"));
        let list = files.into_iter().find(|f| f.name == "not_expressed.md");
        list.unwrap_or_else(|| panic!("no list")).text
    };
    for target in [Target::Urdf, Target::Bam] {
        let list = list("[drive]\nlaw = \"pd\"\nkp = 40.0\nkd = 1.0\n", target);
        let line = "Joint `j1`: its drive follows targets by a position loop of law \"pd\", for which there is no element here";
        assert!(list.contains(line), "{target:?}: {line}\n{list}");
    }
    let unknown = "[drive]\nlaw = \"pd\"\nkp = { unknown = true }\nkd = 1.0\n";
    for target in [Target::Mujoco, Target::IsaacLab, Target::Newton] {
        let list = list(unknown, target);
        let line = "Joint `j2`: its drive follows targets by a position loop whose kp nobody knows, so it is left out";
        assert!(list.contains(line), "{target:?}: {line}\n{list}");
    }
}
