//! A four-axis SCARA robot with the kinematics of the Adept Cobra 600: two parallel vertical axes,
//! a quill that moves down, a flange that turns.
//!
//! Source of the kinematics: P. Corke, *Robotics, Vision and Control*, Springer 2011, and its model
//! `mdl_cobra600` (Denavit-Hartenberg: a₁ = 0.325 m, a₂ = 0.275 m, d₁ = 0.387 m, α₂ = π; travel of
//! the quill 0.210 m). The manufacturer publishes no inertial values: nominal masses and inertias
//! are those of homogeneous rods and cylinders of these lengths, friction of the size usual for
//! such drives. The spline nut that couples quill and flange is left out.
//!
//! The third coordinate is a length, positive downwards.

use pid_runtime::robot;

robot! {
    /// Four-axis SCARA with the kinematics of the Adept Cobra 600.
    pub robot Scara {
        gravity: [0, 0, -9.81] m/s^2;

        params {
            /// Inertia of the inner link about the first axis.
            iz1: kg*m^2 = 0.45 in 0.01..=5.0;
            /// Mass of the outer link.
            m2: kg = 8.0 in 0.5..=40.0;
            /// Centre of mass of the outer link, along it.
            sx2: m = 0.14 in -0.1..=0.4;
            /// Centre of mass of the outer link, across it.
            sy2: m = 0.01 in -0.1..=0.1;
            /// Inertia of the outer link about its centre of mass.
            iz2: kg*m^2 = 0.09 in 0.005..=1.0;
            /// Mass of the quill.
            m3: kg = 1.5 in 0.1..=10.0;
            /// Mass of flange and gripper.
            m4: kg = 0.8 in 0.05..=10.0;
            /// Centre of mass of flange and gripper.
            sx4: m = 0.012 in -0.1..=0.1;
            /// Centre of mass of flange and gripper.
            sy4: m = -0.004 in -0.1..=0.1;
            /// Inertia of flange and gripper about their centre of mass.
            iz4: kg*m^2 = 0.002 in 0.0001..=0.1;
        }

        link inner  { inertia at origin: diag(_, _, iz1); }
        link outer  { mass: m2; com: [sx2, sy2, _]; inertia at com: diag(_, _, iz2); }
        link quill  { mass: m3; }
        link flange { mass: m4; com: [sx4, sy4, _]; inertia at com: diag(_, _, iz4); }

        joint j1: revolute about z   { base -> inner at [0, 0, 0.387] m; limits: -1.83..=1.83 rad; }
        joint j2: revolute about z   { inner -> outer at [0.325, 0, 0] m; limits: -2.44..=2.44 rad; }
        joint j3: prismatic along z  { outer -> quill at [0.275, 0, 0] m rpy [pi, 0, 0] rad; limits: 0..=0.21 m; }
        joint j4: revolute about z   { quill -> flange; limits: -2*pi..=2*pi rad; }

        per joint j1, j2, j4 {
            /// Torque of the drive at the joint.
            input torque: N*m;
            /// Dry friction.
            dry: N*m = [3.0, 2.0, 0.2] in 0.0..=30.0;
            /// Viscous friction.
            viscous: N*m*s/rad = [2.0, 1.0, 0.05] in 0.0..=30.0;
            /// Inertia of the rotor at the joint.
            rotor: kg*m^2 = [0.3, 0.1, 0.005] in 0.0..=5.0;

            armature = rotor;
            force = torque - viscous*v - dry*tanh(v/(0.02 rad/s));
        }

        per joint j3 {
            /// Force of the drive along the quill.
            input push: N;
            /// Dry friction.
            dry: N = 8.0 in 0.0..=100.0;
            /// Viscous friction.
            viscous: N*s/m = 40.0 in 0.0..=500.0;
            /// Mass of screw and rotor at the quill.
            rotor: kg = 3.0 in 0.0..=50.0;

            armature = rotor;
            force = push - viscous*v - dry*tanh(v/(0.005 m/s));
        }

        emit { dynamics, first_derivatives, second_derivatives, lanes }
        expect rank 19;
    }
}
