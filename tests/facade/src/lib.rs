//! `robot!` for a crate that depends on `simtrue` alone, under another name.
#![deny(warnings, rustdoc::broken_intra_doc_links)]

use front::robot;

robot! {
    /// A carriage on a rail.
    pub robot Carriage {
        gravity: [0, 0, -9.81] m/s^2;
        params {
            /// Moving mass.
            mass: kg = 95.0 in 10.0..=300.0;
        }
        link body { mass: mass; }
        joint x: prismatic along x { base -> body; }
        per joint { input force: N; force = force; }
        emit { second_derivatives, lanes, regressor, base_parameters }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_robot_is_a_model_of_the_facade() {
        let p = CarriageParams::nominal();
        let u = CarriageInputs { force_x: 190.0 };
        let a = Carriage::forward_dynamics(&[0.0], &[0.0], &u, &p).expect("a mass above zero");
        assert!((a[0] - 2.0).abs() < 1e-12);
        let model: &dyn front::dynamics::Hessian = &Carriage;
        assert_eq!(model.dims().np, 1);
    }
}
