//! A hobby servo that swings a weight, fed by the voltage at its motor.
//!
//! Source: M. Duclusaud, G. Passault, V. Padois, O. Ly, *Extended Friction Models for the Physics
//! Simulation of Servo Actuators*, ICRA 2025, with the parameters of the servo XL330-M288-T in the
//! repository `Rhoban/bam` (model M1, July 2026): motor constant and rotor inertia as felt behind
//! the gear, resistance of the winding, dry and viscous friction. The arm is that of their test
//! bench, 0.49 kg at 0.10 m; angle 0 hangs straight down.

use pid_runtime::robot;

robot! {
    /// Servo XL330 with a weight on an arm, motor voltage as input.
    pub robot ServoPendulum {
        gravity: [0, 0, -9.81] m/s^2;

        params {
            /// Mass of the weight.
            m: kg = 0.49 in 0.05..=2.0;
            /// Its distance from the axis.
            l: m = 0.10 in 0.02..=0.5;
        }

        link arm { mass: m; com: [0, 0, -l]; }

        /// Output shaft of the servo.
        joint shaft: revolute about y { base -> arm; }

        per joint {
            /// Motor constant behind the gear: torque per ampere, and volts per rad/s.
            gain: N*m/A = 0.3867 in 0.05..=2.0;
            /// Resistance of the winding.
            resistance: Ohm = 4.017 in 0.5..=20.0;
            /// Inertia of rotor and gear.
            rotor: kg*m^2 = 0.001814 in 1e-5..=0.02;
            /// Dry friction.
            dry: N*m = 0.01283 in 0.0..=0.2;
            /// Viscous friction.
            viscous: N*m*s/rad = 0.003662 in 0.0..=0.1;
            /// Velocity at which dry friction is fully developed.
            slip: rad/s = 0.1 fixed;

            /// Voltage at the motor: duty cycle times supply voltage.
            drive: voltage { gain: gain; resistance: resistance; rotor: rotor; }
            force = -dry*tanh(v/slip) - viscous*v;
        }

        emit { dynamics, first_derivatives, second_derivatives }
        expect rank 4;
    }
}
