//! Operation counts of everything that can be generated.

use pid_derive::Equations;
use pid_derive::model::{Emit, Robot};
use pid_symbolic::{Cost, Graph, Id};

/// A table of outputs, entries and operations; derivatives and regressor also where the declaration
/// does not ask for them.
pub(crate) fn table(g: &mut Graph, robot: &Robot, equations: &Equations) -> String {
    let everything = Emit {
        first_derivatives: true,
        second_derivatives: true,
        ..robot.emit
    };
    let derivatives = pid_derive::derivatives(g, equations, everything);
    let jacobian: Vec<Id> = equations
        .residual
        .iter()
        .copied()
        .chain(derivatives.jacobian.iter().map(|entry| entry.value))
        .collect();
    let hessian: Vec<Id> = derivatives
        .hessian
        .iter()
        .map(|entry| entry.value)
        .collect();
    let energies = equations.energies;
    let mut rows: Vec<(&str, Vec<Id>)> = vec![
        ("r", equations.residual.clone()),
        ("M", equations.mass_matrix.clone()),
        ("b", equations.bias.clone()),
        ("b at v = 0", equations.gravity.clone()),
        ("f_L", equations.applied_force.clone()),
        ("T", vec![energies.kinetic]),
        ("U", vec![energies.potential]),
        ("r and dr/dz", jacobian),
        ("d2(lambda r)/dz2", hessian),
    ];
    if let Ok(regressor) = pid_derive::regressor(g, equations) {
        let values = regressor.entries.iter().map(|entry| entry.value);
        rows.push((
            "r0 and Y",
            regressor.offset.iter().copied().chain(values).collect(),
        ));
    }
    let mut text = format!("{:<18} {:>7}  operations\n", robot.name, "values");
    for (name, outputs) in rows {
        text += &format!(
            "{name:<18} {:>7}  {}\n",
            outputs.len(),
            Cost::of(g, &outputs)
        );
    }
    text
}
