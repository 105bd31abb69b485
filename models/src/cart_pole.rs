//! Pole on a cart, given by its Lagrangian.
//!
//! Source: A. Barto, R. Sutton, C. Anderson, *Neuronlike adaptive elements that can solve difficult
//! learning control problems*, IEEE Transactions on Systems, Man, and Cybernetics, 1983: cart of 1
//! kg, uniform pole of 0.1 kg and half length 0.5 m. With the moment of inertia `m l²/3` of the
//! pole about its centre and θ from the upright pole,
//!
//! ```text
//! L = ½ (M + m) ẋ² + m l ẋ θ̇ cos θ + ½ (4/3) m l² θ̇² − m g l cos θ
//! ```
//!
//! (R. Florian, *Correct equations for the dynamics of the cart-pole system*, 2007). Friction is
//! viscous here on both coordinates, with nominal values of the size that paper has for dry
//! friction.

use pid_runtime::robot;

robot! {
    /// Pole on a cart that is pushed along a rail.
    pub robot CartPole {
        params {
            /// Mass of the cart.
            cart: kg = 1.0 in 0.1..=10.0;
            /// Mass of the pole.
            pole: kg = 0.1 in 0.01..=2.0;
            /// Half length of the pole.
            half: m = 0.5 in 0.1..=2.0;
            /// Acceleration of free fall.
            g: m/s^2 = 9.81 fixed;
            /// Friction of the wheels.
            rolling: N*s/m = 5e-4 in 0.0..=5.0;
            /// Friction of the hinge.
            hinge: N*m*s/rad = 2e-6 in 0.0..=0.5;
        }

        coordinates
            /// Position of the cart.
            x: m in -2.4..=2.4,
            /// Angle of the pole, 0 upright.
            theta: rad;

        lagrangian = 0.5*(cart + pole)*v.x^2 + pole*half*v.x*v.theta*cos(theta)
            + 2/3*pole*half^2*v.theta^2 - pole*g*half*cos(theta);

        /// Force on the cart.
        input push: N;

        force on x = push - rolling*v;
        force on theta = -hinge*v;

        emit { dynamics, first_derivatives, second_derivatives }
    }
}
