use pid_runtime::robot;

robot! {
    pub robot Arm {
        gravity: [0, 0, -9.81] m/s^2;
        link rod { mass: 1 kg; com: [0, 0, 0.2] m; }
        joint pivot: revolute about y { base -> rod; }
        motor drive: 2*pivot { drive: torque; dry: N*m = 0.5 in 0..=highest; force = -dry*tanh(20 s/rad*v); }
    }
}

fn main() {}
