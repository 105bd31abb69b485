//! Reads a URDF at run time: no declaration, the same equations and exact derivatives.
#![allow(clippy::print_stdout, reason = "an example prints what it found")]

use simtrue::dynamics::{At, Dynamics};
use simtrue::interpret::Model;
use simtrue::urdf::{Description, Options, robot};

const ARM: &str = r#"<robot name="arm">
  <link name="world"/>
  <link name="rod">
    <inertial>
      <origin xyz="0 0 -0.22"/>
      <mass value="1.5"/>
      <inertia ixx="0.021" ixy="0" ixz="0" iyy="0.021" iyz="0" izz="0.0004"/>
    </inertial>
  </link>
  <joint name="hinge" type="continuous">
    <parent link="world"/>
    <child link="rod"/>
    <axis xyz="0 1 0"/>
  </joint>
</robot>"#;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let description = Description::parse("arm.urdf", ARM)?;
    let model = Model::new(&robot(&description, &Options::default())?)?;
    let p: Vec<f64> = model.params().iter().map(|p| p.nominal).collect();
    let mut mass = [0.0];
    for q in [0.0, 1.0] {
        let at = At {
            q: &[q],
            v: &[0.0],
            a: &[0.0],
            u: &[0.0],
            p: &p,
        };
        model.mass_matrix(&at, &mut mass);
        let mut hold = [0.0];
        model.residual(&at, &mut hold);
        println!(
            "q = {q}: inertia {:.4} kg m^2, torque to hold {:.4} N m",
            mass[0], hold[0]
        );
    }
    Ok(())
}
