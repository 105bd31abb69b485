use pid_runtime::robot;

robot! {
    pub robot Arm {
        gravity: [0, 0, -9.81] m/s^2;
        link upper { inertial: solid cylinder { mass: 2 kg; radius: 30 mm; axis: z; } }
        link fore { mass: 1 kg; com: [0, 0, 0.1] m; }
        joint shoulder: revolute about y { base -> upper; }
        joint elbow: revolute about y { upper -> fore; follows; }
        motor wrist shoulder { drive: torque; }
        per joint { drive: curent { gain: 1 N*m/A; } }
        potential = 1 J;
        limit ops;
        emit { dynamics, regresor }
        variant Held { lock elbow 0 rad; }
    }
}

fn main() {}
