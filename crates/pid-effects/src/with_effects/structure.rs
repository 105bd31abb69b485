//! Effects that change the masses of a described robot: a further body for each.

use pid_derive::model::{Expr, Inertial, Joint, JointKind, Link, Param, Robot, Tensor};

use super::Placed;
use crate::constants::{Constant, Constants};
use crate::nominal::Nominal;

/// The ten constants of a body: mass, first moment, inertia about its origin.
const TEN: usize = 10;
/// Relative departure from a straight line.
const STRAIGHT: f64 = 1e-12;

/// The robot of a description with those effects in it that add masses in proportion to their one
/// parameter, and the others.
///
/// Such an effect adds what a unit of its parameter adds as a body of its own, fixed to the one it
/// changes, times a parameter `EFFECT_PARAMETER`.
pub fn with_masses(nominal: &Nominal, placed: Vec<Placed>) -> (Robot, Vec<Placed>) {
    let mut robot = nominal.description.robot().clone();
    let rest = placed.into_iter().filter(|own| {
        let Some(bodies) = added(nominal, own) else {
            return true;
        };
        let param = Expr::Param(robot.params.len());
        robot.params.push(parameter(own));
        for (body, ten) in bodies {
            attach(&mut robot, body, &param, &ten);
        }
        false
    });
    let rest = rest.collect();
    (robot, rest)
}

/// Per body what a unit of the effect's one parameter adds; `None` for an effect that does anything else.
fn added(nominal: &Nominal, own: &Placed) -> Option<Vec<(usize, [f64; TEN])>> {
    if own.ranges.len() != 1 {
        return None;
    }
    let law = own.term.effect.plain();
    let bodies = nominal.description.robot().links.len();
    let read = |e: f64| -> (Vec<f64>, Vec<f64>) {
        let mut constants = Constants::<f64>::new(nominal, &vec![0.0; nominal.size()]);
        law.constants(&[e], own.term.joint, &mut constants);
        let others = (0..3).map(Constant::Gravity);
        let others = others.chain((0..nominal.n()).map(Constant::Rotor));
        let of_bodies = (0..bodies).flat_map(|b| {
            let moments = (0..3).map(move |i| Constant::Moment(b, i));
            let inertias = (0..6).map(move |i| Constant::Inertia(b, i));
            [Constant::Mass(b)]
                .into_iter()
                .chain(moments)
                .chain(inertias)
        });
        (
            of_bodies.map(|which| constants.get(which)).collect(),
            others.map(|which| constants.get(which)).collect(),
        )
    };
    let (zero, one, two) = (read(0.0), read(1.0), read(2.0));
    let straight = zero.0.iter().zip(&one.0).zip(&two.0).all(|((a, b), c)| {
        let bend = a + c - 2.0 * b;
        bend.abs() <= STRAIGHT * (a.abs() + b.abs() + c.abs())
    });
    if zero.1 != one.1 || zero.1 != two.1 || zero.0 == one.0 || !straight {
        return None;
    }
    let mut out = Vec::new();
    for (body, (a, b)) in (zero.0.chunks_exact(TEN).zip(one.0.chunks_exact(TEN))).enumerate() {
        let ten: [f64; TEN] = std::array::from_fn(|i| b[i] - a[i]);
        if ten != [0.0; TEN] {
            out.push((body, ten));
        }
    }
    Some(out)
}

fn parameter(own: &Placed) -> Param {
    let info = own.term.effect.info();
    let (nominal, lower, upper) = own.ranges[0];
    Param {
        name: format!("{}_{}", info.id, info.parameters[0].name),
        docs: vec![format!(" {}", info.title)],
        unit: own.units[0].clone(),
        nominal,
        lower,
        upper,
        fixed: false,
    }
}

/// Fixes a body of `param` times the ten constants to a link, frame on frame.
fn attach(robot: &mut Robot, link: usize, param: &Expr, ten: &[f64; TEN]) {
    let times = |i: usize| Expr::Mul(Box::new(Expr::Num(ten[i])), Box::new(param.clone()));
    let number = robot.links.len();
    robot.links.push(Link {
        name: format!("added_{number}"),
        docs: Vec::new(),
        inertial: Inertial::Linear {
            mass: times(0),
            first_moment: [1, 2, 3].map(times),
            inertia: Tensor::from([4, 5, 6, 7, 8, 9].map(times)),
        },
    });
    robot.order.push(robot.joints.len());
    let zero = || [0.0; 3].map(Expr::Num);
    robot.joints.push(Joint {
        name: format!("added_{number}"),
        docs: Vec::new(),
        kind: JointKind::Fixed,
        coord: None,
        follows: None,
        parent: Some(link),
        child: number,
        origin: zero(),
        rpy: zero(),
        limits: None,
        armature: None,
        force: None,
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effect::Term;
    use crate::effects::by_id;
    use pid_interpret::Model;
    use pid_runtime::dynamics::{At, Dynamics};

    #[test]
    fn a_payload_is_a_mass_at_the_tool() {
        let text = include_str!("arm.toml");
        let read = |text: &str| Nominal::parse(text, "arm.toml".as_ref()).expect("a robot");
        let nominal = read(text);
        let effect = by_id("payload").expect("an effect");
        let more = 0.4;
        let placed = Placed {
            term: Term { effect, joint: 0 },
            ranges: vec![(more, 0.0, 1.0)],
            units: vec!["kg".to_owned()],
        };
        let (robot, rest) = with_masses(&nominal, vec![placed]);
        assert!(rest.is_empty());
        // The same by hand: the elbow's link, 1 kg at −0.12 m, with 0.4 kg at −0.25 m.
        let (m, c, t) = (1.0, -0.12, -0.25);
        let com = (m * c + more * t) / (m + more);
        let inertia = 0.006 + m * (c - com) * (c - com) + more * (t - com) * (t - com);
        let heavier = text
            .replace("mass = 1.0\n", &format!("mass = {:?}\n", m + more))
            .replace(
                "com = [0.0, 0.0, -0.12]",
                &format!("com = [0.0, 0.0, {com:?}]"),
            )
            .replace(
                "inertia = [0.006, 0.006,",
                &format!("inertia = [{inertia:?}, {inertia:?},"),
            );
        let heavier = read(&heavier);
        let evaluate = |robot: &Robot| {
            let model = Model::new(robot).expect("equations");
            let p: Vec<f64> = model.params().iter().map(|p| p.nominal).collect();
            let at = At {
                q: &[0.4, -0.9],
                v: &[1.1, 0.7],
                a: &[-2.0, 3.0],
                u: &[0.3, 0.2],
                p: &p,
            };
            let mut r = [0.0; 2];
            model.residual(&at, &mut r);
            r
        };
        let (a, b) = (evaluate(&robot), evaluate(heavier.description.robot()));
        assert!(
            a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12),
            "{a:?} {b:?}"
        );
    }

    #[test]
    fn what_turns_gravity_is_no_mass() {
        let nominal = Nominal::parse(include_str!("arm.toml"), "arm.toml".as_ref());
        let effect = by_id("base_tilt").expect("an effect");
        let placed = Placed {
            term: Term { effect, joint: 0 },
            ranges: vec![(0.1, -0.6, 0.6); 2],
            units: vec!["rad".to_owned(); 2],
        };
        let (_, rest) = with_masses(&nominal.expect("a robot"), vec![placed]);
        assert_eq!(rest.len(), 1);
    }
}
