//! Inertias that a file does not state, guessed: from geometry, from a mass, from the other links.

use pid_urdf::{Description, Guess, Missing, Reading, UrdfError};

#[path = "common/arm.rs"]
mod common_arm;
use common_arm::{BODY, GRAVITY, arm, close, read};

#[test]
fn geometry_is_filled() {
    let filled = |geometry: &str| {
        let link =
            format!("<visual><origin xyz=\"0 0 0.5\"/><geometry>{geometry}</geometry></visual>");
        let mut guess = Guess::default();
        guess.density = 500.0;
        let mut reading = Reading::default();
        reading.missing = Missing::Guess(guess);
        Description::parse_with("a.urdf", &arm(&link, ""), &reading)
            .map(|d| d.mechanism(GRAVITY).bodies[0].clone())
    };
    let pi = std::f64::consts::PI;
    let cylinder = filled("<cylinder radius=\"0.1\" length=\"0.6\"/>").expect("a cylinder");
    let m = 500.0 * pi * 0.01 * 0.6;
    close(&[cylinder.mass], &[m]);
    close(&cylinder.com, &[0.0, 0.0, 0.5]);
    close(
        &cylinder.inertia[1..3],
        &[m * (0.03 + 0.36) / 12.0, 0.5 * m * 0.01],
    );
    let sphere = filled("<sphere radius=\"0.1\"/>").expect("a sphere");
    close(
        &[sphere.inertia[0]],
        &[0.4 * 0.01 * 500.0 * 4.0 / 3.0 * pi * 1e-3],
    );
    // A mesh that is not there, or of a format without a simple box: refused for the link.
    for mesh in [
        "<mesh filename=\"package://a/nowhere.stl\"/>",
        "<mesh filename=\"arm.dae\"/>",
    ] {
        assert!(matches!(filled(mesh), Err(UrdfError::NoInertia { .. })));
    }
}

/// A path that lost its beginning: the one file below `meshes` that it ends is read, of two none.
#[test]
fn a_mesh_whose_path_lost_its_beginning_is_found() {
    let package = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("moved_meshes");
    let _ = std::fs::remove_dir_all(&package);
    let mesh = |folder: &str, side: f64| {
        let folder = package.join("meshes").join(folder);
        std::fs::create_dir_all(&folder).expect("a folder");
        let text = format!("v 0 0 0\nv {side} {side} {side}\n");
        std::fs::write(folder.join("arm.obj"), text).expect("a mesh");
    };
    mesh("b/collision", 0.1);
    mesh("b/visual", 0.2);
    std::fs::create_dir_all(package.join("urdf")).expect("a folder");
    let file = package.join("urdf").join("b.urdf");
    let link = "<collision><geometry><mesh filename=\"package://collision/arm.obj\"/></geometry></collision>";
    let mut reading = Reading::default();
    reading.missing = Missing::Guess(Guess::default());
    let parsed = || Description::parse_with(&file, &arm(link, ""), &reading);
    let description = parsed().expect("guessed");
    close(&[description.mechanism(GRAVITY).bodies[0].mass], &[1.0]);
    assert!(
        (description.warnings.iter())
            .any(|w| w.contains("`package://collision/arm.obj` leads nowhere")),
        "{:?}",
        description.warnings
    );
    mesh("c/collision", 0.3);
    assert!(matches!(parsed(), Err(UrdfError::NoInertia { .. })));
}

#[test]
fn a_mass_stands_in_for_geometry() {
    let text = arm("", "").replace(
        "</robot>",
        "<link name=\"hand\"/><joint name=\"j2\" type=\"revolute\"><parent link=\"arm\"/><child link=\"hand\"/>\
         <origin xyz=\"0 0.3 0.4\"/></joint></robot>",
    );
    let mut guess = Guess::default();
    guess.otherwise = Some(2.0);
    let mut reading = Reading::default();
    reading.missing = Missing::Guess(guess);
    let description = Description::parse_with("a.urdf", &text, &reading).expect("guessed");
    let bodies = description.mechanism(GRAVITY).bodies;
    assert_eq!((bodies[0].mass, bodies[1].mass), (2.0, 2.0));
    // A rod of 0.5 m and 2 litres along (0, 3, 4)/5.
    close(&bodies[0].com, &[0.0, 0.15, 0.2]);
    let radius = (0.002 / (std::f64::consts::PI * 0.5)).sqrt();
    let (across, along) = (2.0 * (3.0 * radius * radius + 0.25) / 12.0, radius * radius);
    close(&[bodies[0].inertia[0]], &[across]);
    close(&[bodies[0].inertia[5]], &[-0.48 * (across - along)]);
    let sphere = (0.002_f64 * 0.75 / std::f64::consts::PI).powf(2.0 / 3.0);
    close(&[bodies[1].inertia[2]], &[0.4 * 2.0 * sphere]);
    assert!(
        description
            .warnings
            .iter()
            .any(|w| w.contains("2.0000 kg is taken as a rod of 0.500 m"))
    );
}

/// A finger of which the file says nothing gets 0.5 % of the mass of the others when inertias are guessed; a
/// robot without any mass or geometry is still refused.
#[test]
fn a_link_of_which_nothing_is_known_is_light() {
    let finger = "<link name=\"finger\"/><joint name=\"grip\" type=\"prismatic\"><parent link=\"arm\"/><child link=\"finger\"/>\
                  <limit lower=\"0\" upper=\"0.04\"/></joint></robot>";
    let mut reading = Reading::default();
    reading.missing = Missing::Guess(Guess::default());
    let text = arm(BODY, "").replace("</robot>", finger);
    let description = Description::parse_with("a.urdf", &text, &reading).expect("guessed");
    let bodies = description.mechanism(GRAVITY).bodies;
    close(&[bodies[1].mass], &[0.005 * bodies[0].mass]);
    assert!(
        description
            .warnings
            .iter()
            .any(|w| w.contains("link `finger` has no inertia") && w.contains("as a sphere"))
    );
    let bare = arm("", "").replace("</robot>", finger);
    assert!(Description::parse_with("a.urdf", &bare, &reading).is_err());
}

/// Both links of a body that was guessed are written, the one without parameters too.
#[test]
fn guessed_parts_are_written() {
    let shape = "<collision><geometry><sphere radius=\"0.1\"/></geometry></collision>";
    let text = arm(shape, "").replace(
        "</robot>",
        &format!(
            "<link name=\"cap\">{shape}</link><joint name=\"f\" type=\"fixed\"><parent link=\"arm\"/><child link=\"cap\"/>\
             <origin xyz=\"0 0 0.3\"/></joint></robot>"
        ),
    );
    let mut reading = Reading::default();
    reading.missing = Missing::Guess(Guess::default());
    let description = Description::parse_with("a.urdf", &text, &reading).expect("guessed");
    let robot = pid_urdf::robot(&description, &Default::default()).expect("a robot");
    let value = |name: &str| {
        robot
            .params
            .iter()
            .find(|p| p.name == name)
            .map(|p| p.nominal)
    };
    let written = pid_urdf::write(&description, &Default::default(), value);
    let again = read(&written.text).mechanism(GRAVITY).bodies.remove(0);
    let ball = 4.0 / 3.0 * std::f64::consts::PI;
    close(&[again.mass, again.com[2]], &[2.0 * ball, 0.15]);
}

/// What was guessed gets an element of its own in the written text, in both forms of an empty link.
#[test]
fn guessed_inertias_are_written() {
    for link in [
        "<link name=\"arm\"/>",
        "<link name=\"arm\"></link>",
        "<link name=\"arm\">\n</link>",
    ] {
        let text = arm("", "").replace("<link name=\"arm\"></link>", link);
        let mut guess = Guess::default();
        guess.otherwise = Some(2.0);
        let mut reading = Reading::default();
        reading.missing = Missing::Guess(guess);
        let description = Description::parse_with("a.urdf", &text, &reading).expect("guessed");
        let options = Default::default();
        let robot = pid_urdf::robot(&description, &options).expect("a robot");
        let value = |name: &str| {
            robot
                .params
                .iter()
                .find(|p| p.name == name)
                .map(|p| p.nominal)
        };
        let written = pid_urdf::write(&description, &options, value);
        assert_eq!(written.lost, []);
        let again = read(&written.text).mechanism(GRAVITY).bodies.remove(0);
        let guessed = description.mechanism(GRAVITY).bodies.remove(0);
        assert_eq!((again.mass, again.com), (guessed.mass, guessed.com));
        close(&again.inertia, &guessed.inertia);
    }
}
