// Not in it, as it is no force law: `joint_elasticity` of `wrist`, compliance = 0.01 rad/(N*m), damping_time = 0.002 s.
use simtrue::robot;

robot! {
    /// `Wrist` with the values and effects of a diagnosis.
    #[allow(deprecated)]
    pub robot WristExtended {
        params {
            m: kg = 0.8 in 0.78..=0.8200000000000001;
            /// Coulomb friction.
            coulomb_bend: N*m = 0.1000000000349246 in 0.05999999993946403..=0.14000000013038516;
            /// Viscous friction.
            viscous_bend: N*m*s/rad = 0.19999999999999998 in 0.11999999999999991..=0.28;
            /// Force or torque at the joint per unit of the input.
            gain_bend: N*m/A = 2.0 in 1.98..=2.02;
            /// Sharpness of the transition of Coulomb friction at rest.
            sharp_bend: s/rad = 39.99999997466669 fixed;
            /// Coulomb friction.
            coulomb_wrist: N*m = 0.0500000000174623 in 0.029999999969732016..=0.07000000006519258;
            /// Viscous friction.
            viscous_wrist: N*m*s/rad = 0.09999999999999999 in 0.059999999999999956..=0.14;
            /// Force or torque at the joint per unit of the input.
            gain_wrist: N*m/A = 1.0 in 0.99..=1.01;
            /// Sharpness of the transition of Coulomb friction at rest.
            sharp_wrist: s/rad = 39.99999997466669 fixed;
        }
        gravity: [0.0, 0.0, -9.81] m/s^2;
        link upper { mass: m; com: [0.0, 0.0, -0.1] m; inertia at com: diag(_, 0.006 kg*m^2, _); }
        link hand { mass: m; com: [0.0, 0.0, -0.08] m; inertia at com: diag(_, 0.004 kg*m^2, _); }
        joint bend: revolute about y { base -> upper; }
        joint tip: revolute about y { upper -> hand at [0.0, 0.0, -0.2] m; }
        per joint bend {
            input u: A;
            armature = 0.01 kg*m^2;
            force = gain_bend*u_bend - viscous_bend*v.bend - coulomb_bend*tanh(sharp_bend*v.bend);
        }
        motor wrist: bend + tip {
            input u: A;
            armature = 0.005 kg*m^2;
            force = gain_wrist*u_wrist - viscous_wrist*(v.bend + v.tip) - coulomb_wrist*tanh(sharp_wrist*(v.bend + v.tip));
        }
        params {
            /// A spring at the joint (stiffness).
            spring_stiffness_wrist: N*m/rad = 0.5 in 0.0..=3.0;
            /// A spring at the joint (preload).
            spring_preload_wrist: N*m = -0.2 in -1.2..=0.8;
        }
        force on wrist = spring_preload_wrist - spring_stiffness_wrist*q.wrist;
        params {
            /// Friction rises towards standstill (excess).
            stribeck_excess_wrist: 1 = 0.4 in 0.0..=2.4;
            /// Friction rises towards standstill (stribeck_velocity).
            stribeck_stribeck_velocity_wrist: rad/s = 0.3 in 0.03..=3.0;
        }
        force on wrist = -coulomb_wrist*stribeck_excess_wrist*exp(-(v.wrist/stribeck_stribeck_velocity_wrist)^2)*tanh(v.wrist/(0.02500000001596665 rad/s));
        emit { dynamics, first_derivatives, second_derivatives }
    }
}
